"""The older minutes of one stream: minimum and maximum of every bucket, in blocks as they were folded. Pure numpy.

Where a sample stands is no longer changed here: by the time that samples are folded their clock is long known.
"""

from collections import deque

import numpy as np

from web_gui.columns import Columns, reduced

BUCKET_NS = 20_000_000  # two pixels of a window of 10 s: the shape of a beat is still seen
POINTS_PER_COLUMN = 2


class Coarse:
    """channels: how many; span_ns: how much time is kept before the newest bucket."""

    def __init__(self, channels: int, span_ns: int) -> None:
        self._channels, self._span_ns = channels, span_ns
        self._blocks: deque[Columns] = deque()
        self._gaps: deque[tuple[int, int]] = deque()

    @property
    def oldest_ns(self) -> int | None:
        """Time of the oldest bucket; None while there is none."""
        return int(self._blocks[0].times_ns[0]) if self._blocks else None

    @property
    def kept_bytes(self) -> int:
        """Memory that it takes."""
        return sum(sum(part.nbytes for part in block) for block in self._blocks)

    def fold(self, line: Columns, gaps: list[tuple[int, int]]) -> None:
        """Take samples in order of time, and the holes that begin in them; what is older than the span is forgotten."""
        if len(line.times_ns):
            self._blocks.append(_folded(line, gaps))
        self._gaps.extend(gaps)
        while self._blocks and self._blocks[-1].times_ns[-1] - self._blocks[0].times_ns[-1] > self._span_ns:
            self._blocks.popleft()
        while self._gaps and self._blocks and self._gaps[0][1] < self._blocks[0].times_ns[0]:
            self._gaps.popleft()

    def clear(self) -> None:
        """Forget everything."""
        self._blocks.clear()
        self._gaps.clear()

    def gaps(self, start_ns: int, end_ns: int) -> list[tuple[int, int]]:
        """Return (last sample before, first sample after) of every hole that touches the range."""
        return [(before, after) for before, after in self._gaps if before <= end_ns and after >= start_ns]

    def columns(self, start_ns: int, end_ns: int, column_ns: int, channels: list[int]) -> Columns:
        """Return the line of the chosen channels in a range, per column or, where that is coarser, per bucket."""
        empty = np.empty((0, len(channels)), np.float32)
        found = Columns(np.empty(0, np.int64), empty, empty)
        for block in self._blocks:
            found = found.then(block.within(start_ns, end_ns).of(channels))
        coarser = len(found.times_ns) and column_ns > BUCKET_NS * POINTS_PER_COLUMN
        return reduced(found, column_ns)[0] if coarser else found


def _folded(line: Columns, gaps: list[tuple[int, int]]) -> Columns:
    """Return the line per bucket, the pen lifted after each bucket in which a hole begins that leads out of it."""
    folded, begins = reduced(line, BUCKET_NS)
    before, after = (np.array([gap[side] for gap in gaps], np.int64) for side in (0, 1))
    out = before // BUCKET_NS != after // BUCKET_NS
    row = np.searchsorted(line.times_ns, before[out], side="right") - 1
    at = np.unique(np.searchsorted(begins, row, side="right"))
    at = at[at > 0]
    nan = np.float32(np.nan)
    return Columns(
        np.insert(folded.times_ns, at, folded.times_ns[at - 1] + 1),
        np.insert(folded.low, at, nan, axis=0),
        np.insert(folded.high, at, nan, axis=0),
    )
