"""What is told from the intervals of a window: how fast the heart beats, and how far that can be doubted. Pure."""

from collections.abc import Collection, Sequence
from statistics import median
from typing import NamedTuple

import numpy as np

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
        return self.whole and np.isfinite(self.rr_ms) and Label.UNCERTAIN not in (self.label, self.before)

    @property
    def normal(self) -> bool:
        """Whether the interval is between two normal beats."""
        return self.label is self.before is Label.NORMAL


def usual_ms(window: Collection[Interval]) -> float:
    """The median of the known intervals; NaN without any."""
    known = [interval.rr_ms for interval in window if interval.known]
    return median(known) if known else np.nan


def known_share(window: Collection[Interval]) -> float:
    """Of the time between the beats of the window, the share between those of known kinds."""
    rr_ms = np.array([interval.rr_ms for interval in window])
    known = np.array([interval.known for interval in window], bool)
    return float(rr_ms[known].sum() / max(np.nansum(rr_ms), 1.0))


def rate_bpm(intervals: Collection[Interval], start_ns: int) -> float:
    """Beats per minute of the time after start_ns that the intervals fill; NaN with fewer than two.

    Of an interval that began before only the part after start_ns counts, as that part of a beat: a pause that lies
    mostly before the window does not slow it down.
    """
    rr_ms = np.array([interval.rr_ms for interval in intervals])
    since_ms = np.array([interval.beat.time_ns - start_ns for interval in intervals]) / 1e6
    rr_ms, since_ms = rr_ms[np.isfinite(rr_ms)], since_ms[np.isfinite(rr_ms)]
    if len(rr_ms) < FEWEST_INTERVALS:
        return np.nan
    inside_ms = np.minimum(rr_ms, since_ms)
    return 6e4 * float((inside_ms / rr_ms).sum() / inside_ms.sum())


def agreement(window: Collection[Interval], start_ns: int) -> float:
    """How little the rate hangs on which beats are taken for beats, 0..1.

    It is counted three times: over the intervals between beats of known kinds, over all of them, and over all but the
    beats that split an interval like the others. Where two of these are 5 bpm apart either may be wrong.
    """
    known = [interval for interval in window if interval.known]
    rates = [rate_bpm(intervals, start_ns) for intervals in (known, window, merged(window))]
    doubt_bpm = max(rates) - min(rates)
    return float(np.interp(doubt_bpm, DOUBT_BPM, AGREEMENT)) if np.isfinite(doubt_bpm) else 1.0


def merged(window: Collection[Interval]) -> list[Interval]:
    """The intervals, two of them as one where together they are as long as the median: noise may have split it."""
    known_ms = [interval.rr_ms for interval in window if np.isfinite(interval.rr_ms)]
    usual = median(known_ms) if known_ms else np.nan
    whole: list[Interval] = []
    for interval in window:
        together_ms = whole[-1].rr_ms + interval.rr_ms if whole else np.nan
        if abs(together_ms - usual) < SPLIT * usual:
            whole[-1] = interval._replace(rr_ms=together_ms)
        else:
            whole.append(interval)
    return whole


def of_noise_ms(rmssd_ms: float, jitters_s: Sequence[float]) -> float:
    """Return how much of an RMSSD there would not be without the noise that moves the R peaks; NaN without any.

    A peak is in three successive differences, once of them twice: six times the mean square of its jitter adds.
    """
    if not jitters_s:
        return np.nan
    noise_ms2 = 6 * 1e6 * float(np.mean(np.square(jitters_s)))
    return rmssd_ms - float(np.sqrt(max(rmssd_ms**2 - noise_ms2, 0.0)))
