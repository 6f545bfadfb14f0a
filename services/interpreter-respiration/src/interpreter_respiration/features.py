"""What a breathing signal says: breaths, their period, and whether it is one. Arrays are on the grid of 10 Hz.

Extremes are taken with a threshold from the signal's own spread, in the spirit of Khodadad et al. 2018. Counting alone
may halve or double a rate (8.8 for 12 /min in Sci Rep 2022), so it is compared with the autocorrelation.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.medians import median
from sense4hri.slow import GRID_HZ, runs, smoothed
from sense4hri.windows import windows

SMOOTH_S, WANDER_S = 0.3, 2.0  # what is faster than breathing, and what is slower
REACH = 1.3  # robust standard deviations that the signal leaves an extreme by before it is one: 0.46 of a sine
PERIOD_S = (1.2, 15.0)  # 4 to 50 breaths per min
SHORTEST = 0.85  # of the best autocorrelation that the shortest period has to reach
CLEAN = (0.4, 0.9, 1.0), (0.0, 0.97, 1.0)  # share of what moves the belt that is as slow as breathing, and its quality
ALIKE = (0.6, 0.85)  # likeness alone: quality 0 and 1
TREMOR_S = 0.1  # what is slower than this and faster than SMOOTH_S is no breathing, and much of a random walk
RHYTHM = (1.3, 2.6)  # likeness one period later over the share of tremor, which is 1 in a random walk: quality 0 and 1
OUTLYING, OUTLYING_MOST = 4.5, 0.25  # robust standard deviations that are no breath any more; share of time: quality 0
OUTLYING_TOPS = 2.0  # times the median top of a wave, below which it is none of these
STEP_S, SHARE_OF_TIME = 0.5, 0.05  # what is shorter is noise on a step; the fastest moments
ABRUPT = (0.38, 0.5)  # share of the way that it goes in these: quality 1 and 0; breaths with long pauses reach 0.4
# change of the level from one period to the next, in spreads of the waves, and its quality; from where it is told
WANDERS, WANDERS_TOLD = ((0.0, 2.0, 3.0), (1.0, 0.97, 0.5)), 2.3
SHIFTED = 2.7  # spreads of the waves that the level moves by in a shift of posture: the height of a sine is 1.9 of them
LONG, MOSTLY = 1.5, 0.75  # times the usual period where a breath may be missing; share of known periods, else it drifts
PERIODS = (1.0, 4.0)  # so many fit into the window: quality 0 and 1; that two are alike happens by chance
SMALL = 0.06  # of the usual breath's rise: less is noise, or the heart; of a breath a tenth as high at 20 /min 0.07
HIGH = 0.3  # of the usual breath's rise, from which a wave may be one (NeuroKit2, khodadad2018)
NEAR = 0.25  # share of the usual period by which one of even breathing differs at most
BOTTOM = 0.1  # of its height: noise in a pause before an inspiration stays below
NEAR_S = 1.0  # round the end of an inspiration: a cough is over by then
STEADY = 3.0  # spreads of a sample: a belt that moves less is not worn
SAME = 1e-9  # share by which means of one value may differ
AT_RAIL = 0.02  # of the range: so near an end of it a belt is saturated

Floats = NDArray[np.float64]


class Breath(NamedTuple):
    """One breath, by indices into the points it was found in.

    trough: begin of the inspiration; peak: its end; next_trough: end of the expiration, -1 where it is not known.
    """

    trough: int
    peak: int
    next_trough: int


def breathing(raw: Floats, wander_s: float = WANDER_S) -> Floats:
    """Return what is as fast as breathing: less noise, less wander. raw: shape (n,), without NaN."""
    level = smoothed(raw, SMOOTH_S)
    return level - smoothed(level, wander_s)


def spread_of(waves: Floats) -> float:
    """Return a standard deviation that sighs and movements do not raise; NaN of nothing."""
    return 1.4826 * median(np.abs(waves - median(waves))) if len(waves) else np.nan


def breaths(waves: Floats, reach: float = REACH) -> list[Breath]:
    """Return all breaths whose inspiration has begun and ended in waves, shape (n,), in order."""
    return _left_by(waves, reach * spread_of(waves))


def _left_by(waves: Floats, reach: float) -> list[Breath]:
    peaks, troughs = turns(waves, reach)
    found = []
    for peak in peaks:
        before = [trough for trough in troughs if trough < peak]
        after = [trough for trough in troughs if trough > peak]
        if before:
            found.append(Breath(before[-1], peak, after[0] if after else -1))
    return found


def raised(raw: Floats, waves: Floats, found: list[Breath]) -> list[Breath]:
    """Return the breaths in which the signal itself rises: waves swing back in a long pause, where it rests."""
    level = smoothed(raw, SMOOTH_S)
    return [breath for breath in found if level[breath.peak] > level[breath.trough]]


def with_smaller(raw: Floats, waves: Floats, found: list[Breath]) -> list[Breath]:
    """Return breaths together with the smaller waves between them: all that rise by SMALL of what these usually do."""
    if not found:
        return []
    level = smoothed(raw, SMOOTH_S)
    every = _left_by(waves, SMALL * usual_rise(waves, found))
    high = _rises(level, every) >= SMALL * median(_rises(level, found))
    return [breath for breath, is_high in zip(every, high, strict=True) if is_high]


def usual_rise(waves: Floats, found: list[Breath]) -> float:
    """Return how far the inspiration of a usual breath raises the waves, in their unit; NaN of no breath."""
    return median(_rises(waves, found)) if found else np.nan


def _rises(values: Floats, found: list[Breath]) -> Floats:
    return np.array([values[breath.peak] - values[breath.trough] for breath in found])


def high(waves: Floats, every: list[Breath], found: list[Breath]) -> list[Breath]:
    """Return those of every that rise by HIGH of what the breaths that were found usually do."""
    least = HIGH * usual_rise(waves, found)
    return [breath for breath in every if waves[breath.peak] - waves[breath.trough] >= least]


def evenness(found: list[Breath]) -> float:
    """Return the share of the periods of breaths that are about the usual one, 0..1; 0 of a single one."""
    return even_share(np.diff([breath.peak for breath in found]))


def even_share(periods: NDArray[Any]) -> float:
    """Return the share of periods, in any unit, that are about the usual one, 0..1; 0 of a single one."""
    return float(np.mean(np.abs(periods / median(periods) - 1) <= NEAR)) if len(periods) > 1 else 0.0


def turns(waves: Floats, reach: float) -> tuple[list[int], list[int]]:
    """Return (peaks, troughs): extremes that the signal left by more than reach."""
    ends: tuple[list[int], list[int]] = [], []
    up, best = True, 0
    values = waves.tolist()
    for i, value in enumerate(values):
        further = value - values[best] if up else values[best] - value
        if further > 0:
            best = i
        elif further < -reach:
            ends[not up].append(best)
            up, best = not up, i
    return ends


def autocorrelation(waves: Floats) -> tuple[float, float]:
    """Return (period in s, likeness one period later, -1 to 1); NaN and 0 where no period stands out."""
    longest = min(round(PERIOD_S[1] * GRID_HZ), len(waves) * 2 // 3)
    shortest = round(PERIOD_S[0] * GRID_HZ)
    centred = waves - waves.mean() if len(waves) else waves
    if longest <= shortest + 2:
        return np.nan, 0.0
    spectrum = np.fft.rfft(centred, 2 * len(centred))
    power = np.fft.irfft(spectrum * np.conj(spectrum))[: longest + 2]
    if not power[0] > 0:
        return np.nan, 0.0
    alike = power / power[0] * len(centred) / (len(centred) - np.arange(longest + 2))
    inside = np.arange(shortest, longest)
    tops = inside[(alike[inside] >= alike[inside - 1]) & (alike[inside] > alike[inside + 1])]
    if not len(tops) or alike[tops].max() <= 0:
        return np.nan, 0.0
    first = int(tops[alike[tops] >= SHORTEST * alike[tops].max()][0])
    return first / GRID_HZ, float(alike[first])


def clean_share(raw: Floats, spread: float) -> float:
    """Return how much of what moves the belt is as slow as breathing, 0..1. spread: of the samples behind a point."""
    waves = breathing(raw)
    noise = float(np.var(raw - smoothed(raw, TREMOR_S))) + (spread**2 if np.isfinite(spread) else 0.0) / 4
    slow = spread_of(waves) ** 2
    return slow / (slow + noise) if slow + noise > 0 else 0.0


def rhythm(raw: Floats, likeness: float) -> float:
    """Return how sure a rhythm is, 0..1: nearly the same again, or with little in it that is too fast for breathing."""
    tremor = spread_of(smoothed(raw, TREMOR_S) - smoothed(raw, SMOOTH_S))
    contrast = likeness * spread_of(breathing(raw)) / tremor if tremor > 0 else 0.0
    return max(rise(contrast, RHYTHM), rise(likeness, ALIKE))


def furthest(waves: Floats) -> float:
    """Return how far out a usual breath is at most: of many spreads, or the height of most breaths twice.

    Where a pause follows each breath, waves rest for most of the time and their spread is that of the pauses.
    """
    spread = spread_of(waves)
    tops = np.abs(waves[turns(waves, REACH * spread)[0]])
    return max(OUTLYING * spread, OUTLYING_TOPS * median(tops) if len(tops) else 0.0)


def outlying(waves: Floats) -> float:
    """Return the share of time in which the signal is further out than any usual breath."""
    return float(np.mean(np.abs(waves) > furthest(waves))) if len(waves) else 0.0


def abruptness(raw: Floats, waves: Floats) -> float:
    """Return the share of all its ups and downs that the signal makes in its fastest moments; 1 where it only steps.

    A chest takes its time: 5 % of the moments hold 8 % of a sine's way, up to 40 % of short breaths with long pauses.
    What is further out than any usual breath is left out: a movement hides breaths, and is none.
    """
    width = round(STEP_S * GRID_HZ)
    if len(raw) <= width:
        return 0.0
    level = np.median(windows(raw, width), axis=1)
    usual = (np.abs(waves) <= furthest(waves))[width // 2 :][: len(level)]
    ways = np.sort(np.abs(np.diff(level))[usual[1:] & usual[:-1]])[::-1]
    whole = float(ways.sum())
    return float(ways[: max(1, round(SHARE_OF_TIME * len(ways)))].sum()) / whole if whole > 0 else 0.0


def repeats(raw: Floats, period_s: float) -> float:
    """Return how sure a period is for being there again and again, 0..1."""
    return rise(len(raw) / GRID_HZ / period_s, PERIODS) if np.isfinite(period_s) else 0.0


def wander(raw: Floats, period_s: float) -> float:
    """Return how far the level moves from one period to the next, in spreads of the waves; 0 where none can be known.

    A belt's level drifts while its breaths stay as they are. What grows ever further with its period, as a random walk
    does and even more what falls steeper with the frequency, has waves of any period that are only a part of its way.
    """
    if not np.isfinite(period_s) or len(raw) <= 2 * period_s * GRID_HZ:
        return 0.0
    period, level, spread = round(period_s * GRID_HZ), smoothed(raw, period_s), spread_of(breathing(raw))
    moved = 1.4826 * median(np.abs(level[period:] - level[:-period]))
    return moved / spread if spread > 0 else 0.0


def shifted(raw: Floats, first: int, last: int) -> bool:
    """Return whether the level moves by more than a breath between two points of raw: a shift hides breaths."""
    span = last - first
    before, after = raw[max(0, first - span) : first + 1], raw[last : last + span]
    return abs(median(after) - median(before)) > SHIFTED * spread_of(breathing(raw))


def clipped(raw: Floats, low: float, high: float) -> float:
    """Return the share of points at an end of the range; of an unknown range, of the time it rests on its extremes."""
    if low < high:
        return float(np.mean((raw <= low + AT_RAIL / 4 * (high - low)) | (raw >= high - AT_RAIL / 4 * (high - low))))
    least = 1e-6 * float(np.ptp(raw))
    ends = (raw >= raw.max() - least) | (raw <= raw.min() + least)
    return float(np.mean(ends[1:] & ends[:-1]))


def returning(values: Floats, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the points that are held, shape (n,), are so at a value that is returned to: an end of a range.

    values: shape (n, columns). A device that repeats its last value repeats another one each time.
    """
    out, stretches = np.zeros(len(held), bool), runs(np.where(held, 0.0, np.nan))
    levels = values[np.array([stretch.start for stretch in stretches], int)]
    for stretch, level in zip(stretches, levels, strict=True):
        out[stretch] = np.isclose(levels, level, rtol=SAME, atol=0.0).all(axis=1).sum() > 1
    return out


def is_still(raw: Floats, spread: float) -> bool:
    """Return whether nothing but noise of this spread per sample moves the belt."""
    return float(np.ptp(smoothed(raw, SMOOTH_S))) <= STEADY * (spread if np.isfinite(spread) else 0.0)


def rmssd_ms(periods_s: Floats) -> float:
    """Return the root mean square of successive differences, shape (n,), NaN between holes; NaN with fewer than two."""
    steps = np.diff(periods_s)
    steps = steps[np.isfinite(steps)]
    return 1e3 * float(np.sqrt(np.mean(steps**2))) if len(steps) >= 2 else np.nan


def inspiration(raw: Floats, breath: Breath) -> tuple[float, float]:
    """Return where an inspiration begins and ends, between the points of raw: it leaves the bottom, and is at the top.

    The signal itself tells: in waves a quick inspiration and a slow expiration, or a pause, are nearly alike. That it
    has left the bottom is seen when it has risen by BOTTOM, of half a sine after a share of its time.
    """
    level = raw[breath.trough : max(breath.peak, breath.next_trough) + 1]
    end = int(np.argmax(level))
    if not end:
        return float(breath.trough), float(breath.trough)
    low, high = float(level[: end + 1].min()), float(level[end])
    limit = low + BOTTOM * (high - low)
    last = int(np.flatnonzero(level[:end] <= limit)[-1])
    risen = last + (limit - level[last]) / (level[last + 1] - level[last])
    begin = end - (end - risen) / (1 - np.arccos(1 - 2 * BOTTOM) / np.pi)
    return breath.trough + float(begin), float(breath.trough + end)


def heights(raw: Floats, found: list[Breath]) -> Floats:
    """Return how far each inspiration raises the signal, in its unit."""
    level = smoothed(raw, TREMOR_S)
    near = round(SMOOTH_S * GRID_HZ)
    tops = [level[max(0, breath.peak - near) : breath.peak + near + 1].max() for breath in found]
    bottoms = [level[max(0, breath.trough - near) : breath.trough + near + 1].min() for breath in found]
    return np.array(tops) - np.array(bottoms)


def steepness(raw: Floats, breath: Breath) -> float:
    """Return the most that the signal moves from one point to the next within NEAR_S of a breath, in its unit."""
    near = round(NEAR_S * GRID_HZ)
    return float(np.abs(np.diff(raw[max(0, breath.peak - near) : breath.peak + near + 1])).max(initial=0.0))


def rise(value: float, low_high: tuple[float, float]) -> float:
    """Return 0 up to low, 1 from high on, a straight line between."""
    low, high = low_high
    return float(np.clip((value - low) / (high - low), 0.0, 1.0))
