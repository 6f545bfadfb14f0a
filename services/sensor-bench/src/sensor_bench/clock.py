"""Two kinds of time: the host's, which is the truth of the bench, and a device's own, which drifts."""

import time
from typing import NamedTuple

POLAR_EPOCH_UNIX_NS = 946_684_800_000_000_000
"""2000-01-01T00:00:00Z, the zero of every Polar device clock, in Unix nanoseconds."""
UNSET_CLOCK_NS = 599_616_000_000_000_000
"""2019-01-01T00:00:00Z on the Polar time line: where an H10 that was never set starts counting."""


class HostClock:
    """The bench's true time: Unix ns, steady as it runs on the monotonic clock from one reading of the wall clock."""

    def __init__(self) -> None:
        self._wall_minus_monotonic_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        return time.monotonic_ns() + self._wall_minus_monotonic_ns

    def wall_offset_ns(self) -> int:
        """How far the wall clock has been stepped or slewed away from the bench's time since the start."""
        return time.time_ns() - self.now_ns()


class Segment(NamedTuple):
    """From `host_ns` on the device's clock reads `device_ns`, and gains `skew_ppm` on the host."""

    host_ns: int
    device_ns: int
    skew_ppm: float

    def read_ns(self, host_ns: int) -> int:
        elapsed_ns = host_ns - self.host_ns
        return self.device_ns + elapsed_ns + round(elapsed_ns * self.skew_ppm * 1e-6)


class DeviceClock:
    """A device's clock in ns since 2000-01-01: linear pieces, a new one for every change of skew and every reset."""

    def __init__(self, host_ns: int, device_ns: int = UNSET_CLOCK_NS, skew_ppm: float = 0.0) -> None:
        self.segments = [Segment(host_ns, device_ns, skew_ppm)]
        self.resets = 0

    def at(self, host_ns: int) -> Segment:
        """The piece that is valid at `host_ns`; the first one for times before the start."""
        return next((piece for piece in reversed(self.segments) if piece.host_ns <= host_ns), self.segments[0])

    def read_ns(self, host_ns: int) -> int:
        return self.at(host_ns).read_ns(host_ns)

    def set_skew(self, host_ns: int, skew_ppm: float) -> None:
        """Change the rate without a jump."""
        self.segments.append(Segment(host_ns, self.read_ns(host_ns), skew_ppm))

    def reset(self, host_ns: int, device_ns: int = UNSET_CLOCK_NS) -> None:
        """Jump, as a device does that lost its supply."""
        self.segments.append(Segment(host_ns, device_ns, self.at(host_ns).skew_ppm))
        self.resets += 1
