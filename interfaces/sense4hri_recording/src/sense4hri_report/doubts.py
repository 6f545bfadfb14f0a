"""Messages that came late, by loss or by jitter of the device's stamps, until a later one tells which."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from sense4hri_report.holes import Hole

KEPT = 64  # messages back
LATE = 0.5  # of a message: so much late or early is worth a doubt


class Doubt(NamedTuple):
    """A message that came late.

    late: by how many samples. hole: what is before it, if it was loss. samples, step_ns: in it, and the time they took.
    """

    late: float
    hole: Hole
    samples: int
    step_ns: int


class Doubts:
    """The late messages of one stream that nothing has explained yet."""

    def __init__(self) -> None:
        self._doubts: deque[Doubt] = deque(maxlen=KEPT)

    def take(self, doubt: Doubt) -> None:
        """A message that the kit took for one that continues those before it: what comes back was jitter."""
        if doubt.late < 0:
            self._doubts.clear()
        else:
            self._doubts.append(doubt)

    def settle(self, late: float) -> Doubt | None:
        """Return the one that is late by most, if that is more than `late` samples; all of them are forgotten."""
        worst = max(self._doubts, key=lambda doubt: doubt.late, default=None)
        self._doubts.clear()
        return worst if worst is not None and worst.late > late else None
