"""Mains hum round one beat: its harmonics too, and where it swings or jumps. Pure.

`sense4hri.hum` fits each line over seconds, as if it drifted evenly. A harmonic of a line so found is at a known
frequency, wherever sampling folds it. What is left of a line because its strength changes is fitted again over the
parts of a second round the beat in which no complex is, and over those before and after it alone: the hum may jump.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.hum import MAINS_HZ, folded_hz, hum, offset_hz
from sense4hri.medians import median

from interpreter_ecg.features import Floats

HARMONICS = (2, 3)
LOWEST_HZ, LEAST_BELOW_HZ = 5.0, 1.0  # harmonics that folding puts lower, or so near half the rate, are left alone
SLOWEST_CHANGING_HZ = 25.0  # below, P and T waves are as fast, so a part of a second tells nothing
DRIFT, CURVE = 4, 8  # degrees of freedom of a sine that drifts evenly, and of one whose drift changes
REACH_S, SIDE_S = 0.6, 0.7  # round the beat, and to one side of it, where what is left is fitted
ROUND_SIDE = 0.7  # of the variance left round the beat up to which one side of it is the better fit
CLEAR = 6.0  # times the variance left that what is fitted has for each of its degrees of freedom
CALM = 0.2  # of the way from the usual energy to that of the beat, up to which there is no complex


Bools = NDArray[np.bool_]


class _Fit(NamedTuple):
    """A line fitted to a part of the samples."""

    line: Floats  # at all samples, shape (n,); zeros where it was not clear
    variance: float  # of what is left


def mains(ecg: Floats, energy: Floats, middle: int, fs_hz: float) -> Floats:
    """The hum in ecg, shape (n,) and its unit, best near the index of the beat; zeros where there is none.

    energy: of its complexes, of all but the last few, shape (up to n,).
    """
    total = np.zeros(len(ecg))
    for mains_hz in MAINS_HZ:
        line = hum(ecg - total, fs_hz, mains=(mains_hz,))
        if line.any():
            total += line
            calm = _calm(energy.take(np.arange(len(ecg)), mode="clip"), middle)
            total += _rest(ecg - total, calm, middle, fs_hz, _exact_hz(line, mains_hz, fs_hz))
    return total


def _calm(energy: Floats, middle: int) -> Bools:
    """Where no complex is; energy: of all samples, shape (n,)."""
    usual = median(energy)
    return np.asarray(energy < usual + CALM * (energy[middle] - usual))


def _exact_hz(line: Floats, mains_hz: float, fs_hz: float) -> float:
    """Return the true frequency of the mains, from the one at which sampling shows (aliases) their hum."""
    turned = 1 if mains_hz % fs_hz < fs_hz / 2 else -1
    return mains_hz + turned * offset_hz(line, folded_hz(mains_hz, fs_hz), fs_hz)


def _rest(ecg: Floats, calm: Bools, middle: int, fs_hz: float, mains_hz: float) -> Floats:
    """What is left of a line that has been found: its harmonics, then its changes."""
    total = np.zeros(len(ecg))
    for hz in (folded_hz(k * mains_hz, fs_hz) for k in HARMONICS):
        if LOWEST_HZ < hz < fs_hz / 2 - LEAST_BELOW_HZ:
            total += _Part(ecg - total, calm, middle, fs_hz, hz, DRIFT).fit(-np.inf, np.inf, DRIFT).line
    hz = folded_hz(mains_hz, fs_hz)
    if hz <= SLOWEST_CHANGING_HZ:
        return total
    return total + _changes(_Part(ecg - total, calm, middle, fs_hz, hz, CURVE))


def _changes(part: "_Part") -> Floats:
    """The line as it is near the middle."""
    near = part.fit(-REACH_S, REACH_S, CURVE)
    side = min(part.fit(-SIDE_S, 0, DRIFT), part.fit(0, SIDE_S, DRIFT), key=lambda fit: fit.variance)
    return side.line if side.variance < ROUND_SIDE * near.variance else near.line


class _Part:
    """A line at hz in ecg, shape (n,), to be fitted to parts of it where it is calm. most: of the basis, so many."""

    def __init__(self, ecg: Floats, calm: Bools, middle: int, fs_hz: float, hz: float, most: int) -> None:
        lag = max(round(fs_hz / hz / 2), 1)
        powers = _powers(len(ecg), middle, fs_hz)[: most // 2]
        self._time_s = powers[1]
        wave = np.exp(2j * np.pi * hz * self._time_s)
        self._basis = np.array([x * power for power in powers for x in (wave.real, wave.imag)])
        self._ecg, self._known = _contrary(ecg, lag), _contrary(self._basis, lag)
        self._calm = ~np.convolve(~calm, np.ones(2 * lag + 1), "same").astype(bool)
        self._calm[:lag], self._calm[len(ecg) - lag :] = False, False

    def fit(self, from_s: float, to_s: float, freedom: int) -> _Fit:
        """By least squares to that part, with the first so many of the basis; zeros where the line is not clear."""
        here = self._calm & (from_s < self._time_s) & (self._time_s < to_s)
        values, known, basis = self._ecg[here], self._known[:freedom, here], self._basis[:freedom]
        free = len(values) - freedom
        if free < len(values) / 2:
            return _Fit(np.zeros(len(self._ecg)), np.inf)
        gram = np.einsum("an,bn->ab", known, known)  # a matrix product would wake other threads
        share = np.linalg.solve(gram, np.einsum("an,n->a", known, values))
        fitted = np.einsum("a,an->n", share, known)
        variance = float(np.sum((values - fitted) ** 2)) / free
        clear = float(np.sum(fitted**2)) > CLEAR * freedom * variance
        return _Fit(np.einsum("a,an->n", share, basis) if clear else np.zeros(len(self._ecg)), variance)


@lru_cache(maxsize=8)
def _powers(count: int, middle: int, fs_hz: float) -> Floats:
    """Of the time in s from the middle on, shape (CURVE // 2, n)."""
    time_s = (np.arange(count) - middle) / fs_hz
    return np.array([time_s**power for power in range(CURVE // 2)])


def _contrary(values: Floats, lag: int) -> Floats:
    """Each value less those half a turn of the line before and after it: waves slower than the line nearly vanish."""
    sides = np.arange(values.shape[-1])
    return values - (values.take(sides - lag, -1, mode="clip") + values.take(sides + lag, -1, mode="clip")) / 2
