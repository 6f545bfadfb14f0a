"""Recordings as sources and as hearts: played at the device's rate, over and over."""

from collections.abc import Iterable

import numpy as np
from sense4hri.signal_files.content import UnreadableFileError

from sensor_bench.signals.hearts import Beat
from sensor_bench.signals.recordings import Recording
from sensor_bench.signals.sources import IntArray
from sensor_bench.signals.waveforms import FloatArray

SAME_RATE = 0.03
"""A recording whose rate is this close to the device's is played sample by sample, untouched."""


class PlaybackSource:
    """A recording, over and over, as device counts."""

    def __init__(
        self, recording: Recording, scale: float, channels: int, sample_bytes: int, rates_hz: Iterable[float]
    ) -> None:
        self._recording, self._scale, self._channels = recording, scale, channels
        self._largest = (1 << (8 * sample_bytes - 1)) - 1
        self._at_rate: dict[float, IntArray] = {}
        for rate_hz in rates_hz:
            self._counts(rate_hz)

    def read(self, first_index: int, count: int, fs_hz: float) -> IntArray:
        counts = self._counts(fs_hz)
        return counts[np.arange(first_index, first_index + count) % counts.shape[0]]

    def _counts(self, fs_hz: float) -> IntArray:
        if fs_hz not in self._at_rate:
            values = resampled(self._recording, fs_hz)
            if values.shape[1] < self._channels:
                values = np.repeat(values[:, :1], self._channels, axis=1)
            counts = np.rint(values[:, : self._channels] * self._scale)
            self._at_rate[fs_hz] = np.clip(counts, -self._largest, self._largest).astype(np.int64)
        return self._at_rate[fs_hz]


def resampled(recording: Recording, fs_hz: float) -> FloatArray:
    """The recording at another rate (low-pass below the new Nyquist, then a cubic spline); as it is if rates agree."""
    if abs(recording.fs_hz / fs_hz - 1) < SAME_RATE:
        return recording.values
    # here and not above: scipy takes 60 MB, which a bench that plays no recording need not have
    from scipy.interpolate import CubicSpline
    from scipy.signal import butter, sosfiltfilt

    values = recording.values
    if recording.fs_hz > fs_hz:
        values = sosfiltfilt(butter(4, 0.42 * fs_hz, fs=recording.fs_hz, output="sos"), values, axis=0)
    length = values.shape[0]
    at = np.arange(0, int((length - 1) / recording.fs_hz * fs_hz)) / fs_hz * recording.fs_hz
    return np.asarray(CubicSpline(np.arange(length), values)(at))


class RecordedHeart:
    """The heart in a recording, repeating with it; a drop-in for `signals.Heart`."""

    def __init__(self, beat_times_s: FloatArray, duration_s: float, respiration_hz: float = 0.25) -> None:
        if beat_times_s.size < 3:
            raise UnreadableFileError(f"only {beat_times_s.size} beats were found in the recording")
        self._times_s, self._duration_s = beat_times_s, duration_s
        self.respiration_hz = respiration_hz

    @property
    def heart_rate_bpm(self) -> float:
        return 60.0 / float(np.median(np.diff(self._times_s)))

    def beats(self, from_s: float, to_s: float) -> list[Beat]:
        first, last = int(from_s // self._duration_s), int(to_s // self._duration_s)
        found = []
        for lap in range(first - 1, last + 1):
            times_s = self._times_s + lap * self._duration_s
            before_s = np.concatenate([[self._times_s[-1] + (lap - 1) * self._duration_s], times_s[:-1]])
            pairs = zip(times_s.tolist(), before_s.tolist(), strict=True)
            found += [Beat(at, at - before) for at, before in pairs if from_s <= at < to_s]
        return found

    def breathing(self, times_s: FloatArray) -> FloatArray:
        return np.sin(2 * np.pi * self.respiration_hz * times_s)
