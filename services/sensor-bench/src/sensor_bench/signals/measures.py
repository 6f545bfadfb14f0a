"""What one person's body gives to any analogue sensor, in canonical units, as functions of time and seed alone.

Beats, breath and pulse are those of the participant's heart, so all devices of a participant agree.
"""

from collections.abc import Callable

import numpy as np

from sensor_bench.signals.hearts import Rhythm
from sensor_bench.signals.sources import EcgSource, Noise, PpgSource, Wearing, sample_times_s
from sensor_bench.signals.waveforms import FloatArray, stored

Measure = Callable[[int, int, float], FloatArray]
"""measure(first_index, count, fs_hz) -> shape (count,); sample i is taken i / fs_hz after the bench's start."""

RESPONSE_EVERY_S = 12.0
BURST_EVERY_S, BURST_S = 6.0, 2.0
BLINK_EVERY_S, BLINK_WIDTH_S = 4.0, 0.06
PULSE_COUNTS = 1000.0


def measures(heart: Rhythm, seed: int, transit_s: float) -> dict[str, Measure]:
    """Every measure of one person by name: ecg, emg, eeg, eog in uV, eda in uS, breath -1 to 1, pulse 0 to 1, light,
    warmth in degC, gravity in g."""
    noise, worn, shapes = Noise(seed, 1), Wearing(), stored()
    ecg = EcgSource(heart, worn, shapes, seed)
    ppg = PpgSource(heart, worn, shapes, seed, transit_s)

    def hiss(first: int, count: int) -> FloatArray:
        return noise.at(first, count)[:, 0]

    def of_time(function: Callable[[FloatArray], FloatArray], level: float) -> Measure:
        return lambda first, count, fs: function(sample_times_s(first, count, fs)) + level * hiss(first, count)

    return {
        "ecg": lambda first, count, fs: ecg.read(first, count, fs)[:, 0].astype(np.float64),
        "pulse": lambda first, count, fs: (ppg.BASE[0] - ppg.read(first, count, fs)[:, 0]) / PULSE_COUNTS,
        "breath": of_time(heart.breathing, 0.005),
        "eda": of_time(_skin, 0.005),
        "emg": lambda first, count, fs: _effort(sample_times_s(first, count, fs)) * hiss(first, count),
        "eeg": of_time(lambda times_s: 12 * np.sin(2 * np.pi * 10 * times_s), 4.0),
        "eog": of_time(_blinks, 5.0),
        "light": of_time(lambda times_s: np.full(times_s.size, 60.0), 0.2),
        "warmth": of_time(lambda times_s: np.full(times_s.size, 33.5), 0.05),
        "gravity": of_time(lambda times_s: 0.95 + 0.01 * heart.breathing(times_s), 0.004),
    }


def _skin(times_s: FloatArray) -> FloatArray:
    """A level of 5 uS, and a response of 0.6 uS that rises within a second and fades within some."""
    after_s = times_s % RESPONSE_EVERY_S
    response = np.exp(-after_s / 3.0) - np.exp(-after_s / 0.7)
    return np.asarray(5 + 0.2 * np.sin(2 * np.pi * times_s / 60) + 1.2 * response)


def _effort(times_s: FloatArray) -> FloatArray:
    """4 uV at rest, 120 uV in a burst."""
    return np.where(times_s % BURST_EVERY_S < BURST_S, 120.0, 4.0)


def _blinks(times_s: FloatArray) -> FloatArray:
    after_s = times_s % BLINK_EVERY_S - BLINK_EVERY_S / 2
    return np.asarray(300 * np.exp(-0.5 * (after_s / BLINK_WIDTH_S) ** 2))
