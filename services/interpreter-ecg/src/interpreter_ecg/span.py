"""What is kept of the span of variability: labels of beats, how far noise moves them, what is in doubt. Pure."""

from collections import Counter, deque

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

from interpreter_ecg.morphology import Label

LONGEST_DOUBT_S = 20.0  # two breaths at least, so that the next early beat comes at another phase of one


class Labels:
    """Counts the labels of at most `most` beats; times on the event clock, ns, ascending."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._beats: deque[tuple[int, Label]] = deque()
        self._counts = Counter[Label]()

    def add(self, time_ns: int, label: Label) -> None:
        """Take the next beat in; where that is one too many, the oldest goes."""
        if len(self._beats) == self._most:
            self._drop()
        self._beats.append((time_ns, label))
        self._counts[label] += 1

    def ectopic_percent(self, start_ns: int, early: int) -> float:
        """Ectopic beats among those after start_ns that can be told; NaN without any. Older ones are forgotten.

        early: so many that are normal by their shape came too early.
        """
        while self._beats and self._beats[0][0] <= start_ns:
            self._drop()
        told = len(self._beats) - self._counts[Label.UNCERTAIN]
        return 100 * (self._counts[Label.ECTOPIC] + early) / told if told else np.nan

    def _drop(self) -> None:
        self._counts[self._beats.popleft()[1]] -= 1


class Jitters:
    """How far noise moves each of at most `most` beats, in s; times as for `Labels`."""

    def __init__(self, most: int) -> None:
        self._times_ns: deque[int] = deque(maxlen=most)
        self._jitters_s: deque[float] = deque(maxlen=most)

    def add(self, time_ns: int, jitter_s: float) -> None:
        """Take the next beat in; where that is one too many, the oldest goes."""
        self._times_ns.append(time_ns)
        self._jitters_s.append(jitter_s)

    def after(self, start_ns: int) -> NDArray[np.float64]:
        """Return those of the beats after start_ns, shape (n,). Older ones are forgotten."""
        while self._times_ns and self._times_ns[0] <= start_ns:
            self._times_ns.popleft()
            self._jitters_s.popleft()
        return np.fromiter(self._jitters_s, np.float64, len(self._jitters_s))


class Doubt:
    """A doubt that is gone lasts as long again as there was one, up to LONGEST_DOUBT_S; times in ns, event clock."""

    def __init__(self, first_ns: int) -> None:
        self._looked_ns, self._left_ns = first_ns, 0

    def lasts(self, doubtful: bool | None, now_ns: int) -> bool:
        """Take the next look; None where there is nothing to look at, which leaves a doubt as it is."""
        passed_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        if doubtful is not None:
            left_ns = self._left_ns + (passed_ns if doubtful else -passed_ns)
            self._left_ns = min(max(left_ns, 0), round(LONGEST_DOUBT_S * SECOND_NS))
        return bool(doubtful) or self._left_ns > 0
