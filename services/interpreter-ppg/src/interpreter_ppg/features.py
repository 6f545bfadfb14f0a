"""Photoplethysmogram to pulses, amplitude and quality: arrays in, numbers out.

A pulse is timed at the steepest point of its systolic rise, the fiducial that noise, baseline and the shape of the
crest disturb least (Hemon & Phillips 2016, Comput Biol Med 77:134; Peralta et al. 2019, Physiol Meas 40:025007).
The slope is taken with derivatives of Gaussians (Lindeberg 1994, J Appl Stat 21:225): symmetric, so that no delay
depends on the heart rate, and blind to a constant, so that a DC level of 1e6 counts does no harm.
"""

from bisect import bisect
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from sense4hri.hum import hum
from sense4hri.medians import median, medians, quantile
from sense4hri.motion import Moved

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

DETECTION_SCALE_S = 0.07  # dicrotic waves and quantisation steps melt away, the rises of 220 pulses a minute do not
TIMING_SCALE_S = 0.06  # best agreement with ECG, other sites and the sensor's own intervals of 0.04 to 0.07
REACH = 3.5  # kernels end at this many scales
SLOWEST_BPM = 27.0  # slower is breathing or movement more likely than a heart
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 60 / 240, 60 / SLOWEST_BPM
REFRACTORY_S = 0.22  # no heart beats again sooner
HALF_PERIOD_CORRELATION = 0.5  # share of the best correlation that makes a shorter lag the period
VALLEY_S = 0.75  # how far round a maximum of the slope its valleys are sought
BREATH_S = 1.2  # slopes that change more slowly are those of breathing
CREST_WEIGHT = 0.15  # of the second sign of polarity
FOOT_S, CREST_S = 0.35, 0.45  # a pulse's foot and crest lie this close to its steepest rise
CROWD_SHARE = 0.7  # of a pulse's height, from which a wave beside it counts
POP_S, POP_SHARE = 0.2, 0.5  # a single sample this close to a maximum that makes this share of it
FASTEST_BPM = 245.0  # no heart rate
ROUNDING = 1e-6  # of the signal's range, per second: slopes below are a flat line
NOISE_WINDOW_S = 3.0  # of signal to see its noise in
# The median of the fourth differences of white noise, and of its means of two, in its rms.
NOISE_4TH = 0.6745 * np.sqrt((70, 7))
STEPS_SHARE = (0.1, 0.3)  # of the motion's power at the rate of the pulses, from which they may be, and must be, steps
# Alike waves: intervals of either kind, the longest mean, how much one kind varies and the other does not.
LEAST_OF_A_KIND, SLOWEST_DOUBLE_MS, LEAST_VARIED_MS, MUCH_STEADIER = 7, 700.0, 5.0, 0.3
# Two intervals that are one: which is a whole one, how much of it either is at most and how near their sum comes, how
# unequal they are, and how far they take the rate.
WHOLE_QUANTILE, SPLIT_SHARE, SPLIT_OFF, SPLIT_RATIO, MOVED_BPM = 0.75, 0.7, 0.15, 1.1, 3.0
ALTERNATING = 1.4  # ratio of an interval to the next, either way, in half of the pairs: 1.2 in fibrillation
# How far half of the intervals are off the mean of those beside them, share of the usual one, and of how many at least:
# up to 0.09 where breathing makes an RMSSD of 100 ms, 0.1 to 0.4 in fibrillation.
IRREGULAR, FEWEST_BESIDE = 0.125, 4
# Of the heights' median the lowest pulse has at most, and of the intervals are not trusted, where two rhythms cancel.
VANISHED, UNLIKE_SHARE = 0.4, 0.15
# The mean pulse: in so many phases, of so many intervals at least, and its overtones up to this one. Together they are
# at least 0.25 of the first one in the pulses of fingers, ears and arms, 0.13 in sines that wax and wane.
PHASES, FEWEST_TURNS, HIGHEST_OVERTONE, LEAST_OVERTONES = np.arange(32) / 32, 3, 4, 0.17
SHAPE_S = np.arange(-0.25, 0.451, 0.02)  # where the shape of a pulse is compared
ALIKE, UNLIKE = 0.97, 0.70  # correlations of a pulse with the template that mean quality 1 and 0


def scale(at_least_s: float, fs_hz: float) -> float:
    """Return the Gaussian scale in s to use at fs_hz: no narrower than the sampling can carry."""
    return max(at_least_s, 1.0 / fs_hz)


def slope(ppg: Floats, fs_hz: float) -> Floats:
    """Return the smoothed slope of ppg, shape (n,), in its unit per second; the last REACH scales are provisional."""
    kernel = _slope_kernel(fs_hz)
    half, level = len(kernel) // 2, ppg - ppg[0]
    return np.convolve(np.concatenate([np.zeros(half), level, np.full(half, level[-1])]), kernel, "valid")


@lru_cache(maxsize=4)
def _slope_kernel(fs_hz: float) -> Floats:
    """Return what a signal is convolved with to be its smoothed slope."""
    scale_s = scale(DETECTION_SCALE_S, fs_hz)
    half = max(1, int(np.ceil(REACH * scale_s * fs_hz)))
    t = np.arange(-half, half + 1) / fs_hz
    kernel = -t * np.exp(-0.5 * (t / scale_s) ** 2)
    return np.asarray(kernel / -np.sum(kernel * t))


def steady(ppg_slope: Floats, fs_hz: float) -> Floats:
    """Return the slope without that of breathing and drift: less its mean over BREATH_S."""
    half = max(1, int(0.5 * BREATH_S * fs_hz))
    padded = np.concatenate([np.full(half, ppg_slope[0]), ppg_slope, np.full(half, ppg_slope[-1])])
    return ppg_slope - np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), "valid")


def period(ppg_slope: Floats, fs_hz: float) -> tuple[float, float]:
    """Return the pulse period in s and how periodic the slope is (autocorrelation, 0..1); (nan, 0) where it is not.

    The shortest lag whose correlation is not far below the best: breathing and alternation make multiples of the
    period look better, while dicrotic waves do not reach this share at half of it.
    """
    n = len(ppg_slope)
    shortest, longest = int(SHORTEST_PERIOD_S * fs_hz), min(int(LONGEST_PERIOD_S * fs_hz), (2 * n) // 3)
    if longest < shortest + 3:
        return np.nan, 0.0
    limit = typical_rise(ppg_slope, fs_hz, 0.8)  # an artefact must not outweigh the pulses
    limited = ppg_slope.clip(-limit, limit)
    spectrum = np.fft.rfft(limited - limited.mean(), 1 << (2 * n - 1).bit_length())
    correlation = np.fft.irfft(spectrum.real**2 + spectrum.imag**2)[: longest + 2]
    if not correlation[0] > 0:
        return np.nan, 0.0
    correlation *= n / (correlation[0] * (n - np.arange(longest + 2)))
    lags = maxima(correlation[shortest - 1 :]) + shortest - 1
    lags = lags[correlation[lags] > 0]
    if len(lags) == 0:
        return np.nan, 0.0
    best = lags[correlation[lags] >= HALF_PERIOD_CORRELATION * correlation[lags].max()][0]
    return float(best / fs_hz), float(min(correlation[best], 1.0))


def polarity_evidence(ppg: Floats, ppg_slope: Floats, fs_hz: float, bin_s: float = 1.6) -> float:
    """Return > 0 where blood volume raises the signal, < 0 where it is upside down (as from reflected light).

    A pulse rises faster than it falls and is a crest on a longer base: the logarithms of both ratios, the second with
    less weight because broad crests occur. The median over bins: single artefacts do not count.
    """
    size = int(bin_s * fs_hz)
    slopes = ppg_slope[len(ppg_slope) % size :].reshape(-1, size)
    levels = without_trend(ppg[len(ppg) % size :].reshape(-1, size))
    middle = medians(levels)
    up = np.array([slopes.max(axis=1), levels.max(axis=1) - middle])
    down = np.array([-slopes.min(axis=1), middle - levels.min(axis=1)])
    of_slopes, of_levels = _log_ratio(up, down)
    return median(of_slopes + CREST_WEIGHT * of_levels) if len(middle) else 0.0


def without_trend(levels: Floats) -> Floats:
    """Return every row of levels, shape (n, m), less its straight line."""
    t = np.arange(levels.shape[1]) - (levels.shape[1] - 1) / 2
    centred = levels - levels.mean(axis=1, keepdims=True)
    return centred - (centred @ t / (t @ t))[:, None] * t


def _log_ratio(up: Floats, down: Floats) -> Floats:
    """log(up / down), 0 where one of them is not positive."""
    use = (up > 0) & (down > 0)
    return np.log(np.where(use, up, 1.0) / np.where(use, down, 1.0))


def typical_rise(ppg_slope: Floats, fs_hz: float, period_s: float) -> float:
    """Return the typical height of a pulse in the slope: the median range over bins of a little more than a period."""
    size = max(2, min(len(ppg_slope), int(1.2 * period_s * fs_hz)))
    bins = ppg_slope[len(ppg_slope) % size :].reshape(-1, size)
    return median(bins.max(axis=1) - bins.min(axis=1))


def apart(period_s: float) -> float:
    """Return how far apart in s two pulses are at least: premature ones come early, dicrotic waves earlier still."""
    return max(REFRACTORY_S, 0.45 * min(period_s, 1.0))


def maxima(values: Floats) -> Ints:
    """Return the indices of the local maxima of values; a summit may be two samples wide, a plateau is none."""
    found = ((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])).nonzero()[0] + 1
    level = values[found] == values[found + 1]
    if np.count_nonzero(level):
        beyond = np.append(values, -np.inf)[found + 2]
        found = found[~level | (values[found + 1] > beyond)]
    return found


def rises(ppg_slope: Floats, fs_hz: float, period_s: float) -> Ints:
    """Return the indices of the maxima of the slope that have no greater one closer than two pulses can be."""
    indices = maxima(ppg_slope)
    distance = apart(period_s) * fs_hz
    kept: list[int] = []
    for index in indices[np.argsort(-ppg_slope[indices], kind="stable")].tolist():
        at = bisect(kept, index)
        if all(abs(index - other) >= distance for other in kept[max(0, at - 1) : at + 1]):
            kept.insert(at, index)
    return np.array(kept, np.intp)


def prominence(ppg_slope: Floats, index: int, fs_hz: float) -> float:
    """Return the height of a maximum above the higher one of the valleys beside it, within VALLEY_S, in its unit."""
    reach = max(1, int(VALLEY_S * fs_hz))
    top = ppg_slope[index]
    valleys = []
    for side in (ppg_slope[max(0, index - reach) : index][::-1], ppg_slope[index + 1 : index + reach + 1]):
        higher = (side > top).nonzero()[0]
        valley = side[: higher[0]] if len(higher) else side
        valleys.append(min(top, valley.min()) if len(valley) else top)
    return float(top - max(valleys))


def crowded(ppg_slope: Floats, index: int, fs_hz: float, height: float) -> bool:
    """Return whether a maximum of this height has one nearly as high within REFRACTORY_S: tremor and hum, no heart."""
    reach = int(REFRACTORY_S * fs_hz)
    start = max(0, index - reach)
    near = maxima(ppg_slope[start : index + reach + 2]) + start
    others = [i for i in near.tolist() if 0 < abs(i - index) <= reach]
    return any(prominence(ppg_slope, i, fs_hz) >= CROWD_SHARE * height for i in others)


def is_pop(ppg: Floats, index: int, fs_hz: float, height: float) -> bool:
    """Return whether a maximum of the slope of this prominence comes from one sample above its neighbours.

    Smoothed, such a sample is the derivative of a Gaussian: its two extremes are 2 exp(-1/2) / sqrt(2 pi) apart.
    """
    scale_s = scale(DETECTION_SCALE_S, fs_hz)
    near = ppg[max(0, index - int(POP_S * fs_hz)) : index + int(POP_S * fs_hz) + 2]
    if len(near) < 3:
        return False
    above = float((near[1:-1] - np.maximum(near[:-2], near[2:])).max())
    return 2 * 0.242 * above / (fs_hz * scale_s**2) >= POP_SHARE * height


def steepest(ppg: Floats, times_s: Floats, near_s: float, fs_hz: float) -> float:
    """Return when, in s, ppg rises most steeply near near_s, to a small fraction of the sampling interval.

    Newton's method on the derivatives of the Gaussian-smoothed signal, which exist at any time between the samples.
    """
    scale_s = scale(TIMING_SCALE_S, fs_hz)
    margin_s = REACH * scale_s + 0.06
    inside = slice(*times_s.searchsorted((near_s - margin_s, near_s + margin_s)))
    x, times_s = ppg[inside] - ppg[inside].mean(), times_s[inside]
    t = near_s
    for _ in range(6):
        u = (times_s - t) / scale_s
        squares = u * u
        weighted = x * np.exp(-0.5 * squares)
        bend, change = (weighted * (squares - 1)).sum(), (weighted * (u**3 - 3 * u)).sum() / scale_s
        if not change < 0:
            break  # not at a maximum of the slope
        step_s = min(max(float(-bend / change), -0.02), 0.02)
        t += step_s
        if abs(step_s) < 1e-6:
            return t if abs(t - near_s) <= 0.06 else near_s
    return near_s


def sample_noise(ppg: Floats, fs_hz: float) -> float:
    """Return the rms of the white noise in the newest of evenly spaced samples, shape (n,), in their unit.

    Fourth differences: pulses hardly have any, and most of the time none, hence the median. What one sample more or
    less says of quantisation is noise too. Mains are none: what is left of them above 12 Hz moves no pulse. At half
    the sampling rate, where none can be fitted, they are gone from the means of two neighbours: the smaller one counts.
    """
    newest = ppg[-round(NOISE_WINDOW_S * fs_hz) :]
    noise = newest - hum(newest - newest.mean(), fs_hz)
    if len(noise) < 6:
        return np.nan
    typical = [median(np.abs(np.diff(one, 4))) for one in (noise, (noise[1:] + noise[:-1]) / 2)]
    return float(np.min(typical / NOISE_4TH))


def jitter_s(noise: float, ppg: Floats, times_s: Floats, rise_s: float, fs_hz: float) -> float:
    """Return the standard deviation in s that white noise of this rms gives the time of a pulse's steepest rise.

    The bend of the smoothed signal is 0 there and falls at the rate of its change: noise in the one over the other.
    """
    scale_s = scale(TIMING_SCALE_S, fs_hz)
    u = (times_s - rise_s) / scale_s
    inside = np.abs(u) < REACH
    u, x = u[inside], ppg[inside]
    weight = np.exp(-0.5 * u * u)
    bend, change = weight * (u * u - 1), weight * (u**3 - 3 * u) / scale_s
    slope = abs(float((x - x.mean()) @ change)) if len(x) else 0.0
    return noise * float(np.sqrt(bend @ bend)) / slope if slope > 0 else np.inf


def amplitude(ppg: Floats, times_s: Floats, rise_s: float) -> float:
    """Return foot to crest of the pulse that rises at rise_s, in the unit of ppg."""
    first, rise, last = times_s.searchsorted((rise_s - FOOT_S, rise_s, rise_s + CREST_S))
    if not first < rise < last:
        return np.nan
    return float(ppg[rise:last].max() - ppg[first:rise].min())


def shape(ppg_slope: Floats, times_s: Floats, rise_s: float) -> Floats:
    """Return the slope round a pulse at SHAPE_S after its rise, without mean, of length 1 (all 0 for a flat one)."""
    values = np.interp(rise_s + SHAPE_S, times_s, ppg_slope)
    values -= values.mean()
    length = float(np.sqrt(values @ values))
    return values / length if length > 0 else values


def turns(ppg: Floats, times_s: Floats, rises_s: Floats) -> Floats:
    """Return ppg of every interval between rises_s, shape (m,), brought to one length, shape (m - 1, len(PHASES))."""
    return np.interp(rises_s[:-1, None] + np.diff(rises_s)[:, None] * PHASES, times_s, ppg)


def overtones(ppg: Floats, times_s: Floats, rises_s: Floats) -> float:
    """Return the overtones of the mean pulse of ppg over its first harmonic, amplitudes; NaN for fewer than three.

    rises_s: of the pulses, shape (m,). Every interval is brought to one length and one level at both ends; the median
    of all of them at each phase, so that the rate may vary, and an artefact in one does not count. A sine has none.
    """
    if len(rises_s) <= FEWEST_TURNS:
        return np.nan
    levels = np.interp(rises_s, times_s, ppg)
    level = turns(ppg, times_s, rises_s) - (levels[:-1, None] + np.diff(levels)[:, None] * PHASES)
    level -= level.mean(axis=1, keepdims=True)
    harmonics = np.abs(np.fft.rfft(medians(level.T)))
    higher = float(np.linalg.norm(harmonics[2 : HIGHEST_OVERTONE + 1]))
    return higher / float(harmonics[1]) if harmonics[1] > 0 else np.nan


def likeness(correlation: Floats) -> Floats:
    """Return the quality 0..1 of pulses from their correlation with the template (Orphanidou et al. 2015)."""
    return ((correlation - UNLIKE) / (ALIKE - UNLIKE)).clip(0.0, 1.0)


def plausible(rr_ms: Floats) -> NDArray[np.bool_]:
    """Return which intervals, shape (n,), can be one period each: finite and 0.5 to 1.6 times their median."""
    finite = np.isfinite(rr_ms)
    if not finite.any():
        return finite
    usual_ms = median(rr_ms[finite])
    return finite & (rr_ms >= 0.5 * usual_ms) & (rr_ms <= 1.6 * usual_ms)


def motion_doubt(moved: Moved, rr_ms: Floats) -> float:
    """Return how far the pulses, intervals of shape (n,), may be steps: 0..1, as motion has power at their rate.

    While the device moves for too short a time to tell its rhythm, they may be.
    """
    use = plausible(rr_ms)
    if not moved.strength or not use.any():
        return 0.0
    share = moved.rhythm(1000.0 / float(rr_ms[use].mean()))
    return moved.strength * float(np.interp(share, STEPS_SHARE, (0.0, 1.0)) if np.isfinite(share) else 1.0)


def two_waves(rr_ms: Floats) -> bool:
    """Return whether every second interval, of shape (n,), is steady and the ones between are not.

    So are the intervals of a heart whose pulse has two waves alike: the second follows the first at a constant time.
    """
    if len(rr_ms) < 2 * LEAST_OF_A_KIND:
        return False
    use = plausible(rr_ms)
    sides = [rr_ms[first::2][use[first::2]] for first in (0, 1)]
    if min(len(side) for side in sides) < LEAST_OF_A_KIND or rr_ms[use].mean() > SLOWEST_DOUBLE_MS:
        return False
    steady_ms, varied_ms = sorted(float(side.std()) for side in sides)
    return varied_ms > LEAST_VARIED_MS and steady_ms < MUCH_STEADIER * varied_ms


def split(rr_ms: Floats, trusted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which trusted intervals, of shape (n,), lie two in a row where one of the usual length would, unequally.

    The second wave of a beat was then taken for a pulse; a heart that grows twice as fast makes equal ones.
    """
    halves, finite = np.zeros(len(rr_ms), bool), np.isfinite(rr_ms)
    if finite.any():
        shares = rr_ms / quantile(rr_ms[finite], WHOLE_QUANTILE)
        short, long = np.minimum(shares[1:], shares[:-1]), np.maximum(shares[1:], shares[:-1])
        pairs = (long < SPLIT_SHARE) & (np.abs(short + long - 1) < SPLIT_OFF) & (long > SPLIT_RATIO * short)
        pairs &= trusted[1:] & trusted[:-1]
        halves[1:] = pairs
        halves[:-1] |= pairs
    return halves


def doubled(rr_ms: Floats, trusted: NDArray[np.bool_]) -> bool:
    """Return whether intervals of split beats, of shape (n,), move the rate."""
    halves = split(rr_ms, trusted)
    if not halves.any():
        return False
    return heart_rate(rr_ms, trusted) - heart_rate(rr_ms[~halves], trusted[~halves]) > MOVED_BPM


def alternate(rr_ms: Floats) -> bool:
    """Return whether long and short intervals, of shape (n,), take turns: pulses of a heart and of steps at 3 to 2."""
    ratios = np.abs(np.diff(np.log(rr_ms[np.isfinite(rr_ms)])))
    return len(ratios) > 0 and median(ratios) > np.log(ALTERNATING)


def irregular(rr_ms: Floats) -> bool:
    """Return whether intervals, of shape (n,), say nothing of those beside them, as in fibrillation of the atria.

    There many a beat comes before the heart has filled: its pulse may be too low to be seen, and no interval tells.
    """
    known_ms = np.where(plausible(rr_ms), rr_ms, np.nan)  # a single pulse that is missing is no disorder
    off_ms = np.abs(known_ms[1:-1] - (known_ms[2:] + known_ms[:-2]) / 2)
    off_ms, known_ms = off_ms[np.isfinite(off_ms)], known_ms[np.isfinite(known_ms)]
    return len(off_ms) >= FEWEST_BESIDE and median(off_ms) > IRREGULAR * median(known_ms)


def vanishes(heights: Floats, trusted: NDArray[np.bool_]) -> bool:
    """Return whether the pulses, whose heights have shape (n,), all but vanish for a while and are unlike there.

    So are the pulses of two rhythms that differ by less than the window can tell apart: they cancel now and then.
    """
    if not len(heights) or not len(trusted):
        return False
    return bool(np.mean(~trusted) >= UNLIKE_SHARE and heights.min() <= VANISHED * median(heights))


def heart_rate(rr_ms: Floats, trusted: NDArray[np.bool_]) -> float:
    """Return the rate in 1/min of the plausible intervals, shape (n,); NaN for fewer than three, or above FASTEST_BPM.

    Of the trusted ones alone where there are three: they have no false pulse at either end.
    """
    use = plausible(rr_ms)
    if np.count_nonzero(use & trusted) >= 3:
        use &= trusted
    rate_bpm = float(60_000.0 / rr_ms[use].mean()) if np.count_nonzero(use) >= 3 else np.nan
    return rate_bpm if rate_bpm <= FASTEST_BPM else np.nan
