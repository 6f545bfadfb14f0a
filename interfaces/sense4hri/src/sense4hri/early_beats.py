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


class Irregular(NamedTuple):
    """What intervals, shape (n,), are by their lengths."""

    left_out: Bools  # not normal to normal: the two round a premature beat, and pauses
    early: int  # how many end with a premature beat


def premature(rr_ms: Floats, linked: Bools) -> Bools:
    """Which intervals end with a beat that came too early, though it looks like the others.

    rr_ms: intervals in order, shape (n,); linked: which of them directly follow the one before. Nothing is known of
    fewer than 11. Beside a gap a beat that came too early may show as the pause after it alone.
    """
    found = np.zeros(len(rr_ms), bool)
    if len(rr_ms) < MEDIAN_BEATS:
        return found
    before, after = np.full(len(rr_ms), np.nan), np.full(len(rr_ms), np.nan)
    after[-1] = np.inf  # what will follow the newest is not known: until then a short one counts as early
    before[1:] = np.where(linked[1:], rr_ms[:-1], np.nan)
    after[:-1] = np.where(linked[1:], rr_ms[1:], np.nan)
    depth = np.fmax(np.minimum(before - rr_ms, after - rr_ms), 0.0)
    if not np.any(depth > LEAST_EARLY * rr_ms.min()):
        return _beside_gaps(rr_ms, linked, found)  # what follows takes a tenth of a millisecond
    usual_ms = usual(rr_ms)
    depth /= usual_ms
    height = np.fmax(np.minimum(rr_ms - before, rr_ms - after) / usual_ms, 0.0)
    early = np.flatnonzero(depth > LEAST_EARLY)
    height[early[early + 1 < len(rr_ms)] + 1] = 0.0  # the pause after a premature beat
    upward = _ranked(height, UPWARD_RANK, NEAR_BEATS, early)
    certain = early[depth[early] > CERTAIN * upward]
    early = early[depth[early] > UPWARD * upward]
    for _ in range(MOST_LOOKS):
        rest = depth.copy()
        rest[early] = 0.0
        deeper = np.union1d(certain, early[depth[early] > REST * _ranked(rest, 1, NEAR_BEATS, early)])
        if len(deeper) == len(early):
            break
        early = deeper
    found[early] = True
    return found | _beside_gaps(rr_ms, linked, found)


def either_side(early: Bools, linked: Bools) -> Bools:
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
    left_out = either_side(early, linked)
    steps = np.zeros(len(rr_ms) + 1)
    steps[1:-1] = np.where(linked[1:] & ~left_out[1:] & ~left_out[:-1], np.abs(np.diff(np.log(rr_ms))), 0.0)
    sure = ~beside & ~left_out
    known = steps[1:-1][sure[1:] & sure[:-1]]
    if len(known) < FEWEST_STEPS:
        return np.zeros(len(rr_ms), bool)
    most = max(REST * float(known.max()), LEAST_EARLY)
    return beside & (np.maximum(steps[:-1], steps[1:]) > most)


def usual(rr_ms: Floats) -> Floats:
    """The median of the intervals round each."""
    return _ranked(rr_ms, (MEDIAN_BEATS + 1) // 2, MEDIAN_BEATS, np.arange(len(rr_ms)))


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
    early = premature(rr_ms, linked)
    left_out = either_side(early, linked)
    chained = linked & ~left_out
    chained[1:] &= ~left_out[:-1]
    return Irregular(left_out | paused(rr_ms, chained), int(early.sum()))
