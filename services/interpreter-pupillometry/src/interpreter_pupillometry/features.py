"""What pupils say: which samples are pupils, their sizes drawn through blinks, cognitive activity. Stateless.

Kret & Sjak-Shie 2019 (Behavior Research Methods 51): range, dilation speed, margins of gaps, lone samples, deviation
from a trend, mean of the eyes with a corrected offset. Deviations: the limits come from the last seconds instead of
the whole recording; speed and deviation have a least limit, as quantised sizes have a spread of 0; gaps up to
`longest_gap_s`.
"""

from typing import NamedTuple

import numpy as np
import pywt
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

RANGE_MM = (1.5, 9.0)
SPREADS = 16.0  # median absolute deviations beyond the median that a pupil does not reach
LEAST_SPEED = 1.0  # of its size per s: no limit on speed is lower
LEAST_OFF = 0.02  # of its size: no limit on the deviation from the trend is lower
GAP_S, MARGIN_S = 0.075, 0.05  # beside a gap so long, samples so near are the lid
LONE_S, LONE_APART_S = 0.05, 0.04  # a shorter piece between gaps so long is none
TREND_S = 0.1  # over which the trend is smoothed
MOVING_S = 0.1  # of the mean whose extremes are told
DIFFERENCE = 0.954  # median step of noise over its standard deviation

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Pupils(NamedTuple):
    """Sizes, shape (n,) each: NaN where there is none. size: of the valid eyes; valid: measured, not drawn through."""

    left: Floats
    right: Floats
    size: Floats
    valid: Flags


def valid_sizes(sizes: Floats, times_ns: Times, mm: bool) -> Flags:
    """Return which samples of one eye, shape (n,), are a pupil: NaN, zeros, blinks and their margins are not."""
    low, high = RANGE_MM if mm else (0.0, np.inf)
    good = np.asarray(np.isfinite(sizes) & (sizes > low) & (sizes < high))
    if good.sum() < 3:
        return good
    level, seconds = float(np.median(sizes[good])), (times_ns - times_ns[0]) / SECOND_NS
    good = _not_faster(sizes, seconds, good, level)
    good = _without_margins(seconds, good)
    for _ in (1, 2):
        good = _near_trend(sizes, seconds, good, level)
    return _without_lone(seconds, good)


def _limit(values: Floats, least: float) -> float:
    middle = float(np.median(values))
    return max(least, middle + SPREADS * float(np.median(np.abs(values - middle))))


def _not_faster(sizes: Floats, seconds: Floats, good: Flags, level: float) -> Flags:
    """Without samples from or to which the size changes faster than all but a few do."""
    at = np.flatnonzero(good)
    steps = np.abs(np.diff(sizes[at])) / np.diff(seconds[at])
    speed = np.maximum(np.append(steps, 0.0), np.insert(steps, 0, 0.0))
    out = good.copy()
    out[at[speed > _limit(speed, LEAST_SPEED * level)]] = False
    return out


def _without_margins(seconds: Floats, good: Flags) -> Flags:
    """Return which samples are good and not near a gap: the lid hides part of the pupil before and after a blink."""
    at = np.flatnonzero(good)
    if len(at) < 2:
        return good
    gaps = np.flatnonzero(np.diff(seconds[at]) > GAP_S)
    begins, ends = seconds[at[gaps]], seconds[at[gaps + 1]]
    if not good[-1] and seconds[-1] - seconds[at[-1]] > GAP_S:
        begins = np.append(begins, seconds[at[-1]])
    if not good[0] and seconds[at[0]] - seconds[0] > GAP_S:
        ends = np.insert(ends, 0, seconds[at[0]])
    near = np.zeros(len(good), bool)
    for edges, sign in ((begins, -1), (ends, 1)):
        for edge in edges.tolist():
            low, high = sorted((edge, edge + sign * MARGIN_S))
            near[np.searchsorted(seconds, low - 1e-6) : np.searchsorted(seconds, high + 1e-6)] = True
    return np.asarray(good & ~near)


def _near_trend(sizes: Floats, seconds: Floats, good: Flags, level: float) -> Flags:
    """Without what is far from the smoothed line through all."""
    at = np.flatnonzero(good)
    period_s = float(np.median(np.diff(seconds))) if len(seconds) > 1 else np.inf
    width = round(TREND_S / period_s) // 2 * 2 + 1 if period_s > 0 else 1
    if width < 3 or len(at) < width:
        return good
    line = np.interp(seconds, seconds[at], sizes[at])
    padded = np.pad(line, width // 2, mode="edge")
    sums = np.concatenate([[0.0], np.cumsum(padded)])
    trend = (sums[width:] - sums[:-width]) / width
    off = np.abs(sizes - trend)
    out = good.copy()
    out[at] = off[at] <= _limit(off[at], LEAST_OFF * level)
    return out


def _without_lone(seconds: Floats, good: Flags) -> Flags:
    """Without short pieces that stand alone between gaps."""
    at = np.flatnonzero(good)
    if not len(at):
        return good
    cuts = np.flatnonzero(np.diff(seconds[at]) > LONE_APART_S) + 1
    period_s = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    if period_s > LONE_APART_S / 2:
        return good  # so slow that two samples are a gap
    out = good.copy()
    for piece in np.split(at, cuts):
        if len(cuts) and seconds[piece[-1]] - seconds[piece[0]] + period_s < LONE_S:
            out[piece] = False
    return out


def together(left: Floats, right: Floats, offset: float) -> Floats:
    """Return the mean of both eyes, NaN where lost; of one eye alone half the usual left less right is taken."""
    half = offset / 2 if np.isfinite(offset) else 0.0
    both = (left + right) / 2
    return np.where(np.isfinite(both), both, np.where(np.isfinite(left), left - half, right + half))


def noise_of(sizes: Floats) -> float:
    """Return the standard deviation of what changes from sample to sample; NaN for less than 3 of them."""
    steps = np.abs(np.diff(sizes[np.isfinite(sizes)]))
    return float(np.median(steps)) / DIFFERENCE if len(steps) > 1 else np.nan


def slope_per_s(sizes: Floats, times_ns: Times) -> float:
    """Return the slope of the straight line through sizes, per s; NaN for less than 3 of them."""
    use = np.isfinite(sizes)
    if use.sum() < 3:
        return np.nan
    seconds = (times_ns[use] - times_ns[use][0]) / SECOND_NS
    off = seconds - seconds.mean()
    spread = float(off @ off)
    return float(off @ sizes[use]) / spread if spread > 0 else np.nan


def extremes(sizes: Floats, fs_hz: float) -> tuple[float, float]:
    """Return (least, greatest) size after a moving mean of MOVING_S; NaN for too few samples."""
    use = sizes[np.isfinite(sizes)]
    width = max(1, round(MOVING_S * fs_hz))
    if len(use) < width:
        return np.nan, np.nan
    means = np.convolve(use, np.full(width, 1 / width), mode="valid")
    return float(means.min()), float(means.max())


def lhipa_per_s(sizes: Floats, seconds: float) -> float:
    """Return the low/high index of pupillary activity (Duchowski et al. 2020), 1/s; NaN for too few samples.

    sizes: shape (n,), evenly sampled over so many seconds, without NaN. Falls with cognitive load.
    """
    wavelet = pywt.Wavelet("sym16")
    deepest = pywt.dwt_max_level(len(sizes), wavelet.dec_len)
    low = deepest // 2
    if low < 2:
        return np.nan
    high_part = pywt.downcoef("d", sizes, wavelet, "periodization", level=1) / np.sqrt(2.0)
    low_part = pywt.downcoef("d", sizes, wavelet, "periodization", level=low) / np.sqrt(2.0**low)
    beside = high_part[np.minimum(np.arange(len(low_part)) * 2 ** (low - 1), len(high_part) - 1)]
    ratio = np.divide(low_part, beside, out=np.zeros(len(low_part)), where=beside != 0)
    maxima = _modulus_maxima(ratio)
    threshold = float(np.std(maxima)) * np.sqrt(2 * np.log2(max(2, len(maxima))))
    return float(np.sum((np.abs(maxima) <= threshold) & (maxima != 0))) / seconds


def _modulus_maxima(values: Floats) -> Floats:
    """Values whose modulus is not below that of either neighbour, and above one of them; 0 elsewhere."""
    size = np.abs(values)
    before, after = np.concatenate([[size[0]], size[:-1]]), np.concatenate([size[1:], [size[-1]]])
    top = (size >= before) & (size >= after) & ((size > before) | (size > after))
    return np.where(top, size, 0.0)


def quality(valid: float, noise: float, trend_per_min: float) -> float:
    """Return 0 to 1: share of valid samples, and how far noise and trend, as shares of the size, are from harmless."""
    trend = trend_per_min if np.isfinite(trend_per_min) else 0.0
    clean = 1 / (1 + (noise / 0.03) ** 2) if np.isfinite(noise) else 0.0
    return float(np.clip(valid * clean / (1 + (trend / 0.5) ** 2), 0.0, 1.0))
