"""The page's right edge, and how time goes on it. Pure."""

from collections import deque
from collections.abc import Callable

from sense4hri.stamps import SECOND_NS

from web_gui.pace import SLOWEST, Pace
from web_gui.stream import FRESH_NS

LIVE_NS = 10 * SECOND_NS  # data further than this from the wall clock is a replay
PLAYED_NS = 30 * SECOND_NS  # for so long after its last message it is one
ABREAST_NS = SECOND_NS  # the newest of what came within this is where a replay is: it may be slow, paused, sought back


class Axis:
    """The page's right edge: the wall clock, or the time of a replay that plays from long ago.

    wall_ns: of a moment `now_ns`, see `steady.Steady`.
    """

    def __init__(self, wall_ns: Callable[[int], int]) -> None:
        self._wall_ns = wall_ns
        self._live_until_ns = 0
        self._pace = Pace()
        self._offsets: deque[tuple[int, int]] = deque()  # of a replay: when, and stamp minus when; the greatest first

    def saw(self, stamp_ns: int, now_ns: int) -> None:
        """Take the receipt stamp of a message, and when it came."""
        if abs(stamp_ns - self._wall_ns(now_ns)) < LIVE_NS:
            self._live_until_ns = now_ns + FRESH_NS
            self._offsets.clear()
            self._pace = Pace()
            return
        self._pace.take(stamp_ns, now_ns)
        offset_ns = stamp_ns - now_ns
        while self._offsets and self._offsets[-1][1] <= offset_ns:
            self._offsets.pop()
        self._offsets.append((now_ns, offset_ns))
        while now_ns - self._offsets[0][0] > ABREAST_NS:
            self._offsets.popleft()

    def replaying(self, now_ns: int) -> bool:
        """True while everything that arrives is from another time."""
        slow = min(1.0, self._pace.rate or 1.0)
        playing = bool(self._offsets) and (now_ns - self._offsets[-1][0]) * slow < PLAYED_NS
        return playing and now_ns > self._live_until_ns

    def rate(self, now_ns: int) -> float:
        """Return how fast time goes on it, at most 1: what is played fast is judged as what is live.

        As slowly as can be while the pace of a replay is not known: nothing is missed before its second message is due.
        """
        return min(1.0, self._pace.rate or SLOWEST) if self.replaying(now_ns) else 1.0

    def step_ns(self, now_ns: int) -> int:
        """Return how much of it is played in a second, a second at least."""
        return round(SECOND_NS * max(1.0, self._pace.rate or 1.0)) if self.replaying(now_ns) else SECOND_NS

    def age_ns(self, at_ns: int, now_ns: int) -> int:
        """Return how long ago a moment was: of a slow replay, in the time of what is played."""
        return round((now_ns - at_ns) * self.rate(now_ns))

    def now_ns(self, now_ns: int) -> int:
        """Return the axis time of the right edge."""
        if not self.replaying(now_ns):
            return self._wall_ns(now_ns)
        return max(at_ns + offset_ns + self.age_ns(at_ns, now_ns) for at_ns, offset_ns in self._offsets)
