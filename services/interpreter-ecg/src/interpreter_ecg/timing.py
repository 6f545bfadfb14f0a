"""Which intervals between beats of normal shape are none of the sinus node's, by their lengths alone. Pure, stateless.

An atrial premature beat: an interval shorter than the one before and the one after it, in the spirit of Clifford's NN
criteria (2002, PhD thesis, Oxford) and of Lipponen & Tarvainen (2019). Deviation: how much shorter follows neither a
fixed share, which deep breathing exceeds, nor the spread of the differences, which ectopy itself widens. Breathing
makes an interval stick out upwards as often as downwards, and by any length; a premature beat only downwards (the pause
after it aside), and further than anything else does.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.medians import median
from sense4hri.windows import windows

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

MEDIAN_BEATS = 11  # round an interval, in which lengths are told
LEAST_EARLY = 0.08  # of the median: a beat that comes hardly early is told from noise by nothing
NEAR_BEATS = 61  # round an interval, with which it is compared
UPWARD_RANK, UPWARD = 3, 1.6  # deeper by so much than the third highest sticks out ...
CERTAIN = 5.0  # ... by so much it is one whatever the rest does ...
REST = 2.0  # ... else by so much than the deepest of those that are no premature beats
MOST_LOOKS = 16
FEWEST_STEPS = 10  # from one known interval to the next, with which those beside gaps are compared
JUMP = 1.5  # ratio of two intervals, one after the other, that no sinus node makes
BESIDE = 5  # intervals before and after, their median: a single short one makes a jump too
LONGEST_BLOCK = 30  # beats for which conduction changes; after more it is another rhythm
BEFORE_AND_AFTER = (-3, -2, -1, 2, 3)  # intervals that foretell one; what follows it at once may be a pause
UNFORESEEN = 3.0  # robust standard deviations by which an interval is shorter than foretold
FEWEST_FORETOLD = 14


class Irregular(NamedTuple):
    """What intervals, shape (n,), are by their lengths."""

    left_out: Bools  # not normal to normal: the two round a premature beat, and pauses
    early: int  # how many end with a premature beat
    suspected: Bools  # the two round a beat that sticks out, left out or not


def premature(rr_ms: Floats, linked: Bools) -> tuple[Bools, Bools]:
    """Which intervals end with a beat that came too early, though it looks like the others; and which may.

    rr_ms: intervals in order, shape (n,); linked: which of them directly follow the one before. Nothing is known of
    fewer than 11. Beside a gap a beat that came too early may show as the pause after it alone. Those that may stick
    out, but not from each other: many premature beats hide each other so.
    """
    found, may = np.zeros(len(rr_ms), bool), np.zeros(len(rr_ms), bool)
    if len(rr_ms) < MEDIAN_BEATS:
        return found, may
    before, after = np.full(len(rr_ms), np.nan), np.full(len(rr_ms), np.nan)
    after[-1] = np.inf  # what will follow the newest is not known: until then a short one counts as early
    before[1:] = np.where(linked[1:], rr_ms[:-1], np.nan)
    after[:-1] = np.where(linked[1:], rr_ms[1:], np.nan)
    depth = np.fmax(np.minimum(before - rr_ms, after - rr_ms), 0.0)
    if not np.any(depth > LEAST_EARLY * rr_ms.min()):
        return _beside_gaps(rr_ms, linked, found), may  # what follows takes a tenth of a millisecond
    usual_ms = _ranked(rr_ms, (MEDIAN_BEATS + 1) // 2, MEDIAN_BEATS, np.arange(len(rr_ms)))
    depth /= usual_ms
    height = np.fmax(np.minimum(rr_ms - before, rr_ms - after) / usual_ms, 0.0)
    early = np.flatnonzero(depth > LEAST_EARLY)
    height[early[early + 1 < len(rr_ms)] + 1] = 0.0  # the pause after a premature beat
    upward = _ranked(height, UPWARD_RANK, NEAR_BEATS, early)
    certain = early[depth[early] > CERTAIN * upward]
    early = early[depth[early] > UPWARD * upward]
    may[early] = True
    for _ in range(MOST_LOOKS):
        rest = depth.copy()
        rest[early] = 0.0
        deeper = np.union1d(certain, early[depth[early] > REST * _ranked(rest, 1, NEAR_BEATS, early)])
        if len(deeper) == len(early):
            break
        early = deeper
    found[early] = True
    return found | _beside_gaps(rr_ms, linked, found), may


def unforeseen(rr_ms: Floats, linked: Bools, left_out: Bools) -> Bools:
    """Those left out, and which intervals, shorter than both beside them, are shorter too than the others foretell.

    And the one after each of these. left_out: those known to be none of the sinus node's, shape (n,).

    A second opinion on `premature`, which compares extremes: many premature beats in deep breathing hide each other
    there. Breathing is nearly periodic, so an interval follows from those round it (a linear model of the window, as
    autoregressive ones are, fitted with Cauchy's weights against outliers). A premature beat and the pause after it do
    not, and are replaced by what is foretold until nothing changes. Beside gaps, and of few, nothing is known.
    """
    if len(rr_ms) < FEWEST_FORETOLD + 6:
        return left_out
    joined = windows(linked.astype(np.float64), 6)[1:].all(axis=1)
    at = np.flatnonzero(joined) + 3
    if len(at) < FEWEST_FORETOLD:
        return left_out
    usual_ms = _ranked(rr_ms, (MEDIAN_BEATS + 1) // 2, MEDIAN_BEATS, np.arange(len(rr_ms)))
    short = np.minimum(rr_ms[at - 1], rr_ms[at + 1]) - rr_ms[at] > LEAST_EARLY * usual_ms[at]
    found = np.zeros(len(rr_ms), bool)
    found[at] = short
    suspect = _round(found, linked)
    if not (suspect & ~left_out).any():
        return left_out
    middle_ms = median(rr_ms)
    length, usual = rr_ms / middle_ms, usual_ms / middle_ms
    filled = np.where(suspect, usual, length)
    weight = np.where(short, 0.2, 1.0)
    for _ in range(MOST_LOOKS):
        known = np.stack([*(filled[at + i] for i in BEFORE_AND_AFTER), np.ones(len(at))])
        foretold = np.linalg.lstsq(known * weight @ known.T, known * weight @ length[at])[0] @ known
        off = length[at] - foretold
        spread = max(median(np.abs(off)) / 0.6745, LEAST_EARLY / UNFORESEEN)
        weight = 1 / (1 + (off / (2.5 * spread)) ** 2)
        before, found[at] = found.copy(), short & (off < -UNFORESEEN * spread)
        if np.array_equal(found, before):
            break
        usual[at] = foretold
        filled = np.where(_round(found, linked), usual, length)
    return left_out | _round(found, linked)


def _round(early: Bools, linked: Bools) -> Bools:
    """The intervals round beats that came too early: those that end with one, and those that follow."""
    both = early.copy()
    both[1:] |= early[:-1] & linked[1:]
    return both


def _beside_gaps(rr_ms: Floats, linked: Bools, early: Bools) -> Bools:
    """Which intervals beside a gap differ more from their neighbour than known ones do: a premature beat's, or a pause.

    early: those of known neighbours that end with a premature beat, shape (n,).
    """
    beside = ~linked
    beside[:-1] |= ~linked[1:]
    left_out = _round(early, linked)
    steps = np.zeros(len(rr_ms) + 1)
    steps[1:-1] = np.where(linked[1:] & ~left_out[1:] & ~left_out[:-1], np.abs(np.diff(np.log(rr_ms))), 0.0)
    sure = ~beside & ~left_out
    known = steps[1:-1][sure[1:] & sure[:-1]]
    if len(known) < FEWEST_STEPS:
        return np.zeros(len(rr_ms), bool)
    most = max(REST * float(known.max()), LEAST_EARLY)
    return beside & (np.maximum(steps[:-1], steps[1:]) > most)


def _ranked(values: Floats, rank: int, width: int, at: NDArray[np.intp]) -> Floats:
    """The rank-th largest of the `width` values round some of them; at the edges of the nearest so many."""
    width = min(width, len(values))
    near = windows(values, width).take(at - width // 2, axis=0, mode="clip")
    return np.asarray(np.partition(near, width - rank, axis=1)[:, width - rank])


def paused(rr_ms: Floats, linked: Bools) -> Bools:
    """Which intervals are a pause, or lie between beats that were not conducted: longer by a jump than those beside.

    What is beside it may be unknown on one side. A rate that jumps and stays is none: known LONGEST_BLOCK beats later.
    """
    ratio = np.ones(len(rr_ms) + 1)
    ratio[1:-1] = np.where(linked[1:], rr_ms[1:] / rr_ms[:-1], 1.0)
    found = np.zeros(len(rr_ms), bool)
    up, down = ratio > JUMP, ratio < 1 / JUMP
    if not (up | down).any():
        return found
    edges = np.flatnonzero(up | down | np.append(~linked, True))
    for first, end in pairwise(np.unique(np.append(0, edges))):
        longer = (up[first] or down[end]) and not (down[first] or up[end])
        if longer and end - first <= LONGEST_BLOCK:
            beside_ms = np.append(rr_ms[max(first - BESIDE, 0) : first], rr_ms[end : end + BESIDE])
            found[first:end] = rr_ms[first:end].min() > JUMP * median(beside_ms)
    return found


def irregular(rr_ms: Floats, linked: Bools) -> Irregular:
    """Tell premature beats and pauses."""
    early, may = premature(rr_ms, linked)
    left_out = _round(early, linked)
    chained = linked & ~left_out
    chained[1:] &= ~left_out[:-1]
    return Irregular(left_out | paused(rr_ms, chained), int(early.sum()), _round(may, linked))
