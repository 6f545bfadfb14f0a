"""What the health of a driver says of its host's clock."""

from __future__ import annotations

from typing import NamedTuple

ANEW_NS = 10_000_000_000  # a monotonic clock that is so far back began again; accounts of several drivers overtake less


class HostAccount(NamedTuple):
    """The host's account of its clock: stamp in ROS time and CLOCK_REALTIME - CLOCK_MONOTONIC, ns."""

    stamp_ns: int
    realtime_minus_monotonic_ns: int

    @property
    def monotonic_ns(self) -> int:
        """CLOCK_MONOTONIC then, which begins with the host and which nobody sets."""
        return self.stamp_ns - self.realtime_minus_monotonic_ns

    def is_of_a_new_start(self, before: HostAccount) -> bool:
        """True where the host was started after `before`: what it says of its clock then tells of no step."""
        return self.monotonic_ns < before.monotonic_ns - ANEW_NS
