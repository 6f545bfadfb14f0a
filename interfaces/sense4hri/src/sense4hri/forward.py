"""Streams whose stamps go back now and then: late samples are counted and left out, never reordered. Imports no ROS.

For interpreters of streams without a fixed rate, or with frames that come twice (contract, section 3). Of samples that
share a time, as of a frame of many in a stream that has one to a message, only the first is taken.
"""

import numpy as np

from sense4hri.chunk import Break, TimedChunk
from sense4hri.stamps import SECOND_NS

BACK_S = 1.0  # stamps that go back by less are late samples, by more a device that started afresh


class Forward:
    """Lets one stream's samples through in the order of their times. away_s: a longer time without any is a gap."""

    def __init__(self, away_s: float) -> None:
        self._away_ns = round(away_s * SECOND_NS)
        self._newest_ns: int | None = None
        self._late = 0

    def take(self, timed: TimedChunk) -> TimedChunk | None:
        """Return the samples that are newer than the newest one; None where there is none."""
        timed = self._rising(timed)
        newest_ns, self._newest_ns = self._newest_ns, int(timed.times_ns[-1])
        if newest_ns is None or newest_ns - timed.times_ns[0] > BACK_S * SECOND_NS:
            return timed
        late = int(np.searchsorted(timed.times_ns, newest_ns, side="right"))
        self._late += late
        if late == len(timed.times_ns):
            self._newest_ns = newest_ns
            return None
        timed = timed.part(late, len(timed.times_ns))
        away = timed.times_ns[0] - newest_ns > self._away_ns
        return timed._replace(break_=Break.GAP if away else None)

    def _rising(self, timed: TimedChunk) -> TimedChunk:
        """Without samples whose time is no later than that of the one before."""
        later = np.concatenate([[True], np.diff(timed.times_ns) > 0])
        if later.all():
            return timed
        self._late += int((~later).sum())
        return timed._replace(samples=timed.samples[later], times_ns=timed.times_ns[later])

    def late(self) -> int:
        """Return how many samples were left out since this was asked last."""
        late, self._late = self._late, 0
        return late
