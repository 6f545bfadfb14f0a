"""Frames missing beyond what four bits can count: whole rounds of 16, told by the host's clock."""

from collections import deque

from sense4hri.stamps import SECOND_NS

from driver_bitalino.protocol import ROUND

SETTLE_S = 2.0  # of arrivals before and after a break that are compared
FEW = 4  # arrivals at least, of a slow board


class Rounds:
    """Counts the rounds that were missed when frames were lost.

    Frames come late by what the link takes, and never early. The least of that over SETTLE_S, in frames, stays what it
    was while every missing frame is counted; where it has grown by 16 after a break, a round of 16 was missed. Right
    while the board's rate is within 0.2 % of what it says, and the quickest of the link's deliveries take no longer
    than before.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._settle_s = max(SETTLE_S, FEW / rate_hz)
        self._count = 0
        self._late: deque[tuple[float, float]] = deque()  # when, and by how many frames
        self._before: float | None = None
        self._since_s = 0.0

    def missed(self, frames: int, lost: int, now_ns: int) -> int:
        """Return how many frames more are missing than counted so far, in whole rounds; mostly 0.

        frames: that have come now, with lost missing before or between them. now_ns: of a clock that nobody sets.
        """
        now_s = now_ns / SECOND_NS
        if lost and self._late:
            self._before = self._least() if self._before is None else self._before
            self._since_s = now_s
            self._late.clear()
        self._count += frames + lost
        self._late.append((now_s, now_s * self._rate_hz - self._count))
        while self._before is None and now_s - self._late[0][0] > self._settle_s:
            self._late.popleft()
        if self._before is None or now_s - self._since_s < self._settle_s:
            return 0
        missed = max(0, round((self._least() - self._before) / ROUND)) * ROUND
        self._count += missed
        self._late = deque((when_s, late - missed) for when_s, late in self._late)
        self._before = None
        return missed

    def _least(self) -> float:
        return min(late for _, late in self._late)
