"""Where a sensor's samples lie in ROS time, for the markers that the sensor told in its device's clock."""

from __future__ import annotations

from collections.abc import Iterable

from sense4hri.clock_model import nearest_ns

from sense4hri_report.raw_findings import RawFindings


class Epochs:
    """ROS time less device time of a stream's samples, the newest of each epoch of its device's clock."""

    def __init__(self) -> None:
        self._offsets_ns: dict[int, int] = {}

    def learn(self, raw: RawFindings) -> bool:
        """Look at the newest sample; returns whether device times can be placed."""
        if raw.has_device_time and raw.last_device_ns:
            self._offsets_ns[raw.resets] = raw.last_ns - raw.last_device_ns
        return bool(self._offsets_ns)

    def ros_ns(self, device_ns: int) -> list[int]:
        """ROS time of a device time, by each epoch."""
        return [device_ns + offset_ns for offset_ns in self._offsets_ns.values()]


def marked_ns(epochs: Iterable[Epochs], device_ns: int, told_ns: int) -> int:
    """ROS time of a device time that was told then; of one of another clock the time at which it was told."""
    at_ns = nearest_ns((at_ns for each in epochs for at_ns in each.ros_ns(device_ns)), told_ns)
    return told_ns if at_ns is None else at_ns
