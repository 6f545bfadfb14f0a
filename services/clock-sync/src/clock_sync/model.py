"""What the estimator says of a device clock."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from sense4hri import clock_model


class State(IntEnum):
    """As in ClockModel."""

    WARMUP = 0
    LOCKED = 1
    HOLDOVER = 2


class Model(NamedTuple):
    """A clock model (contract, section 3).

    stamp_ns: receipt of the newest packet used. uncertainty_s: 95 % half width.
    """

    stamp_ns: int
    device_reference_ns: int
    offset_ns: int
    skew_ppm: float
    uncertainty_s: float
    latency_s: float
    segment: int
    state: State

    def ros_ns(self, device_ns: int) -> int:
        """ROS time at which the sample of device time `device_ns` was taken."""
        return clock_model.ros_ns(device_ns, self.device_reference_ns, self.offset_ns, self.skew_ppm)
