"""Which number each board gives its samples, and how many are missing by it. Pure.

The number is BrainFlow's `package_num_channel`. How far it counts is not in BrainFlow's tables: for the boards below it
is read in BrainFlow's source. For all others nobody can know what is missing.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

AFRESH_S = 1.0  # by which stamps go back where a recording begins afresh
EARLY = 0.5  # of a round: a pause that took more than so much of the rounds that are in question


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

    rate_hz: of the samples. Rounds of the counter that went by unseen are told by BrainFlow's stamps, where the board
    was silent for more than half a round. A recording that begins afresh (its stamps go back) has lost nothing.
    """

    def __init__(self, numbering: Numbering, rate_hz: float) -> None:
        self._numbering, self._per_s = numbering, rate_hz / numbering.samples * numbering.step
        self._last: tuple[float, float] | None = None

    def before(self, numbers: NDArray[np.float64], stamps_s: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return how many samples are missing before each sample; numbers and stamps of each, shape (n,)."""
        first = self._last or (numbers[0], stamps_s[0])
        known, self._last = self._last is not None, (float(numbers[-1]), float(stamps_s[-1]))
        period, samples, step, skips = self._numbering
        moved = np.diff(numbers, prepend=first[0]).astype(np.int64) % period
        passed_s = np.diff(stamps_s, prepend=first[1])
        rounds = np.rint((passed_s * self._per_s - moved) / period)
        long = passed_s * self._per_s > EARLY * period
        moved += (np.where(long & (rounds > 0), rounds, 0) * period * skips).astype(np.int64)
        missing = np.maximum(moved // step - 1, 0) * samples
        missing[passed_s < -AFRESH_S] = 0
        if not known:
            missing[0] = 0
        return missing
