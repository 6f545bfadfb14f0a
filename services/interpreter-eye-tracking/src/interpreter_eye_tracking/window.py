"""What of one stream lies in the window: events that were told, and sums over the samples of each update."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

from interpreter_eye_tracking.features import Kind, Run

Floats = NDArray[np.float64]


class Fixation(NamedTuple):
    """Gaze rested here, in its own unit."""

    begin_ns: int
    duration_ms: float
    x: float
    y: float


class Saccade(NamedTuple):
    """Gaze jumped; amplitude in its own unit, peak in that per s."""

    begin_ns: int
    duration_ms: float
    amplitude: float
    peak: float


class Blink(NamedTuple):
    """Gaze was lost for a moment."""

    begin_ns: int
    duration_ms: float


class Told(NamedTuple):
    """Events that have ended, in order."""

    fixations: list[Fixation]
    saccades: list[Saccade]
    blinks: list[Blink]


class Tally(NamedTuple):
    """Sums over the samples of one update, the newest of them at end_ns.

    seen_ns: of time without a hole; stuck: samples in which x, and y, is frozen alone; gaze: n, x, y, x^2 + y^2;
    rest: n, x, y of the velocity at rest; areas_s: dwell in each area of interest.
    """

    end_ns: int
    seen_ns: int
    samples: int
    valid: int
    missing: int
    irregular: int
    backward: int
    stuck: Floats
    gaze: Floats
    rest: Floats
    areas_s: Floats


class Window:
    """Events and tallies of the last window_s."""

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * SECOND_NS)
        self.fixations: deque[Fixation] = deque()
        self.saccades: deque[Saccade] = deque()
        self.blinks: deque[Blink] = deque()
        self._tallies: deque[Tally] = deque()

    def add(self, tally: Tally) -> None:
        """Take the sums of the newest samples; what is older than the window goes."""
        self._tallies.append(tally)
        start_ns = tally.end_ns - self._window_ns
        while self._tallies[0].end_ns <= start_ns:
            self._tallies.popleft()
        for events in (self.fixations, self.saccades, self.blinks):
            while events and events[0].begin_ns <= start_ns:
                events.popleft()

    def file(self, fresh: Told) -> Told:
        """Take new events; return them."""
        self.fixations.extend(fresh.fixations)
        self.saccades.extend(fresh.saccades)
        self.blinks.extend(fresh.blinks)
        return fresh

    def total(self, field: str) -> Floats:
        """Return the sum of one field over the window."""
        return np.sum([getattr(tally, field) for tally in self._tallies], axis=0)

    def recent_gaze(self, seconds: float) -> Floats:
        """Return the sums of gaze over the newest tallies."""
        start_ns = self._tallies[-1].end_ns - round(seconds * SECOND_NS) if self._tallies else 0
        return np.sum([t.gaze for t in self._tallies if t.end_ns > start_ns], axis=0) + np.zeros(4)


def spread(sums: Floats) -> float:
    """Return the root mean square distance of points from their centre, by sums n, x, y, x^2 + y^2; NaN without any."""
    n, x, y, squares = sums
    return float(np.sqrt(max(0.0, squares / n - (x / n) ** 2 - (y / n) ** 2))) if n else np.nan


def mean(values: "list[float]") -> float:
    """Return the mean of the numbers among them; NaN without any."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else np.nan


def sums_of(gaze: Floats) -> Floats:
    """Return n, x, y, x^2 + y^2 summed over the points, shape (n, 2), that are no NaN."""
    known = gaze[np.isfinite(gaze).all(axis=1)]
    return np.array([len(known), *known.sum(axis=0), (known * known).sum()])


def told(closed: list[tuple[Kind | None, Run, Run | None]], least_fixation_s: float, longest_blink_s: float) -> Told:
    """Return what runs that ended amount to. closed: each between the kind before it and the run after it."""
    found = Told([], [], [])
    for before, run, after in closed:
        ms = 1000 * run.seconds
        whole = before is not Kind.HOLE and after is not None and after.kind is not Kind.HOLE
        if run.kind is Kind.REST and whole and run.seconds >= least_fixation_s and run.n:
            found.fixations.append(Fixation(run.begin_ns, ms, float(run.centre[0]), float(run.centre[1])))
        if run.kind is Kind.SACCADE and after is not None:
            found.saccades.append(Saccade(run.begin_ns, ms, float(np.hypot(*(after.first - run.first))), run.peak))
        if run.kind is Kind.LOST and whole and before is not None and run.seconds <= longest_blink_s:
            found.blinks.append(Blink(run.begin_ns, ms))
    return found
