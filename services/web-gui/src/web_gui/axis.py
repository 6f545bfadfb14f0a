"""The page's right edge. Pure."""

from collections.abc import Callable

from sense4hri.stamps import SECOND_NS

from web_gui.stream import FRESH_NS

LIVE_NS = 10 * SECOND_NS  # data further than this from the wall clock is a replay


class Axis:
    """The page's right edge: the wall clock, or the time of a replay that plays from long ago.

    wall_ns: of a moment `now_ns`, see `steady.Steady`.
    """

    def __init__(self, wall_ns: Callable[[int], int]) -> None:
        self._wall_ns = wall_ns
        self._live = True  # what the offset is of
        self._live_until_ns = 0
        self._offset_ns = 0
        self._offset_at_ns = 0

    def saw(self, stamp_ns: int, now_ns: int) -> None:
        """Take the receipt stamp of a message, and when it came."""
        offset_ns = stamp_ns - now_ns
        live = abs(stamp_ns - self._wall_ns(now_ns)) < LIVE_NS
        if live:
            self._live_until_ns = now_ns + FRESH_NS
        if offset_ns > self._offset_ns or now_ns - self._offset_at_ns > FRESH_NS or self._live:
            self._offset_ns, self._live = offset_ns, live
        self._offset_at_ns = now_ns

    def replaying(self, now_ns: int) -> bool:
        """True while everything that arrives is from another time."""
        playing = now_ns - self._offset_at_ns < 30 * SECOND_NS
        return playing and now_ns > self._live_until_ns and not self._live

    def now_ns(self, now_ns: int) -> int:
        """Return the axis time of the right edge."""
        return now_ns + self._offset_ns if self.replaying(now_ns) else self._wall_ns(now_ns)
