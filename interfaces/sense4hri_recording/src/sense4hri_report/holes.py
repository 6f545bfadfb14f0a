"""What is missing of a stream, and where a message that came late fits in."""

from __future__ import annotations

from dataclasses import dataclass

from sense4hri_report.watch import HostStep

TRIED = 64  # holes back that a late message is tried on


@dataclass
class Hole:
    """Samples that are missing. Device times are those of the neighbours' newest samples; log times those of receipt.

    lost: samples per channel. estimated: by receipt, since no device time tells.
    """

    from_device_ns: int
    to_device_ns: int
    from_log_ns: int
    to_log_ns: int
    from_ns: int
    to_ns: int
    lost: int
    estimated: bool = False


class Holes(list[Hole]):
    """A stream's holes in order of time; those since the device's clock was last set can still be filled."""

    def __init__(self) -> None:
        super().__init__()
        self._fillable_from = 0

    def begin_epoch(self) -> None:
        """The device's clock was set: no stamp from now on is of an old hole."""
        self._fillable_from = len(self)

    def around(self, stamp_ns: int, n: int, period_ns: float) -> int | None:
        """Index of the hole in which n samples that end at a stamp of the device are missing."""
        begin_ns = stamp_ns - n * period_ns
        slack_ns = max(0.5, n / 20) * period_ns
        for i in range(len(self) - 1, max(self._fillable_from, len(self) - TRIED) - 1, -1):
            hole = self[i]
            if hole.estimated or hole.lost < n:
                continue
            if begin_ns > hole.from_device_ns - slack_ns and stamp_ns < hole.to_device_ns:
                return i
        return None

    def without(self, step: HostStep, rate_hz: float) -> None:
        """Take a step of the host's clock out of the hole that it made by receipt."""
        for hole in list(self):
            left_ns = step.left_of(hole.from_ns, hole.to_ns)
            if left_ns < hole.to_ns - hole.from_ns:
                hole.from_ns, hole.lost = hole.to_ns - left_ns, round(left_ns * 1e-9 * rate_hz)
                if not hole.lost:
                    self.remove(hole)
                return

    def fill(self, i: int, stamp_ns: int, n: int, period_ns: float, ros_ns: int) -> None:
        """Put n samples that end at a stamp, at ros_ns in ROS time, into a hole: what is left of it stays."""
        hole = self.pop(i)
        begin_ns = stamp_ns - n * period_ns
        left = min(max(round((begin_ns - hole.from_device_ns) / period_ns), 0), hole.lost - n)
        right = hole.lost - n - left
        parts = []
        if left:
            begin_ros_ns = ros_ns - round(n * period_ns)
            parts.append(Hole(hole.from_device_ns, round(begin_ns), hole.from_log_ns, hole.to_log_ns,
                              hole.from_ns, begin_ros_ns, left))  # fmt: skip
        if right:
            parts.append(Hole(stamp_ns, hole.to_device_ns, hole.from_log_ns, hole.to_log_ns,
                              ros_ns, hole.to_ns, right))  # fmt: skip
        self[i:i] = parts
