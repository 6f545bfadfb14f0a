"""Sample times of a stream whose device gives none, by when its messages came. Imports no ROS."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sense4hri.chunk import Break
from sense4hri.running_rate import MEMORY_S, RATE_TRUST
from sense4hri.stamps import SECOND_NS

SETTLED = 10  # messages, from which on the period of a stream without device time is measured


class ArrivalFit:
    """Line through (sample count, receipt stamp) for devices that give no time of their own.

    The line's slope is the sample period. A message that arrives more than GAP_S after the line says so is a hole of
    unknown length; then the line starts afresh. So are messages that are late by LATE_S for LASTING_S, all by much the
    same: what a link has held up comes later and later less late, what it has lost stays away. So are messages that
    come as much before the earliest ones so far: the host's clock was set back. Before the line alone are those, too,
    that a link which often stands has not held up.
    """

    GAP_S = 1.0
    LATE_S, LASTING_S, ALIKE = 0.15, 1.0, 0.5

    def __init__(self, nominal_hz: float) -> None:
        self._nominal_period_ns = SECOND_NS / nominal_hz if nominal_hz else 0.0
        self._restart()

    def _restart(self) -> None:
        self._count = 0
        self._origin_ns: int | None = None
        self._weight = self._x = self._y = self._xx = self._xy = 0.0
        self._last_ns = 0
        self._late: deque[tuple[int, float]] = deque()  # receipt of the last messages, and by how much they are off
        self._earliest_ns = 0.0  # how late the earliest messages are

    def place(self, received_ns: int, n: int) -> tuple[NDArray[np.int64], Break | None]:
        """Return times, shape (n,), of the n samples that ended with this message, and the break before them."""
        break_: Break | None = None
        if self._origin_ns is None:
            break_ = Break.FIRST
        else:
            late_ns = received_ns - self._origin_ns - float(self._line(np.float64(self._count + n)))
            lasting = self._lasting(received_ns, late_ns, self._keep(n))
            if lasting or abs(late_ns) > self.GAP_S * SECOND_NS:
                break_ = Break.GAP if late_ns > 0 else Break.RESET
                self._restart()
        if self._origin_ns is None:
            self._origin_ns = received_ns
        self._count += n
        self._add(float(self._count), float(received_ns - self._origin_ns), n)
        counts = np.arange(self._count - n + 1, self._count + 1)
        times = self._origin_ns + np.rint(self._line(counts.astype(float))).astype(np.int64)
        if break_ is None:  # the line moves a little with every message; time of samples does not go back
            times = np.maximum(times, self._last_ns + 1 + np.arange(n))
        self._last_ns = int(times[-1])
        return times, break_

    def _lasting(self, received_ns: int, late_ns: float, keep: float) -> bool:
        """Return whether all messages of the last LASTING_S were late or early alike; known with the slope measured."""
        off_ns = late_ns if late_ns > 0 else min(0.0, late_ns - self._earliest_ns)
        if abs(off_ns) < self.LATE_S * SECOND_NS or self._weight <= SETTLED:
            self._earliest_ns = min(late_ns, keep * self._earliest_ns)
            self._late.clear()
            return False
        self._late.append((received_ns, off_ns))
        least, most = (choose(off for _, off in self._late) for choose in (min, max))
        if most - least > self.ALIKE * min(abs(least), abs(most)):
            self._late.clear()
        return len(self._late) > 2 and received_ns - self._late[0][0] >= self.LASTING_S * SECOND_NS

    def _keep(self, n: int) -> float:
        """Return the share that n samples leave of what was known before them."""
        return max(0.0, 1.0 - n * self._nominal_period_ns / (MEMORY_S * SECOND_NS))

    def _add(self, x: float, y: float, n: int) -> None:
        keep = self._keep(n)
        dx, dy = x - self._x, y - self._y
        self._weight = keep * self._weight + 1.0
        self._x += dx / self._weight
        self._y += dy / self._weight
        self._xx = keep * self._xx + dx * (x - self._x)
        self._xy = keep * self._xy + dx * (y - self._y)

    def _line(self, count: NDArray[np.float64] | np.float64) -> NDArray[np.float64] | np.float64:
        """Return ns after the origin at which the given counts of samples were complete."""
        slope = self._nominal_period_ns
        if self._weight > SETTLED and self._xx > 0:
            measured = self._xy / self._xx
            if abs(measured / self._nominal_period_ns - 1) < RATE_TRUST:
                slope = measured
        return self._y + slope * (count - self._x)
