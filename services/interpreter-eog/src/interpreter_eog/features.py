"""What one channel of an electrooculogram says: blinks, saccades, quality. Stateless; arrays are on a grid of 100 Hz.

A blink is a hump: up within a tenth of a second, down again within half a second. A saccade is a step that stays. Both
are told from the shape alone, so that drift, which is slower, needs no filter that would bend them. Limits in uV are
for eyes: 10 to 20 uV per degree, blinks of 50 to 500 uV.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.medians import median
from sense4hri.slow import smoothed
from sense4hri.windows import windows

GRID_HZ = 100.0
SMOOTH_S = 0.025  # leaves nothing of 40 Hz and more; below about 90 Hz the mains fold to less
NOISE_MARGIN = 5.0  # times the ripple that a blink or saccade is high at least

BASE_S = 0.65  # on either side of a blink: where its feet are looked for
APART_S = 0.1  # between two summits
LASTS_S = (
    0.08,
    0.5,
)  # at half height, smoothed; a pop of one sample lasts 0.06, a lid that is closed for longer is asleep
LOPSIDED = 0.4  # lower over greater of both flanks; less is a change of gaze that overshoots
CLOSING_S, CLOSING = 0.1, 0.55  # at the steepest, a lid would close by this share of its way within this time

SPEED_MARGIN = 6.0  # robust standard deviations of the speed (Engbert & Kliegl 2003)
STEP_ENDS = 0.1  # of the greatest speed
STEP_S = (0.03, 0.3)  # shortest and longest saccade as it is seen after smoothing
STAYS_S, STAYS = (0.1, 0.2), 0.6  # share of a saccade that is there so long before and after it
HIGHEST_UV = 1500.0  # no eye moves the potential further at once

STILL_UV, STILL_S = 0.5, 3.0  # a channel that moves less, for so long, has no eye behind it
NOISE_ONLY = 5.5  # times its ripple: a channel that moves less for the whole window shows noise
NOISE_HALF_UV, WANDER_HALF_UV = 20.0, 400.0  # noise and wandering that halve the quality
AFTER_JUMP_S = 2.0  # doubtful after a jump

Floats = NDArray[np.float64]


class Blink(NamedTuple):
    """One blink; peak: index of the greatest closure; duration_s: between its half heights; height: of its summit."""

    peak: int
    duration_s: float
    height: float


class Saccade(NamedTuple):
    """One saccade; onset: index, between two points where it lies there; amplitude: signed."""

    onset: float
    amplitude: float


def level_of(raw: Floats) -> Floats:
    """Return the potential without noise and mains; symmetric, so nothing is late. raw: shape (n,), without NaN."""
    return smoothed(raw, SMOOTH_S, GRID_HZ) if len(raw) else raw


def ripple(raw: Floats, level: Floats) -> float:
    """Return the standard deviation of what smoothing took away, robust against movements."""
    return 1.4826 * median(np.abs(raw - level)) if len(raw) else np.nan


def sample_noise(samples: Floats) -> float:
    """Return the standard deviation of noise between neighbouring samples, robust against movements; NaN of a few."""
    bends = np.diff(samples[np.isfinite(samples)], 2)
    return 1.4826 * median(np.abs(bends)) / np.sqrt(6) if len(bends) else np.nan


def speed_limit(level: Floats) -> float:
    """Return the speed in uV/s that noise does not reach: Engbert and Kliegl's median estimator."""
    speed = np.diff(level) * GRID_HZ
    if not len(speed):
        return np.inf
    return SPEED_MARGIN * float(np.sqrt(max(0.0, median(speed**2) - median(speed) ** 2)))


def blinks(level: Floats, least: float) -> list[Blink]:
    """Return the humps upwards of at least this height that a lid could have made, in order."""
    found = [_blink(level, peak) for peak in _summits(level)]
    return [each for each in found if each is not None and each.height >= least]


def _summits(level: Floats) -> list[int]:
    """Where the level is the highest within APART_S on either side."""
    reach = round(APART_S * GRID_HZ)
    if len(level) < 2 * reach + 1:
        return []
    highest = windows(level, 2 * reach + 1).max(axis=1)
    middle = level[reach:-reach]
    tops = np.flatnonzero((middle == highest) & (middle > level[reach - 1 : -reach - 1]))
    return [int(top) + reach for top in tops]


def _blink(level: Floats, peak: int) -> Blink | None:
    """The hump round a summit: both flanks down to their feet; None where no lid has such a shape."""
    reach = round(BASE_S * GRID_HZ)
    before, after = level[max(0, peak - reach) : peak][::-1], level[peak + 1 : peak + 1 + reach]
    up, down = _flank(before, level[peak]), _flank(after, level[peak])
    if not len(up) or not len(down):
        return None
    rose, fell = float(level[peak] - up.min()), float(level[peak] - down.min())
    height = min(rose, fell)
    half = level[peak] - height / 2
    duration_s = (_until(up, half) + _until(down, half)) / GRID_HZ
    steepest = float(-np.diff(up[: int(up.argmin()) + 1], prepend=level[peak]).min()) * GRID_HZ
    shaped = height >= LOPSIDED * max(rose, fell) and LASTS_S[0] <= duration_s <= LASTS_S[1]
    return Blink(peak, duration_s, height) if shaped and steepest * CLOSING_S >= CLOSING * rose else None


def _flank(values: Floats, top: float) -> Floats:
    """Values from a summit outwards, as far as they stay below it."""
    higher = np.flatnonzero(values > top)
    return values[: int(higher[0])] if len(higher) else values


def _until(flank: Floats, half: float) -> float:
    """Steps from the summit to where a flank falls to half; between two points by a straight line."""
    below = int(np.argmax(flank <= half))
    if below == 0:
        return 1.0
    return below + float((flank[below - 1] - half) / (flank[below - 1] - flank[below]))


def saccades(level: Floats, least: float, limit: float) -> list[Saccade]:
    """Return the steps of at least this height, faster than limit (uV/s), that stay; in order."""
    speed = np.gradient(level) * GRID_HZ if len(level) > 1 else np.zeros(len(level))
    fast = np.concatenate([[False], np.abs(speed) > limit, [False]])
    begins, ends = np.flatnonzero(fast[1:] & ~fast[:-1]), np.flatnonzero(fast[:-1] & ~fast[1:])
    found = [_step(level, speed, begin, end) for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]
    return [each for each in found if each is not None and least <= abs(each.amplitude) <= HIGHEST_UV]


def _step(level: Floats, speed: Floats, begin: int, end: int) -> Saccade | None:
    """The movement round a stretch of great speed; None where it is too long, or is not known to stay before and after.

    Smoothing widens a step; as widths add by their squares, what it added is taken off before the onset is told.
    """
    peak = begin + int(np.abs(speed[begin:end]).argmax())
    slow = np.flatnonzero(speed * np.sign(speed[peak]) < STEP_ENDS * abs(speed[peak]))
    first, last = (int(slow[slow < peak].max(initial=-1)) + 1, int(slow[slow > peak].min(initial=len(level))) - 1)
    amplitude = float(level[last] - level[first])
    near, far = (round(after_s * GRID_HZ) for after_s in STAYS_S)
    earlier, later = level[max(0, first - far) : max(0, first - near)], level[last + near : last + far]
    if not STEP_S[0] <= (last - first) / GRID_HZ <= STEP_S[1] or not len(earlier) or not len(later):
        return None
    ways = np.array([np.median(later) - level[first], level[last] - np.median(earlier)])
    if (ways / amplitude).min() < STAYS:
        return None
    way = (level[first : last + 1] - level[first]) / amplitude
    middle = first + float(np.interp(0.5, way, np.arange(len(way))))
    seen_s = abs(amplitude / speed[peak])
    took_s = np.sqrt(max(0.0, seen_s**2 - 2 * np.pi * SMOOTH_S**2))
    return Saccade(middle - took_s / 2 * GRID_HZ, amplitude)


def is_still(raw: Floats) -> bool:
    """Return whether nothing at all moves the channel."""
    newest = raw[-round(STILL_S * GRID_HZ) :]
    return len(newest) >= STILL_S * GRID_HZ and float(np.ptp(newest)) <= STILL_UV


def is_noise(level: Floats, noise: float) -> bool:
    """Return whether the level moves no more than noise of this ripple makes it."""
    return float(np.ptp(level)) <= NOISE_ONLY * noise


def after_jumps(level: Floats) -> float:
    """Return the share of time less than AFTER_JUMP_S after a change that no eye makes."""
    lag = round(STEP_S[0] * GRID_HZ)
    if len(level) <= lag:
        return 0.0
    jumped = np.abs(level[lag:] - level[:-lag]) > HIGHEST_UV
    after = np.convolve(jumped, np.ones(round(AFTER_JUMP_S * GRID_HZ)))[: len(jumped)] > 0.5
    return float(after.mean())


def quality(level: Floats, noises: Floats, filled: float) -> float:
    """Return the quality 0..1 of a channel, a product of terms that are each 1 for a clean one.

    noises: of a sample, in each part of the window; the spread of the level; time after jumps; filled: share of the
    window with samples.
    """
    wander = 0.5 * float(np.subtract(*np.percentile(level, (84, 16))))
    clean = float(np.mean(1 / (1 + (noises / NOISE_HALF_UV) ** 2)))
    calm = 1 / (1 + (wander / WANDER_HALF_UV) ** 2)
    return float(np.clip(filled * clean * calm * (1 - after_jumps(level)), 0.0, 1.0))
