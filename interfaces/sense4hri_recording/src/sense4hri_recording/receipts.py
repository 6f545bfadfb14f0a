"""Receipt stamps that no clock explains."""

from __future__ import annotations

FAR_NS = 3_600_000_000_000


class Receipts:
    """The receipt stamps of one stream beside the times at which the recorder had its messages.

    A host's clock may be far from the recorder's, and may be set; then every stamp from there on says so. One stamp
    alone that leaps by more than an hour is no time. odd: how many of them there were.
    """

    def __init__(self) -> None:
        self.odd = 0
        self._ahead_ns: int | None = None
        self._candidate_ns: int | None = None

    def believed_ns(self, received_ns: int, log_ns: int) -> int:
        """The stamp; or, of an odd one, when the message came by the stamps before it."""
        ahead_ns = received_ns - log_ns
        expected = (self._ahead_ns, self._candidate_ns)
        if self._ahead_ns is None or any(e is not None and abs(ahead_ns - e) <= FAR_NS for e in expected):
            if self._candidate_ns is not None and abs(ahead_ns - self._candidate_ns) <= FAR_NS:
                self.odd -= 1  # the clock was set: the first stamp after it was right
            self._ahead_ns, self._candidate_ns = ahead_ns, None
            return received_ns
        self.odd += 1
        self._candidate_ns = ahead_ns
        return log_ns + self._ahead_ns
