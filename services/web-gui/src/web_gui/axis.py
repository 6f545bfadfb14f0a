"""The page's right edge. Pure."""

from sense4hri.stamps import SECOND_NS

from web_gui.stream import FRESH_NS

LIVE_NS = 10 * SECOND_NS  # data further than this from the wall clock is a replay


class Axis:
    """The page's right edge: the wall clock, or the time of a replay that plays from long ago."""

    def __init__(self) -> None:
        self._live_until_ns = 0
        self._offset_ns = 0
        self._offset_at_ns = 0

    def saw(self, stamp_ns: int, now_ns: int) -> None:
        """Take the receipt stamp of a message and the wall clock when it came."""
        offset_ns = stamp_ns - now_ns
        if abs(offset_ns) < LIVE_NS:
            self._live_until_ns = now_ns + FRESH_NS
        if offset_ns > self._offset_ns or now_ns - self._offset_at_ns > FRESH_NS or abs(self._offset_ns) < LIVE_NS:
            self._offset_ns = offset_ns
        self._offset_at_ns = now_ns

    def replaying(self, now_ns: int) -> bool:
        """True while everything that arrives is from another time."""
        playing = now_ns - self._offset_at_ns < 30 * SECOND_NS
        return playing and now_ns > self._live_until_ns and abs(self._offset_ns) >= LIVE_NS

    def now_ns(self, now_ns: int) -> int:
        """Return the axis time of the right edge."""
        return now_ns + self._offset_ns if self.replaying(now_ns) else now_ns
