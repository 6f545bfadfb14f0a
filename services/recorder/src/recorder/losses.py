"""Messages that were sent and never came, by the numbers a publisher gives them."""

from collections.abc import Callable


class Losses:
    """Counts of one topic. A publisher numbers its messages from 1; the middleware does not say whose number it is.

    lost: missing between two that came. missed: sent before the subscription was known to the publisher. Both are
    counted only while the topic has one publisher. replays: the publisher sends its newest again to late subscribers.
    alone: True where the middleware has one publisher connected; it knows of a second before the graph is looked at.
    """

    def __init__(self, alone: Callable[[], bool]) -> None:
        self._alone = alone
        self.lost = self.missed = 0
        self.replays = False
        self._publishers: frozenset[bytes] = frozenset()
        self._known = self._publishers  # those that were there last, while nobody is
        self._number: int | None = 0  # None: whose number comes next is not known

    def follow(self, publishers: frozenset[bytes]) -> None:
        """Note who publishes now; what another one than the last counts from 1 again."""
        if publishers != self._publishers:
            if max(len(publishers), len(self._publishers)) > 1:
                self._number = None
            elif publishers and self._number is not None and publishers != self._known:
                self._number = 0
            self._known = publishers or self._known
            self._publishers = publishers

    def take(self, number: int) -> tuple[int, int]:
        """A message with this number has come; returns how many are (lost, missed) before it."""
        before, self._number = self._number, number
        if len(self._publishers) > 1 or before is None or number <= 0:
            return 0, 0
        if number != before + 1 and not self._alone():
            self._number = None
            return 0, 0
        if before == 0 or number <= before:  # the first of a publisher
            missed = 0 if self.replays else number - 1
            self.missed += missed
            return 0, missed
        self.lost += number - before - 1
        return number - before - 1, 0
