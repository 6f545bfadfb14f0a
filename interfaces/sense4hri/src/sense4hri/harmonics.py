"""Mains hum with its harmonics, under a signal that is itself as fast: a muscle. Imports no ROS.

As `sense4hri.hum`, but the lines are found in one spectrum, fitted all together, and where the signal is calm.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sense4hri.hum import BESIDE_HZ, LEAST_S, LOWEST_HZ, MAINS_HZ, OFF_HZ, folded_hz, offsets_hz

HARMONICS = 10
LOUD_S = 0.05  # in which something is loud beside the mains
APART_HZ = 1.0  # lines that sampling folds closer together are one

Floats = NDArray[np.float64]


def lines_seen(values: Floats, fs_hz: float, stands_out: float) -> list[float]:
    """Where the mains and harmonics, as sampling shows them, are stands_out times the amplitude beside them, in Hz."""
    if len(values) < LEAST_S * fs_hz:
        return []
    amplitude = np.asarray(np.abs(np.fft.rfft(values * np.hanning(len(values)))), np.float64)
    lines = {folded_hz(k * hz, fs_hz): None for hz in MAINS_HZ for k in range(1, HARMONICS + 1)}
    shown = [hz for hz in lines if LOWEST_HZ < hz < fs_hz / 2 - LOWEST_HZ]
    return [hz for hz in shown if _peak(amplitude, hz, len(values) / fs_hz) > stands_out]


def _peak(amplitude: Floats, hz: float, bins_per_hz: float) -> float:
    """The height of a spectrum near hz over that beside it; 0 on the slope of another line."""
    at, near, slope, far = (
        round(x * bins_per_hz) for x in (hz, 1.1 * OFF_HZ, min(map(abs, BESIDE_HZ)), max(BESIDE_HZ))
    )
    around = np.sort(amplitude[max(0, at - far) : at + far + 1])
    beside, height = float(around[len(around) // 2]), float(amplitude[max(0, at - near) : at + near + 1].max())
    if not beside > 0 or height < amplitude[max(0, at - slope) : at + slope + 1].max():
        return 0.0
    return height / beside


def lines_at(values: Floats, fs_hz: float, lines_hz: Sequence[float]) -> Floats:
    """The sines near these frequencies in values, shape (n,), whether they stand out or not.

    Fitted twice: the second time what is loud beside them, a muscle at work, counts the less the louder it is.
    """
    time_s: Floats = (np.arange(len(values), dtype=np.float64) - (len(values) - 1) / 2) / fs_hz
    taper: Floats = np.hanning(len(values) + 2)[1:-1].astype(np.float64)
    beside, bases = values, []
    taken_hz: list[float] = []
    for hz in lines_hz:
        if all(abs(hz - other_hz) > APART_HZ for other_hz in taken_hz):
            off_hz = float(offsets_hz((beside * taper)[None], hz, time_s, taper)[0])
            bases.append(_basis(hz + off_hz, time_s))
            beside = beside - _fitted(beside, bases[-1], taper)
            taken_hz.append(hz)
    if not bases:
        return np.zeros(len(values))
    size = max(1, round(LOUD_S * fs_hz))
    power = np.convolve(beside**2, np.ones(size) / size, "same")
    return _fitted(values, np.concatenate(bases), taper / (power + 1e-3 * float(np.mean(power)) + 1e-30))


def _basis(hz: float, time_s: Floats) -> Floats:
    """A sine of any amplitude and phase, both of which drift evenly, shape (4, n)."""
    wave = np.array([np.cos(2 * np.pi * hz * time_s), np.sin(2 * np.pi * hz * time_s)])
    return np.concatenate((wave, wave * time_s))


def _fitted(values: Floats, basis: Floats, weights: Floats) -> Floats:
    """What of the basis is in values, by least squares with these weights."""
    weighted = basis * weights
    gram = np.array([[float(np.sum(a * b)) for b in basis] for a in weighted])  # a product would wake other threads
    share = np.linalg.solve(gram, np.array([float(np.sum(a * values)) for a in weighted]))
    return np.asarray((share[:, None] * basis).sum(axis=0))
