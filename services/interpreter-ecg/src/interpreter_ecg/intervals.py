"""What is told from the intervals of a window: how fast the heart beats, and how far that can be doubted. Pure."""

import math
from collections.abc import Collection
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from interpreter_ecg.detector import Beat
from interpreter_ecg.morphology import Label

FEWEST_INTERVALS = 2  # for a heart rate
DOUBT_BPM, AGREEMENT = (2.5, 5.0, 20.0), (1.0, 0.69, 0.3)  # a rate in doubt by 5 bpm has no quality of 0.7

SPLIT = 0.15  # of the median interval, to which two are together as long as one


class Interval(NamedTuple):
    """The time from one beat to the next."""

    beat: Beat  # that it ends with
    rr_ms: float  # NaN after a gap
    label: Label
    before: Label  # of the beat it begins with
    whole: bool  # most likely no beat is missing in it
    unlike: bool  # between two beats of different kinds, whatever their labels

    @property
    def known(self) -> bool:
        """Whether the interval is between two beats, neighbours, of kinds that have been seen before."""
        return self.whole and math.isfinite(self.rr_ms) and Label.UNCERTAIN not in (self.label, self.before)

    @property
    def normal(self) -> bool:
        """Whether the interval is between two normal beats."""
        return self.label is self.before is Label.NORMAL


def usual_ms(known: Collection[Interval]) -> float:
    """The median of the known intervals; NaN without any."""
    return median(interval.rr_ms for interval in known) if known else np.nan


def known_share(known: Collection[Interval], window: Collection[Interval]) -> float:
    """Of the time between the beats of the window, the share between those of known kinds."""
    known_ms = np.array([interval.rr_ms for interval in known])
    all_ms = np.array([0.0 if math.isnan(interval.rr_ms) else interval.rr_ms for interval in window])
    return float(known_ms.sum() / max(all_ms.sum(), 1.0))


def rate_bpm(intervals: Collection[Interval], start_ns: int) -> float:
    """Beats per minute of the time after start_ns that the intervals fill; NaN with fewer than two.

    Of an interval that began before only the part after start_ns counts, as that part of a beat: a pause that lies
    mostly before the window does not slow it down.
    """
    finite = [interval for interval in intervals if math.isfinite(interval.rr_ms)]
    if len(finite) < FEWEST_INTERVALS:
        return np.nan
    rr_ms = np.array([interval.rr_ms for interval in finite])
    inside_ms = np.minimum(rr_ms, np.array([interval.beat.time_ns - start_ns for interval in finite]) / 1e6)
    return 6e4 * float((inside_ms / rr_ms).sum() / inside_ms.sum())


def agreement(known: Collection[Interval], window: Collection[Interval], start_ns: int) -> float:
    """How little the rate hangs on which beats are taken for beats, 0..1.

    It is counted three times: over the intervals between beats of known kinds, over all of them, and over all but the
    beats that split an interval like the others. Where two of these are 5 bpm apart either may be wrong.
    """
    rate = rate_bpm(window, start_ns)
    some = (known, window, merged(window))
    rates = [rate if len(intervals) == len(window) else rate_bpm(intervals, start_ns) for intervals in some]
    doubt_bpm = max(rates) - min(rates)
    return float(np.interp(doubt_bpm, DOUBT_BPM, AGREEMENT)) if np.isfinite(doubt_bpm) else 1.0


def merged(window: Collection[Interval]) -> list[Interval]:
    """The intervals, two of them as one where together they are as long as the median: noise may have split it."""
    known_ms = [interval.rr_ms for interval in window if math.isfinite(interval.rr_ms)]
    usual = median(known_ms) if known_ms else np.nan
    whole: list[Interval] = []
    for interval in window:
        together_ms = whole[-1].rr_ms + interval.rr_ms if whole else np.nan
        if abs(together_ms - usual) < SPLIT * usual:
            whole[-1] = interval._replace(rr_ms=together_ms)
        else:
            whole.append(interval)
    return whole


def of_noise_ms(rmssd_ms: float, jitters_s: NDArray[np.float64]) -> float:
    """Return how much of an RMSSD there would not be without the noise that moves the R peaks; NaN without any.

    jitters_s: how far it moves each, shape (n,). A peak is in three successive differences, once of them twice: six
    times the mean square of its jitter adds.
    """
    if not len(jitters_s):
        return np.nan
    noise_ms2 = 6 * 1e6 * float(np.mean(np.square(jitters_s)))
    return rmssd_ms - float(np.sqrt(max(rmssd_ms**2 - noise_ms2, 0.0)))
