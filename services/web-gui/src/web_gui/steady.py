"""The clock that everything is judged by: nobody sets it, and it goes on while the machine sleeps."""

import copy
import time
from collections.abc import Callable
from typing import Self

from sense4hri.stamps import SECOND_NS

STEP_NS = 1_000_000  # back by less than this is what lies between two looks
SETTLES_NS = 2 * SECOND_NS  # of a message from its stamp to here, and some way for a busy machine


def _since_boot_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class Steady:
    """Begins at the host's time of day, and does not follow where that is set."""

    def __init__(
        self, of_day_ns: Callable[[], int] = time.time_ns, since_boot_ns: Callable[[], int] = _since_boot_ns
    ) -> None:
        self._of_day_ns, self._since_boot_ns = of_day_ns, since_boot_ns
        booted_ns = since_boot_ns()  # looked at first: what lies between the two looks is less than a step back
        self._begun_ns = of_day_ns() - booted_ns
        self._set_ns = 0  # by how much the time of day has been set since
        self._set_at_ns = 0
        self._to_reference: Callable[[int], int] = lambda host_ns: host_ns

    def corrected(self, to_reference: Callable[[int], int]) -> Self:
        """Return this clock with the time of day of another host, as to_reference makes it of this host's."""
        other = copy.copy(self)
        other._to_reference = to_reference
        return other

    def now_ns(self) -> int:
        """Return what is called `now_ns` everywhere."""
        return self._begun_ns + self._since_boot_ns()

    def wall_ns(self, at_ns: int) -> int:
        """Return the reference host's time of day at a moment of this clock, the same until a host's clock is set."""
        before_ns, wall_ns, after_ns = self.now_ns(), self._of_day_ns(), self.now_ns()
        if not wall_ns - after_ns <= self._set_ns <= wall_ns - before_ns + STEP_NS:
            self._set_ns, self._set_at_ns = wall_ns - before_ns, after_ns
        return self._to_reference(at_ns + self._set_ns)

    def settled(self, at_ns: int) -> bool:
        """Return False for a moment after the time of day was set: what comes then may have been stamped before."""
        return at_ns - self._set_at_ns > SETTLES_NS
