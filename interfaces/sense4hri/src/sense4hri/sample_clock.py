"""Sample times (contract, section 3): computed once, here, the same for every consumer.

A frame that comes later by device time than its samples take tells of lost samples, or of a device whose stamps jitter:
a board that is kept busy takes or stamps its samples some ms late. Jitter is what this stream has shown over the last
minute. Where it hides single samples, only whole frames are lost, and their number is exact all the same. Where a frame
is a single sample and jitter hides it, nothing shorter than the jitter is a loss.
"""

from bisect import bisect_left
from collections import deque
from itertools import islice
from statistics import median

import numpy as np
from numpy.typing import NDArray

from sense4hri.chunk import Break, Chunk, TimedChunk
from sense4hri.stamps import SECOND_NS

MEMORY_S = 60.0  # of signal that the running rate remembers
RATE_TRUST = 0.25  # share by which a measured rate may differ from the declared one before it is not believed
STEADY_FRAMES = 8  # frames in a row that agree with each other, but not with the declared rate, correct it
STEADY = 0.05  # share within which they agree
SPREAD_FRAMES, SPREAD_SHARE, SPREADS = 1000, 0.99, 3.5  # jitter: 3.5 times what 99 % of so many frames stay within
FEW_FRAMES = 30  # before so many nothing is known of the jitter: a loss is a whole frame, or a whole number of samples
UNSURE = 0.6  # samples: where 3.5 times the usual jitter is more, only whole frames are missed
PAUSE, ROOM = 0.7, 1.2  # of a sample or frame: boards pause for less; 1.2 times the jitter less than a whole one
UNTIMED_S = 10.0  # for so long frames without a device time follow those with one; then the device gives none any more
SETTLED = 10  # messages, from which on the period of a stream without device time is measured
ROBUST = 1.4826  # times the median of absolute values: their standard deviation
WHOLE = 0.05  # samples: so near to whole numbers losses lie where stamps do not jitter


class SampleClock:
    """Gives every sample of one stream its time, and counts what is missing.

    nominal_hz: the declared rate; 0 for an irregular stream (one sample per message, at its stamp).
    With device time the event clock is the device's own, for single frames that lack it too; without it, ROS time as a
    running fit of the receipt stamp over the sample count, which keeps the jitter of arrival out of the samples.
    """

    def __init__(self, nominal_hz: float) -> None:
        if not nominal_hz >= 0:
            raise ValueError(f"sampling_frequency_hz is {nominal_hz}, must be 0 (irregular) or positive")
        self.nominal_hz = nominal_hz
        self.lost_samples_total = 0
        self.gaps_total = 0
        self.resets_total = 0
        self.backwards_total = 0
        self.duplicates_total = 0
        self._previous_ns: int | None = None
        self._device_ns: int | None = None  # of the newest sample; None while the device gives no time
        self._told_ns = 0  # receipt of the newest frame with a device time
        self._rate = _RunningRate(nominal_hz)
        self._jitter = _Jitter()
        self._arrivals = _ArrivalFit(nominal_hz)

    @property
    def fs_hz(self) -> float:
        """The running estimate of the true rate in the clock of the samples; the declared one at first."""
        return self._rate.fs_hz

    @property
    def in_device_time(self) -> bool:
        """True where the newest chunk's times are of the device's clock."""
        return self._device_ns is not None

    def place(self, chunk: Chunk) -> TimedChunk:
        """Return the chunk with the time of every sample. Raises ValueError for an empty chunk."""
        n = len(chunk.samples)
        if n == 0:
            raise ValueError("a chunk without samples has no time")
        if chunk.device_ns is None and chunk.received_ns - self._told_ns >= UNTIMED_S * SECOND_NS:
            self._device_ns = None
        if self.nominal_hz == 0:
            return self._irregular(chunk, n)
        if chunk.device_ns is not None:
            return self._by_device(chunk, chunk.device_ns, n)
        if self._device_ns is not None:
            return self._untimed(chunk, self._device_ns, n)
        return self._by_arrival(chunk, n)

    def begin_segment(self) -> None:
        """Forget the measured rate and jitter, so that what follows does not depend on how long was listened before.

        With device time the samples go on where they are; without it the line through the receipts starts afresh.
        """
        self._rate = _RunningRate(self.nominal_hz)
        self._jitter = _Jitter()
        self._arrivals = _ArrivalFit(self.nominal_hz)

    def _by_device(self, chunk: Chunk, stamp_ns: int, n: int) -> TimedChunk:
        previous_ns, self._device_ns, self._told_ns = self._device_ns, stamp_ns, chunk.received_ns
        if previous_ns is None:
            return self._timed(chunk, self._back_from(stamp_ns, n), Break.FIRST, 0)
        delta_ns = stamp_ns - previous_ns
        if delta_ns == 0:
            self.duplicates_total += 1
            return self._timed(chunk, self._back_from(stamp_ns, n), Break.DUPLICATE, 0)
        if delta_ns < 0:
            self.backwards_total += 1
            self.resets_total += 1
            self._rate.restart()
            self._jitter = _Jitter()
            return self._timed(chunk, self._back_from(stamp_ns, n), Break.RESET, 0)
        missing = self._jitter.missing(delta_ns / SECOND_NS * self.fs_hz - n, n, stamp_ns)
        steps = np.arange(1, n + 1, dtype=np.int64)
        between_ns = previous_ns + (steps * delta_ns) // n
        if missing is None:
            self._rate.add(n, delta_ns)
            return self._timed(chunk, between_ns, None, 0)
        self._rate.add_odd(n, delta_ns)
        self.gaps_total += 1
        self.lost_samples_total += missing
        back_ns = self._back_from(stamp_ns, n)
        return self._timed(chunk, back_ns if back_ns[0] > previous_ns else between_ns, Break.GAP, missing)

    def _untimed(self, chunk: Chunk, previous_ns: int, n: int) -> TimedChunk:
        """A frame without a time among others that have one: it follows the one before; the next time tells."""
        times_ns = previous_ns + np.rint(np.arange(1, n + 1) * (SECOND_NS / self.fs_hz)).astype(np.int64)
        self._device_ns = int(times_ns[-1])
        return self._timed(chunk, times_ns, None, 0)

    def _by_arrival(self, chunk: Chunk, n: int) -> TimedChunk:
        previous_ns, self._previous_ns = self._previous_ns, chunk.received_ns
        if previous_ns is not None and chunk.received_ns <= previous_ns:
            self.backwards_total += 1
        times_ns, break_ = self._arrivals.place(chunk.received_ns, n)
        if break_ is Break.GAP:
            self.gaps_total += 1
        return self._timed(chunk, times_ns, break_, 0)

    def _irregular(self, chunk: Chunk, n: int) -> TimedChunk:
        if chunk.device_ns is not None:
            self._device_ns, self._told_ns = chunk.device_ns, chunk.received_ns
        stamp_ns = chunk.received_ns
        if self._device_ns is not None:
            stamp_ns += self._device_ns - self._told_ns
        previous_ns, self._previous_ns = self._previous_ns, stamp_ns
        break_ = Break.FIRST if previous_ns is None else None
        if previous_ns is not None and stamp_ns <= previous_ns:
            self.backwards_total += 1
            break_ = Break.RESET
        return self._timed(chunk, np.full(n, stamp_ns, np.int64), break_, 0)

    def _back_from(self, stamp_ns: int, n: int) -> NDArray[np.int64]:
        ages = np.arange(n - 1, -1, -1) * (SECOND_NS / self.fs_hz)
        return stamp_ns - np.rint(ages).astype(np.int64)

    @staticmethod
    def _timed(chunk: Chunk, times_ns: NDArray[np.int64], break_: Break | None, lost: int) -> TimedChunk:
        return TimedChunk(chunk.channels, chunk.samples, times_ns, chunk.device_ns, chunk.received_ns, break_, lost)


class _Jitter:
    """Tells samples that are missing from stamps that jitter, by how late and early the stream's frames came so far."""

    def __init__(self) -> None:
        self._shown: deque[tuple[int, float]] = deque(maxlen=SPREAD_FRAMES)  # stamp, and samples late or early
        self._single: deque[float] = deque(maxlen=SPREAD_FRAMES)  # the same of all frames of one sample

    def missing(self, late: float, n: int, stamp_ns: int) -> int | None:
        """Return how many samples are missing before a frame of n; None where it continues the one before.

        late: by how many samples longer its stamp took than its samples do; negative = too early.
        """
        whole = late > 0.5 and abs(late - round(late)) < (WHOLE if self._shown else WHOLE / 10)
        least = max(0.5, n / 20)
        tolerance = least if abs(late) < least else self._tolerance(least, n, whole, stamp_ns)
        if abs(late) < n / 2 and not whole:
            self._shown.append((stamp_ns, abs(late)))
        if n == 1 and not whole:
            self._single.append(abs(late))
        if abs(late) < tolerance:
            return None
        frames = round(late / n) * n
        return max(0, frames if abs(late - frames) < tolerance else round(late))

    def _tolerance(self, least: float, n: int, whole: bool, stamp_ns: int) -> float:
        """Samples by which a frame may be late or early.

        Most of a sample where stamps jitter little; where one sample cannot be told from jitter, only whole frames are
        missed: half of one, or more where that leaves room for the jitter of a frame that is late because one was lost.
        """
        begun = bisect_left(self._shown, stamp_ns - MEMORY_S * SECOND_NS, key=lambda shown: shown[0])
        recent = sorted(late for _, late in islice(self._shown, begun, None))
        if n == 1 and self._single:  # the median, as losses may be among them
            least = max(least, SPREADS * ROBUST * median(self._single))
        if len(recent) < FEW_FRAMES:
            true = not recent or recent[-1] < 2 * WHOLE
            return least if whole and true else max(least, n / 2)
        usual = recent[int(SPREAD_SHARE * (len(recent) - 1))]
        if SPREADS * usual <= max(UNSURE, least):
            return max(least, SPREADS * usual, min(PAUSE, 1 - ROOM * usual))
        return max(least, n / 2, min(PAUSE * n, n - ROOM * recent[-1]))


class _RunningRate:
    """Samples over time with a fading memory; starts from the declared rate."""

    def __init__(self, nominal_hz: float) -> None:
        self.nominal_hz = self.fs_hz = nominal_hz
        self._samples = self._seconds = 0.0
        self._odd: list[tuple[int, int]] = []

    def restart(self) -> None:
        self._samples = self._seconds = 0.0
        self._odd.clear()

    def add_odd(self, n: int, delta_ns: int) -> None:
        """Take a frame that does not fit the rate; many alike mean that the declared rate is wrong."""
        self._odd = [*self._odd[1 - STEADY_FRAMES :], (n, delta_ns)]
        rates = np.array([n * SECOND_NS / delta_ns for n, delta_ns in self._odd])
        middle = float(np.median(rates))
        if len(rates) < STEADY_FRAMES or np.any(np.abs(rates / middle - 1) > STEADY):
            return
        if abs(middle / self.nominal_hz - 1) < RATE_TRUST:
            self.restart()
            self.fs_hz = middle

    def add(self, n: int, delta_ns: int) -> None:
        self._odd.clear()
        delta_s = delta_ns / SECOND_NS
        keep = max(0.0, 1.0 - delta_s / MEMORY_S)
        self._samples = keep * self._samples + n
        self._seconds = keep * self._seconds + delta_s
        measured_hz = self._samples / self._seconds
        if abs(measured_hz / self.nominal_hz - 1) < RATE_TRUST:
            self.fs_hz = measured_hz


class _ArrivalFit:
    """Line through (sample count, receipt stamp) for devices that give no time of their own.

    The line's slope is the sample period. A message that arrives more than GAP_S after the line says so is a hole of
    unknown length; then the line starts afresh. So are messages that are late by LATE_S for LASTING_S, all by much the
    same: what a link has held up comes later and later less late, what it has lost stays away.
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
        self._late: deque[tuple[int, float]] = deque()  # receipt and lateness of the last messages, both in ns

    def place(self, received_ns: int, n: int) -> tuple[NDArray[np.int64], Break | None]:
        """Return times, shape (n,), of the n samples that ended with this message, and the break before them."""
        break_: Break | None = None
        if self._origin_ns is None:
            break_ = Break.FIRST
        else:
            late_ns = received_ns - self._origin_ns - float(self._line(np.float64(self._count + n)))
            lasting = self._lasting(received_ns, late_ns)
            if lasting or late_ns > self.GAP_S * SECOND_NS or late_ns < -self.GAP_S * SECOND_NS:
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

    def _lasting(self, received_ns: int, late_ns: float) -> bool:
        """Return whether all messages of the last LASTING_S were late alike; known once the slope is measured."""
        if late_ns < self.LATE_S * SECOND_NS or self._weight <= SETTLED:
            self._late.clear()
            return False
        self._late.append((received_ns, late_ns))
        least, most = (choose(late for _, late in self._late) for choose in (min, max))
        if most - least > self.ALIKE * least:
            self._late.clear()
        return len(self._late) > 2 and received_ns - self._late[0][0] >= self.LASTING_S * SECOND_NS

    def _add(self, x: float, y: float, n: int) -> None:
        keep = max(0.0, 1.0 - n * self._nominal_period_ns / (MEMORY_S * SECOND_NS))
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
