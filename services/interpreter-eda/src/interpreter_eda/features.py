"""What skin conductance says: responses, level, and why it may say nothing. Stateless; arrays are on the grid of 10 Hz.

Boucsein 2012 (Electrodermal Activity, 2nd ed.) for responses and their least amplitude, scored from the trough before
to the peak. Deviation: two responses that follow so closely that the conductance only slows down between them are told
apart where the slope falls to a third and rises again.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.slow import GRID_HZ, smoothed

SMOOTH_S = 0.25
SLOWED = 1 / 3  # of the steepest slope: less than this parts two rises; a rise that starts with more had begun before
BEGUN = 0.1  # of the steepest slope: where a rise begins, if the conductance did not fall before
RISE_S = (0.4, 10.0)  # from onset to peak
JUMP_S, JUMP = 0.2, 0.7  # what rises by this share within this time is no skin
REBOUND_S, REBOUND = 2.0, 0.5  # what has fallen by this share in this time just before only comes back
MIRROR_S, EXPLAINS_S = 10.0, 15.0  # a fall so near a response is its mirror; a steeper rise so long before explains it
MIRROR_RISE_S = 2.5  # what rises more slowly is no hand that presses
MIRROR, MIRROR_HEIGHT = 0.7, (0.5, 2.0)  # of the rise's steepest slope, and of its height: a fall alike
EDGE = 8  # newest points whose slope smoothing has not settled
HUMP = 1.3  # steepest slope of a response over its mean one; a ramp has 1
CREEP = 1.5  # times what the conductance creeps up by anyway in the time that a response takes to rise
SUMMIT_S = 1.0  # the slope stays low for so long where a peak is taken for one without a fall after it
TONIC_RISE = 0.002  # of the conductance per s: what rises faster is phasic
PULSE_S, PULSE_LAG_S, PULSE_LIKE = 12.0, (0.33, 1.5), 0.6  # window, period, autocorrelation of a heart
HIGHEST_US = 100.0  # no skin conducts better
FLAT_US, STEADY = 0.001, 3.0  # a channel that stays within this, or within so many spreads of a sample, is flat
NOISE_MARGIN = 10.0  # times the ripple left on the grid that a response is high at least
STEPS = 3.0  # of the converter that a response is high at least: a level that creeps up rises by one at a time
STEEPEST_US_PER_S, STEEPEST = 10.0, 0.5  # faster (Kleckner et al. 2018) is a jump; so is a step of this share per s
AROUND_S, STEP = 1.0, 0.5  # a step makes this share of the range of this time within JUMP_S; skin takes longer
AFTER_JUMP_S = 5.0  # doubtful after a jump


Floats = NDArray[np.float64]


class Scr(NamedTuple):
    """One response, by indices into the points it was found in; amplitude in the unit of these."""

    onset: int
    peak: int
    amplitude: float


def responses(raw: Floats, least: float, whole: bool) -> list[Scr]:
    """Return the responses of at least this amplitude whose peaks are certain, in order.

    raw: shape (n,), without NaN. whole: nothing follows for now, so that the last peak needs nothing after it.
    """
    level = smoothed(raw, SMOOTH_S)
    slope = np.gradient(level) if len(level) > 1 else np.zeros(len(level))
    creeping = max(0.0, float(np.median(slope))) if len(slope) else 0.0
    found = []
    for begin, steepest, end in rises(slope, whole):
        onset, peak = _onset(slope, begin, steepest), _peak(slope, steepest, end)
        scr = Scr(onset, peak, float(level[peak] - level[onset]))
        humped = slope[steepest] * (peak - onset) >= HUMP * scr.amplitude
        enough = max(least, CREEP * creeping * (peak - onset))
        seen_whole = onset > 0 or slope[0] <= SLOWED * slope[steepest]
        if scr.amplitude >= enough and humped and seen_whole and is_response(raw, level, scr):
            found.append(scr)
    return found


def rises(slope: Floats, whole: bool) -> list[tuple[int, int, int]]:
    """Return (begin, steepest, end) of every rise: between two of them the slope falls to SLOWED of either, or below 0.

    slope: shape (n,), change per point. A rise that the slope has not left for certain is none yet, unless whole.
    """
    found, begin, top, low = [], 0, -1, -1  # low: the slowest point since the slope fell to SLOWED
    for i, value in enumerate(slope.tolist()):
        if value <= 0:
            if top >= 0:
                found.append((begin, top, low if low >= 0 and i - low > SUMMIT_S * GRID_HZ else i))
            begin, top, low = i, -1, -1
        elif top < 0 or (low < 0 and value > slope[top]):
            top = i
        elif low < 0:
            low = i if value < SLOWED * slope[top] else -1
        elif value < slope[low]:
            low = i
        elif value > slope[low] / SLOWED:
            found.append((begin, top, low))
            begin, top, low = low, i, -1
    if top >= 0 and (whole or (low >= 0 and len(slope) - low > 3 * SUMMIT_S * GRID_HZ)):
        found.append((begin, top, low if low >= 0 else len(slope) - 1))
    return found


def _onset(slope: Floats, begin: int, steepest: int) -> int:
    """Where a rise begins: the trough before it, or where the slope begins to be more than the creeping before it."""
    slow = np.flatnonzero(slope[begin:steepest] <= BEGUN * slope[steepest])
    return begin + int(slow[-1]) if len(slow) else begin


def _peak(slope: Floats, steepest: int, end: int) -> int:
    """Where a rise ends: the summit, or where no more than creeping is left of it."""
    slow = np.flatnonzero(slope[steepest : end + 1] <= BEGUN * slope[steepest])
    return steepest + int(slow[0]) if len(slow) and slope[end] > 0 else end


def is_response(raw: Floats, level: Floats, scr: Scr) -> bool:
    """Return whether skin could have done it: neither too fast nor too slow, no jump, nothing that only comes back."""
    rise_s = (scr.peak - scr.onset) / GRID_HZ
    if not RISE_S[0] <= rise_s <= RISE_S[1]:
        return False
    jump = round(JUMP_S * GRID_HZ)
    around = raw[max(0, scr.onset - jump) : scr.peak + jump]
    if len(around) > jump and float((around[jump:] - around[:-jump]).max()) > JUMP * scr.amplitude:
        return False
    return not _rebounds(level, scr)


def _rebounds(level: Floats, scr: Scr) -> bool:
    """A dip: the conductance fell just before, as fast as it rises now, and not from the peak of another response."""
    reach = round(REBOUND_S * GRID_HZ)
    start = max(0, scr.onset - reach)
    before = level[start : scr.onset + 1]
    fell = float(before.max() - level[scr.onset])
    if fell < REBOUND * scr.amplitude:
        return False
    earlier = level[max(0, start - 3 * reach) : start + 1]
    return bool(before.max() - earlier.min() < fell)


def mirrored(level: Floats, scr: Scr) -> bool:
    """Return whether level, shape (n,), falls near a response as steeply as it rises in it, and by about its height.

    Sweat leaves a duct more slowly than it fills it; a hand that presses an electrode and lets go is as fast both ways.
    A fall after a steeper rise is the recovery of that.
    """
    if scr.peak - scr.onset > MIRROR_RISE_S * GRID_HZ:
        return False
    near, before = round(MIRROR_S * GRID_HZ), round(EXPLAINS_S * GRID_HZ)
    slope = np.gradient(level)
    least, most = (share * scr.amplitude for share in MIRROR_HEIGHT)
    begins, ends = max(0, scr.onset - near), min(scr.peak + near, len(level) - EDGE)
    for begin, steepest, end in rises(-slope[begins:ends], True):
        at = begins + steepest
        rose = max(slope[max(0, at - before) : at].max(initial=0.0), slope[scr.onset : scr.peak + 1].max())
        if least <= level[begins + begin] - level[begins + end] <= most and -slope[at] >= MIRROR * rose:
            return True
    return False


def half_recovery_s(level: Floats, scr: Scr, next_onset: int | None) -> float:
    """Return the time from the peak until half of the amplitude is lost; NaN where it has not been lost (yet)."""
    after = level[scr.peak : next_onset]
    low = np.flatnonzero(after <= level[scr.peak] - scr.amplitude / 2)
    return float(low[0]) / GRID_HZ if len(low) else np.nan


def tonic(level: Floats, start: float) -> Floats:
    """Return the tonic line under conductances, shape (n,): falls with them, rises by at most TONIC_RISE of them per s.

    start: the line before the first point, NaN where there is none. It is never above the signal and, as it follows
    every trough, never drifts away from it.
    """
    out = np.empty(len(level))
    line = start if np.isfinite(start) else np.inf
    for i, value in enumerate(level.tolist()):
        line = min(value, line + abs(value) * TONIC_RISE / GRID_HZ)
        out[i] = line
    return out


def trend_per_min(values: Floats) -> float:
    """Return the slope of the straight line through values of the grid, per min; NaN for less than 10 s of them."""
    use = np.flatnonzero(np.isfinite(values))
    if len(use) < 10 * GRID_HZ:
        return np.nan
    t = use - use.mean()
    return float(t @ values[use] / (t @ t)) * GRID_HZ * 60


def shows_pulse(raw: Floats, least: float) -> bool:
    """Return whether a heart is in the newest PULSE_S: ripples of at least this height at the same distance."""
    newest = raw[-round(PULSE_S * GRID_HZ) :]
    if len(newest) < PULSE_S * GRID_HZ:
        return False
    ripple = (newest - smoothed(newest, SMOOTH_S))[5:-5]
    most = 3 * float(np.median(np.abs(ripple)))
    ripple = np.clip(ripple, -most, most)  # what a response leaves there is no ripple
    power = float(ripple @ ripple)
    if not 2.8 * np.sqrt(power / len(ripple)) > least:  # peak to peak of a sine
        return False
    first, last = (round(lag_s * GRID_HZ) for lag_s in PULSE_LAG_S)
    alike = np.array([_alike(ripple, lag) for lag in range(2 * last + 1)]) / _alike(ripple, 0)
    period = first + int(np.argmax(alike[first : last + 1]))
    again = alike[2 * period - 1 : 2 * period + 2].max()
    return bool(min(alike[period], again) > PULSE_LIKE and alike[: period + 1].min() < 0)


def _alike(ripple: Floats, lag: int) -> float:
    return float(np.mean(ripple[lag:] * ripple[: len(ripple) - lag]))


def ripple(raw: Floats, period_s: float) -> float:
    """Return the standard deviation of what is faster than skin, robust against responses; raw without NaN.

    period_s: between two samples. Lines drawn through samples further apart than SMOOTH_S leave nothing to smooth:
    there it is how far samples are from the middle of their neighbours.
    """
    apart = round(period_s * GRID_HZ)
    if period_s <= SMOOTH_S or len(raw) <= 2 * apart:
        return 1.4826 * float(np.median(np.abs(raw - smoothed(raw, SMOOTH_S)))) if len(raw) else np.nan
    off = (raw[apart:-apart] - (raw[: -2 * apart] + raw[2 * apart :]) / 2) / np.sqrt(1.5)
    return 1.4826 * float(np.median(np.abs(off)))


def is_flat(raw: Floats, spread: float, least: float) -> bool:
    """Return whether nothing but noise of this spread per sample moves the channel; least: a change that is none."""
    span = float(np.ptp(smoothed(raw, 2 * SMOOTH_S)))
    return span <= max(least, STEADY * spread)


def jumps(raw: Floats, period_s: float, calibrated: bool) -> float:
    """Return the share of points, shape (n,) without NaN, less than AFTER_JUMP_S after a change too fast for skin.

    period_s: between two samples; where they are further apart than JUMP_S, a step takes as long on the grid.
    """
    lag = round(max(JUMP_S, period_s) * GRID_HZ)
    if len(raw) <= lag:
        return 0.0
    changes, seconds = np.abs(raw[lag:] - raw[:-lag]), lag / GRID_HZ
    steep = changes > STEEPEST * seconds * abs(float(np.median(raw)))
    jumped = steep & (changes > STEP * _ranges(raw, lag))
    if calibrated:
        jumped |= changes > STEEPEST_US_PER_S * seconds
    after = np.convolve(jumped, np.ones(round(AFTER_JUMP_S * GRID_HZ)))[: len(jumped)] > 0.5
    return float(after.mean())


def _ranges(raw: Floats, lag: int) -> Floats:
    """Return the range of the points within AROUND_S round the middle of each two that are lag apart."""
    more = max(0, round(AROUND_S * GRID_HZ) - lag) // 2
    views = np.lib.stride_tricks.sliding_window_view(np.pad(raw, more, mode="edge"), lag + 2 * more + 1)
    return np.asarray(np.ptp(views, axis=1))


def quality(level: float, noise: float, jumps_share: float, trend: float, filled: float) -> float:
    """Return the signal quality 0..1, a product of terms that are each 1 for a clean signal.

    noise: spread of the samples, against 2 % of the level; trend per min against the level itself (the conductance
    of skin takes longer to double); jumps_share of the time after a jump; filled: share of the window with samples.
    """
    size = max(abs(level), 1e-12)
    steady = 1 / (1 + (trend / size) ** 2) if np.isfinite(trend) else 1.0
    clean = 1 / (1 + (noise / (0.02 * size)) ** 2)
    return float(np.clip(filled * steady * clean * (1 - jumps_share), 0.0, 1.0))
