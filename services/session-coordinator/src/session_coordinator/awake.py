"""A clock that goes only while this process does. Pure."""

import time
from collections.abc import Callable

MOST_S = 0.5


class AwakeClock:
    """Seconds on a clock nobody sets, of which at most MOST_S count between two readings; it is read in every tick.

    Where more passes this process stood still itself (a machine that is too busy, SIGSTOP): what was not heard in that
    time is not the silence of others.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._now_s = self._read_s = clock()

    def now_s(self) -> float:
        """How late it is."""
        read_s = self._clock()
        self._now_s += min(read_s - self._read_s, MOST_S)
        self._read_s = read_s
        return self._now_s
