"""A line to draw: samples, or minimum and maximum per column. Pure numpy."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]
Values = NDArray[np.floating]
"""Single precision; double of a stream with values beyond `history.EXACT`."""


class Columns(NamedTuple):
    """A line to draw: at times_ns (n,), from low to high (n, channels). A row of NaN lifts the pen."""

    times_ns: Times
    low: Values
    high: Values

    def of(self, channels: list[int]) -> "Columns":
        """Return the line of some of its channels."""
        if channels == list(range(self.low.shape[1])):
            return self
        return Columns(self.times_ns, self.low[:, channels], self.high[:, channels])

    def then(self, later: "Columns") -> "Columns":
        """Return this line and, after it, another one, whose first column may be this one's last."""
        if not len(self.times_ns):
            return later
        before = np.minimum(self.times_ns, later.times_ns[0] - 1) if len(later.times_ns) else self.times_ns
        times_ns = np.concatenate((before, later.times_ns))
        return Columns(times_ns, np.concatenate((self.low, later.low)), np.concatenate((self.high, later.high)))

    def within(self, start_ns: int, end_ns: int) -> "Columns":
        """Return the part of the line in [start_ns, end_ns)."""
        a, b = (int(i) for i in np.searchsorted(self.times_ns, (start_ns, end_ns)))
        return Columns(self.times_ns[a:b], self.low[a:b], self.high[a:b])


def reduced(line: Columns, column_ns: int) -> tuple[Columns, NDArray[np.int64]]:
    """Return the line with one row per column, at its middle, and the number of the row with which each began.

    column_ns: width of a column; columns begin at whole multiples of it. A column that holds a NaN is NaN.
    """
    column = line.times_ns // column_ns
    begins = np.concatenate(([0], np.flatnonzero(np.diff(column)) + 1))
    middle = column[begins] * column_ns + column_ns // 2
    low, high = np.minimum.reduceat(line.low, begins), np.maximum.reduceat(line.high, begins)
    return Columns(middle, low, high), begins


def lifted(line: Columns, at: NDArray[np.int64]) -> Columns:
    """Return the line with a row of NaN before each row of `at`."""
    if not len(at):
        return line
    nan = np.float32(np.nan)
    return Columns(
        np.insert(line.times_ns, at, line.times_ns[at] - 1),
        np.insert(line.low, at, nan, axis=0),
        np.insert(line.high, at, nan, axis=0),
    )
