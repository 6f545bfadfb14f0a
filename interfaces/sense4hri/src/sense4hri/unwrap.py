"""A device's counter that wraps, as a number that does not (contract, section 3). Imports no ROS.

Sequence numbers of 8 bits, clocks of 16, 24 or 32: what they count goes on for longer than they can. The host's clock
tells how often the counter has gone round since the last message, and whether it began afresh.
"""

import time
from collections.abc import Callable

from sense4hri.stamps import SECOND_NS

RATE_TRUST = 0.02  # share by which a device may count faster or slower than it says...
RATE_ROUNDS = 1 / 8  # ...but over a gap by no more than this share of a round
LATE_S = 10.0  # that a message may be late; later than this the counter has begun afresh
EARLY_S = 1.0  # that a message may come sooner than the quickest so far


class Unwrap:
    """Counts on where a counter of `bits` bits starts again at 0, and begins a new epoch where the device did.

    rate_hz: counts per second, right to within 2 %; what that makes in the longest gap should stay below an eighth of a
    round, if the rounds missed in it are to be told. clock_ns: a clock of the host that nobody sets.

    A message may come late (a stalled host, a congested link), but never before the device has sent it. So of all the
    numbers of rounds that fit a count, the largest the host's clock allows is taken: the rounds missed while the link
    was away are made up, and messages that come in a burst after a stall are not taken for a round more. Where that
    means a message more than LATE_S late, the device has restarted: its count is passed on as it is.
    A counter that goes round within LATE_S has no count that says so; its restart looks like lost samples.
    """

    def __init__(self, bits: int, rate_hz: float, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        if not (bits > 0 and rate_hz > 0):
            raise ValueError(f"a counter of {bits} bits at {rate_hz} Hz: both must be above 0")
        self._period, self._rate_hz, self._clock_ns = 1 << bits, rate_hz, clock_ns
        self._early = min(self._period / 4, EARLY_S * rate_hz)
        self._last: tuple[int, int] | None = None
        self._late = 0.0
        self.restarts_total = 0

    def __call__(self, count: int) -> int:
        """Return the count that has just come without its wraps. Raises ValueError where it has too many bits."""
        if not 0 <= count < self._period:
            raise ValueError(f"count {count} of a counter that ends at {self._period - 1}")
        now_ns = self._clock_ns()
        whole = self._continued(count, now_ns)
        if whole is None:
            self._late, whole = 0.0, count
        self._last = whole, now_ns
        return whole

    def _continued(self, count: int, now_ns: int) -> int | None:
        """Return the count that goes on from the last one, None where there is none: first message, or restart."""
        if self._last is None:
            return None
        last, last_ns = self._last
        passed = (now_ns - last_ns) / SECOND_NS * self._rate_hz
        unsure = min(RATE_TRUST * passed, RATE_ROUNDS * self._period)
        latest = last + passed + self._late + self._early + unsure
        whole = count + int((latest - count) // self._period) * self._period
        late = self._late + passed - (whole - last)
        if late > LATE_S * self._rate_hz:
            self.restarts_total += 1
            return None
        self._late = max(0.0, late - unsure)
        return whole


def ticks_ns(ticks: int, rate_hz: int) -> int:
    """Return a clock's ticks in ns, exact for any number of them."""
    return (ticks * SECOND_NS + rate_hz // 2) // rate_hz
