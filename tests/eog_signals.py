"""Electrooculograms with known truth."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SACCADE_S = 0.05


def step(times_s: Floats, at_s: float) -> Floats:
    """From 0 to 1 in SACCADE_S, smoothly (least jerk)."""
    way = np.clip((times_s - at_s) / SACCADE_S, 0, 1)
    return np.asarray(way**3 * (10 - 15 * way + 6 * way**2))


def lid(times_s: Floats, peak_s: float) -> Floats:
    """A closure of height 1: shut in 0.1 s, half open again 0.15 s later."""
    before = np.cos(np.clip((times_s - peak_s) / 0.1, -1, 0) * np.pi) / 2 + 0.5
    after = np.cos(np.clip((times_s - peak_s) / 0.3, 0, 1) * np.pi) / 2 + 0.5
    return np.where(times_s < peak_s, before, after)


def eyes(
    seconds: float,
    fs_hz: float,
    blinks_s: Iterable[float] = (),
    horizontal: Iterable[tuple[float, float]] = (),
    vertical: Iterable[tuple[float, float]] = (),
    noise_uv: float = 3.0,
    drift_uv_per_min: float = 60.0,
) -> Floats:
    """heog and veog in uV, shape (n, 2): blinks of 200 uV at their summits, saccades (onset in s, amplitude in uV)."""
    times_s = np.arange(round(seconds * fs_hz)) / fs_hz
    noise = np.random.default_rng(5).normal(0, noise_uv, (len(times_s), 2))
    out: Floats = noise + (drift_uv_per_min * times_s / 60)[:, None]
    for column, saccades in enumerate((horizontal, vertical)):
        for onset_s, amplitude_uv in saccades:
            out[:, column] += amplitude_uv * step(times_s, onset_s)
    for peak_s in blinks_s:
        out += lid(times_s, peak_s)[:, None] * (15.0, 200.0)
    return out
