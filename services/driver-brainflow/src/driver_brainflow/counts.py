"""Which number each board gives its samples, and how many are missing by it. Pure.

The number is BrainFlow's `package_num_channel`. How far it counts is not in BrainFlow's tables: for the boards below it
is read in BrainFlow's source. For all others nobody can know what is missing.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

AFRESH_S = 1.0  # by which stamps go back where a recording begins afresh
LATE_S = 10.0  # beyond the time that has passed, that a count may have moved on; further it has begun anew
BEHIND = 0.5  # of a round, that the count must be behind for a round to be in question
CATCH_UP_S = 1.0  # within which what was only held up has come
NEAR = 0.25  # of a round, by which what is missing may differ from whole rounds
SLOWER = 0.05  # share by which a board may be slower than its rate


class Numbering(NamedTuple):
    """How a board numbers what it sends.

    period: numbers until it begins again at 0. samples: that share a number. step: from one number to the next.
    skips: False where a number that is missing was never sent (a generator that falls behind).
    """

    period: int
    samples: int = 1
    step: int = 1
    skips: bool = True


_U8, _U16 = 1 << 8, 1 << 16
_MUSE = {"default": Numbering(_U16, 12), "auxiliary": Numbering(_U16, 3)}
_MUSES = ("MUSE_2", "MUSE_S", "MUSE_2016", "MUSE_2_BLED", "MUSE_S_BLED", "MUSE_2016_BLED")
NUMBERINGS: Mapping[str, Mapping[str, Numbering]] = {
    "SYNTHETIC": {name: Numbering(_U8, skips=False) for name in ("default", "auxiliary")},
    "CYTON": {"default": Numbering(_U8)},
    "CYTON_WIFI": {"default": Numbering(_U8)},
    "CYTON_DAISY": {"default": Numbering(_U8, step=2)},
    "FREEEEG32": {"default": Numbering(_U8)},
    "UNICORN": {"default": Numbering(1 << 24)},  # a float32: exact so far, 18 h
    **dict.fromkeys(_MUSES, _MUSE),
}


class Missing:
    """Tells how many samples are missing before each one of a preset.

    rate_hz: of the samples. Rounds of the counter that went by unseen are told once the count has stayed behind the
    time of the polls by whole rounds for a second: what was only held up catches up by then. A recording that begins
    afresh (its stamps go back) has lost nothing, nor has a board that counts anew: no time has passed for what would be
    missing.
    """

    def __init__(self, numbering: Numbering, rate_hz: float) -> None:
        self._numbering, self._per_s = numbering, rate_hz / numbering.samples * numbering.step
        self._rounds = Rounds(numbering.period, self._per_s)
        self._last: tuple[float, float] | None = None
        self._polled_s = math.inf
        self._repeated = False  # a number came twice: the sample did, or a whole round went by between the two

    def before(self, numbers: NDArray[np.float64], stamps_s: NDArray[np.float64], polled_s: float) -> NDArray[np.int64]:
        """Return how many samples are missing before each sample; numbers and stamps of each, shape (n,).

        polled_s: when they were fetched, on a clock that nobody sets.
        """
        first = self._last or (numbers[0], stamps_s[0])
        known, self._last = self._last is not None, (float(numbers[-1]), float(stamps_s[-1]))
        period, samples, step, skips = self._numbering
        moved = np.diff(numbers, prepend=first[0]).astype(np.int64) % period
        passed_s, self._polled_s = max(0.0, polled_s - self._polled_s), polled_s
        afresh = np.diff(stamps_s, prepend=first[1]) < -AFRESH_S
        afresh |= moved > (passed_s + LATE_S) * self._per_s
        if afresh.any():
            self._rounds.forget()
        rounds = self._rounds.unseen(int(moved.sum()), polled_s)
        self._repeated |= samples == 1 and not moved.all()
        missing = np.maximum(moved // step - 1, 0) * samples
        missing[afresh] = 0
        if not known:
            missing[0] = 0
        missing[0] += max(0, rounds * period // step - self._repeated) * samples * skips
        self._repeated &= self._rounds.behind
        return missing


class Rounds:
    """Tells the rounds of a counter that went by unseen, by how far it stays behind the time.

    period: numbers of a round. per_s: numbers in a second.
    """

    def __init__(self, period: int, per_s: float) -> None:
        self._period, self._per_s = period, per_s
        self.forget()

    def forget(self) -> None:
        """Begin anew, with the next numbers."""
        self._count, self._polled_s, self._best = 0, math.nan, -math.inf
        self._since_s, self._least = math.inf, math.inf

    @property
    def behind(self) -> bool:
        """Whether rounds may have gone by that are not told yet."""
        return self._since_s < math.inf

    def unseen(self, moved: int, polled_s: float) -> int:
        """Return the rounds that are now known to be missing. moved: numbers since the last poll that had any."""
        self._count += moved
        ahead = self._count - polled_s * self._per_s
        behind, passed_s = self._best - ahead, min(1.0, polled_s - self._polled_s)
        self._polled_s = polled_s
        if behind <= BEHIND * self._period:
            self._best = max(ahead, self._best - SLOWER * self._per_s * passed_s)
            self._since_s, self._least = math.inf, math.inf
            return 0
        self._since_s, self._least = min(self._since_s, polled_s), min(self._least, behind)
        return self._judged() if polled_s - self._since_s >= CATCH_UP_S else 0

    def _judged(self) -> int:
        rounds = round(self._least / self._period)
        near = abs(self._least - rounds * self._period) < NEAR * self._period
        self.forget()
        return rounds if near else 0
