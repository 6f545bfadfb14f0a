"""Signals whose every beat is known: what the page must show can be calculated. Pure.

Times are seconds since the Unix epoch, so that any process that asks for the same second gets the same signal.
"""

import numpy as np
from numpy.typing import NDArray

BREATH_S = 4.0
PULSE_DELAY_S = 0.22  # of the finger behind the R peak
Signal = NDArray[np.float64]


def beats(start_s: float, end_s: float, rate_bpm: float) -> Signal:
    """Return the times of the R peaks in [start_s, end_s): a steady rate that swings with the breath."""
    first, last = np.floor(start_s * rate_bpm / 60) - 1, np.ceil(end_s * rate_bpm / 60) + 1
    even = np.arange(first, last + 1) * 60 / rate_bpm
    swung = even + 0.03 * np.sin(2 * np.pi * even / BREATH_S)
    return swung[(swung >= start_s) & (swung < end_s)]


def ecg_uv(times_s: Signal, rate_bpm: float) -> Signal:
    """Return an ECG in uV, shape of times_s: P, Q, R, S and T as bumps around each R peak, with a little noise."""
    found = 25 * np.sin(2 * np.pi * times_s / BREATH_S) + _noise(times_s, 9)
    for peak in beats(times_s[0] - 1, times_s[-1] + 1, rate_bpm):
        for height, after_s, width_s in (
            (110, -0.17, 0.022),
            (-130, -0.028, 0.009),
            (1150, 0.0, 0.0105),
            (-280, 0.03, 0.011),
            (260, 0.26, 0.045),
        ):
            found += height * np.exp(-(((times_s - peak - after_s) / width_s) ** 2) / 2)
    return found


def ppg_counts(times_s: Signal, rate_bpm: float) -> Signal:
    """Return one optical channel in counts, shape of times_s."""
    found = 203_000 + 500 * np.sin(2 * np.pi * times_s / BREATH_S) + _noise(times_s, 25)
    for peak in beats(times_s[0] - 2, times_s[-1] + 1, rate_bpm) + PULSE_DELAY_S:
        found += 2600 * np.exp(-(((times_s - peak - 0.1) / 0.085) ** 2) / 2)
        found += 900 * np.exp(-(((times_s - peak - 0.38) / 0.12) ** 2) / 2)
    return found


def acceleration(times_s: Signal) -> Signal:
    """Return x, y, z in m/s^2, shape (n, 3): a sitting person who breathes."""
    breath = 0.12 * np.sin(2 * np.pi * times_s / BREATH_S)
    return np.column_stack(
        [
            0.6 + breath + _noise(times_s, 0.03),
            -1.2 + _noise(times_s + 1, 0.03),
            9.66 - breath + _noise(times_s + 2, 0.03),
        ]
    )


def _noise(times_s: Signal, size: float) -> Signal:
    """Noise that depends on the time alone."""
    phase = np.sin(times_s * 12989.8233) * 43758.5453
    return size * (2 * (phase - np.floor(phase)) - 1)


def every(period_s: float, after_s: float, start_s: float, end_s: float) -> Signal:
    """Return the times in [start_s, end_s) that are a whole number of periods and after_s since the Unix epoch."""
    first, last = np.floor(start_s / period_s) - 1, np.ceil(end_s / period_s)
    found = np.arange(first, last + 1) * period_s + after_s
    return found[(found >= start_s) & (found < end_s)]


def noise(times_s: Signal, channels: int, size: float) -> Signal:
    """Return noise of as many channels, shape (n, channels), that depends on the time alone."""
    return np.column_stack([_noise(times_s % 3600 + 7 * channel, size) for channel in range(channels)])
