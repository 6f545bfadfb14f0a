"""How often work that costs more the larger a study is may be done. Pure."""

import time


class Pace:
    """Tells how long to rest after each round of work, so that the rounds take at most `share` of one core.

    The rest is never shorter than shortest_s and never longer than longest_s. What counts is the CPU that the calling
    thread has used, not the time that has passed: on a busy machine a round takes longer and is rested for no longer.
    """

    def __init__(self, share: float, shortest_s: float, longest_s: float) -> None:
        self.share, self.shortest_s, self.longest_s = share, shortest_s, longest_s
        self._begun_s = self._before_s = 0.0

    def begin(self) -> None:
        """A round begins; on the thread that works."""
        self._before_s = 0.0
        self.go_on()

    def pause(self) -> None:
        """The round is not over, but others have the thread now."""
        self._before_s = self.used_s()

    def go_on(self) -> None:
        """The round goes on after `pause`."""
        self._begun_s = time.thread_time()

    def used_s(self) -> float:
        """Return the CPU that the round has used so far, in s."""
        return self._before_s + time.thread_time() - self._begun_s

    def rest_s(self) -> float:
        """Return how long to rest after the round that was begun."""
        return max(min(self.used_s() / self.share, self.longest_s), self.shortest_s)
