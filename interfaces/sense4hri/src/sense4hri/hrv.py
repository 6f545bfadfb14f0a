"""Heart-rate variability of a stream of beat-to-beat intervals: what the HRV message means, for ECG and PPG alike.

Task Force (1996), Circulation 93:1043. SDNN has ddof 1; pNN50 is NN50 per successive difference, that is N - 1 for an
unbroken series. Pure: numpy alone, time comes in with the beats.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sense4hri.nn_intervals import Bools, Floats, Intervals, corrected, without

RMSSD_NEEDS_S, SDNN_NEEDS_S, SPECTRUM_NEEDS_S = 30.0, 120.0, 300.0
COVERED = 0.8  # share of that time which valid intervals must fill
LONGEST_GAP_S = (
    10.0  # a longer gap in the signal starts the window afresh; a shorter one only breaks the chain of intervals
)
LF_HZ, HF_HZ = (0.04, 0.15), (0.15, 0.4)
FREQUENCIES_AT_ONCE = 12  # of the spectrum: few enough to stay in the cache
NN50_MS = 50.0
MOST_BEATS_PER_S = 5.0
UNLIKE = 1.5  # differences across two shapes of beats, mean square over that of the others, from which they are no NN

DISORDER_BEATS, FEWEST_DIFFERENCES = 96, 32  # are looked at together for a rhythm without order
LARGE_DIFFERENCE, MANY_LARGE = 0.1, 0.4  # of the mean interval; share of the differences that are larger
ENTROPY_MS, DISORDERED = 30.0, -1.1  # Lake & Moorman 2011
NO_NORMAL_RHYTHM = "hrv withheld: the intervals have no order, so none is normal to normal"


class Hrv(NamedTuple):
    """The fields of the HRV message; NaN where it cannot be computed."""

    window_s: float
    nn_count: int
    corrected_count: int
    mean_nn_ms: float
    sdnn_ms: float
    rmssd_ms: float
    pnn50_percent: float
    lf_power_ms2: float
    hf_power_ms2: float
    lf_hf_ratio: float


MEASURES = Hrv._fields[3:]


class Span(NamedTuple):
    """What a window of variability holds."""

    raw: Intervals  # between normal beats, as measured
    window_s: float
    left_out: int  # intervals with a beat that is not normal
    unlike: Bools  # which of raw are between two beats of different shapes, shape (n,)


class HrvWindow:
    """The last `window_s` seconds of intervals, bounded; beats come in order, each once."""

    def __init__(self, window_s: float) -> None:
        if not window_s > 0:
            raise ValueError(f"window_s must be positive, not {window_s}")
        self._window_s = window_s
        self._most = int(MOST_BEATS_PER_S * window_s) + 2
        self._ns, self._rr_ms = np.empty(2 * self._most, np.int64), np.empty(2 * self._most)
        self._told = np.empty((3, 2 * self._most), bool)  # complete, normal, unlike
        self._first = self._end = 0  # of the beats in use
        self._first_ns: int | None = None

    def restart(self, first_ns: int) -> None:
        """Forget everything; a new segment begins with the sample at first_ns."""
        self._first = self._end = 0
        self._first_ns = first_ns

    def add(
        self, time_ns: int, rr_ms: float, complete: bool = False, normal: bool = True, unlike: bool = False
    ) -> None:
        """Take a beat at time_ns and the interval in ms that ends with it.

        NaN breaks the chain: no difference is taken across it. complete: the source saw the whole interval well and is
        sure that no beat is missing, so a long one is a true pause. normal: not False where the source knows that one
        of the two beats is none of the sinus node's; the interval is left out and counts as corrected. unlike: the two
        beats have different shapes, so that what is between their peaks is not what is between their beginnings.
        """
        if self._first_ns is None:
            self._first_ns = time_ns
        if self._end == len(self._ns):
            self._to_front()
        i = self._end
        self._ns[i], self._rr_ms[i], self._told[:, i] = time_ns, rr_ms, (complete, normal, unlike)
        self._end += 1
        self._first = max(self._first, self._end - self._most)

    def _to_front(self) -> None:
        used, self._first, self._end = slice(self._first, self._end), 0, self._end - self._first
        for kept in (self._ns, self._rr_ms, *self._told):
            kept[: self._end] = kept[used]

    def span(self, now_ns: int) -> Span:
        """Return the intervals between normal beats of the window that ends with the sample at now_ns."""
        first_ns = now_ns if self._first_ns is None else self._first_ns
        window_s = min((now_ns - first_ns) / 1e9, self._window_s)
        start_ns = now_ns - round(window_s * 1e9)
        self._first += int(np.searchsorted(self._ns[self._first : self._end], start_ns, "right"))
        used = slice(self._first, self._end)
        ns, rr_ms, (complete, normal, unlike) = self._ns[used], self._rr_ms[used], self._told[:, used]
        finite = np.isfinite(rr_ms)
        valid = finite & normal
        linked = np.zeros(len(ns), bool)
        linked[1:] = valid[1:] & valid[:-1]
        raw = Intervals((ns[valid] - start_ns) / 1e9, rr_ms[valid], linked[valid], complete[valid])
        return Span(raw, window_s, int(np.count_nonzero(finite & ~normal)), unlike[valid])

    def at(self, now_ns: int) -> tuple[Hrv, tuple[str, ...]]:
        """Return the variability of the window that ends with the sample at now_ns, and why values are missing."""
        return variability(self.span(now_ns))


def variability(span: Span, irregular: Bools | None = None) -> tuple[Hrv, tuple[str, ...]]:
    """Return the variability of a window, and why values are missing.

    irregular: which of its intervals the source knows, by their lengths, to be none of the sinus node's, shape (n,);
    they are left out and count as corrected, as are those between beats of different shapes where that moves them.
    """
    left_out = np.zeros(len(span.raw.rr_ms), bool) if irregular is None else irregular
    left_out = left_out | moved(span, left_out)
    nn, corrected_count = corrected(without(span.raw, left_out))
    hrv, reasons = measured(nn, corrected_count + span.left_out + int(left_out.sum()), span.window_s)
    return (withheld(hrv), (NO_NORMAL_RHYTHM,)) if disordered(span.raw) else (hrv, reasons)


def moved(span: Span, left_out: Bools) -> Bools:
    """Which intervals are between beats of different shapes, if those vary more than the others; else none.

    Noise and posture sort the same beats under several shapes and move no peak; a beat conducted another way does.
    """
    if not span.unlike.any():
        return span.unlike
    rr_ms, chained = span.raw.rr_ms, span.raw.linked[1:] & ~left_out[1:] & ~left_out[:-1]
    power, unlike = (rr_ms[1:] - rr_ms[:-1])[chained] ** 2, (span.unlike[1:] | span.unlike[:-1])[chained]
    if unlike.all() or not unlike.any() or power[unlike].mean() < UNLIKE * power[~unlike].mean():
        return np.zeros(len(span.unlike), bool)
    return span.unlike


def withheld(hrv: Hrv) -> Hrv:
    """Return the same window with every measure NaN, for publishing while the signal is too poor to be trusted."""
    return Hrv(hrv.window_s, hrv.nn_count, hrv.corrected_count, *[np.nan] * len(MEASURES))


def measured(nn: Intervals, corrected_count: int, window_s: float) -> tuple[Hrv, tuple[str, ...]]:
    """Return every measure that the window is long enough for, and reasons that name the others.

    A measure that needs T seconds is given once the window is T long and its intervals fill 80 % of T and half of the
    window.
    """
    filled_s = float(nn.rr_ms.sum()) / 1e3
    reasons = []

    def allowed(measures: str, needed_s: float) -> bool:
        if window_s < needed_s - 1e-6:
            reasons.append(f"{measures} needs {needed_s:.0f} s")
        elif filled_s < max(COVERED * needed_s, 0.5 * window_s):
            reasons.append(
                f"{measures} needs {needed_s:.0f} s, valid intervals fill {filled_s:.0f} of {window_s:.0f} s"
            )
        else:
            return True
        return False

    mean_nn = sdnn_ms = rmssd_ms = pnn50 = lf = hf = np.nan
    if len(nn.rr_ms):
        mean_nn = float(nn.rr_ms.mean())
    else:
        reasons.append("mean_nn_ms needs a valid interval")
    if allowed("rmssd_ms, pnn50_percent", RMSSD_NEEDS_S):
        rmssd_ms, pnn50 = rmssd_and_pnn50(nn)
    if allowed("sdnn_ms", SDNN_NEEDS_S):
        sdnn_ms = sdnn(nn)
    if allowed("lf_power_ms2, hf_power_ms2, lf_hf_ratio", SPECTRUM_NEEDS_S):
        lf, hf = band_powers(nn, window_s)
    ratio = lf / hf if hf > 0 else np.nan
    return Hrv(window_s, len(nn.rr_ms), corrected_count, mean_nn, sdnn_ms, rmssd_ms, pnn50, lf, hf, ratio), tuple(
        reasons
    )


def disordered(raw: Intervals) -> bool:
    """Whether in some stretch of the intervals one says nothing about the next, as in fibrillation of the atria.

    Deep breathing makes differences as large, but one follows from the other: only with a high coefficient of sample
    entropy too is it no rhythm. On MIT-BIH it tells stretches annotated AFIB from 113 and 123, whose sinus is the least
    steady.
    """
    steps_ms, chained = np.abs(raw.rr_ms[1:] - raw.rr_ms[:-1]), raw.linked[1:]
    large = chained & (steps_ms > LARGE_DIFFERENCE * raw.rr_ms.min(initial=np.inf))
    for first in range(0, max(len(raw.rr_ms) - DISORDER_BEATS // 2, 1), DISORDER_BEATS // 2):
        steps = slice(first, first + DISORDER_BEATS - 1)
        if np.count_nonzero(large[steps]) <= MANY_LARGE * FEWEST_DIFFERENCES:
            continue  # too few, whatever the mean
        rr_ms, differences = raw.rr_ms[first : first + DISORDER_BEATS], steps_ms[steps][chained[steps]]
        if len(differences) < FEWEST_DIFFERENCES:
            continue
        many = np.mean(differences > LARGE_DIFFERENCE * rr_ms.mean()) > MANY_LARGE
        if many and sample_entropy(rr_ms) > DISORDERED:
            return True
    return False


def sample_entropy(rr_ms: Floats) -> float:
    """Coefficient of sample entropy of intervals, m = 1 (Lake & Moorman 2011, Am J Physiol 300:H319)."""
    near = np.abs(rr_ms[:, None] - rr_ms) <= ENTROPY_MS
    pairs = np.triu(near[:-1, :-1], 1)
    alike, still = int(np.count_nonzero(pairs)), int(np.count_nonzero(pairs & near[1:, 1:]))
    if not alike:
        return 0.0
    return float(np.log(alike / (still or 0.5)) + np.log(2 * ENTROPY_MS / rr_ms.mean()))


def sdnn(nn: Intervals) -> float:
    """Standard deviation of the intervals in ms, ddof 1."""
    return float(nn.rr_ms.std(ddof=1)) if len(nn.rr_ms) > 1 else np.nan


def rmssd_and_pnn50(nn: Intervals) -> tuple[float, float]:
    """RMSSD in ms and the percentage of successive differences above 50 ms."""
    differences = (nn.rr_ms[1:] - nn.rr_ms[:-1])[nn.linked[1:]]
    if not len(differences):
        return np.nan, np.nan
    count = len(differences)
    pnn50 = 100 * int(np.count_nonzero(np.abs(differences) > NN50_MS)) / count
    return math.sqrt(float((differences**2).sum()) / count), pnn50


def band_powers(nn: Intervals, window_s: float) -> tuple[float, float]:
    """LF (0.04-0.15 Hz) and HF (0.15-0.4 Hz) power in ms^2.

    The periodogram of the intervals at the times they end, each weighing its own length, linear trend removed, Hann
    taper; no resampling (Clifford & Tarassenko 2005, IEEE TBME 52:630), so missing stretches add nothing. Its integral
    over all frequencies is the tapered variance: a sine of amplitude A in a band is A^2/2 there.
    """
    length_s = nn.rr_ms / 1e3
    taper = np.sin(np.pi * np.clip((nn.end_s - length_s / 2) / window_s, 0, 1)) ** 2
    weight = taper * length_s
    late_s, deviation = nn.end_s - nn.end_s.mean(), nn.rr_ms - nn.rr_ms.mean()
    deviation -= late_s * (np.sum(late_s * deviation) / np.sum(late_s**2))
    deviation -= np.sum(deviation * weight) / np.sum(weight)
    step_hz = 1 / window_s
    first, last = int(np.ceil(LF_HZ[0] / step_hz - 1e-6)), int(np.ceil(HF_HZ[1] / step_hz - 1e-6)) - 1
    turn = np.exp(-2j * np.pi * step_hz * nn.end_s)
    terms = np.empty((FREQUENCIES_AT_ONCE, len(turn)), complex)
    terms[0] = deviation * weight * turn**first
    for before, after in pairwise(terms):
        np.multiply(before, turn, out=after)
    sums, leap = [], turn**FREQUENCIES_AT_ONCE
    for _ in range(first, last + 1, FREQUENCIES_AT_ONCE):
        sums.append(terms.sum(axis=1))
        terms *= leap
    power = np.abs(np.concatenate(sums)[: last + 1 - first]) ** 2
    power *= 2 * step_hz / np.sum(taper * weight)
    boundary = int(np.ceil(HF_HZ[0] / step_hz - 1e-6)) - first
    return float(power[:boundary].sum()), float(power[boundary:].sum())
