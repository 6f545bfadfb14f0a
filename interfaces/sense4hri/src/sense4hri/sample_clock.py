"""Sample times (contract, section 3): computed once, here, the same for every consumer."""

import numpy as np
from numpy.typing import NDArray

from sense4hri.arrival_fit import ArrivalFit
from sense4hri.chunk import Break, Chunk, TimedChunk
from sense4hri.jitter import Jitter
from sense4hri.running_rate import RunningRate
from sense4hri.stamps import SECOND_NS

UNTIMED_S = 10.0  # for so long frames without a device time follow those with one; then the device gives none any more
LEAP_S = 5.0  # by which samples must seem to come before they were taken, for the device's clock to have been set ahead
OTHER_RATE = 0.005  # share by which a rate must change to change how late frames are


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
        self._rate = RunningRate(nominal_hz)
        self._jitter = Jitter()
        self._arrivals = ArrivalFit(nominal_hz)
        self._leaps = _Leaps(0, 0)

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
        self._rate = RunningRate(self.nominal_hz)
        self._jitter = Jitter()
        self._arrivals = ArrivalFit(self.nominal_hz)

    def _by_device(self, chunk: Chunk, stamp_ns: int, n: int) -> TimedChunk:
        previous_ns, self._device_ns, self._told_ns = self._device_ns, stamp_ns, chunk.received_ns
        if previous_ns is None:
            self._leaps = _Leaps(stamp_ns, chunk.received_ns)
            return self._timed(chunk, self._back_from(stamp_ns, n), Break.FIRST, 0)
        delta_ns = stamp_ns - previous_ns
        if delta_ns == 0:
            self.duplicates_total += 1
            return self._timed(chunk, self._back_from(stamp_ns, n), Break.DUPLICATE, 0)
        leapt = self._leaps.leapt(stamp_ns, chunk.received_ns, delta_ns - n * SECOND_NS / self.fs_hz)
        if delta_ns < 0 or leapt:
            self.backwards_total += delta_ns < 0
            self.resets_total += 1
            self._rate.restart()
            self._jitter = Jitter()
            self._leaps = _Leaps(stamp_ns, chunk.received_ns)
            return self._timed(chunk, self._back_from(stamp_ns, n), Break.RESET, 0)
        missing = self._jitter.missing(delta_ns / SECOND_NS * self.fs_hz - n, n, stamp_ns, self.fs_hz)
        steps = np.arange(1, n + 1, dtype=np.int64)
        between_ns = previous_ns + (steps * delta_ns) // n
        if missing is None:
            before_hz = self.fs_hz
            self._rate.add(n, delta_ns, doubtful=self._jitter.doubtful)
            if abs(self.fs_hz / before_hz - 1) > OTHER_RATE:
                self._jitter.of_another_rate()
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
        return self._timed(chunk, np.array([stamp_ns] * n, np.int64), break_, 0)

    def _back_from(self, stamp_ns: int, n: int) -> NDArray[np.int64]:
        ages = np.arange(n - 1, -1, -1) * (SECOND_NS / self.fs_hz)
        return stamp_ns - np.rint(ages).astype(np.int64)

    @staticmethod
    def _timed(chunk: Chunk, times_ns: NDArray[np.int64], break_: Break | None, lost: int) -> TimedChunk:
        return TimedChunk(chunk.channels, chunk.samples, times_ns, chunk.device_ns, chunk.received_ns, break_, lost)


class _Leaps:
    """Tells a device's clock that was set ahead from lost samples: these pass on the host's clock as well.

    What a link has held up, or a device has kept and sends at once, is late before, never earlier than all else. A
    recording that is played fast is as fast throughout.
    """

    def __init__(self, device_ns: int, received_ns: int) -> None:
        self._first = self._newest = device_ns, received_ns
        self._least_delay_ns = received_ns - device_ns

    def leapt(self, device_ns: int, received_ns: int, missing_ns: float) -> bool:
        """Return whether a frame's clock was set ahead; missing_ns: of device time, between it and the one before."""
        delay_ns = received_ns - device_ns
        least_ns, self._least_delay_ns = self._least_delay_ns, min(self._least_delay_ns, delay_ns)
        last, self._newest = self._newest, (device_ns, received_ns)
        leap_ns = LEAP_S * SECOND_NS
        if missing_ns <= leap_ns or delay_ns >= least_ns - leap_ns:
            return False
        ran_ns, passed_ns = last[0] - self._first[0], last[1] - self._first[1]
        if passed_ns <= 0:
            return False
        speed = max(1.0, ran_ns / passed_ns)
        return device_ns - last[0] > speed * (received_ns - last[1]) + leap_ns
