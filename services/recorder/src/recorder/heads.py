"""The messages that still hold (transient local): every file begins with them, so that each can be read alone."""

from __future__ import annotations

from sense4hri_recording.rosbag2 import Channel

from recorder.split import Entry

PER_PUBLISHER = 8
SETTLED_NS = 500_000_000
"""What is written next was not received longer ago: messages come topic by topic."""


class Heads:
    """The newest message of every state topic.

    The middleware does not say whose message one is: with several publishers the newest different ones are kept,
    8 for each publisher, in their order.
    """

    def __init__(self) -> None:
        self._kept: dict[Channel, dict[bytes, Entry]] = {}

    def keep(self, entry: Entry) -> None:
        """Note a message that may hold from now on."""
        if not entry.channel.state:
            return
        kept = self._kept.setdefault(entry.channel, {})
        kept.pop(entry.data, None)
        kept[entry.data] = entry
        publishers = entry.channel.publishers
        while len(kept) > (publishers * PER_PUBLISHER if publishers > 1 else 1):
            del kept[next(iter(kept))]

    def forget_gone(self) -> None:
        """Let go of what nobody publishes any more: it does not hold in a recording that begins now."""
        for channel in [channel for channel in self._kept if channel.gone]:
            del self._kept[channel]

    def at(self, begun_ns: int) -> list[Entry]:
        """What holds, to be written with number 0 at the head of a file that begins now.

        It stands before all that follows, for it held before; but not before its own receipt, unless that lies so far
        ahead that the host's clock was set back since.
        """
        first_ns, last_ns = begun_ns - SETTLED_NS, begun_ns + SETTLED_NS
        return [
            Entry(
                entry.channel,
                entry.data,
                entry.log_ns if first_ns < entry.log_ns < last_ns else first_ns,
                entry.publish_ns,
            )
            for kept in self._kept.values()
            for entry in kept.values()
        ]
