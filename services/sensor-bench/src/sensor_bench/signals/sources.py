"""What the virtual sensors measure: the signals that the known beats of a heart produce.

Times here are seconds of true time since the bench's start. Every source is a function of time and seed alone: the same
instant gives the same value however the samples are cut into frames and whatever the link did in between.
"""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sensor_bench.signals.hearts import Rhythm
from sensor_bench.signals.waveforms import FS_HZ, FloatArray, Waveforms

IntArray = NDArray[np.int64]

PAUSE_S = 4.0
"""The longest pause between beats that a pulse wave spans; a recorded heart may pause longer."""
SHORTEST_RUNOFF_S = 0.05
NOISE_LENGTH = 1 << 16


class Source(Protocol):
    """A signal that can be read at any time."""

    def read(self, first_index: int, count: int, fs_hz: float) -> IntArray:
        """Device counts (count, channels); sample i since the bench's start is taken at i / fs_hz."""
        ...


def sample_times_s(first_index: int, count: int, fs_hz: float) -> FloatArray:
    return np.arange(first_index, first_index + count) / fs_hz


class Noise:
    """Gaussian noise by sample number, unit variance, repeating after `NOISE_LENGTH` samples."""

    def __init__(self, seed: int, channels: int) -> None:
        self._table = np.random.default_rng(seed).standard_normal((NOISE_LENGTH, channels)).astype(np.float32)

    def at(self, first_index: int, count: int) -> FloatArray:
        return self._table[np.arange(first_index, first_index + count) % NOISE_LENGTH].astype(np.float64)


class Wearing:
    """Whether the sensor touches the skin; shared by the sources of one device."""

    def __init__(self, contact: bool = True) -> None:
        self.contact = contact


class EcgSource:
    """Microvolts: the simulated beat at every R peak, breathing wander, noise; open-electrode noise without contact."""

    QRS_HALF_WIDTH_S = 0.07
    """This much around the R peak keeps its shape; P and T waves move with the square root of the RR interval."""

    def __init__(
        self,
        heart: Rhythm,
        wearing: Wearing,
        waveforms: Waveforms,
        seed: int,
        amplitude_uv: float = 1000.0,
        noise_uv: float = 8.0,
        wander_uv: float = 40.0,
    ) -> None:
        self._heart, self._wearing, self._waveforms = heart, wearing, waveforms
        self._noise = Noise(seed, 1)
        self._amplitude_uv, self._noise_uv, self._wander_uv = amplitude_uv, noise_uv, wander_uv
        samples = np.arange(waveforms.ecg.size)
        self._beat_s = (samples - waveforms.ecg_peak) / FS_HZ

    def read(self, first_index: int, count: int, fs_hz: float) -> IntArray:
        times_s = sample_times_s(first_index, count, fs_hz)
        noise = self._noise.at(first_index, count)[:, 0]
        if not self._wearing.contact:
            return np.rint(noise * 2000.0).astype(np.int64).reshape(-1, 1)
        return np.rint(self.at(times_s) + self._noise_uv * noise).astype(np.int64).reshape(-1, 1)

    def at(self, times_s: FloatArray) -> FloatArray:
        """The signal at any rising times, in uV, without noise."""
        signal = self._wander_uv * self._heart.breathing(times_s)
        for beat in self._heart.beats(float(times_s[0]) - 1.5, float(times_s[-1]) + 1.5):
            signal += self._amplitude_uv * self._beat(times_s - beat.time_s, beat.rr_s)
        return signal

    def _beat(self, offsets_s: FloatArray, rr_s: float) -> FloatArray:
        beyond_s = np.abs(offsets_s) - self.QRS_HALF_WIDTH_S
        stretched_s = np.sign(offsets_s) * (self.QRS_HALF_WIDTH_S + beyond_s / math.sqrt(rr_s))
        at_s = np.where(beyond_s > 0, stretched_s, offsets_s)
        return np.interp(at_s, self._beat_s, self._waveforms.ecg, left=0.0, right=0.0)


class PpgSource:
    """Counts of three green channels and ambient light, as a Verity Sense gives them: more blood, fewer counts.

    A pulse reaches the wrist `transit_s` after its R peak: that is the time of its systolic peak (count minimum).
    """

    BASE = np.array([261_500.0, 278_900.0, 293_100.0, -640.0])
    PULSE = np.array([-900.0, -1100.0, -1300.0, 0.0])
    BREATH = np.array([250.0, 270.0, 290.0, 5.0])
    NOISE = np.array([12.0, 12.0, 12.0, 15.0])

    def __init__(
        self, heart: Rhythm, wearing: Wearing, waveforms: Waveforms, seed: int, transit_s: float = 0.28
    ) -> None:
        self._heart, self._wearing, self._waveforms = heart, wearing, waveforms
        self._noise = Noise(seed, 4)
        self.transit_s = transit_s

    def read(self, first_index: int, count: int, fs_hz: float) -> IntArray:
        times_s = sample_times_s(first_index, count, fs_hz)
        noise = self._noise.at(first_index, count)
        if not self._wearing.contact:
            return np.rint(np.array([40_000.0, 42_000.0, 44_000.0, 150_000.0]) + 400.0 * noise).astype(np.int64)
        signal = self.BASE + self.NOISE * noise + self.BREATH * self._heart.breathing(times_s)[:, None]
        return np.rint(signal + self.PULSE * self.pulse(times_s)[:, None]).astype(np.int64)

    def pulse(self, times_s: FloatArray) -> FloatArray:
        """0..1: every beat's upstroke in its own time, its runoff stretched to the next foot."""
        beats = self._heart.beats(float(times_s[0]) - PAUSE_S, float(times_s[-1]) + PAUSE_S)
        if len(beats) < 2:
            return np.zeros(times_s.size)
        rise_s = self._waveforms.ppg_peak / FS_HZ
        runoff_s = (self._waveforms.ppg.size - 1) / FS_HZ - rise_s
        feet_s = np.array([beat.time_s for beat in beats]) + self.transit_s - rise_s
        index = np.clip(np.searchsorted(feet_s, times_s, side="right") - 1, 0, feet_s.size - 2)
        since_s = times_s - feet_s[index]
        left_s = np.maximum(feet_s[index + 1] - feet_s[index] - rise_s, SHORTEST_RUNOFF_S)
        stretched_s = rise_s + (since_s - rise_s) * runoff_s / left_s
        at = np.where(since_s < rise_s, since_s, stretched_s) * FS_HZ
        return np.interp(at, np.arange(self._waveforms.ppg.size), self._waveforms.ppg)


class MotionSource:
    """A resting triple of channels around a constant vector, in counts of `unit` each: breathing, tremor, noise."""

    def __init__(
        self, heart: Rhythm, seed: int, at_rest: Sequence[float], breath: float, noise: float, unit: float = 1.0
    ) -> None:
        self._heart = heart
        self._noise = Noise(seed, 3)
        self._at_rest = np.array(at_rest) / unit
        self._breath, self._level = breath / unit, noise / unit

    def read(self, first_index: int, count: int, fs_hz: float) -> IntArray:
        times_s = sample_times_s(first_index, count, fs_hz)
        breath = self._heart.breathing(times_s)[:, None] * np.array([0.3, 0.5, 1.0])
        noise = self._noise.at(first_index, count)
        return np.rint(self._at_rest + self._breath * breath + self._level * noise).astype(np.int64)
