"""When a recorded message is due: recorded time on one side, the host's steady clock on the other. Asks no clock."""

import math

LONGEST_SILENCE_S = 3600.0  # of recorded time; a stamp years away keeps nobody waiting
LATEST_S = 1.0  # a playback further behind than this does not hurry to catch up


class Pace:
    """Maps log times in ns to times of a steady clock in s. rate 0: everything is due at once."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._at_ns, self._at_s = 0, 0.0
        self._paused_s: float | None = None

    @property
    def paused(self) -> bool:
        return self._paused_s is not None

    def begin(self, log_ns: int, now_s: float) -> None:
        """The message of log_ns is due now; also after a seek. A pause goes on."""
        self._at_ns, self._at_s = log_ns, now_s
        if self.paused:
            self._paused_s = now_s

    def due_s(self, log_ns: int) -> float:
        """When the message of log_ns is due; infinity while paused."""
        if self.paused:
            return math.inf
        if self.rate == 0.0:
            return -math.inf
        return self._at_s + (log_ns - self._at_ns) / 1e9 / self.rate

    def leap(self, log_ns: int, newest_ns: int, now_s: float) -> float:
        """Go on at log_ns at once where nothing was played for longer than anybody waits; return the s left out."""
        silent_s = (log_ns - newest_ns) / 1e9
        if silent_s <= LONGEST_SILENCE_S:
            return 0.0
        self.begin(log_ns, now_s)
        return silent_s

    def position_ns(self, now_s: float, newest_ns: int) -> int:
        """The recorded time that is reached. newest_ns: log time of the newest message played, for rate 0."""
        if self.rate == 0.0:
            return newest_ns
        until_s = now_s if self._paused_s is None else self._paused_s
        return self._at_ns + round((until_s - self._at_s) * 1e9 * self.rate)

    def told_ns(self, now_s: float, newest_ns: int, next_ns: int) -> int:
        """The recorded time to tell: on its way from the newest message played to the next one, never past that.

        A playback that is late has not yet reached what is overdue.
        """
        return max(newest_ns, min(next_ns, self.position_ns(now_s, newest_ns)))

    def played(self, log_ns: int, now_s: float) -> float:
        """Take note that a message goes out; return by how many s the schedule was moved because it came too late."""
        if self.rate == 0.0:
            self._at_ns, self._at_s = log_ns, now_s
            return 0.0
        late_s = now_s - self.due_s(log_ns)
        if late_s <= LATEST_S:
            return 0.0
        self._at_s += late_s
        return late_s

    def pause(self, now_s: float) -> None:
        """Nothing is due until resume."""
        if not self.paused:
            self._paused_s = now_s

    def resume(self, now_s: float) -> None:
        """Go on where it was paused."""
        if self._paused_s is not None:
            self._at_s += now_s - self._paused_s
            self._paused_s = None

    def set_rate(self, rate: float, now_s: float, newest_ns: int) -> None:
        """Go on from here at another speed."""
        until_s = now_s if self._paused_s is None else self._paused_s
        self._at_ns, self._at_s = self.position_ns(now_s, newest_ns), until_s
        self.rate = rate
