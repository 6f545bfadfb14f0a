"""The normal-to-normal intervals among measured ones: artefacts are found, merged or left out, never invented.

Lipponen & Tarvainen (2019), J Med Eng Technol 43:173; deviations at `artefacts` and `corrected`. Pure: numpy alone.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.medians import medians
from sense4hri.windows import windows

C1, C2, ALPHA, THRESHOLD_BEATS, MEDIAN_BEATS = 0.13, 0.17, 5.2, 91, 11  # the paper's
THRESHOLD_STEP = 10  # beats between two looks at the spread: it changes little from beat to beat, and costs the most
LEAST_DIFFERENCE, LEAST_DEVIATION = 0.3, 0.1  # floors of the two thresholds, share of the local median interval

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Intervals(NamedTuple):
    """Valid intervals in order, shape (n,) each."""

    end_s: Floats
    rr_ms: Floats
    linked: Bools  # directly follows the one before it
    complete: Bools  # its source is sure that no beat is missing in it


def without(raw: Intervals, left_out: Bools) -> Intervals:
    """The intervals without some of them, across which the chain is broken."""
    keep, linked = ~left_out, raw.linked.copy()
    linked[1:] &= keep[:-1]
    return Intervals(raw.end_s[keep], raw.rr_ms[keep], linked[keep], raw.complete[keep])


def corrected(raw: Intervals) -> tuple[Intervals, int]:
    """The normal-to-normal intervals among the measured ones, and how many had to be corrected for it.

    An interval that ends in an extra beat is merged into the next one; other artefacts are left out, which breaks the
    chain. Deviation from Lipponen & Tarvainen (2019): they fill them by interpolation, which invents intervals and
    lowers RMSSD; nothing here needs an unbroken series.
    """
    extra, wrong = artefacts(raw)
    count = int(extra.sum() + wrong.sum())
    if not count:
        return raw, 0
    rr_ms, linked, keep = raw.rr_ms.copy(), raw.linked.copy(), ~(extra | wrong)
    linked[1:] &= ~wrong[:-1]
    for i in np.flatnonzero(extra):
        rr_ms[i + 1] += rr_ms[i]
        linked[i + 1] = linked[i]
    return Intervals(raw.end_s[keep], rr_ms[keep], linked[keep], raw.complete[keep]), count


def artefacts(raw: Intervals) -> tuple[Bools, Bools]:
    """Which intervals end in an extra beat, and which are otherwise no NN interval (beat ectopic, missed or misplaced).

    Lipponen & Tarvainen (2019). Deviations: thresholds have a floor, 30 % (difference) and 10 % (deviation) of the
    local median, or a steady rhythm would be corrected for being steady and a deep breath for being deep; they are
    renewed every tenth beat; the edges of the window use the nearest full neighbourhood; a lone long interval is an
    artefact only if a beat may be missing in it, because a misplaced beat makes a short one beside it and a sinus
    pause does not; the interval that begins with a beat that came too early is no NN interval either, whatever its
    length (Task Force 1996: both its beats are normal).
    """
    rr, linked, n = raw.rr_ms, raw.linked, len(raw.rr_ms)
    extra, wrong = np.zeros(n, bool), np.zeros(n, bool)
    if n < MEDIAN_BEATS:
        return extra, wrong
    median = _around(rr, MEDIAN_BEATS, medians)
    difference = np.where(linked[1:], rr[1:] - rr[:-1], 0.0)
    difference = np.concatenate(((0.0,), difference))
    deviation = rr - median
    deviation = np.where(deviation > 0, deviation, 2 * deviation)
    steps, stray = np.abs(difference), np.abs(deviation)
    least_step, least_tolerance = LEAST_DIFFERENCE * median, LEAST_DEVIATION * median
    if not ((steps > least_step) | (stray > 3 * least_tolerance)).any():
        return extra, wrong  # below the floors none is suspect, whatever the spread
    d, tolerance = difference / _limit(steps, least_step), _limit(stray, least_tolerance)
    suspect = _steps_like_an_artefact(d) | (stray > 3 * tolerance)
    for i in np.flatnonzero(suspect):
        if i and extra[i - 1]:
            continue  # what is left of it is part of the merged interval
        short_before = i > 0 and linked[i] and wrong[i - 1] and rr[i - 1] < median[i - 1]
        if rr[i] < median[i] and i + 1 < n and linked[i + 1] and abs(rr[i] + rr[i + 1] - median[i]) < tolerance[i]:
            extra[i] = True
        elif rr[i] < median[i] or short_before:
            wrong[i] = True
        else:
            wrong[i] = not raw.complete[i] and rr[i] / 2 > median[i] - 2 * tolerance[i]
    early = wrong & (rr < median)
    early[1:] &= ~(suspect & (rr > median))[:-1]  # after such a long one the beat before it was late, this one is right
    wrong[1:] |= early[:-1] & linked[1:] & ~extra[1:]
    return extra, wrong


def _steps_like_an_artefact(d: Floats) -> Bools:
    """Which intervals differ from their neighbours as beside an ectopic, a missed or an extra beat.

    d: difference to the interval before each, in units of its limit.
    """
    before, after, second = np.append(0.0, d[:-1]), np.append(d[1:], 0.0), np.append(d[2:], (0.0, 0.0))
    s12 = np.where(d > 0, np.maximum(before, after), np.minimum(before, after))
    s22 = np.where(d >= 0, np.minimum(after, second), np.maximum(after, second))
    ectopic = ((d > 1) & (s12 < -C1 * d - C2)) | ((d < -1) & (s12 > -C1 * d + C2))
    falls, rises = (d < -1) & (s22 > 1), (d > 1) & (s22 < -1)
    return np.asarray(ectopic | falls | rises)


def _limit(values: Floats, floor: Floats) -> Floats:
    """5.2 quartile deviations of the 91 values round each one, but not below the floor."""
    return np.maximum(ALPHA * _around(values, THRESHOLD_BEATS, _quartile_deviation, THRESHOLD_STEP), floor)


def _around(values: Floats, width: int, statistic: Callable[[Floats], Floats], step: int = 1) -> Floats:
    """The statistic of the `width` values round each one, or round one at most `step` / 2 beside it.

    At the edges it is that of the nearest `width` values.
    """
    width = min(width, len(values))
    found = statistic(windows(values, width)[::step])
    at = (np.arange(len(values)) - width // 2 + step // 2) // step
    return np.asarray(found.take(at, mode="clip"))


def _quartile_deviation(rows: Floats) -> Floats:
    low, high = rows.shape[1] // 4, 3 * rows.shape[1] // 4
    ordered = np.partition(rows, (low, high), axis=1)
    return (ordered[:, high] - ordered[:, low]) / 2
