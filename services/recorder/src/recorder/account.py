"""What became of the messages of one topic in one recording: how many are in it, and where some are missing."""

from __future__ import annotations

from collections import Counter
from typing import Any, NamedTuple

MIDDLEWARE, QUEUE, DISK = "middleware", "queue", "disk"
MOST_HOLES = 10_000  # of one topic; further ones widen the last, so that counts stay exact


class Hole(NamedTuple):
    """So many messages are missing between two, whose log times these are; at an end, of the recording."""

    after_ns: int
    before_ns: int
    messages: int
    cause: str

    def as_json(self) -> dict[str, Any]:
        """As in recorder.json."""
        return {
            "after_ns": self.after_ns,
            "before_ns": self.before_ns,
            "count": self.messages,
            "cause": self.cause,
        }


class Account:
    """Counts of one topic in one recording. opened_ns: when the recording began, on the host's clock."""

    def __init__(self, opened_ns: int) -> None:
        self.messages = self.missed = 0
        self.causes: Counter[str] = Counter()
        """Messages lost, by cause."""
        self._last_ns = opened_ns
        self._holes: list[Hole] = []
        self._open: dict[str, tuple[int, int]] = {}  # by cause: log time before it, count

    @property
    def lost(self) -> int:
        """Messages that are not in the recording, though they were sent while it was being written."""
        return self.causes.total()

    def lose(self, count: int, cause: str) -> None:
        """So many are missing after the last one written."""
        if count:
            self.causes[cause] += count
            after_ns, before = self._open.get(cause, (self._last_ns, 0))
            self._open[cause] = after_ns, before + count

    def write(self, log_ns: int) -> None:
        """A message is in the recording."""
        self.messages += 1
        if self._open:
            self._add(self.holes(log_ns)[len(self._holes) :])
            self._open.clear()
        self._last_ns = log_ns

    def withdraw(self, count: int, hole: Hole) -> None:
        """So many that were written are gone all the same, the file being so."""
        self.messages -= count
        self.causes[hole.cause] += count
        self._add([hole])

    def holes(self, now_ns: int) -> list[Hole]:
        """Every hole so far; one that has no message behind it yet ends now."""
        ending = [Hole(after_ns, now_ns, count, cause) for cause, (after_ns, count) in self._open.items()]
        return self._holes + ending

    def as_json(self, now_ns: int) -> dict[str, Any]:
        """The topic's part of recorder.json."""
        return {
            "messages": self.messages,
            "lost": self.lost,
            "missed_at_start": self.missed,
            "losses": [hole.as_json() for hole in self.holes(now_ns)],
        }

    def _add(self, holes: list[Hole]) -> None:
        for hole in holes:
            last = self._holes[-1] if self._holes else hole
            if len(self._holes) < MOST_HOLES or last.cause != hole.cause:
                self._holes.append(hole)
            else:
                self._holes[-1] = Hole(last.after_ns, hole.before_ns, last.messages + hole.messages, hole.cause)
