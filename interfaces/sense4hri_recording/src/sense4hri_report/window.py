"""The time over which a recording is judged, and how points of time are written."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any, NamedTuple

from sense4hri_report.rules import duration

Json = dict[str, Any]


class Window(NamedTuple):
    """What is judged, ROS time. begins, ends: the session says so itself; else it is only the recording's edge.

    continues: the session began in another folder, so that nothing in this one can begin late. away: times within that
    do not count, from and to, in order.
    """

    from_ns: int
    to_ns: int
    begins: bool
    ends: bool
    continues: bool = False
    away: tuple[tuple[int, int], ...] = ()

    def has(self, at_ns: int) -> bool:
        inside = self.from_ns <= at_ns <= self.to_ns
        return inside and not any(from_ns < at_ns < to_ns for from_ns, to_ns in self.away)

    def meets(self, one_ns: int, other_ns: int) -> bool:
        """True where a time between two may lie in here, in whichever order a clock that was set has put them."""
        return min(one_ns, other_ns) <= self.to_ns and max(one_ns, other_ns) >= self.from_ns

    def share(self, from_ns: int, to_ns: int) -> float:
        """How much of a time lies in here, 0..1."""
        if to_ns <= from_ns:
            return float(self.has(from_ns))
        inside_ns = _overlap(from_ns, to_ns, self.from_ns, self.to_ns)
        return (inside_ns - sum(_overlap(from_ns, to_ns, *away) for away in self.away)) / (to_ns - from_ns)

    def without(self, spans: Iterable[tuple[int, int]]) -> Window:
        """The same, less further times that do not count."""
        merged: list[tuple[int, int]] = []
        for from_ns, to_ns in sorted((*self.away, *spans)):
            from_ns, to_ns = max(from_ns, self.from_ns), min(to_ns, self.to_ns)
            if merged and from_ns <= merged[-1][1]:
                merged[-1] = (merged[-1][0], max(to_ns, merged[-1][1]))
            elif from_ns < to_ns:
                merged.append((from_ns, to_ns))
        return self._replace(away=tuple(merged))

    @property
    def seconds(self) -> float:
        away_ns = sum(to_ns - from_ns for from_ns, to_ns in self.away)
        return max(self.to_ns - self.from_ns - away_ns, 0) * 1e-9

    def at(self, at_ns: int) -> Json:
        """A time as report.json writes it."""
        return {"ros_ns": at_ns, "utc": utc(at_ns), "since_start_s": round((at_ns - self.from_ns) * 1e-9, 4)}


def _overlap(from_ns: int, to_ns: int, begin_ns: int, end_ns: int) -> int:
    return max(0, min(to_ns, end_ns) - max(from_ns, begin_ns))


def at(at_ns: int, window: Window) -> str:
    """`12.3 s after the start`, for sentences."""
    seconds = (at_ns - window.from_ns) * 1e-9
    where = "the session's start" if window.begins else "the beginning"
    return f"{duration(abs(seconds))} {'before' if seconds < 0 else 'after'} {where}"


def utc(at_ns: int) -> str:
    """ISO 8601 to the millisecond."""
    stamp = datetime.fromtimestamp(at_ns // 1_000_000_000, UTC)
    return f"{stamp:%Y-%m-%dT%H:%M:%S}.{at_ns % 1_000_000_000 // 1_000_000:03d}Z"
