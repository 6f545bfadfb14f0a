"""The grid of sample time on which interpreters update, whatever the chunking."""

import numpy as np

from sense4hri.chunk import Break, TimedChunk
from sense4hri.hrv import LONGEST_GAP_S
from sense4hri.stamps import SECOND_NS

EARLY_NS = 1_000  # stamps are rounded: a sample that is this little before a point is on it


class UpdateGrid:
    """Cuts chunks at the points first + k * update_interval_s of a segment.

    The grid goes on over a gap of at most longest_gap_s, or frequent small losses would delay updates for ever.
    """

    def __init__(self, update_interval_s: float, longest_gap_s: float = LONGEST_GAP_S) -> None:
        if not update_interval_s > 0:
            raise ValueError(f"update_interval_s is {update_interval_s}, must be positive")
        self._interval_ns = round(update_interval_s * SECOND_NS)
        self._longest_gap_ns = round(longest_gap_s * SECOND_NS)
        self._next_ns: int | None = None
        self._newest_ns = 0

    def split(self, timed: TimedChunk) -> list[tuple[TimedChunk, bool]]:
        """Return consecutive pieces of the chunk; True where an update is due at the end of the piece.

        Such a piece ends with the first sample at or after its grid point. Points that no sample reached before the
        next one was due are passed over: one sample brings one update.
        """
        if self._next_ns is None or self._is_new_segment(timed):
            self._next_ns = int(timed.times_ns[0]) + self._interval_ns
        self._newest_ns = int(timed.times_ns[-1])
        reached_ns = timed.times_ns + EARLY_NS
        pieces, start = [], 0
        while start < len(timed.times_ns):
            last = start + int(np.searchsorted(reached_ns[start:], self._next_ns))
            if last >= len(timed.times_ns):
                pieces.append((timed.part(start, len(timed.times_ns)), False))
                break
            pieces.append((timed.part(start, last + 1), True))
            behind = int(reached_ns[last]) - self._next_ns
            self._next_ns += self._interval_ns * (1 + behind // self._interval_ns)
            start = last + 1
        return pieces

    def _is_new_segment(self, timed: TimedChunk) -> bool:
        if timed.break_ is not Break.GAP:
            return timed.break_ is not None
        return int(timed.times_ns[0]) - self._newest_ns > self._longest_gap_ns
