"""Breathing from what it does to heart beats: three waves made one, and how sure it is. Stateless, at 10 Hz.

Inspiration shortens the interval between beats (respiratory sinus arrhythmia, FM) and turns the heart against the
electrodes, which changes height and area of the QRS complex (AM). The wave is what these have most in common, their
first principal component. As in Smart Fusion (Karlen et al. 2013; Charlton et al. 2016) nothing is told without
agreement; deviation: not of the rates of three waves, but of ways to count in the one, which misses fewer breaths.
First each wave counts by how even it is, as Lázaro et al. (2013) weigh spectra by their peaks: a ventilator shows in
QRS complexes alone, and intervals without sinus arrhythmia only hide it. Breathing that is not even needs all alike.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.slow import GRID_HZ
from sense4hri.stamps import SECOND_NS

from interpreter_respiration.beats import Beat
from interpreter_respiration.features import Breath, autocorrelation, breathing, breaths, rise, spread_of

WANDER_S = 1.5  # what is slower than breathing; less than for a belt, as heart rate and posture wander more
REACHES = (0.5, 0.7, 0.9)  # robust standard deviations a wave is high for a breath; less than for a belt: it is weaker
OF_TOPS = 0.2  # of the upper quartile of its tops: a higher one may be a breath (Schäfer & Kratky 2008)
OUTLYING = 5.0  # robust standard deviations from which a beat is ectopic, or none
CLIPPED = 3.0  # robust standard deviations; a greater wave counts no more than this
RATES_APART = (0.5, 5.0)  # 1/min between the reaches: agreement 1 and 0
SURE = (0.0, 1.0)  # likeness or rhythm: quality 0 and 1
LEAST_ALIKE, LEAST_RHYTHM = 0.3, 0.3  # of a wave in which the most different ways of counting agree
RHYTHM_ALONE = 0.6  # the same, where only intervals or only QRS complexes show it: as even as a ventilator
ALIKE_ALONE = 0.4  # where only the reaches agree: breathing that is not even
WEIGHED_RHYTHM = 0.4  # as LEAST_RHYTHM, where even waves count more: the evenest of three is even by chance sooner
CLOSE, CLOSE_RHYTHM = 0.5, 0.5  # 1/min between all ways of counting that leave no breath in doubt, and rhythm for it
LEAST_WEIGHT = 0.05  # of a wave without rhythm
SLOW_WANDER_S = 4.0  # what is slower than the slowest breathing
SLOW_PER_MIN, SLOW_APART = 10.0, 1.0  # rates below have to be those of the slow wave too, to so much
OWN, HALF = 0.15, 0.1  # how near, as a share, to the rate told and to half of it
LOUDER = 1.8  # times the power at the rate told, of the wave at half of it whose overtone that is; else up to 1.5
APART, REACHES_APART = 1.5, 1.0  # 1/min between all ways of counting, and between the reaches, that agree

Floats = NDArray[np.float64]


class Fused(NamedTuple):
    """One wave, up where lungs are full, with its breaths; times_ns: of its points.

    rates_per_min: by each of REACHES; counted_per_min: by `counted_per_min`; both NaN with too few breaths. likeness:
    mean correlation, 0 to 1, of the intervals with height and area of the beats; rhythm: likeness of the wave one
    period later, up to 1. weighed: even waves count more in it.
    """

    times_ns: NDArray[np.int64]
    wave: Floats
    breaths: list[Breath]
    rates_per_min: tuple[float, ...]
    counted_per_min: float
    likeness: float
    rhythm: float
    weighed: bool


def told_per_min(seen: Fused) -> float:
    """Return the rate, NaN where too little agrees: all ways of counting in an even wave, or the reaches in another."""
    every = (*seen.rates_per_min, seen.counted_per_min)
    if np.ptp(every) <= APART and _is_even(seen, float(np.ptp(every))):
        return float(np.mean(every))
    if np.ptp(seen.rates_per_min) <= REACHES_APART and seen.likeness >= ALIKE_ALONE and not seen.weighed:
        return float(np.mean(seen.rates_per_min))
    return np.nan


def _is_even(seen: Fused, apart_per_min: float) -> bool:
    """Whether a wave is even enough for what intervals and QRS complexes share, and for how all counts agree."""
    if seen.likeness >= LEAST_ALIKE and seen.rhythm >= (WEIGHED_RHYTHM if seen.weighed else LEAST_RHYTHM):
        return True
    return seen.rhythm >= (CLOSE_RHYTHM if seen.weighed and apart_per_min <= CLOSE else RHYTHM_ALONE)


def unclear(seen: Fused) -> str:
    """Return in words how far the ways of counting are apart, where no rate is told of them."""
    every = (*seen.rates_per_min, seen.counted_per_min)
    if not np.isfinite(every).all():
        return "beats do not show three breaths clearly"
    return f"beats do not show clearly what is a breath: {min(every):.1f} to {max(every):.1f} /min"


def usual(values: Floats) -> NDArray[np.bool_]:
    """Return which values are no outliers."""
    spread = spread_of(values)
    return (
        np.asarray(np.abs(values - np.median(values)) <= OUTLYING * spread)
        if spread > 0
        else np.ones(len(values), bool)
    )


def fused(beats: Sequence[Beat], begin_ns: int, end_ns: int) -> Fused:
    """Return what beats between two times, each with the interval before it, show of breathing.

    The more even of the three waves count more, where a rate is told of that; else all alike.
    """
    times_ns, waves = _waves(beats, begin_ns, end_ns, WANDER_S)
    likeness = float(np.mean([abs(_correlation(waves[0], other)) for other in waves[1:]]))
    weighed = _seen(times_ns, _weighed(waves), likeness, weighed=True)
    if np.isfinite(told_per_min(weighed)):
        return weighed
    return _seen(times_ns, _common(waves), likeness, weighed=False)


def slower_per_min(beats: Sequence[Beat], at_per_min: float) -> float:
    """Return the rate of the slow wave, where the one told is too fast, or its overtone; NaN where it is right.

    WANDER_S takes four fifths of a breath of 13 s away and a third of its overtone: noise is a breath more then, and a
    breath with a pause has two tops.
    """
    wave = _weighed(_waves(beats, beats[0].time_ns, beats[-1].time_ns, SLOW_WANDER_S)[1])
    if at_per_min < SLOW_PER_MIN:
        slow_per_min = 60 / autocorrelation(wave)[0]
        return slow_per_min if abs(at_per_min - slow_per_min) > SLOW_APART else np.nan
    size = 8 << len(wave).bit_length()
    power = np.abs(np.fft.rfft(wave * np.hanning(len(wave)), size)) ** 2
    per_min = np.fft.rfftfreq(size, 1 / GRID_HZ) * 60
    half = np.abs(2 * per_min / at_per_min - 1) <= HALF
    own = np.abs(per_min / at_per_min - 1) <= OWN
    return at_per_min / 2 if power[half].max(initial=0.0) > LOUDER * power[own].max(initial=0.0) else np.nan


def _waves(beats: Sequence[Beat], begin_ns: int, end_ns: int, wander_s: float) -> tuple[NDArray[np.int64], Floats]:
    """(times of the grid, waves of intervals, heights and areas of the beats, shape (3, n)) without a slower wander."""
    times_ns = np.arange(begin_ns, end_ns, round(SECOND_NS / GRID_HZ))
    ends_s = np.array([(beat.time_ns - begin_ns) / SECOND_NS for beat in beats])
    before_s, heights, areas = np.array([(beat.interval_s, beat.height, beat.area) for beat in beats]).T
    grid_s = (times_ns - begin_ns) / SECOND_NS
    shown = (ends_s - before_s / 2, -before_s), (ends_s, heights), (ends_s, areas)
    return times_ns, np.array([_wave(at_s, values, grid_s, wander_s) for at_s, values in shown])


def _seen(times_ns: NDArray[np.int64], wave: Floats, likeness: float, *, weighed: bool) -> Fused:
    """The breaths in a wave, and how even it is."""
    found = [breaths(wave, reach) for reach in REACHES]
    rates = tuple(rate_per_min(each) for each in found)
    rhythm, middle = autocorrelation(wave)[1], found[len(REACHES) // 2]
    return Fused(times_ns, wave, middle, rates, counted_per_min(wave), likeness, rhythm, weighed)


def _weighed(waves: Floats) -> Floats:
    """What waves have most in common where even ones count more, shape (n,)."""
    return _common(waves * np.array([max(autocorrelation(wave)[1], LEAST_WEIGHT) for wave in waves])[:, None])


def _common(waves: Floats) -> Floats:
    """What waves, shape (k, n), have most in common, shape (n,), in the direction of the first."""
    weights = np.linalg.eigh(waves @ waves.T)[1][:, -1]
    return np.asarray((weights if weights[0] >= 0 else -weights) @ waves)


def _wave(at_s: Floats, values: Floats, grid_s: Floats, wander_s: float) -> Floats:
    """What breathes in values at uneven times, on the grid, in robust standard deviations."""
    at_s, values = at_s[np.isfinite(values)], values[np.isfinite(values)]
    good = usual(values)
    wave = breathing(np.interp(grid_s, at_s[good], values[good]), wander_s)
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


def counted_per_min(wave: Floats) -> float:
    """Return the rate by Schäfer & Kratky's count of 2008: from top to top with one bottom below zero between.

    Where there are several, or none, it is no breath and left out; NaN with fewer than two.
    """
    turns = np.flatnonzero(np.diff(np.sign(np.diff(wave)))) + 1
    is_top = wave[turns] > wave[turns - 1]
    tops, bottoms = turns[is_top], turns[~is_top & (wave[turns] < 0)]
    if not len(tops):
        return np.nan
    tops = tops[wave[tops] > OF_TOPS * np.quantile(wave[tops], 0.75)]
    periods = np.diff(tops)[np.diff(np.searchsorted(bottoms, tops)) == 1]
    return 60 * GRID_HZ / float(periods.mean()) if len(periods) > 1 else np.nan


def agreement(rates_per_min: Sequence[float]) -> float:
    """Return 1 where the rate does not depend on the reach, 0 where it does by 5 /min."""
    apart = float(np.ptp(rates_per_min))
    return 1 - rise(apart, RATES_APART) if np.isfinite(apart) else 0.0
