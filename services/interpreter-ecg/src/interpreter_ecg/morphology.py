"""Which beats are of one kind: a beat is known by the shape of its QRS complex, what is usual by how often it comes.

Bounded: a few templates, each the running mean of its beats. No time but the intervals that come with the beats.
"""

import math
from collections import deque
from enum import Enum
from statistics import median

import numpy as np

from interpreter_ecg.features import SHAPE_HZ, SHAPE_S, Floats

QRS_S = (-0.1, 0.1)  # the part of a beat's shape that is compared
SHIFTS = (0, -1, 1, -2, 2)  # points of the shape by which two beats may be apart
ALIKE = 0.93  # correlation from which two beats are of one kind ...
LARGER = 1.8  # ... if neither is that many times larger ...
SAME, MUCH_LARGER = 0.997, 5.0  # ... or this many, where the shapes are the same: the electrode, not the heart
LEARNING = 0.1  # of the mean, once ten beats are in it
MEMORY_BEATS = 60  # so many beats back a kind is remembered
ESTABLISHED = 2.5  # beats among those, from which a kind is no accident
RIVAL = 1.5  # times as frequent as the usual kind another one must be to take its place
MOST_KINDS = 8
PAUSE, USUAL_PAUSE = 0.06, 0.3  # mean log ratio of the intervals after and before a kind of beats that come early;
PAUSE_OF_ONE = 0.12  # over the number of beats: of a few the mean is as large by chance
EARLY, ONSET_BEATS = -0.18, 2  # mean log ratio of the first intervals of some unusual beats to the one before them
LATE = 0.9  # usual intervals after the beat before, from which on the next one may be the sinus node's
USUAL_BEATS, FEWEST_BEATS = 9, 4  # that tell how long an interval is
RESIDUALS, FEWEST_RESIDUALS = 60, 8  # beats of a kind that tell by how much (rms, of the mean's) they differ from it
ODD, ODD_RMS = 3.0, 0.3  # times their median, and of the mean's rms, from which one has fused with another kind's


class Label(Enum):
    """What a beat is."""

    NORMAL = "normal"
    ECTOPIC = "ectopic"
    UNCERTAIN = "uncertain"  # like nothing seen before: noise, or the first of its kind


class _Kind:
    """Beats that look alike. shape: of their QRS, wider than compared by the largest shift at both ends."""

    def __init__(self, wide: Floats) -> None:
        self.wide, self.members, self.weight = wide, 1, 1.0
        self.timed, self.pause = 0, 0.0  # mean log ratio of the intervals after and before, of so many beats
        self.begun, self.onset = 0, 0.0  # how early such beats set in: mean log ratio, of so many times
        self._residuals: deque[float] = deque(maxlen=RESIDUALS)

    def likeness(self, qrs: Floats, power: float) -> tuple[float, float, int]:
        """Correlation and gain of a beat at the shift that suits best."""
        best = (-1.0, 0.0, 0)
        shifted = _levelled(self.wide.take(_SHIFTED))
        powers, products = np.vecdot(shifted, shifted).tolist(), np.vecdot(shifted, qrs).tolist()
        for shift, own, both in zip(SHIFTS, powers, products, strict=True):
            if not own * power > 0:
                continue  # what is flat is like nothing
            correlation = both / math.sqrt(own * power)
            if correlation > best[0]:
                best = (correlation, both / own, shift)
        return best

    def add(self, wide: Floats) -> None:
        self.members += 1
        rate = max(1 / self.members, LEARNING)
        self.wide = self.wide + rate * (wide - self.wide)

    def is_odd(self, residual: float) -> bool:
        """Whether a beat differs from the mean of its kind far more than others; it is one of them from now on."""
        known = self._residuals
        odd = residual > ODD_RMS and len(known) >= FEWEST_RESIDUALS and residual > ODD * median(known)
        known.append(residual)
        return odd

    def begin(self, log_ratio: float) -> None:
        self.begun += 1
        self.onset += max(1 / self.begun, LEARNING) * (log_ratio - self.onset)

    def time(self, log_ratio: float) -> None:
        self.timed += 1
        self.pause += max(1 / self.timed, LEARNING) * (log_ratio - self.pause)


_REACH = max(SHIFTS)
_FIRST, _LAST = (round((edge - SHAPE_S[0]) * SHAPE_HZ) for edge in QRS_S)
_RAMP = np.arange(_LAST - _FIRST + 1) - (_LAST - _FIRST) / 2
_RAMP_POWER = float(_RAMP @ _RAMP)
_SHIFTED = np.array(SHIFTS)[:, None] + np.arange(_REACH, _REACH + len(_RAMP))  # the compared part of a wide one


def _levelled(qrs: Floats) -> Floats:
    """Without mean and slope, so that wander does not count; shape (..., 21)."""
    qrs = qrs - qrs.sum(axis=-1, keepdims=True) / len(_RAMP)
    return np.asarray(qrs - _RAMP * (np.vecdot(qrs, _RAMP)[..., None] / _RAMP_POWER))


class Morphology:
    """Labels the beats of one lead, in order."""

    def __init__(self) -> None:
        self._kinds: list[_Kind] = []
        self._usual: _Kind | None = None
        self._last: _Kind | None = None  # of the beat before
        self.unlike = False  # whether the newest beat is not shaped like the one before
        self._odd = False
        self._last_rr_ms = np.nan
        self._unusual, self._before_ms, self._onset = 0, np.nan, np.nan  # beats since the last usual one
        self._intervals_ms: deque[float] = deque(maxlen=USUAL_BEATS)

    def label(self, shape: Floats, rr_ms: float, clean: bool) -> Label:
        """Return what the beat is, and remember it.

        shape: features.beat_shape; rr_ms: the interval before, or NaN; clean: nothing else in it looked like a beat.
        """
        wide = shape[_FIRST - _REACH : _LAST + _REACH + 1]
        last_rr_ms = self._last_rr_ms
        self._time(rr_ms)
        for known in self._kinds:
            known.weight *= 1 - 1 / MEMORY_BEATS
        kind, shift, residual = self._like(wide)
        odd = kind is not None and kind.is_odd(residual)
        if kind is None:
            kind = self._remember(wide)
        else:
            kind.weight += 1
            kind.add(np.roll(wide, shift) if shift else wide)
        self._begin(kind, rr_ms, last_rr_ms)
        self.unlike = kind is not self._last or odd or self._odd
        self._last, self._odd = kind, odd
        return self._label(kind, clean and self._late(rr_ms))

    def _begin(self, kind: _Kind, rr_ms: float, last_rr_ms: float) -> None:
        """How early beats set in that are not the usual ones is true of every kind among them.

        Told by the first two: the very first may have been taken for a T wave.
        """
        if kind is self._usual:
            self._unusual = 0
            return
        if not self._unusual:
            self._before_ms = last_rr_ms
        self._unusual += 1
        if self._unusual <= ONSET_BEATS:
            self._onset = float(np.log(rr_ms / self._before_ms))
        if math.isfinite(self._onset) and (self._unusual <= ONSET_BEATS or kind is not self._last):
            kind.begin(self._onset)

    def _label(self, kind: _Kind, in_time: bool) -> Label:
        usual = self._usual
        rival = usual is not None and kind.weight > RIVAL * usual.weight and kind.onset > EARLY
        if usual not in self._kinds or rival:
            self._usual = kind
        if kind is not self._usual and min(kind.weight, kind.timed) < ESTABLISHED:
            return Label.NORMAL if in_time else Label.UNCERTAIN
        limit = (USUAL_PAUSE if kind is self._usual else PAUSE) + PAUSE_OF_ONE / max(kind.timed, 1)
        run = kind is not self._usual and kind.onset < EARLY
        return Label.ECTOPIC if run or kind.pause > limit else Label.NORMAL

    def _late(self, rr_ms: float) -> bool:
        return len(self._intervals_ms) >= FEWEST_BEATS and rr_ms > LATE * median(self._intervals_ms)

    def _like(self, wide: Floats) -> tuple[_Kind | None, int, float]:
        """The most frequent kind that the beat is like, by how many points it is to be shifted, and what is left then.

        What is left is in rms, of that of the kind's mean.
        """
        qrs = _levelled(wide[_REACH:-_REACH])
        power = float(qrs @ qrs)
        for kind in sorted(self._kinds, key=lambda kind: -kind.weight):
            correlation, gain, shift = kind.likeness(qrs, power)
            largest = MUCH_LARGER if correlation > SAME else LARGER
            if correlation > ALIKE and 1 / largest < gain < largest:
                left = 1 - 2 * gain + (gain / correlation) ** 2
                return kind, shift, math.sqrt(max(left, 0.0))  # rounding makes it less where beats are the same
        return None, 0, np.nan

    def _remember(self, wide: Floats) -> _Kind:
        if len(self._kinds) == MOST_KINDS:
            self._kinds.remove(min(self._kinds, key=lambda kind: kind.weight))
        self._kinds.append(_Kind(wide))
        return self._kinds[-1]

    def _time(self, rr_ms: float) -> None:
        """A beat that came early is followed by a longer interval than it ends; one in time is not."""
        if self._last is not None and math.isfinite(rr_ms / self._last_rr_ms):
            self._last.time(float(np.log(rr_ms / self._last_rr_ms)))
        self._last_rr_ms = rr_ms
        if math.isfinite(rr_ms):
            self._intervals_ms.append(rr_ms)
