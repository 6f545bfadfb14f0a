"""Whether a quality has lasted: what looks like a signal for a moment is none yet. Pure."""

from sense4hri.stamps import SECOND_NS

IN_DOUBT = 0.69
"""The quality, at most, of a number that may be another one: below the 0.7 of a sure one."""
ALWAYS_NS = -(2**62)


class Lasting:
    """Since when the quality of one stream has been at least `least`, 0 to 1.

    at_once: True where a stream that is good from its first quality on need not last, as that quality stands for a long
    window already.
    """

    def __init__(self, least: float, at_once: bool = False) -> None:
        self._least, self._at_once = least, at_once
        self.restart()

    def restart(self) -> None:
        """What comes next is another stretch of the stream."""
        self._from_ns: int | None = ALWAYS_NS if self._at_once else None

    def too_short(self, quality: float, end_ns: int, enough_s: float) -> bool:
        """Return whether an update at end_ns has a quality of `least` that has not lasted for enough_s, in s.

        A quality of NaN, which is none yet, ends nothing.
        """
        if quality < self._least:
            self._from_ns = None
        if not quality >= self._least:
            return False
        if self._from_ns is None:
            self._from_ns = end_ns
        return end_ns - self._from_ns < enough_s * SECOND_NS
