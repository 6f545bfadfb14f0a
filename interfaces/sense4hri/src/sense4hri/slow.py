"""Slow signals on an even grid: skin conductance, breathing, eyes, whatever the rate they come at. Imports no ROS.

Means over 0.1 s hold whole periods of 50 and of 60 Hz, so that the mains are gone without a filter (a finer grid needs
one); what comes more slowly, or unevenly, is drawn through. The grid begins with the first sample, so the cut into
chunks cannot matter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.stamps import SECOND_NS

GRID_HZ = 10.0

Floats = NDArray[np.float64]


class Points(NamedTuple):
    """Points of the grid. values: shape (k, channels), NaN where samples are missing; times_ns: shape (k,).

    spread: shape (k,), standard deviation of the samples of the first channel round their mean, NaN where one sample
    or none is behind a point.
    """

    values: Floats
    times_ns: NDArray[np.int64]
    spread: Floats


class Slow:
    """Brings one stream onto the grid. bridged_s: a longer time without a number becomes NaN, a shorter one a line."""

    def __init__(self, channels: int, bridged_s: float, grid_hz: float = GRID_HZ) -> None:
        self._channels, self._bridged_ns = channels, round(bridged_s * SECOND_NS)
        self._step_ns = round(SECOND_NS / grid_hz)
        self.restart()

    def restart(self) -> None:
        """The next sample begins a new grid."""
        self._first_ns: int | None = None
        self._next = 0  # point of the grid that comes next
        self._samples = np.empty((0, self._channels))  # of the step that is not full yet
        self._times_ns = np.empty(0, np.int64)
        self._mean, self._mean_ns = np.empty((0, self._channels)), np.empty(0)  # the newest one
        self._spreads: dict[int, float] = {}  # of points that are still to come

    def push(self, samples: Floats, times_ns: NDArray[np.int64]) -> Points:
        """Take samples, shape (n, channels), at their times; return the points that are complete now."""
        good = np.isfinite(samples).all(axis=1)
        self._samples = np.concatenate([self._samples, samples[good]])
        self._times_ns = np.concatenate([self._times_ns, times_ns[good]])
        if not len(self._times_ns):
            return Points(np.empty((0, self._channels)), np.empty(0, np.int64), np.empty(0))
        if self._first_ns is None:
            self._first_ns = int(self._times_ns[0])
        steps = (self._times_ns - self._first_ns) // self._step_ns
        full = int(np.searchsorted(steps, steps[-1]))
        means, means_ns, spreads = _means(self._samples[:full], self._times_ns[:full], steps[:full])
        self._samples, self._times_ns = self._samples[full:], self._times_ns[full:]
        return self._drawn(means, means_ns, spreads, steps[:full])

    def _drawn(self, means: Floats, means_ns: Floats, spreads: Floats, steps: NDArray[np.int64]) -> Points:
        """Points between the newest mean so far and the last of these."""
        means, means_ns = np.concatenate([self._mean, means]), np.concatenate([self._mean_ns, means_ns])
        if not len(means_ns):
            return Points(means, np.empty(0, np.int64), np.empty(0))
        assert self._first_ns is not None
        last = int((means_ns[-1] - self._first_ns - self._step_ns // 2) // self._step_ns)
        grid = np.arange(self._next, last + 1)
        times_ns = self._first_ns + grid * self._step_ns + self._step_ns // 2
        values = np.array([np.interp(times_ns, means_ns, column) for column in means.T]).T.reshape(-1, self._channels)
        values[self._missing(times_ns, means_ns)] = np.nan
        self._spreads |= dict(zip(np.unique(steps).tolist(), spreads.tolist(), strict=True))
        spread = np.array([self._spreads.pop(k, np.nan) for k in grid.tolist()])
        self._next, self._mean, self._mean_ns = max(self._next, last + 1), means[-1:], means_ns[-1:]
        return Points(values, times_ns.astype(np.int64), spread)

    def _missing(self, times_ns: NDArray[np.int64], means_ns: Floats) -> NDArray[np.bool_]:
        """Which points lie in a hole between two means."""
        after = np.clip(np.searchsorted(means_ns, times_ns), 1, max(1, len(means_ns) - 1))
        if len(means_ns) < 2:
            return np.zeros(len(times_ns), bool)
        apart_ns = means_ns[after] - means_ns[after - 1]
        inside = (times_ns - means_ns[after - 1] > self._step_ns) & (means_ns[after] - times_ns > self._step_ns)
        return np.asarray(inside & (apart_ns > self._bridged_ns))


def _means(samples: Floats, times_ns: NDArray[np.int64], steps: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """(means, their times, spread) of the samples of each step."""
    if not len(steps):
        return samples, np.empty(0), np.empty(0)
    starts = np.flatnonzero(np.diff(steps, prepend=-1))
    counts = np.diff(starts, append=len(steps))
    means = np.add.reduceat(samples, starts) / counts[:, None]
    offsets_ns = np.add.reduceat((times_ns - times_ns[0]).astype(float), starts) / counts
    off = samples[:, 0] - np.repeat(means[:, 0], counts)
    squares = np.add.reduceat(off * off, starts)
    with np.errstate(invalid="ignore", divide="ignore"):
        spreads = np.where(counts > 1, np.sqrt(squares / np.maximum(counts - 1, 1)), np.nan)
    return means, times_ns[0] + offsets_ns, spreads


def smoothed(values: Floats, width_s: float, grid_hz: float = GRID_HZ) -> Floats:
    """Convolve values of the grid, shape (n,) or (n, channels) without NaN, with a Gaussian of this standard deviation.

    Symmetric, so nothing is late; at both ends the last value goes on.
    """
    reach = int(np.ceil(4 * width_s * grid_hz))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (width_s * grid_hz)) ** 2)
    kernel /= kernel.sum()
    columns = values[:, None] if values.ndim == 1 else values
    padded = np.concatenate((np.repeat(columns[:1], reach, axis=0), columns, np.repeat(columns[-1:], reach, axis=0)))
    out = np.array([np.convolve(column, kernel, mode="valid") for column in padded.T]).T
    return out[:, 0] if values.ndim == 1 else out


def drawn_through(values: Floats, times_ns: NDArray[np.int64], longest_s: float) -> Floats:
    """Return values, shape (n,), with lines where those that are no numbers lie between two at most longest_s apart."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    known_ns = times_ns[known]
    after = np.searchsorted(known_ns, times_ns)
    inside = (after > 0) & (after < len(known_ns))
    after = np.clip(after, 1, max(1, len(known_ns) - 1))
    apart_ns = np.append(np.diff(known_ns, prepend=known_ns[0]), 0)[after]
    bridged = ~known & inside & (apart_ns <= round(longest_s * SECOND_NS))
    return np.where(bridged, np.interp(times_ns, known_ns, values[known]), values)


def runs(values: Floats) -> list[slice]:
    """Return the stretches of points without NaN, in order; values: shape (n,)."""
    known = np.concatenate([[False], np.isfinite(values), [False]])
    edges = np.flatnonzero(known[1:] != known[:-1]).tolist()
    return [slice(begin, end) for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def newest_run(values: Floats) -> int:
    """Return where the newest points without NaN among them begin; values: shape (n,)."""
    bad = np.flatnonzero(~np.isfinite(values))
    return int(bad[-1]) + 1 if len(bad) else 0
