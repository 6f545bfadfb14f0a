"""The rate at which samples really come, by their times: declared ones are up to 10 % off. Imports no ROS.

Who tells frequencies of a signal needs it; who only cuts it into windows does not.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sense4hri.blocks import Block
from sense4hri.stamps import SECOND_NS

LEAST_S = 2.5  # of samples in a row before their rate is known
OFF = 0.01  # share by which it may be off unnoticed, besides what the stamps are uncertain by
UNCERTAIN_S, ARRIVAL_UNCERTAIN_S = 0.03, 0.2  # of the device's stamps, and of those by arrival
BLOCKS, ALIKE = 5, 0.25  # so many in a row, each within this share of the others, tell another usual step
LOST = 0.1  # share of the samples that may be lost unseen where the device gives no time


def usual_step_s(times_ns: NDArray[np.int64]) -> float:
    """Return the usual time from one sample of an irregular stream to the next, times shape (n,), none before another.

    Samples of one and the same time tell nothing; 1 where all are.
    """
    steps_ns = np.diff(times_ns)
    steps_ns = steps_ns[steps_ns > 0]
    return float(np.median(steps_ns)) / SECOND_NS if len(steps_ns) else 1.0


class UsualStep:
    """The usual time from one sample to the next of a stream without a fixed rate, as of its first block.

    Another one counts once BLOCKS of them in a row are alike, so that a device that begins slowly, or changes its rate,
    is not judged by its first second for good.
    """

    def __init__(self) -> None:
        self.seconds = np.nan
        self._steps_s: deque[float] = deque(maxlen=BLOCKS)

    def take(self, times_ns: NDArray[np.int64]) -> bool:
        """Take a block's times, shape (n,), n > 0; return whether another time is the usual one from here on."""
        self._steps_s.append(usual_step_s(times_ns))
        steps_s = np.array(self._steps_s)
        usual_s = float(np.median(steps_s))
        if np.isnan(self.seconds):
            self.seconds = usual_s
        alike = len(steps_s) == BLOCKS and bool((np.abs(steps_s / usual_s - 1) <= ALIKE).all())
        if not alike or abs(usual_s / self.seconds - 1) <= ALIKE:
            return False
        self.seconds = usual_s
        return True


class TrueRate:
    """The rate of one stream whose blocks have every sample, lost ones as NaN (`Blocks(filled=True)`).

    hz: the declared rate until another one has been seen; it stays within a share OFF of what is measured. Without
    device time nobody knows what was lost: fewer samples than declared are taken for a loss, up to a share LOST.
    """

    def __init__(self, declared_hz: float) -> None:
        self.hz = self._declared_hz = declared_hz
        self._since_ns: int | None = None
        self._count = 0

    def take(self, block: Block) -> bool:
        """Take a block; return whether what depends on the rate begins anew: with a segment, and with another rate."""
        if block.begins:
            self.hz, self._since_ns = self._declared_hz, None
        changed = self._measure(block) or block.begins
        if block.hole is not None:
            self._since_ns = None
        return changed

    def reasons(self) -> list[str]:
        """Say that frequencies are by another rate than the declared one; empty where they are not."""
        if self.hz == self._declared_hz:
            return []
        both = f"sampling_frequency_hz is {self._declared_hz:g}, measured {self.hz:.5g}"
        return [f"{both}: frequencies are by the latter"]

    def _measure(self, block: Block) -> bool:
        """Count from the end of the first block on: the first samples have their times by the declared rate."""
        if self._since_ns is None:
            self._since_ns, self._count = block.end_ns, 0
            return False
        self._count += len(block.times_ns)
        past_s = (block.end_ns - self._since_ns) / SECOND_NS
        if past_s < LEAST_S:
            return False
        measured_hz = self._count / past_s
        by_arrival = block.device_ns is None
        off = measured_hz / self.hz - 1
        unsure = OFF + (ARRIVAL_UNCERTAIN_S if by_arrival else UNCERTAIN_S) / past_s
        if -max(unsure, LOST if by_arrival else 0.0) <= off <= unsure:
            return False
        self.hz = measured_hz
        return True
