"""How fast what arrives is played: a replay may be slower than life. Pure."""

from collections import deque
from itertools import pairwise
from statistics import median

from sense4hri.stamps import SECOND_NS

SLOWEST = 0.01  # a replay plays no slower
STEPS = 3  # of them the middle one counts: a pause or a seek is one that is not like the others


class Pace:
    """Recorded time over the time in which it is played."""

    def __init__(self) -> None:
        self.rate: float | None = None
        """None while it is not known."""
        self._seen: deque[tuple[int, int]] = deque(maxlen=STEPS + 1)  # when, and the stamp of what came

    def take(self, stamp_ns: int, now_ns: int) -> None:
        """Take the receipt stamp of a message of a replay, and when it came."""
        if self._seen and now_ns - self._seen[-1][0] < SECOND_NS:
            return
        self._seen.append((now_ns, stamp_ns))
        steps = [(stamp - stamp_before) / (at - before) for (before, stamp_before), (at, stamp) in pairwise(self._seen)]
        if steps:
            self.rate = max(SLOWEST, median(steps))
