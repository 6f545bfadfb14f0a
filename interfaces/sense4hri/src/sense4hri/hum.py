"""Mains hum, as it is round one moment of a signal: fitted there and taken away, nothing else touched. Imports no ROS.

A filter that takes 50 Hz away moves peaks or rings; a sine fitted over some seconds round a moment is the hum alone,
because nothing that lives keeps its phase for so long. Where sampling folds the mains to a lower frequency it is looked
for there.
"""

import numpy as np
from numpy.typing import NDArray

MAINS_HZ = (50.0, 60.0)
OFF_HZ = 0.5  # grids stay within this of their frequency
BESIDE_HZ = (-7.0, -5.0, -3.5, 3.5, 5.0, 7.0)  # what is as strong there is no hum
STANDS_OUT = 10.0  # times the amplitude beside it from which a line is hum
LEAST_S = 1.0
LOWEST_HZ = 1.0  # hum folded to less cannot be told from wander

Floats = NDArray[np.float64]


def folded_hz(hz: float, fs_hz: float) -> float:
    """Where a frequency appears after sampling at fs_hz without a filter before it."""
    return abs(hz - fs_hz * round(hz / fs_hz))


def hum(values: Floats, fs_hz: float) -> Floats:
    """The mains in evenly spaced values, shape (n,) and their unit; zeros where there is none.

    The fit is best in the middle; values shorter than LEAST_S are too few for one.
    """
    total = np.zeros(len(values))
    if len(values) < LEAST_S * fs_hz:
        return total
    taper: Floats = np.hanning(len(values) + 2)[1:-1].astype(np.float64)
    for mains_hz in MAINS_HZ:
        hz = folded_hz(mains_hz, fs_hz)
        if LOWEST_HZ < hz < fs_hz / 2 - LOWEST_HZ:
            total += _line(values - total, hz, fs_hz, taper)
    return total


def _line(values: Floats, hz: float, fs_hz: float, taper: Floats) -> Floats:
    """The sine near hz whose amplitude and phase drift evenly; zeros where nothing stands out there."""
    time_s: Floats = (np.arange(len(values), dtype=np.float64) - (len(values) - 1) / 2) / fs_hz
    strength = _amplitude(values, hz, time_s, taper)
    beside = [_amplitude(values, hz + off_hz, time_s, taper) for off_hz in BESIDE_HZ if hz + off_hz > LOWEST_HZ]
    if strength < STANDS_OUT * float(np.median(beside)):
        return np.zeros(len(values))
    hz += _offset_hz(values, hz, time_s, taper)
    wave = np.array([np.cos(2 * np.pi * hz * time_s), np.sin(2 * np.pi * hz * time_s)])
    basis = np.concatenate((wave, wave * time_s))
    weighted = basis * taper
    gram = np.array([[float(np.sum(a * b)) for b in basis] for a in weighted])  # a product would wake other threads
    share = np.linalg.solve(gram, np.array([float(np.sum(a * values)) for a in weighted]))
    return np.asarray((share[:, None] * basis).sum(axis=0))


def _amplitude(values: Floats, hz: float, time_s: Floats, taper: Floats) -> float:
    return 2 * abs(complex(np.sum(values * taper * np.exp(-2j * np.pi * hz * time_s)))) / float(taper.sum())


def _offset_hz(values: Floats, hz: float, time_s: Floats, taper: Floats) -> float:
    """How far from hz the line is, from the turn of its phase between the two halves."""
    turned = values * taper * np.exp(-2j * np.pi * hz * time_s)
    half = len(values) // 2
    first, second = np.sum(turned[:half]), np.sum(turned[half:])
    apart_s = float(time_s[half:] @ taper[half:]) / float(taper[half:].sum()) * 2
    offset_hz = float(np.angle(second * np.conj(first))) / (2 * np.pi * apart_s)
    return float(np.clip(offset_hz, -OFF_HZ, OFF_HZ))
