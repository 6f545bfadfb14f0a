"""Premature beats as pulses show them: early, and low, because the heart had no time to fill.

The kit's correction of artefacts (Lipponen & Tarvainen 2019) lets intervals pass that differ by less than 30 % of the
median, or it would correct deep breathing: a beat a fifth too early is among them. In breathing no single pulse is
both far earlier and far lower than the one before it and the one after. Nor is one twice as high as both: that is a
blow on the sensor, which hides the pulse. A premature beat whose pulse is about as high as the others is told by the
intervals of the window alone (`by_timing`).
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.early_beats import either_side, premature
from sense4hri.hrv import HrvWindow
from sense4hri.medians import median

from interpreter_ppg.unsure import Unsure

USUAL_OF, FEWEST_USUAL = 9, 3  # intervals whose median is the usual one, and at least
EARLY, LOW = 0.87, 0.85  # share of an interval, and of a height, that a premature beat has at most
TALL = 2.0  # times as high as both its neighbours no pulse is
LONG = 1.6  # times the usual interval that one with a missing pulse has at least, as for the rate
ISOLATED = 1.6  # times what the intervals beside it do, that a premature one is shorter: at most 1.2 in deep breaths

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Taken(NamedTuple):
    """A pulse that the variability is to know of."""

    time_ns: int
    rr_ms: float  # since the pulse before, as measured
    exact_ms: float  # the same where it is sure enough for variability, else NaN
    height: float  # of its rise, the same measure for all


class NormalBeats:
    """Hands pulses on to the variability, each once the next one says whether it was premature."""

    def __init__(self, hrv: HrvWindow, unsure: Unsure) -> None:
        self._hrv, self._unsure = hrv, unsure
        self.restart()

    def restart(self) -> None:
        """Forget everything; a new segment begins."""
        self._before: Taken | None = None
        self._held: Taken | None = None
        self._after_odd = False  # the beat before the held one was premature, or none
        self._usual_ms: deque[float] = deque(maxlen=USUAL_OF)

    def add(self, pulse: Taken) -> None:
        """Take the next pulse; the one before it is known now.

        Neither the interval that a premature beat or a blow ends nor the one that it begins is normal to normal.
        """
        before, held, self._before, self._held = self._before, self._held, self._held, pulse
        if held is None:
            return
        odd = before is not None and (self._is_premature(before, held, pulse) or _is_blow(before, held, pulse))
        irregular = odd or self._after_odd
        normal = not (irregular or self._lacks_one(held))
        self._hrv.add(held.time_ns, held.exact_ms, normal=normal)
        self._unsure.add(held.time_ns, held.rr_ms, held.exact_ms if normal else np.nan)
        if not irregular and np.isfinite(held.rr_ms):
            self._usual_ms.append(held.rr_ms)
        self._after_odd = odd

    def _lacks_one(self, pulse: Taken) -> bool:
        """Return whether a pulse is missing in the interval that this one ends, as a deep breath may take it away."""
        return len(self._usual_ms) >= FEWEST_USUAL and pulse.rr_ms > LONG * median(np.array(self._usual_ms))

    def _is_premature(self, before: Taken, pulse: Taken, after: Taken) -> bool:
        """Return whether a pulse is earlier and lower than both its neighbours, and than usual; NaN is neither."""
        if len(self._usual_ms) < FEWEST_USUAL:
            return False
        shortest_ms = min(before.rr_ms, median(np.array(self._usual_ms)), after.rr_ms)
        early = np.isfinite(before.rr_ms + after.rr_ms) and pulse.rr_ms < EARLY * shortest_ms
        return bool(early and pulse.height < LOW * min(before.height, after.height))


def _is_blow(before: Taken, pulse: Taken, after: Taken) -> bool:
    """Return whether a pulse is far higher than both its neighbours."""
    return pulse.height > TALL * max(before.height, after.height)


def by_timing(rr_ms: Floats, linked: Bools) -> Bools:
    """Which intervals, in order, shape (n,), lie beside a beat that came too early, by the intervals alone.

    linked: which directly follow the one before. What the kit finds, where it stands alone: a breath that quickens
    several beats, not every one alike, makes a trough with shoulders, and a rate that moves fast makes a flank.
    """
    early = premature(rr_ms, linked)
    return either_side(early & _stands_alone(rr_ms), linked) if early.any() else early


def _stands_alone(rr_ms: Floats) -> Bools:
    """Which intervals are a dip, or a pause, between those beside them, gaps or not, that has no shoulders."""
    steps_ms = np.concatenate([[np.nan, np.nan], np.diff(rr_ms), [np.nan, np.nan]])
    next_ms = steps_ms[2:-1].copy()
    next_ms[-1] = np.inf  # what follows the newest is not known: until then it is a dip
    alone = np.zeros(len(rr_ms), bool)
    for sign in (1, -1):
        depth_ms = np.minimum(-sign * steps_ms[1:-2], sign * next_ms)
        shoulders_ms = np.fmax(np.fmax(-sign * steps_ms[:-3], sign * steps_ms[3:]), 0.0)
        alone |= depth_ms > ISOLATED * shoulders_ms
    return alone
