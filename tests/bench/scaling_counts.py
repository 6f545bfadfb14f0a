"""Whether every stream of a study came in real time: by the packets in its recording, each stream for itself."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from mcap.reader import make_reader

SECOND_NS = 1_000_000_000
LATE_NS = 60 * SECOND_NS  # the longest way of a packet from its driver to the recorder that is looked for


def packets(recordings: Path, begin_ns: int, end_ns: int) -> Counter[str]:
    """Return how many packets of every raw topic were received from begin_ns on and before end_ns, and recorded.

    When a packet was received its driver has stamped (`header.stamp`, ns); the way to the recorder does not count.
    """
    found: Counter[str] = Counter()
    for path in sorted(recordings.rglob("*.mcap")):
        with path.open("rb") as file:
            messages = make_reader(file).iter_messages(
                starting_at=begin_ns, ending_before=end_ns + LATE_NS, log_time_order=False
            )
            for _, channel, message in messages:
                if channel.topic.endswith("/raw") and begin_ns <= message.publish_time < end_ns:
                    found[channel.topic] += 1
    return found


def behind(found: Mapping[str, int], packets_per_s: Mapping[str, float], window_s: float) -> list[str]:
    """Return a sentence for every topic that has not its rate x window_s packets, give or take one, at an end of it."""
    return [
        f"{topic}: {found.get(topic, 0)} of {rate * window_s:.1f} packets"
        for topic, rate in sorted(packets_per_s.items())
        if abs(found.get(topic, 0) - rate * window_s) > 1
    ]
