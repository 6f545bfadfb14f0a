"""Nanoseconds <-> builtin_interfaces/Time, by attribute alone, so that no ROS is needed to read a stamp."""

import time
from typing import Any

SECOND_NS = 1_000_000_000
LATEST_NS = 2**31 * SECOND_NS
"""A Time holds seconds in 31 bits: it is before this."""


def can_be(ns: int | None) -> bool:
    """Return whether a Time message can carry it; None is no time."""
    return ns is None or 0 <= ns < LATEST_NS


def to_ns(time: Any) -> int:
    """Return a Time message in ns; 0 means "no time"."""
    return int(time.sec) * SECOND_NS + int(time.nanosec)


def event_ns(marker: Any) -> int:
    """Return when a Marker's event was; of one without a stamp, as `ros2 topic pub` sends it, now."""
    return to_ns(marker.header.stamp) or time.time_ns()


def set_time(time: Any, ns: int | None) -> None:
    """Write ns into a Time message; None becomes zero, "no time"."""
    time.sec, time.nanosec = divmod(int(ns or 0), SECOND_NS)


def from_ns(ns: int | None) -> Any:
    """Return a new builtin_interfaces/Time; None becomes zero."""
    from builtin_interfaces.msg import Time

    seconds, nanoseconds = divmod(int(ns or 0), SECOND_NS)
    return Time(sec=seconds, nanosec=nanoseconds)
