"""What is kept of every beat of the span of variability: its label, and how far noise moves it. Pure."""

from collections import Counter, deque

import numpy as np
from numpy.typing import NDArray

from interpreter_ecg.morphology import Label


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
