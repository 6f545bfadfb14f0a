"""Mains hum, as it is round one moment of a signal: fitted there and taken away, nothing else touched. Imports no ROS.

A filter that takes 50 Hz away moves peaks or rings; a sine fitted over some seconds round a moment is the hum alone,
because nothing that lives keeps its phase for so long. Where sampling folds the mains to a lower frequency it is looked
for there.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sense4hri.medians import medians

MAINS_HZ = (50.0, 60.0)
OFF_HZ = 0.5  # grids stay within this of their frequency
BESIDE_HZ = (-7.0, -5.0, -3.5, 3.5, 5.0, 7.0)  # what is as strong there is no hum
STANDS_OUT = 10.0  # times the amplitude beside it from which a line is hum
LEAST_S = 1.0
LOWEST_HZ = 1.0  # hum folded to less cannot be told from wander

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def folded_hz(hz: float, fs_hz: float) -> float:
    """Where a frequency appears after sampling at fs_hz without a filter before it."""
    return abs(hz - fs_hz * round(hz / fs_hz))


def folds_hz(fs_hz: float) -> list[float]:
    """Where sampling at fs_hz shows the mains at another frequency than their own; empty where it does not."""
    return [hz for mains_hz in MAINS_HZ if (hz := folded_hz(mains_hz, fs_hz)) < mains_hz]


def hum(
    values: Floats, fs_hz: float, folded_stands_out: float = STANDS_OUT, mains: Sequence[float] = MAINS_HZ
) -> Floats:
    """The mains in evenly spaced values, shape (n,) or (n, channels) and their unit; zeros where there is none.

    The fit is best in the middle; values shorter than LEAST_S are too few for one. folded_stands_out: times the
    amplitude beside it from which a line is hum at a frequency that is not the mains' own. mains: in Hz, looked for.
    """
    rows = np.atleast_2d(values.T)
    total = np.zeros(rows.shape)
    count = rows.shape[1]
    if count < LEAST_S * fs_hz:
        return np.zeros(values.shape)
    for mains_hz in mains:
        hz = folded_hz(mains_hz, fs_hz)
        if LOWEST_HZ < hz < fs_hz / 2 - LOWEST_HZ:
            least = folded_stands_out if hz < mains_hz else STANDS_OUT
            total += _lines(rows - total, hz, fs_hz, least)
    return total.T.reshape(values.shape)


def offset_hz(line: Floats, hz: float, fs_hz: float) -> float:
    """How far from hz a line, shape (n,), is."""
    time_s, taper = _times_s(len(line), fs_hz), _taper(len(line))
    return float(offsets_hz(line[None] * taper, hz, time_s, taper)[0])


def _lines(rows: Floats, hz: float, fs_hz: float, stands_out: float) -> Floats:
    """The sine near hz in each row, amplitude and phase drifting evenly; zeros where nothing stands out there."""
    count = rows.shape[1]
    waves = _waves(hz, fs_hz, count)
    strength = np.array([np.abs(np.add.reduce(row * waves, axis=-1)) for row in rows])
    found = np.flatnonzero(~(strength[:, 0] < stands_out * medians(strength[:, 1:])))
    lines = np.zeros(rows.shape)
    if len(found):
        time_s, taper = _times_s(count, fs_hz), _taper(count)
        lines[found] = _fitted(rows[found], hz + offsets_hz(rows[found] * taper, hz, time_s, taper), time_s, taper)
    return lines


@lru_cache(maxsize=8)
def _waves(hz: float, fs_hz: float, count: int) -> Complexes:
    """What makes a sum of products an amplitude: a row for hz, then those beside it."""
    taper = _taper(count)
    near_hz = [hz, *(hz + off_hz for off_hz in BESIDE_HZ if hz + off_hz > LOWEST_HZ)]
    turns = -2j * np.pi * _times_s(count, fs_hz)
    return np.asarray(2 / float(taper.sum()) * taper * np.exp(np.multiply.outer(near_hz, turns)))


@lru_cache(maxsize=8)
def _taper(count: int) -> Floats:
    return np.hanning(count + 2)[1:-1].astype(np.float64)


def _times_s(count: int, fs_hz: float) -> Floats:
    """Return the times of so many samples in s, 0 in the middle of them."""
    return (np.arange(count, dtype=np.float64) - (count - 1) / 2) / fs_hz


def _fitted(rows: Floats, hz: Floats, time_s: Floats, taper: Floats) -> Floats:
    """Each row's own sine at its own frequency; both that sine and its drift are fitted by least squares."""
    turn = 2 * np.pi * hz[:, None] * time_s
    wave = [np.cos(turn), np.sin(turn)]
    basis = np.stack([*wave, *(part * time_s for part in wave)])
    weighted = basis * taper
    total = np.add.reduce  # a matrix product would wake other threads
    gram = np.array([[total(a * b, axis=-1) for b in basis] for a in weighted])
    known = np.array([total(a * rows, axis=-1) for a in weighted])
    share = np.linalg.solve(np.moveaxis(gram, 2, 0), known.T[:, :, None])[:, :, 0]
    return np.asarray((share.T[:, :, None] * basis).sum(axis=0))


def offsets_hz(tapered: Floats, hz: float, time_s: Floats, taper: Floats) -> Floats:
    """How far from hz each row's line is, from the turn of its phase between the two halves."""
    turned = tapered * np.exp(-2j * np.pi * hz * time_s)
    half = len(time_s) // 2
    first, second = np.sum(turned[:, :half], axis=-1), np.sum(turned[:, half:], axis=-1)
    apart_s = float(time_s[half:] @ taper[half:]) / float(taper[half:].sum()) * 2
    offsets_hz = np.angle(second * np.conj(first)) / (2 * np.pi * apart_s)
    return np.asarray(np.clip(offsets_hz, -OFF_HZ, OFF_HZ))
