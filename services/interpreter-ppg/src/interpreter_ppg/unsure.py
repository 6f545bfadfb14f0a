"""What variability lacks of a rate that changes fast: its pulses change their shape, and are not among the sure ones.

Between two sure intervals of which n differences apart all those between are unsure, the squares of the differences
add up to at least the square of the whole change over n (Cauchy and Schwarz). Noise and single pulses that are left
out add hardly anything to it, a rate that moves while no pulse is sure adds much.
"""

from collections import deque

import numpy as np
from sense4hri.hrv import Hrv
from sense4hri.stamps import SECOND_NS

LACKING_MS = 3.0  # of an RMSSD, from which it is not told
ALIKE = 0.75  # of its predecessor, that an interval has at least
FEWEST = 3  # differences since the last sure interval, from which they count: two are one pulse, which may be false
LACKING = "the rate changed while no pulse was sure enough, rmssd_ms would be too small"


class Unsure:
    """The unsure intervals of one stream, over the window of its variability."""

    def __init__(self, most: int) -> None:
        self._runs: deque[tuple[int, int, float]] = deque(maxlen=most)  # time, differences, least sum of their squares
        self.restart()

    def restart(self) -> None:
        """Forget everything; a new segment begins."""
        self._runs.clear()
        self._rr_ms = self._sure_ms = self._least_ms2 = np.nan
        self._since = 0

    def add(self, time_ns: int, rr_ms: float, sure_ms: float) -> None:
        """Take the next interval, NaN where there is none, and the same where it is sure, else NaN."""
        before_ms, self._rr_ms = self._rr_ms, rr_ms
        self._since += 1
        if not np.isfinite(rr_ms):
            self._sure_ms = self._least_ms2 = np.nan
        elif ALIKE < rr_ms / before_ms < 1 / ALIKE:  # else a pulse between is missing or false
            self._least_ms2 = (rr_ms - self._sure_ms) ** 2 / self._since
            if np.isfinite(sure_ms):
                if self._since >= FEWEST and np.isfinite(self._sure_ms):
                    self._runs.append((time_ns, self._since, self._least_ms2))
                self._sure_ms, self._since = sure_ms, 0

    def lacks(self, hrv: Hrv, end_ns: int) -> bool:
        """Return whether RMSSD with the least of what is between the sure intervals is much above that without."""
        start_ns = end_ns - round(hrv.window_s * SECOND_NS)
        while self._runs and self._runs[0][0] <= start_ns:
            self._runs.popleft()
        unsure, power_ms2 = sum(run[1] for run in self._runs), sum(run[2] for run in self._runs)
        if self._since >= FEWEST and np.isfinite(self._least_ms2):
            unsure, power_ms2 = unsure + self._since, power_ms2 + self._least_ms2
        if not unsure or not np.isfinite(hrv.rmssd_ms):
            return False
        least_ms2 = (hrv.rmssd_ms**2 * hrv.nn_count + power_ms2) / (hrv.nn_count + unsure)
        return bool(np.sqrt(least_ms2) > hrv.rmssd_ms + LACKING_MS)
