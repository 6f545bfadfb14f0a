"""What became of the messages of all topics in one recording."""

from __future__ import annotations

from collections import Counter
from typing import Any

from sense4hri_recording.rosbag2 import Channel

from recorder.account import DISK, MIDDLEWARE, QUEUE, Account, Hole
from recorder.split import Entry, Split

WHERE = {MIDDLEWARE: "on the way", QUEUE: "waiting in the recorder", DISK: "at the disk"}
MOST_NAMED = 3  # of the topics that lack messages, in one sentence; recorder.json has all of them


class Accounts:
    """messages: in the recording; payload_bytes: of them all that ever were; lost: sent, and not in it."""

    def __init__(self, opened_ns: int) -> None:
        self.messages = self.lost = self.payload_bytes = 0
        self._opened_ns = opened_ns
        self.by_channel: dict[Channel, Account] = {}

    def of(self, channel: Channel) -> Account:
        """The counts of a topic."""
        account = self.by_channel.get(channel)
        if account is None:
            account = self.by_channel[channel] = Account(self._opened_ns)
        return account

    def arrived(self, entry: Entry) -> None:
        """A message has come, with what is known to be missing before it."""
        self.of(entry.channel).missed += entry.missed
        self.lose(entry.channel, entry.lost, MIDDLEWARE)
        self.lose(entry.channel, entry.dropped, QUEUE)

    def written(self, entry: Entry) -> None:
        """It is in the recording."""
        self.of(entry.channel).write(entry.log_ns)
        self.messages += 1
        self.payload_bytes += len(entry.data)

    def lose(self, channel: Channel, count: int, cause: str) -> None:
        """So many are missing after the last one written."""
        self.of(channel).lose(count, cause)
        self.lost += count

    def withdraw(self, split: Split, counts: Counter[Channel]) -> None:
        """So many that were written to a file are not in it after all."""
        for channel, count in counts.items():
            self.of(channel).withdraw(count, Hole(split.first_ns, split.last_ns, count, DISK))
            self.messages -= count
            self.lost += count

    @property
    def missing(self) -> str:
        """What the recording lacks, in one sentence; empty where it lacks nothing."""
        of_streams = [account.causes for channel, account in self.by_channel.items() if not _newest_says_all(channel)]
        causes = sum(of_streams, Counter())
        lost = f"{causes.total()} messages lost ({', '.join(f'{n} {WHERE[c]}' for c, n in causes.items())})"
        return lost if causes else ""

    @property
    def lost_of(self) -> str:
        """Of which topics messages are lost, those with the most first; empty where none are. From any thread."""
        lost = [(account.lost, channel.topic) for channel, account in list(self.by_channel.items()) if account.lost]
        named = [f"{count} of {topic}" for count, topic in sorted(lost, reverse=True)[:MOST_NAMED]]
        others = len(lost) - len(named)
        return ", ".join([*named, *([f"the rest of {others} more"] if others else [])])

    def as_json(self, now_ns: int) -> list[dict[str, Any]]:
        """`topics` of recorder.json."""
        return [
            {"topic": channel.topic, "type": channel.type_name, **account.as_json(now_ns)}
            for channel, account in self.by_channel.items()
        ]


def _newest_says_all(channel: Channel) -> bool:
    """True where an older message tells nothing that a newer one does not: a state, or totals since the beginning."""
    return channel.state or channel.topic.endswith("/health")
