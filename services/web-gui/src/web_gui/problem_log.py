"""What is wrong, since when, and what is over. Pure."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from sense4hri.stamps import SECOND_NS

from web_gui.intake import LONGEST_SENTENCE, shown
from web_gui.rules import RULES

MOST_ENDED = 200


class Problem(NamedTuple):
    """One sentence.

    key: what it is about, the same as long as it lasts. severity: `error` or `warning`. alert: which of rules.RULES it
    breaks, or empty. stream: the one it belongs to, as `human_id/sensor_type/sensor_id`, or empty.
    """

    key: str
    text: str
    severity: str
    alert: str = ""
    stream: str = ""

    @classmethod
    def of(cls, alert: str, key: str, text: str, stream: str = "") -> "Problem":
        """Return what breaks a rule, as bad as that says."""
        return cls(key, text, RULES[alert].severity, alert, stream)

    @property
    def for_ns(self) -> int:
        """How long it must have lasted before it is told."""
        return round(RULES[self.alert].for_s * SECOND_NS) if self.alert else 0


class Entry(NamedTuple):
    """A problem with when it began and was over; ended_ns None = it lasts."""

    problem: Problem
    since_ns: int
    ended_ns: int | None


class ProblemLog:
    """Remembers since when a problem lasts, and those that are over. One that never was told is forgotten."""

    def __init__(self) -> None:
        self._lasting: dict[str, Entry] = {}
        self._told: set[str] = set()
        self._ended: deque[Entry] = deque(maxlen=MOST_ENDED)

    def update(self, problems: Iterable[Problem], now_ns: int) -> None:
        """Take the problems of this moment."""
        current = {one.key: one._replace(text=shown(one.text, LONGEST_SENTENCE)) for one in problems}
        for key in self._lasting.keys() - current.keys():
            entry = self._lasting.pop(key)
            if key in self._told:
                self._ended.append(entry._replace(ended_ns=now_ns))
        for key, problem in current.items():
            since_ns = self._lasting[key].since_ns if key in self._lasting else now_ns
            self._lasting[key] = Entry(problem, since_ns, None)
        due = {key for key, one in self._lasting.items() if now_ns - one.since_ns >= one.problem.for_ns}
        self._told = due | (self._told & self._lasting.keys())

    def lasting(self) -> list[Entry]:
        """Return what is wrong now, newest first."""
        told = [entry for key, entry in self._lasting.items() if key in self._told]
        return sorted(told, key=lambda entry: -entry.since_ns)

    def ended(self) -> list[Entry]:
        """Return what is over, newest first."""
        return sorted(self._ended, key=lambda entry: -(entry.ended_ns or 0))
