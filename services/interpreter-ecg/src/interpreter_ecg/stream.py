"""The state of one ECG stream: samples in, one update per grid point out."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Break, TimedChunk
from sense4hri.grid import UpdateGrid
from sense4hri.hrv import LONGEST_GAP_S, Hrv, HrvWindow, withheld

from interpreter_ecg.config import Config
from interpreter_ecg.detector import Beat, Detector
from interpreter_ecg.features import signal_quality

FS_HZ = (50.0, 8000.0)
FEWEST_INTERVALS = 2  # for a heart rate
SILENT_S = 5.0  # a window this long with hardly a beat is not unknown, it is bad
DEVICE_AGE_S = (1.0, 6.0)  # a device's own rate is compared when it came this long before the samples


class EcgUpdate(NamedTuple):
    """What the features message says; NaN where it cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    peak_count: int
    peak_times_ns: tuple[int, ...]
    rr_intervals_ms: tuple[float, ...]
    rr_interval_ms: float
    heart_rate_bpm: float
    hrv: Hrv
    device_heart_rate_difference_bpm: float
    r_amplitude_uv: float
    signal_quality: float
    reasons: tuple[str, ...]


class _Interval(NamedTuple):
    beat: Beat
    rr_ms: float  # ends with the beat; NaN after a gap


class EcgStream:
    """A Step of the kit (sense4hri.interpreter)."""

    def __init__(self, config: Config, fs_hz: float, channels: tuple[str, ...] = (), unit: str = "uV") -> None:
        if not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(f"sampling_frequency_hz is {fs_hz:g}, must be {FS_HZ[0]:g} to {FS_HZ[1]:g} for ECG")
        if config.channel and channels and config.channel not in channels:
            raise ValueError(f"parameter 'channel' is {config.channel!r}, the stream has {', '.join(channels)}")
        self._config, self._calibrated = config, unit == "uV"
        self._grid = UpdateGrid(config.update_interval_s)
        self._detector = Detector(fs_hz)
        self._hrv = HrvWindow(config.hrv_window_s)
        self._pieces: list[TimedChunk] = []  # since the last update
        self._fresh: list[_Interval] = []  # beats decided on since the last update
        self._device_rates: deque[tuple[int, float]] = deque(maxlen=64)
        self._held = 0.0  # the last valid sample
        self._newest_ns: int | None = None
        self._begin_segment(0)

    def _begin_segment(self, first_ns: int) -> None:
        self._detector.restart()
        self._hrv.restart(first_ns)
        self._first_ns = first_ns
        self._window: deque[_Interval] = deque()
        self._previous_ns: int | None = None  # the last beat, unless a gap came after it
        self._quality = np.nan

    def device_reported(self, name: str, value: float, received_ns: int) -> None:
        """Remember the heart rate in 1/min that the device itself computed; 0 means that it has none."""
        if name == "heart_rate" and value > 0:
            self._device_rates.append((received_ns, value))

    def push(self, timed: TimedChunk) -> list[EcgUpdate]:
        """Take the next samples; one update for every grid point they reach, one for a stretch that ends."""
        updates = [] if timed.break_ is None else self._broken(timed.break_, int(timed.times_ns[0]))
        for piece, due in self._grid.split(timed):
            self._pieces.append(piece)
            self._newest_ns = int(piece.times_ns[-1])
            if due:
                self._detect()
                updates.append(self._update(piece))
        return updates

    def _broken(self, break_: Break, first_ns: int) -> list[EcgUpdate]:
        """A gap breaks the chain of intervals; a long one, or a clock that starts afresh, ends the segment.

        Beats undecided on are told at once, in an update that belongs to the last sample before the gap: after it they
        would come too late, or in another clock.
        """
        ended = self._pieces[-1] if self._pieces else None  # None: an update was due at the very last sample
        self._detect()
        self._take(self._detector.cut())
        updates = [self._update(ended)] if self._fresh and ended is not None else []
        if break_ is Break.RESET:
            self._fresh.clear()
        gap_s = np.inf if self._newest_ns is None else (first_ns - self._newest_ns) / 1e9
        if break_ is not Break.GAP or gap_s > LONGEST_GAP_S:
            self._begin_segment(first_ns)
        self._previous_ns = None
        return updates

    def _detect(self) -> None:
        """Hand everything since the last update to the detector, in one block: so chunks cannot matter."""
        if self._pieces:
            ecg = np.concatenate([self._lead(piece) for piece in self._pieces])
            times_ns = np.concatenate([piece.times_ns for piece in self._pieces])
            self._pieces.clear()
            self._take(self._detector.push(self._without_holes(ecg), times_ns))

    def _lead(self, piece: TimedChunk) -> NDArray[np.float64]:
        name = self._config.channel
        return piece.samples[:, piece.channels.index(name) if name in piece.channels else 0]

    def _without_holes(self, ecg: NDArray[np.float64]) -> NDArray[np.float64]:
        """A value that the device could not give (NaN) is held: flat, so no beat in it, and the quality falls."""
        valid = np.isfinite(ecg)
        if not valid.all():
            newest = np.maximum.accumulate(np.where(valid, np.arange(len(ecg)), -1))
            ecg = np.where(newest >= 0, ecg[newest], self._held)
        self._held = float(ecg[-1])
        return ecg

    def _take(self, beats: list[Beat]) -> None:
        """File beats under everything that is computed from them."""
        intervals = []
        for beat in beats:
            rr_ms = np.nan if self._previous_ns is None else (beat.time_ns - self._previous_ns) / 1e6
            intervals.append(_Interval(beat, rr_ms))
            self._previous_ns = beat.time_ns
        self._fresh += intervals
        self._window += intervals
        if self._newest_ns is None:
            return
        start_ns = self._newest_ns - round(self._config.window_s * 1e9)
        while self._window and self._window[0].beat.time_ns <= start_ns:
            self._window.popleft()
        self._quality = self._window_quality()
        poor = self._quality < self._config.hrv_min_quality
        for beat, rr_ms in intervals:
            self._hrv.add(beat.time_ns, np.nan if poor else rr_ms, beat.complete)

    def _window_quality(self) -> float:
        beats = [interval.beat for interval in self._window]
        quality = signal_quality(np.array([beat.shape for beat in beats]), np.array([beat.energy for beat in beats]))
        return 0.0 if np.isnan(quality) and self._window_s() >= SILENT_S else quality

    def _window_s(self) -> float:
        newest_ns = self._first_ns if self._newest_ns is None else self._newest_ns
        return min((newest_ns - self._first_ns) / 1e9, self._config.window_s)

    def _update(self, piece: TimedChunk) -> EcgUpdate:
        fresh, self._fresh = self._fresh, []
        hrv, reasons = self._hrv.at(int(piece.times_ns[-1]))
        notes = []
        if self._quality < self._config.hrv_min_quality:
            hrv = withheld(hrv)
            reasons = (f"hrv withheld: signal_quality below {self._config.hrv_min_quality:g}",)
            notes.append("heart_rate_bpm, rr_interval_ms doubtful: poor signal")
        if np.isnan(self._quality):
            notes.append("signal_quality needs three beats")
        valid_ms = [interval.rr_ms for interval in self._window if np.isfinite(interval.rr_ms)]
        rate = 6e4 / float(np.mean(valid_ms)) if len(valid_ms) >= FEWEST_INTERVALS else np.nan
        if np.isnan(rate):
            notes.append(f"heart_rate_bpm needs {FEWEST_INTERVALS} intervals")
        if not valid_ms:
            notes.append("rr_interval_ms: no interval in the window")
        difference = rate - self._device_rate(piece.received_ns)
        if np.isnan(difference):
            notes.append("device_heart_rate_difference_bpm: no heart rate of the device to compare with")
        if not self._calibrated:
            notes.append("uncalibrated: r_amplitude needs the unit uV")
        heights = [abs(interval.beat.height) for interval in self._window]
        return EcgUpdate(
            device_ns=piece.device_ns,
            received_ns=piece.received_ns,
            window_s=self._window_s(),
            peak_count=len(self._window),
            peak_times_ns=tuple(interval.beat.time_ns for interval in fresh),
            rr_intervals_ms=tuple(interval.rr_ms for interval in fresh),
            rr_interval_ms=valid_ms[-1] if valid_ms else np.nan,
            heart_rate_bpm=rate,
            hrv=hrv,
            device_heart_rate_difference_bpm=difference,
            r_amplitude_uv=float(np.median(heights)) if heights and self._calibrated else np.nan,
            signal_quality=self._quality,
            reasons=(*notes, *reasons),
        )

    def _device_rate(self, received_ns: int) -> float:
        """The newest rate the device reported 1 to 6 s before this receipt: old enough to be there in every replay."""
        for reported_ns, rate in reversed(self._device_rates):
            if DEVICE_AGE_S[0] <= (received_ns - reported_ns) / 1e9 <= DEVICE_AGE_S[1]:
                return rate
        return np.nan
