"""Heart beats of a raw ECG, and how breathing changes them: the interval before, the height and the area of each.

Not interpreter-ecg's detector: who looks for breathing in the beats can leave out a doubtful one, and needs none of the
care for ectopic beats that variability needs (docs/decisions/respiration-from-ecg.md). Imports no ROS.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.slow import drawn_through
from sense4hri.stamps import SECOND_NS
from sense4hri.windows import windows

from interpreter_respiration.features import spread_of

SLOPE_S, ENERGY_S = 0.02, 0.1  # a change over the first, averaged over the second, stands out where a QRS complex is
APART_S = 0.28  # between two beats
OF_USUAL = 0.35  # of the energy of usual beats, from which one is a beat
USUAL_S = 8.0  # the past that tells what is usual
NEAR_S = 0.06  # round the greatest energy: where the R peak is
BEFORE_S = (0.3, 0.08)  # before the R peak: what is level with it without a beat
FOOT_S = 0.1  # before the R peak: its foot
OVERLAP_S = 1.0  # of the samples before the next ones: a beat needs room on both sides, and SETTLED_S after it
SETTLED_S = 0.4  # after so much signal a beat does not change any more
NEEDS_S = 2.0  # of samples before any beat is certain
SHAPE_POINTS = 13  # of a QRS complex, that tell how alike two are
ALIKE = 0.66  # correlation with the median QRS complex, from which a beat is one of these (Orphanidou et al. 2015)
BRIDGED_S = 0.1  # a shorter loss is drawn through: it hides one beat at most, whose interval is left out

Floats = NDArray[np.float64]


class Beat(NamedTuple):
    """One beat; interval_s: since the one before, NaN after a loss; height and area of its QRS, level before it.

    shape: of its QRS complex, at SHAPE_POINTS times.
    """

    time_ns: int
    interval_s: float
    height: float
    area: float
    level: float
    shape: Floats


class Beats:
    """Finds the beats of one ECG. fs_hz: its rate."""

    def __init__(self, fs_hz: float) -> None:
        self._fs_hz = fs_hz
        self.restart()

    def restart(self) -> None:
        """Forget everything: what comes next has nothing to do with what came."""
        self._raw, self._times_ns = np.empty(0), np.empty(0, np.int64)  # of the last seconds
        self._ecg = self._raw  # the same with lines where samples are lost
        self._lost = np.empty(0, bool)  # drawn through, but too long to know what was there
        self._previous_ns: int | None = None
        self._decided_ns = -(2**62)

    def push(self, ecg: Floats, times_ns: NDArray[np.int64]) -> list[Beat]:
        """Take the next samples, shape (n,), evenly spaced; return the beats that are certain now.

        Of NaN for longer than BRIDGED_S, samples that are lost, nothing is known: it has no beat, nor is one of what
        reaches into it, and no interval is measured across.
        """
        least = len(ecg) + round(OVERLAP_S * self._fs_hz)
        kept = slice(-max(least, round((USUAL_S + 1) * self._fs_hz)), None)
        self._raw = np.append(self._raw, ecg)[kept]
        self._times_ns = np.append(self._times_ns, times_ns)[kept]
        self._lost = ~np.isfinite(drawn_through(self._raw, self._times_ns, BRIDGED_S))
        if np.count_nonzero(~self._lost) < NEEDS_S * self._fs_hz:
            return []
        known = np.isfinite(self._raw)
        self._ecg = np.interp(self._times_ns, self._times_ns[known], self._raw[known])
        until_ns = int(self._times_ns[-1]) - round(SETTLED_S * SECOND_NS)
        beats = [beat for beat in map(self._beat, self._peaks()) if beat.time_ns <= until_ns]
        return [self._chained(beat) for beat in beats if self._is_new(beat)]

    def _is_new(self, beat: Beat) -> bool:
        """Not one that was told, nor told from one only by a tie of two samples."""
        if beat.time_ns <= self._decided_ns + round(APART_S * SECOND_NS):
            return False
        self._decided_ns = beat.time_ns
        return True

    def _chained(self, beat: Beat) -> Beat:
        before_ns, self._previous_ns = self._previous_ns, beat.time_ns
        if before_ns is None or before_ns < self._times_ns[0]:
            return beat
        between = slice(*np.searchsorted(self._times_ns, (before_ns, beat.time_ns)))
        return beat if self._lost[between].any() else beat._replace(interval_s=(beat.time_ns - before_ns) / SECOND_NS)

    def _peaks(self) -> list[int]:
        """R peaks among the kept samples that have room on both sides."""
        near, apart = round(NEAR_S * self._fs_hz), round(APART_S * self._fs_hz)
        energy = energy_of(self._ecg, self._fs_hz)
        tops = _highest_within(energy, apart)
        if not len(tops):
            return []
        usual = np.median(np.sort(energy[tops])[-max(3, len(tops) // 2) :])
        deviation = self._ecg - np.median(self._ecg)
        tops = tops[(energy[tops] > OF_USUAL * usual) & (tops > BEFORE_S[0] * self._fs_hz + near)]
        tops = tops[tops < len(energy) - near - 2]
        before = round(BEFORE_S[0] * self._fs_hz) + near
        tops = np.array([top for top in tops if not self._lost[top - before : top + 2 * near].any()], np.int64)
        if not len(tops):
            return []
        ends = np.array(
            [
                [deviation[top - near : top + near + 1].max(), deviation[top - near : top + near + 1].min()]
                for top in tops
            ]
        )
        sign = 1.0 if np.median(ends.sum(axis=1)) >= 0 else -1.0
        return [int(top) - near + int(np.argmax(sign * deviation[top - near : top + near + 1])) for top in tops]

    def _beat(self, peak: int) -> Beat:
        """The beat at a peak, which is refined between samples by a parabola."""
        ecg, fs_hz = self._ecg, self._fs_hz
        left, top, right = ecg[peak - 1 : peak + 2]
        bend = left - 2 * top + right
        shift = float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend else 0.0
        top -= 0.25 * (left - right) * shift
        level = float(np.median(ecg[peak - round(BEFORE_S[0] * fs_hz) : peak - round(BEFORE_S[1] * fs_hz)]))
        near = round(NEAR_S * fs_hz)
        feet = ecg[peak - round(FOOT_S * fs_hz) : peak]
        height = float(top - (feet.min() if top >= level else feet.max()))
        area = float(np.abs(ecg[peak - near : peak + near] - level).mean())
        at = peak + shift + np.linspace(-NEAR_S, NEAR_S, SHAPE_POINTS) * fs_hz
        shape = np.interp(at, np.arange(len(ecg)), ecg)
        return Beat(int(self._times_ns[peak]) + round(shift / fs_hz * SECOND_NS), np.nan, height, area, level, shape)


def intervals_s(beats: Sequence[Beat]) -> Floats:
    """Return the intervals that are known, shape (k,)."""
    return np.array([beat.interval_s for beat in beats if np.isfinite(beat.interval_s)])


def alike(beats: Sequence[Beat]) -> list[Beat]:
    """Return the beats whose QRS complex looks like the median one; no interval is known across another."""
    if not beats:
        return []
    shapes = np.array([beat.shape for beat in beats])
    shapes -= shapes.mean(axis=1, keepdims=True)
    usual = np.median(shapes, axis=0)
    likeness = shapes @ usual
    is_one = likeness >= ALIKE * np.linalg.norm(shapes, axis=1) * np.linalg.norm(usual)
    follows = np.append(True, is_one[:-1])
    return [
        beat if after_one else beat._replace(interval_s=np.nan)
        for beat, one, after_one in zip(beats, is_one, follows, strict=True)
        if one
    ]


def longest_pause_s(beats: Sequence[Beat]) -> float:
    """Return the longest time between two neighbours, whatever is between them."""
    return float(np.diff([beat.time_ns for beat in beats]).max(initial=0)) / SECOND_NS


def swing(beats: Sequence[Beat]) -> float:
    """Return how far the slope of the baseline alone moves heights or areas of beats, as a share of how far they move.

    A height is measured over FOOT_S, an area against the level that was BEFORE_S: an electrode's cable that swings gets
    into both as if a chest had moved the heart.
    """
    slopes = np.gradient([beat.level for beat in beats], [beat.time_ns / SECOND_NS for beat in beats])
    of_heights = FOOT_S, spread_of(np.array([beat.height for beat in beats]))
    of_areas = sum(BEFORE_S) / 2, spread_of(np.array([beat.area for beat in beats]))
    shares = [over_s * spread_of(slopes) / spread for over_s, spread in (of_heights, of_areas) if spread > 0]
    return float(max(shares, default=0.0))


def energy_of(ecg: Floats, fs_hz: float) -> Floats:
    """Return how fast the ECG changes, averaged over a QRS complex; shape (n,) as the ECG."""
    lag, width = max(1, round(SLOPE_S * fs_hz)), max(1, round(ENERGY_S * fs_hz))
    change = np.zeros(len(ecg))
    change[lag // 2 : lag // 2 + len(ecg) - lag] = np.abs(ecg[lag:] - ecg[:-lag])
    return np.convolve(change, np.ones(width) / width, mode="same")


def _highest_within(values: Floats, reach: int) -> NDArray[np.int64]:
    """Indices whose value is the highest within reach on either side, of those that have so much room."""
    if len(values) < 2 * reach + 1:
        return np.empty(0, np.int64)
    highest = windows(values, 2 * reach + 1).max(axis=1)
    found: NDArray[np.int64] = np.flatnonzero((values[reach:-reach] == highest) & (highest > 0)) + reach
    return found
