"""Messages that were sent and never came, by the numbers that each publisher gives its own."""

MOST_PUBLISHERS = 1000  # of one topic: a stranger may make new ones for ever; those heard longest ago are forgotten


class Losses:
    """Counts of one topic. A publisher numbers its messages from 1.

    lost: missing between two of one publisher that came. missed: sent before the subscription was known to the
    publisher. replays: publishers send their newest again to late subscribers.
    """

    def __init__(self) -> None:
        self.lost = self.missed = 0
        self.replays = False
        self._numbers: dict[bytes, int] = {}  # of the newest message of each, those heard last at the end

    def take(self, publisher: bytes, number: int) -> tuple[int, int]:
        """A publisher's message with this number has come; returns how many of its are (lost, missed) before it."""
        if number <= 0:
            return 0, 0
        before = self._numbers.pop(publisher, 0)
        self._numbers[publisher] = number
        if len(self._numbers) > MOST_PUBLISHERS:
            del self._numbers[next(iter(self._numbers))]
        if before == 0 or number <= before:  # its first
            missed = 0 if self.replays else number - 1
            self.missed += missed
            return 0, missed
        self.lost += number - before - 1
        return number - before - 1, 0
