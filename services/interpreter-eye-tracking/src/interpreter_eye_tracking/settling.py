"""Turns gaze into runs (rest, saccade, lost), each sample once: as soon as nothing that follows could change it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

from interpreter_eye_tracking import features
from interpreter_eye_tracking.features import Kind, Run

CONTEXT_S, CONTEXT = 0.15, 5  # of settled samples that are kept for what follows
SECURE_S = 0.06  # of the same on either side of a sample that settles all before it
LATEST_S = 1.0  # after so long everything is settled as it looks

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


class Settled(NamedTuple):
    """Samples of which it is now certain what they are. gaze, velocity: shape (n, 2); the others: (n,)."""

    times_ns: Times
    gaze: Floats
    velocity: Floats
    kind: NDArray[np.int8]
    closed: list[tuple[Kind | None, Run, Run | None]]  # each run that ended, between the kind before and the run after


class Settling:
    """The samples of one stream that are not settled yet, and the run that is open.

    reach: samples before and after one over which its velocity is taken.
    """

    def __init__(self, reach: int) -> None:
        self._reach = reach
        self._times_ns, self._gaze = np.empty(0, np.int64), np.empty((0, 2))
        self._holes, self._thresholds = np.empty(0, bool), np.empty(0)
        self._smooth = self._velocity = np.empty((0, 2))
        self._settled = 0  # so many of the kept ones are settled
        self._open: Run | None = None
        self._before: Kind | None = None

    def extend(self, times_ns: Times, gaze: Floats, holes: NDArray[np.bool_]) -> Floats:
        """Take the next samples, NaN where gaze is lost; return the speeds that are known only now."""
        kept = len(self._times_ns)
        self._times_ns = np.concatenate([self._times_ns, times_ns])
        self._gaze = np.concatenate([self._gaze, gaze])
        self._holes = np.concatenate([self._holes, holes])
        self._smooth = features.without_spikes(features.filled(self._gaze, self._times_ns, self._holes))
        self._velocity = features.velocity(self._smooth, self._times_ns, self._reach)
        return np.hypot(*self._velocity[max(0, kept - self._reach - 1) :].T)

    @property
    def resting(self) -> Run | None:
        """The rest that has not ended yet, as far as it is settled; None where gaze does not rest."""
        return self._open if self._open is not None and self._open.kind is Kind.REST and self._open.n else None

    def void(self, since_ns: int) -> None:
        """What came since then turned out to be no gaze."""
        gone = self._times_ns >= since_ns
        self._gaze[gone], self._holes[gone] = np.nan, True
        if self._open is not None and self._open.end_ns > since_ns:
            self._open = self._open._replace(end_ns=max(self._open.begin_ns, since_ns))

    def settle(self, threshold: float, whole: bool) -> Settled:
        """Return what is settled now, by this threshold for the newest samples; whole: nothing follows for now."""
        fresh = len(self._times_ns) - len(self._thresholds)
        self._thresholds = np.concatenate([self._thresholds, np.full(fresh, threshold)])
        speed = np.hypot(*self._velocity.T)
        kind = features.kinds(speed, self._smooth, self._times_ns, self._holes, self._thresholds)
        cut = len(kind) if whole else self._cut(kind)
        part = slice(self._settled, cut)
        times_ns = self._times_ns[part]
        settled = Settled(times_ns, self._smooth[part], self._velocity[part], kind[part], [])
        if len(times_ns):
            end_ns = int(self._times_ns[cut]) if cut < len(kind) else int(times_ns[-1]) + 1
            for run in features.runs(kind[part], settled.gaze, speed[part], times_ns, end_ns):
                self._follow(run, settled)
        if whole and self._open is not None:
            settled.closed.append((self._before, self._open, None))
        self._forget(cut)
        return settled

    def end(self) -> Settled:
        """Return what is left: nothing follows the samples that came."""
        self.extend(np.empty(0, np.int64), np.empty((0, 2)), np.empty(0, bool))
        return self.settle(np.nan, whole=True)

    def _follow(self, run: Run, settled: Settled) -> None:
        """Take the next run: it goes on with the open one, or ends it."""
        if self._open is not None and self._open.kind is run.kind:
            self._open = self._open.with_next(run)
            return
        if self._open is not None:
            settled.closed.append((self._before, self._open, run))
            self._before = self._open.kind
        self._open = run

    def _cut(self, kind: NDArray[np.int8]) -> int:
        """How many samples are settled: up to the newest that has the same on either side for long enough."""
        known = max(0, len(kind) - self._reach - 1)
        if not known:
            return self._settled
        late_ns = self._times_ns[-1] - round(LATEST_S * SECOND_NS)
        least = max(self._settled, int(np.searchsorted(self._times_ns, late_ns, side="right")))
        edges = np.concatenate([[0], np.flatnonzero(np.diff(kind[:known])) + 1, [known]])
        secure_ns = round(SECURE_S * SECOND_NS)
        for begin, end in zip(edges[:-1][::-1].tolist(), edges[1:][::-1].tolist(), strict=True):
            if end <= least:
                break
            last_ns = self._times_ns[end - 1] - secure_ns
            if kind[begin] in (Kind.REST, Kind.LOST, Kind.HOLE) and last_ns - self._times_ns[begin] > secure_ns:
                return max(least, int(np.searchsorted(self._times_ns, last_ns)))
        return least

    def _forget(self, cut: int) -> None:
        """Keep what is not settled, and a little before it."""
        if not cut:
            return
        from_ns = self._times_ns[cut - 1] - round(CONTEXT_S * SECOND_NS)
        first = max(0, min(int(np.searchsorted(self._times_ns, from_ns)), cut - CONTEXT))
        self._times_ns, self._gaze = self._times_ns[first:], self._gaze[first:]
        self._holes, self._thresholds = self._holes[first:], self._thresholds[first:]
        self._settled = cut - first
