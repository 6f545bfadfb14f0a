"""Electromyograms with known truth: shaped noise of a known spectrum, working and at rest at known times."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
LOW_HZ, HIGH_HZ = 60.0, 120.0


def density(at_hz: Floats) -> Floats:
    """The power density of a muscle (Stulen & De Luca 1981), of no unit."""
    return at_hz**2 / ((at_hz**2 + LOW_HZ**2) * (at_hz**2 + HIGH_HZ**2) ** 2)


def muscle(
    seconds: float,
    fs_hz: float,
    bursts_s: Iterable[tuple[float, float]],
    rms_uv: float = 100.0,
    rest_uv: float = 2.0,
    seed: int = 0,
    sunk: float = 1.0,
) -> Floats:
    """Samples in uV: white noise of rest_uv, and between the times of each burst a muscle of rms_uv besides.

    sunk: factor of its frequencies, below 1 for a tired one.
    """
    rng = np.random.default_rng(seed)
    n = round(seconds * fs_hz)
    spectrum = np.fft.rfft(rng.normal(0, 1, n)) * np.sqrt(density(np.fft.rfftfreq(n, 1 / fs_hz) / sunk))
    works = np.fft.irfft(spectrum, n)
    works *= rms_uv / works.std()
    times_s = np.arange(n) / fs_hz
    on = np.zeros(n, bool)
    for begin_s, end_s in bursts_s:
        on |= (times_s >= begin_s) & (times_s < end_s)
    return np.asarray(rng.normal(0, rest_uv, n) + np.where(on, works, 0.0))


def heartbeats(seconds: float, fs_hz: float, bpm: float, height_uv: float, seed: int = 0) -> Floats:
    """QRS complexes in uV, at intervals that vary by 3 %."""
    rng = np.random.default_rng(seed)
    at_s = np.cumsum(60 / bpm * (1 + rng.normal(0, 0.03, int(seconds * bpm / 60) + 2)))
    after_s = np.arange(round(seconds * fs_hz))[:, None] / fs_hz - at_s[None]
    wave = np.exp(-0.5 * (after_s / 0.011) ** 2) - 0.3 * np.exp(-0.5 * ((after_s - 0.03) / 0.012) ** 2)
    return np.asarray(height_uv * wave.sum(axis=1))
