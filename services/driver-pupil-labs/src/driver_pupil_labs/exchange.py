"""A device's clock measured both ways: asked several times, the quickest answer counts. Pure."""

from typing import NamedTuple

from sense4hri.device import ClockMeasurement
from sense4hri.stamps import SECOND_NS


class Asked(NamedTuple):
    """One exchange: host's monotonic clock at sending and at the answer, and the device's clock, all in ns."""

    sent_ns: int
    answered_ns: int
    device_ns: int

    @property
    def round_trip_ns(self) -> int:
        """Return how long it took."""
        return self.answered_ns - self.sent_ns


def best(exchanges: list[Asked], wall_ns: int, method: str, reading_ns: int = 0) -> ClockMeasurement:
    """Return what the exchange with the shortest round trip says; the truth lies within half of that and reading_ns.

    wall_ns: what the wall clock shows now beyond the monotonic one. A clock that was set meanwhile spoils none of them.
    reading_ns: by which the clock may be off as the device tells it.
    """
    shortest = min(exchanges, key=lambda each: each.round_trip_ns)
    middle_ns = wall_ns + shortest.sent_ns + shortest.round_trip_ns // 2
    half_s = (shortest.round_trip_ns / 2 + reading_ns) / SECOND_NS
    offset_ns = middle_ns - shortest.device_ns
    return ClockMeasurement(wall_ns + exchanges[-1].answered_ns, shortest.device_ns, offset_ns, half_s, method)
