"""ROS time of what a device stamps: by the clock models of the recording, else by the smallest delay seen."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from sense4hri import clock_model
from sense4hri.cdr import RawMessage
from sense4hri.stamps import SECOND_NS

STEP_S = 0.25  # a device clock that runs ahead of receipt by more was set; the delay of a link does not get shorter
BASE_TRUST = 8  # messages after which the smallest delay seen is taken for the link's
BASE_WINDOW = 10  # minutes in which the smallest delay is sought


class Model(NamedTuple):
    """A clock model of the recording: ROS = device + offset + skew from the reference on."""

    reference_ns: int
    offset_ns: int
    skew_ppm: float

    def ros_ns(self, device_ns: int) -> int:
        return clock_model.ros_ns(device_ns, self.reference_ns, self.offset_ns, self.skew_ppm)


class RosTime:
    """What is known of one epoch of a device's clock. model: None before one has come."""

    def __init__(self) -> None:
        self.model: Model | None = None
        self._seen = 0
        self._least: deque[tuple[int, int]] = deque(maxlen=BASE_WINDOW)  # minute, and the smallest delay in it
        self._least_ns = 0  # of them all

    def restart(self) -> None:
        """The device's clock, or the host's, was set: nothing holds any more."""
        self.model = None
        self._seen = 0
        self._least.clear()

    def learn(self, raw: RawMessage) -> None:
        """Take the delay of a message in."""
        delay_ns = raw.received_ns - raw.device_ns
        self._seen += 1
        if self._least and delay_ns < self._least_ns - SECOND_NS:
            self._least.clear()  # the host's clock was set back
        minute = raw.received_ns // (60 * SECOND_NS)
        if self._least and self._least[-1][0] == minute:
            if delay_ns >= self._least[-1][1]:
                return
            self._least[-1] = (minute, delay_ns)
        else:
            self._least.append((minute, delay_ns))
        self._least_ns = min(least_ns for _, least_ns in self._least)

    def ros_ns(self, device_ns: int) -> int:
        """Corrected ROS time of device time."""
        if self.model is not None:
            return self.model.ros_ns(device_ns)
        return device_ns + (self._least_ns if self._least else 0)

    def ran_ahead(self, raw: RawMessage, excess_s: float) -> bool:
        """True where samples would have been received before they were taken, had excess_s of them been lost."""
        if not self._least:
            return False
        ahead_s = (self._least_ns - (raw.received_ns - raw.device_ns)) * 1e-9
        return ahead_s > (STEP_S if self._seen >= BASE_TRUST else max(STEP_S, 0.5 * excess_s))
