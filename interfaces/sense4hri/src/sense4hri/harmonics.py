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
    """The sines near these frequencies in values, shape (n, channels), whether they stand out or not.

    All channels have the same mains. The newer half counts in full, so that the fit is good up to the newest value.
    Fitted twice: the second time what is loud beside them, a muscle at work, counts the less the louder it is.
    """
    rows = np.ascontiguousarray(values.T)
    time_s: Floats = (np.arange(len(values), dtype=np.float64) - (len(values) - 1) / 2) / fs_hz
    taper: Floats = np.hanning(len(values) + 2)[1:-1].astype(np.float64)
    weights = np.where(time_s > 0, 1.0, taper)
    beside, bases = rows, []
    taken_hz: list[float] = []
    for hz in lines_hz:
        if all(abs(hz - other_hz) > APART_HZ for other_hz in taken_hz):
            bases.append(_basis(hz + _offset_hz(beside * taper, hz, time_s, taper), time_s))
            beside = beside - _fitted(beside, bases[-1], weights[None])
            taken_hz.append(hz)
    if not bases:
        return np.zeros(values.shape)
    size = max(1, round(LOUD_S * fs_hz))
    power = np.array([np.convolve(row**2, np.ones(size) / size, "same") for row in beside])
    calm = weights / (power + 1e-3 * power.mean(axis=1, keepdims=True) + 1e-30)
    return _fitted(rows, np.concatenate(bases), calm).T


def _offset_hz(tapered: Floats, hz: float, time_s: Floats, taper: Floats) -> float:
    """How far from hz the line is that the rows have in common; where it is strong counts most."""
    wave = np.exp(-2j * np.pi * hz * time_s)
    power = np.abs(np.einsum("cn,n->c", tapered, wave)) ** 2 + 1e-30
    return float(np.average(offsets_hz(tapered, hz, time_s, taper), weights=power))


def _basis(hz: float, time_s: Floats) -> Floats:
    """A sine of any amplitude and phase, both of which drift evenly, shape (4, n)."""
    wave = np.array([np.cos(2 * np.pi * hz * time_s), np.sin(2 * np.pi * hz * time_s)])
    return np.concatenate((wave, wave * time_s))


def _fitted(rows: Floats, basis: Floats, weights: Floats) -> Floats:
    """What of the basis is in each row, by least squares with these weights, a row for each or one for all."""
    fitted = np.empty(rows.shape)
    for i in range(len(weights)):  # einsum, as a matrix product would wake other threads
        here = slice(None) if len(weights) == 1 else slice(i, i + 1)
        weighted = basis * weights[i]
        gram = np.einsum("an,bn->ab", weighted, basis)
        share = np.linalg.solve(gram, np.einsum("an,cn->ac", weighted, rows[here]))
        fitted[here] = np.einsum("ac,an->cn", share, basis)
    return fitted
