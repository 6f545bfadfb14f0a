"""What gaze says: its velocity, where it rests, jumps and is lost, and how it is spread. Stateless.

Velocity threshold (I-VT) that follows the noise of the tracker: 6 standard deviations of the velocity, estimated from
its median as in Engbert & Kliegl 2003; on- and offset lower than the peak as in Nystroem & Holmqvist 2010. Deviations:
one radius instead of an ellipse, the median of the speed itself, and a least threshold where degrees are known.
"""

from enum import IntEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS
from sense4hri.stream_info import StreamInfo

REACH_S = 0.004  # half of the time over which velocity is taken: 2 samples at 500 Hz, as Engbert & Kliegl
SIGMAS = 6.0  # of velocity noise that a saccade exceeds at its peak
EDGE, END_EDGE = 0.45, 0.6  # of the threshold: where a saccade begins and ends
MEDIAN_SPEED = 1.1774  # median of the length of a vector of two noises of standard deviation 1
SHORTEST_SACCADE_S, LONGEST_SACCADE_S = 0.006, 0.25
SHORTEST_LOSS_S, SHORTEST_LOSS = 0.025, 3  # less of it, or fewer samples, is drawn through
NEAR_LOSS_S = 0.05  # what is fast so near to lost gaze is the lid, no saccade
PAUSE_S, SWING = 0.03, 0.5  # after so short a pause what is less than this share as fast is no saccade: the eye swings
CELL_DEG, CELL_SHARE, CELL_PX = 1.0, 0.05, 50.0  # sides of a cell for entropy, in deg, of the screen, in px

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


class Kind(IntEnum):
    """What the eye does at a sample."""

    REST = 0  # a fixation, where it lasts
    SACCADE = 1
    LOST = 2  # no gaze: a blink, where it does not last
    HOLE = 3  # no gaze, and no sample: nothing is known
    OTHER = 4  # fast, but no saccade


class Run(NamedTuple):
    """A stretch of one kind. end_ns: first sample after it. first: gaze where it begins; total: sum over n samples."""

    kind: Kind
    begin_ns: int
    end_ns: int
    first: Floats
    total: Floats
    n: int
    peak: float  # greatest speed, gaze units per s

    @property
    def seconds(self) -> float:
        """How long it lasted."""
        return (self.end_ns - self.begin_ns) / SECOND_NS

    @property
    def centre(self) -> Floats:
        """Mean gaze; NaN where there is none."""
        return self.total / self.n if self.n else np.full(2, np.nan)

    def with_next(self, other: "Run") -> "Run":
        """This run and the one of the same kind that goes on where it ends."""
        total, n, peak = self.total + other.total, self.n + other.n, max(self.peak, other.peak)
        return Run(self.kind, self.begin_ns, other.end_ns, self.first, total, n, peak)


def stretches(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return (begin, end) of every stretch of True in flags, shape (k, 2); end: the first index after it."""
    return np.flatnonzero(np.diff(flags, prepend=False, append=False)).reshape(-1, 2)


def known_at(gaze: Floats) -> NDArray[np.bool_]:
    """Return which points, shape (n, 2), are numbers."""
    return np.asarray(np.isfinite(gaze).all(axis=1))


def filled(gaze: Floats, times_ns: Times, holes: NDArray[np.bool_]) -> Floats:
    """Return gaze, shape (n, 2), with a line through what is lost for too short a time to be a blink.

    holes: shape (n,), points that stand for samples which never came; no line leads through them.
    """
    lost = ~known_at(gaze)
    keep = lost.copy()
    for begin, end in stretches(lost).tolist():
        inside = begin > 0 and end < len(gaze)
        seconds = (times_ns[end] - times_ns[begin]) / SECOND_NS if inside else np.inf
        if inside and (end - begin < SHORTEST_LOSS or seconds < SHORTEST_LOSS_S) and not holes[begin:end].any():
            keep[begin:end] = False
    out = np.where(lost[:, None], np.nan, gaze)
    new = np.flatnonzero(lost & ~keep)
    if len(new):
        seen = np.flatnonzero(~lost)
        for column in (0, 1):
            out[new, column] = np.interp(times_ns[new], times_ns[seen], gaze[seen, column])
    return out


def without_spikes(gaze: Floats) -> Floats:
    """Return gaze with the median of three samples in place of each: a single one far off is gone (Stampe 1993)."""
    if len(gaze) < 3:
        return gaze
    one, two, three = gaze[:-2], gaze[1:-1], gaze[2:]
    middle = np.maximum(np.minimum(one, two), np.minimum(np.maximum(one, two), three))
    known = known_at(middle)
    out = gaze.copy()
    out[1:-1][known] = middle[known]
    return out


def velocity(gaze: Floats, times_ns: Times, reach: int) -> Floats:
    """Return gaze units per s, shape (n, 2): mean of `reach` samples after less that of as many before.

    NaN where one of them is lost or absent. Engbert & Kliegl's velocity for reach 2, at any spacing of the samples.
    """
    out = np.full(gaze.shape, np.nan)
    if len(gaze) <= 2 * reach:
        return out
    seconds = (times_ns - times_ns[0]) / SECOND_NS
    known = known_at(gaze)
    rows = np.column_stack([np.where(known[:, None], gaze, 0.0), seconds, ~known])
    sums = np.concatenate([np.zeros((1, 4)), np.cumsum(rows, axis=0)])
    after = sums[2 * reach + 1 :] - sums[reach + 1 : -reach]
    before = sums[reach : -reach - 1] - sums[: -2 * reach - 1]
    span = after - before
    good = (after[:, 3] + before[:, 3] < 0.5) & (span[:, 2] > 0)
    inner = out[reach:-reach]
    inner[good] = span[good, :2] / span[good, 2:3]
    return out


def kinds(
    speed: Floats, gaze: Floats, times_ns: Times, holes: NDArray[np.bool_], thresholds: Floats
) -> NDArray[np.int8]:
    """Return the Kind of every sample. speed, thresholds: shape (n,), units per s; gaze: (n, 2), filled."""
    lost = ~known_at(gaze)
    out = np.where(lost, Kind.LOST, Kind.REST).astype(np.int8)
    for begin, end in stretches(lost).tolist():
        if holes[begin:end].any():
            out[begin:end] = Kind.HOLE
    gone = np.flatnonzero(lost)
    for begin, end in _fast(speed, times_ns, thresholds):
        if lost[begin:end].any():
            continue
        reach_begin, reach_end = _to_loss(begin, end, times_ns, gone)
        if (reach_begin, reach_end) != (begin, end):
            out[reach_begin:reach_end] = Kind.OTHER
        else:
            short = times_ns[end - 1] - times_ns[begin] <= LONGEST_SACCADE_S * SECOND_NS
            out[begin:end] = Kind.SACCADE if short else Kind.OTHER
    return out


def _fast(speed: Floats, times_ns: Times, thresholds: Floats) -> list[tuple[int, int]]:
    """(begin, end) of stretches that exceed the threshold at their peak.

    Of two with a short pause between them the second is the swing after a saccade, so rest, where it is much slower;
    else both are one saccade.
    """
    found: list[tuple[int, int, int, float]] = []  # begin, end, end with the swings after it, peak
    for begin, until in stretches(speed > EDGE * thresholds).tolist():
        above = np.flatnonzero(speed[begin:until] > thresholds[begin:until])
        if not len(above):
            continue
        end = begin + int(np.flatnonzero(speed[begin:until] > END_EDGE * thresholds[begin:until])[-1]) + 1
        peak = float(speed[begin:until].max())
        if found and times_ns[begin] - times_ns[found[-1][2]] < PAUSE_S * SECOND_NS:
            earlier, its_end, _, its_peak = found.pop()
            begin, end = earlier, its_end if peak < SWING * its_peak else end
            peak = max(peak, its_peak)
        found.append((begin, end, until, peak))
    least_ns = SHORTEST_SACCADE_S * SECOND_NS
    long = [end - begin > 1 and times_ns[end - 1] - times_ns[begin] >= least_ns for begin, end, *_ in found]
    return [(begin, end) for (begin, end, *_), kept in zip(found, long, strict=True) if kept]


def _to_loss(begin: int, end: int, times_ns: Times, gone: Times) -> tuple[int, int]:
    """Extend a stretch to lost samples that are near it; gone: their indices."""
    near_ns, k = round(NEAR_LOSS_S * SECOND_NS), int(np.searchsorted(gone, begin))
    reach = [begin, end]
    if k > 0 and times_ns[begin] - times_ns[gone[k - 1]] < near_ns:
        reach[0] = int(gone[k - 1]) + 1
    if k < len(gone) and times_ns[gone[k]] - times_ns[end - 1] < near_ns:
        reach[1] = int(gone[k])
    return reach[0], reach[1]


def runs(kind: NDArray[np.int8], gaze: Floats, speed: Floats, times_ns: Times, end_ns: int) -> list[Run]:
    """Return consecutive samples of one kind as runs. end_ns: when the last of them ends."""
    edges = [0, *(np.flatnonzero(np.diff(kind)) + 1).tolist(), len(kind)] if len(kind) else [0]
    found = []
    for begin, end in pairwise(edges):
        part = gaze[begin:end]
        known = part[known_at(part)]
        peak = float(np.nanmax(speed[begin:end])) if np.isfinite(speed[begin:end]).any() else 0.0
        until_ns = int(times_ns[end]) if end < len(kind) else end_ns
        total = known.sum(axis=0)
        found.append(Run(Kind(kind[begin]), int(times_ns[begin]), until_ns, part[0], total, len(known), peak))
    return found


def noise_speed(speed: Floats) -> float:
    """Return the standard deviation of velocity noise per axis; saccades are too rare to move it. NaN without any."""
    known = speed[np.isfinite(speed)]
    return float(np.median(known)) / MEDIAN_SPEED if len(known) else np.nan


def entropy_bits(centres: Floats, weights: Floats, cell: float) -> float:
    """Return Shannon's entropy of where gaze rested, shape (n, 2), on a grid of cells; NaN without rest.

    Stationary gaze entropy (Shiferaw, Downey & Crewther 2019), each fixation weighted by its duration. Multiples of
    the cell are centres of cells.
    """
    total = weights.sum()
    if not total > 0 or not np.isfinite(cell):
        return np.nan
    at = np.floor(centres / cell + 0.5)
    _, which = np.unique(at, axis=0, return_inverse=True)
    share = np.bincount(which.ravel(), weights) / total
    share = share[share > 0]
    return float(max(0.0, -(share * np.log2(share)).sum()))


def quality(valid: float, arrived: float, noise: float, drift: float) -> float:
    """Return 0 to 1: share of valid samples, share of samples that came, and how far noise and drift are from harmless.

    noise, drift: 1 = as much as halves the quality.
    """
    return float(np.clip(valid * arrived / (1 + noise**2) / (1 + drift**2), 0.0, 1.0))


def share(value: float, of: float) -> float:
    """Return value / of; 0 where there is nothing to compare with."""
    return value / of if of > 0 and np.isfinite(value) else 0.0


def deg_per_unit(info: StreamInfo) -> float:
    """Return how many degrees of the visual field one unit of the stream's gaze is; NaN where that is not known."""
    if info.unit == "deg":
        return 1.0
    px_per_deg = info.optional("px_per_deg")
    return 1 / px_per_deg if info.unit == "px" and px_per_deg > 0 else np.nan


def cell_of(info: StreamInfo) -> float:
    """Return the side of a cell for entropy in the stream's unit: a degree, where known; NaN for other units."""
    if np.isfinite(deg_per_unit(info)):
        return CELL_DEG / deg_per_unit(info)
    return {"1": CELL_SHARE, "px": CELL_PX}.get(info.unit, np.nan)
