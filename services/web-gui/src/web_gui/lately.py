"""What has been counted and measured lately. Pure."""

from collections import deque

from sense4hri.stamps import SECOND_NS

from web_gui.rules import RULES

WINDOW_S = RULES["SamplesLost"].window_s
MOST = 128  # of values; whoever counts tells once a second
DELAYS_NS = 30 * SECOND_NS
MOST_DELAYS = 600


class Increase:
    """A counter of somebody else's. One that fell has begun anew: what it counts then is growth."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_ns = round(window_s * SECOND_NS)
        self._known: float | None = None
        self._grown = 0.0
        self._seen: deque[tuple[int, float]] = deque(maxlen=MOST)

    def take(self, value: float, now_ns: int) -> None:
        """Take the newest value; the first one says nothing of growth."""
        if self._known is not None:
            self._grown += value - self._known if value >= self._known else value
        self._known = value
        self._seen.append((now_ns, self._grown))

    def lately(self, now_ns: int) -> float:
        """Return the growth within the window before now_ns."""
        recent = [grown for at_ns, grown in self._seen if now_ns - at_ns <= self._window_ns]
        return recent[-1] - recent[0] if recent else 0.0


class Delays:
    """How late messages come: the time of day when they are heard minus their stamp, in s."""

    def __init__(self) -> None:
        self._seen: deque[tuple[int, float]] = deque(maxlen=MOST_DELAYS)

    def take(self, delay_s: float, now_ns: int) -> None:
        """Take one message's."""
        self._seen.append((now_ns, delay_s))

    def p99_s(self, now_ns: int) -> float | None:
        """Return the 99th percentile (nearest rank) of the last 30 s, None where nothing came."""
        recent = sorted(delay_s for at_ns, delay_s in self._seen if now_ns - at_ns <= DELAYS_NS)
        return recent[-1 - len(recent) // 100] if recent else None
