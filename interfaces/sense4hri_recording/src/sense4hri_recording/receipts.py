"""Receipt stamps that no clock explains."""

from __future__ import annotations

FAR_NS = 3_600_000_000_000


class Receipts:
    """The receipt stamps of one stream beside the times at which the recorder had its messages.

    A host's clock may be far from the recorder's, and may be set; then the stamps from the second one on say so. One
    stamp alone that leaps by more than an hour is no time. odd: how many of them there were, the first after a clock
    was set among them, and a stream's first where the second is nearer to the recorder's time by more than an hour.
    """

    def __init__(self) -> None:
        self.odd = 0
        self._ahead_ns: int | None = None
        self._candidate_ns: int | None = None
        self._is_second = False

    def believed_ns(self, received_ns: int, log_ns: int) -> int:
        """The stamp; or, of an odd one, when the message came by the stamps before it."""
        ahead_ns, is_second = received_ns - log_ns, self._is_second
        self._is_second = self._ahead_ns is None
        if self._ahead_ns is None or _is_near(self._ahead_ns, ahead_ns) or _is_near(self._candidate_ns, ahead_ns):
            self._ahead_ns, self._candidate_ns = ahead_ns, None
            return received_ns
        self.odd += 1
        if is_second and abs(ahead_ns) + FAR_NS < abs(self._ahead_ns):
            self._ahead_ns = ahead_ns
            return received_ns
        self._candidate_ns = ahead_ns
        return log_ns + self._ahead_ns


def _is_near(expected_ns: int | None, ahead_ns: int) -> bool:
    return expected_ns is not None and abs(ahead_ns - expected_ns) <= FAR_NS
