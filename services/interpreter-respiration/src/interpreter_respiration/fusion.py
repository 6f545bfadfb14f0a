"""Breathing from what it does to heart beats: three waves made one, and whether they agree. Stateless, at 10 Hz.

Inspiration shortens the interval between beats (respiratory sinus arrhythmia, FM) and turns the heart against the
electrodes, which changes height and area of the QRS complex (AM). As in Smart Fusion (Karlen et al. 2013; Charlton et
al. 2016) nothing is told where these disagree. Deviation: not three rates but three waves are fused, which finds
breaths that a single one misses, and the rate must not depend on how high a wave has to be for a breath.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.slow import GRID_HZ
from sense4hri.stamps import SECOND_NS

from interpreter_respiration.beats import Beat
from interpreter_respiration.features import Breath, breathing, breaths, rise, spread_of

WANDER_S = 1.5  # what is slower than breathing; less than for a belt, as heart rate and posture wander more
REACHES = (0.5, 0.7, 0.9)  # robust standard deviations a wave is high for a breath; less than for a belt: it is weaker
OUTLYING = 5.0  # robust standard deviations from which a beat is ectopic, or none
CLIPPED = 3.0  # robust standard deviations; a greater wave counts no more than this
RATES_APART = (0.5, 3.0)  # 1/min between the reaches: agreement 1 and 0
ALIKE = (0.1, 0.9)  # correlation of the waves: likeness 0 and 1

Floats = NDArray[np.float64]


class Fused(NamedTuple):
    """One wave, up where lungs are full, with its breaths; times_ns: of its points.

    rates_per_min: by each of REACHES, NaN with fewer than three breaths; likeness: mean correlation, 0 to 1, of the
    intervals with height and area of the beats.
    """

    times_ns: NDArray[np.int64]
    wave: Floats
    breaths: list[Breath]
    rates_per_min: tuple[float, ...]
    likeness: float


def usual(values: Floats) -> NDArray[np.bool_]:
    """Return which values are no outliers."""
    spread = spread_of(values)
    return (
        np.asarray(np.abs(values - np.median(values)) <= OUTLYING * spread)
        if spread > 0
        else np.ones(len(values), bool)
    )


def fused(beats: Sequence[Beat], begin_ns: int, end_ns: int) -> Fused:
    """Return what beats between two times, each with the interval before it, show of breathing."""
    times_ns = np.arange(begin_ns, end_ns, round(SECOND_NS / GRID_HZ))
    ends_s = np.array([(beat.time_ns - begin_ns) / SECOND_NS for beat in beats])
    intervals_s = np.array([beat.interval_s for beat in beats])
    heights, areas = (np.array([getattr(beat, name) for beat in beats]) for name in ("height", "area"))
    grid_s = (times_ns - begin_ns) / SECOND_NS
    heart = _wave(ends_s - intervals_s / 2, -intervals_s, grid_s)
    others = [_wave(ends_s, values, grid_s) for values in (heights, areas)]
    alike = [_correlation(heart, other) for other in others]
    wave = heart + sum(np.sign(r) * other for r, other in zip(alike, others, strict=True))
    found = [breaths(wave, reach) for reach in REACHES]
    rates = tuple(rate_per_min(each) for each in found)
    return Fused(times_ns, wave, found[len(REACHES) // 2], rates, float(np.mean(np.abs(alike))))


def _wave(at_s: Floats, values: Floats, grid_s: Floats) -> Floats:
    """What breathes in values at uneven times, on the grid, in robust standard deviations."""
    good = usual(values)
    wave = breathing(np.interp(grid_s, at_s[good], values[good]), WANDER_S)
    spread = spread_of(wave)
    return np.clip(wave / spread, -CLIPPED, CLIPPED) if spread > 0 else np.zeros(len(grid_s))


def _correlation(one: Floats, other: Floats) -> float:
    power = float((one @ one) * (other @ other))
    return float(one @ other) / np.sqrt(power) if power > 0 else 0.0


def rate_per_min(found: Sequence[Breath]) -> float:
    """Return the rate from the mean time between the ends of inspiration; NaN with fewer than three."""
    if len(found) < 3:
        return np.nan
    return 60 * GRID_HZ * (len(found) - 1) / (found[-1].peak - found[0].peak)


def agreement(rates_per_min: Sequence[float]) -> float:
    """Return 1 where the rate does not depend on the reach, 0 where it does by 3 /min."""
    apart = float(np.ptp(rates_per_min))
    return 1 - rise(apart, RATES_APART) if np.isfinite(apart) else 0.0
