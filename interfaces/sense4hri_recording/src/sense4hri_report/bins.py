"""What a long recording looks like in a few hundred columns: fixed memory, however long it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sense4hri.intake import LARGEST

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

COLUMNS = 720
BATCH = 4096


class Axis:
    """Columns of equal length from begin_ns to end_ns, ROS time."""

    def __init__(self, begin_ns: int, end_ns: int, columns: int = COLUMNS) -> None:
        self.begin_ns, self.end_ns, self.columns = begin_ns, max(end_ns, begin_ns + 1), columns

    def column(self, at_ns: int) -> int:
        """The column of a time; the first or last one for times beyond."""
        share = (at_ns - self.begin_ns) / (self.end_ns - self.begin_ns)
        return min(max(int(share * self.columns), 0), self.columns - 1)

    def of(self, times_ns: Ints) -> Ints:
        """The columns of many times, shape (n,)."""
        share = (times_ns - self.begin_ns) / (self.end_ns - self.begin_ns)
        return np.clip(np.floor(share * self.columns), 0, self.columns - 1).astype(np.int64)


class Values:
    """A quantity now and then: smallest, largest and mean of each column. NaN is not counted, nor what no unit has."""

    def __init__(self, axis: Axis) -> None:
        self.axis = axis
        self.low = np.full(axis.columns, np.inf)
        self.high = np.full(axis.columns, -np.inf)
        self.total = np.zeros(axis.columns)
        self.count = np.zeros(axis.columns, np.int64)
        self.first = self.last = float("nan")

    def add(self, at_ns: int, value: float) -> None:
        """Take a value at a time; NaN and what no unit has is left out."""
        if not abs(value) <= LARGEST:
            return
        i = self.axis.column(at_ns)
        self.low[i], self.high[i] = min(self.low[i], value), max(self.high[i], value)
        self.total[i] += value
        self.count[i] += 1
        self.first = value if np.isnan(self.first) else self.first
        self.last = value

    @property
    def mean(self) -> Floats:
        """Mean of every column, NaN where nothing came."""
        return np.where(self.count > 0, self.total / np.maximum(self.count, 1), np.nan)

    def median(self) -> float:
        """Median over time of the columns' means; NaN where nothing came."""
        means = self.mean[self.count > 0]
        return float(np.median(means)) if len(means) else float("nan")

    def least(self) -> float:
        """Smallest value of all; NaN where nothing came."""
        return float(self.low.min()) if self.count.any() else float("nan")

    def most(self) -> float:
        """Largest value of all; NaN where nothing came."""
        return float(self.high.max()) if self.count.any() else float("nan")


class Picture:
    """The envelope of every channel of a raw stream. fresh: columns in which samples do not continue those before."""

    def __init__(self, axis: Axis) -> None:
        self.axis = axis
        self.channels: dict[str, tuple[Floats, Floats]] = {}
        self.fresh = np.zeros(axis.columns, bool)
        self._times: list[Ints] = []
        self._samples: list[Floats] = []
        self._names: tuple[str, ...] = ()
        self._waiting = 0

    def add(self, times_ns: Ints, names: tuple[str, ...], samples: Floats, fresh: bool) -> None:
        """Samples of shape (n, channels) in order of time."""
        if fresh or names != self._names:
            self.flush()
            self._names = names
            self.fresh[self.axis.column(int(times_ns[0]))] = True
        self._times.append(times_ns)
        self._samples.append(samples)
        self._waiting += len(times_ns)
        if self._waiting >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Put the samples that wait into their columns."""
        if not self._waiting:
            return
        columns = self.axis.of(np.concatenate(self._times))
        samples = np.concatenate(self._samples)
        self._times, self._samples, self._waiting = [], [], 0
        order = np.argsort(columns, kind="stable")
        columns, samples = columns[order], samples[order]
        starts = np.flatnonzero(np.diff(columns, prepend=-1))
        finite = np.isfinite(samples)
        low = np.minimum.reduceat(np.where(finite, samples, np.inf), starts, axis=0)
        high = np.maximum.reduceat(np.where(finite, samples, -np.inf), starts, axis=0)
        at = columns[starts]
        for i, name in enumerate(self._names):
            if name not in self.channels:
                empty = np.full(self.axis.columns, np.inf)
                self.channels[name] = (empty, -empty)
            lowest, highest = self.channels[name]
            lowest[at] = np.minimum(lowest[at], low[:, i])
            highest[at] = np.maximum(highest[at], high[:, i])
