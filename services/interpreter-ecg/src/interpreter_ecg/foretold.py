"""Which premature beats breathing hides: those that a model of the window does not foretell. Pure, stateless.

A second opinion on `early_beats`, which compares extremes: where breathing is as deep as beats are early these hide
each other, and one that is early while breathing lengthens the intervals makes no dip at all, but shows by the pause
after.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.early_beats import LEAST_EARLY, either_side, usual
from sense4hri.medians import median
from sense4hri.windows import windows

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

ORDER = 4  # of the autoregressive model, so that it has two frequencies: of breathing and of blood pressure (0.1 Hz)
STEADY = 1e-9 * np.eye(ORDER + 1)  # with it the model of equal intervals is that they stay so
FEWEST_INTERVALS, FEWEST_FORETOLD = 20, 14
LEAST_SPREAD = 0.01  # of the median interval: nothing is foretold better
OUTLYING = 2.5  # standard deviations at which what was foretold wrongly weighs half (Cauchy)
PAUSES = np.array([[0.0], [0.5], [1.0]])  # what the pause after an early beat makes up for, as a share of how early
BRAKES = np.array([[-1.0], [-0.5], [0.0], [0.5], [1.0]])  # the same after a late one: negative, as what brakes may last
UNFORESEEN = 3.0  # standard deviations by which a beat is earlier than foretold, ...
DIP = 0.03  # ... in an interval shorter by so much than the one before; else ...
LATE = 1.2  # ... by so much more than any beat elsewhere is late, too: hearts brake between two beats as well
BLIND = 0.25  # of the median interval: where a beat so early may not be unforeseen, all are in doubt
CERTAIN = 0.5  # of what is known of an interval far from gaps: with less nothing is told
MANY = 0.25  # of the beats: rather than so many are early, the heart beats twice a breath
MOST_LOOKS = 12


class Early(NamedTuple):
    """How early each beat is, in median intervals, and its pause as a share of that; shape (n,) each, 0 in time."""

    by: Floats
    pause: Floats


class Certainty(NamedTuple):
    """The inverse covariance, in squares of the spread, of each interval and the next; shape (n,) each."""

    one: Floats
    both: Floats
    following: Floats

    def product(self, pause: Floats, other: Floats) -> Floats:
        """Of two beats in the same place, early by as much as the median interval, with these pauses."""
        return self.one - (pause + other) * self.both + pause * other * self.following


def doubt_ms(rr_ms: Floats, linked: Bools, left_out: Bools) -> float:
    """By how much at most RMSSD can hang on beats that are LEAST_EARLY: on steps as large, and those beside them.

    Where that is little, as it is in most hearts, `unforeseen` need not be asked.
    """
    steps_ms, chained = rr_ms[1:] - rr_ms[:-1], linked[1:] & ~left_out[1:] & ~left_out[:-1]
    near = np.convolve(chained & (np.abs(steps_ms) > LEAST_EARLY * rr_ms[1:]), np.ones(4))[1:-2] > 0
    power, near = steps_ms[chained] ** 2, near[chained]
    if not near.any():
        return 0.0
    rmssd_ms, least_ms = np.sqrt(np.array([power.sum(), power[~near].sum()]) / len(power))
    most_ms = np.sqrt(power.sum() / max(np.count_nonzero(~near), 0.1))
    return float(max(rmssd_ms - least_ms, most_ms - rmssd_ms))


def newest_ms(rr_ms: Floats, linked: Bools, left_out: Bools) -> float:
    """By how much RMSSD is larger with the newest ORDER intervals, which are not foretold from both sides.

    NaN where no two others follow each other.
    """
    power, chained = (rr_ms[1:] - rr_ms[:-1]) ** 2, linked[1:] & ~left_out[1:] & ~left_out[:-1]
    older = chained[:-ORDER]
    if not older.any():
        return np.nan
    return float(np.sqrt(power[chained].mean()) - np.sqrt(power[:-ORDER][older].mean()))


def unforeseen(rr_ms: Floats, linked: Bools, left_out: Bools) -> Bools:
    """Those left out, and the two intervals round each beat that is earlier than the others foretell.

    rr_ms: intervals in order, shape (n,); linked: which directly follow the one before; left_out: those known to be
    none of the sinus node's. Breathing is nearly periodic, so an interval follows from those on both sides of it (an
    autoregressive model of the window, fitted with Cauchy's weights against outliers). A premature beat and the pause
    after it do not, and are judged together, by the likelihood ratio of a beat that is early by any length. Those found
    are taken out of what foretells the others until nothing changes. Of few, nothing is known. Where others foretell
    so badly that even an early beat would not stick out, every one may be early.
    """
    if len(rr_ms) < FEWEST_INTERVALS:
        return left_out
    known = np.asarray(windows(linked.astype(np.float64), ORDER)[1:].all(axis=1))
    if np.count_nonzero(known) < FEWEST_FORETOLD:
        return left_out
    middle_ms = median(rr_ms)
    dip = ~linked
    dip[1:] |= rr_ms[1:] - rr_ms[:-1] < -DIP * middle_ms
    for begin_ms in (_without_short(rr_ms, linked), rr_ms):
        early = _early(rr_ms / middle_ms - 1, begin_ms / middle_ms - 1, linked, known, dip)
        if early.mean() <= MANY:
            break
    return left_out | either_side(early, linked)


def _without_short(rr_ms: Floats, linked: Bools) -> Floats:
    """The intervals, with the usual length round beats that end one clearly shorter than those beside it."""
    usual_ms, longer_ms, short = usual(rr_ms), rr_ms[1:] - rr_ms[:-1], np.zeros(len(rr_ms), bool)
    short[1:-1] = np.minimum(-longer_ms[:-1], longer_ms[1:]) > LEAST_EARLY * usual_ms[1:-1]
    return np.where(either_side(short & linked, linked), usual_ms, rr_ms)


def _early(length: Floats, begin: Floats, linked: Bools, known: Bools, dip: Bools) -> Bools:
    """Which intervals end with a beat that is earlier than foretold; all, where one need not stick out.

    length: of the intervals, less the median; begin: the same for the first fit, with the usual length instead of that
    of short ones; known: which, from the ORDER-th on, follow so many; dip: which are shorter than the one before.
    """
    fitted, cleaned, weight = begin, length, known.astype(np.float64)
    follows, before_gap = np.append(linked[1:], False), ~np.append(linked[1:], True)
    early, found = Early(np.zeros(len(length)), np.zeros(len(length))), begin != length
    for _ in range(MOST_LOOKS):
        model, mean = _autoregression(fitted, weight)
        spread = max(median(np.abs(np.convolve(fitted, model, "valid") - mean)[known]) / 0.6745, LEAST_SPREAD)
        off = np.where(known, np.convolve(cleaned, model, "valid") - mean, 0.0)
        certainty = _certainty(model, known, follows)
        deviations, late, early = _judged(off / spread, model, certainty, early, spread)
        enough = np.where(dip, UNFORESEEN, np.maximum(UNFORESEEN, _latest(late)))
        enough[before_gap | (certainty.one < CERTAIN * model @ model)] = np.inf
        before, found = found, _peaks(np.where((early.by > LEAST_EARLY) & (deviations > enough), deviations, 0.0))
        if np.array_equal(found, before):
            break
        early = Early(np.where(found, early.by, 0.0), early.pause)
        cleaned = fitted = length + early.by - _previous(early.by * early.pause, linked)
        weight = known / (1 + ((np.convolve(fitted, model, "valid") - mean) / (OUTLYING * spread)) ** 2)
    surely = spread * (1 + 2 / np.sqrt(2 * (np.count_nonzero(known) - ORDER - 1)))
    return found | (UNFORESEEN * surely > BLIND * np.sqrt(model @ model))


def _autoregression(length: Floats, weight: Floats) -> tuple[Floats, float]:
    """The filter, shape (ORDER + 1,), that leaves of the lengths what the ORDER before do not foretell, and a mean."""
    known = np.column_stack((windows(length[:-1], ORDER), np.ones(len(weight))))
    weighted = known.T * weight
    fit = np.linalg.solve(weighted @ known + STEADY, weighted @ length[ORDER:])
    return np.append(1.0, -fit[ORDER - 1 :: -1]), float(fit[ORDER])


def _certainty(model: Floats, known: Bools, follows: Bools) -> Certainty:
    """What the model knows of pairs, from the intervals on both sides of them."""
    used = known.astype(np.float64)
    one = np.convolve(used, model[::-1] ** 2)
    both = np.append(np.convolve(used, (model[1:] * model[:-1])[::-1]), 0.0)
    return Certainty(one, np.where(follows, both, 0.0), _next(one, follows))


def _judged(
    off: Floats, model: Floats, certainty: Certainty, early: Early, spread: float
) -> tuple[Floats, Floats, Early]:
    """By how many standard deviations each beat is early, by how many it is late, and how early it may be.

    off: what was not foretold, in units of the spread, where beats that are `early` are moved to their time.
    """
    pull, follows = np.convolve(off, model[::-1]), certainty.following > 0
    following = _next(pull, follows)
    late = (pull - BRAKES * following) / np.sqrt(np.maximum(certainty.product(BRAKES, BRAKES), 1e-3))
    evidence = PAUSES * following - pull + certainty.product(PAUSES, early.pause) * early.by / spread
    square = np.maximum(certainty.product(PAUSES, PAUSES), 1e-3)
    deviations = evidence / np.sqrt(square)
    best, at = deviations.argmax(axis=0), np.arange(len(pull))
    return deviations[best, at], late.max(axis=0), Early((evidence / square)[best, at] * spread, PAUSES[best, 0])


def _latest(late: Floats) -> Floats:
    """By how many standard deviations a beat without a dip must be early, given by how many each is late.

    The pause of an early beat is a late one by itself: among the ORDER beats on either side the likelier of the two
    counts. Elsewhere it is another beat.
    """
    none = np.full(ORDER + 1, -np.inf)
    near = windows(np.concatenate((none[1:], late, none[1:])), 2 * ORDER + 1).max(axis=1)
    before = np.append(none, np.maximum.accumulate(late))[: len(late)]
    after = np.append(none, np.maximum.accumulate(late[::-1]))[: len(late)][::-1]
    return np.asarray(np.maximum(near, LATE * np.maximum(before, after)))


def _next(values: Floats, follows: Bools) -> Floats:
    return np.where(follows, np.append(values[1:], 0.0), 0.0)


def _previous(values: Floats, linked: Bools) -> Floats:
    return np.where(linked, np.append(0.0, values[:-1]), 0.0)


def _peaks(values: Floats) -> Bools:
    """Which are larger than nothing and not smaller than those beside them."""
    beside = np.maximum(np.append(0.0, values[:-1]), np.append(values[1:], 0.0))
    return (values > 0) & (values >= beside)
