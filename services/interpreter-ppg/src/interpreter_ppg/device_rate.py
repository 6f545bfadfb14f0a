"""What the device itself says of the heart rate, to compare with."""

from collections import deque

import numpy as np
from sense4hri.stamps import SECOND_NS

FROM_S, TO_S = 1.0, 6.0  # age of device values that an update is compared with


class DeviceRate:
    """The heart rate the device itself reports; the same for an update however late its messages came in."""

    def __init__(self) -> None:
        self._rates: deque[tuple[int, float]] = deque(maxlen=32)
        self._intervals: deque[tuple[int, float]] = deque(maxlen=64)

    def add(self, name: str, value: float, received_ns: int) -> None:
        """Take `heart_rate` in 1/min or `pp_interval` in ms; a device says 0 for "not known"."""
        if not 0 < value < np.inf:
            return
        if name == "heart_rate":
            self._rates.append((received_ns, value))
        elif name == "pp_interval":
            self._intervals.append((received_ns, value))

    def at(self, received_ns: int) -> float:
        """Return the newest rate in 1/min reported 1 to 6 s before, else that of the intervals, else NaN."""
        oldest, newest = received_ns - round(TO_S * SECOND_NS), received_ns - round(FROM_S * SECOND_NS)
        rates = [rate for at_ns, rate in self._rates if oldest <= at_ns <= newest]
        if rates:
            return rates[-1]
        intervals = [interval for at_ns, interval in self._intervals if oldest <= at_ns <= newest]
        return 60_000.0 / float(np.mean(intervals)) if intervals else np.nan
