"""Jumps of the baseline: what goes from one sample to the next as no heart does. Imports no ROS.

An electrode that slips moves the signal by millivolts within one sample. A QRS complex, however steep, is spread over
several at FS_HZ and above. A jump is a difference between neighbours that stands alone; it is taken out before anything
is computed, so it makes no beat and hides none. A pop, two of opposite sign, is left to the detector.
"""

import numpy as np

from interpreter_ecg.features import Floats

FS_HZ = 120.0  # below, a narrow QRS complex may be as steep as a jump
ALONE = 4.0  # times its neighbours that a jump is
MEMORY_S = 4.0  # in which the steepness of what went before is forgotten to a third
BESIDE = 3  # differences to either side of it that are its neighbours
UNSURE = BESIDE + 1  # of the newest samples so many may still change
CONTEXT = 2 * UNSURE + 1  # samples before the new ones that are needed


class Jumps:
    """Takes them out where they are steeper than anything that rose or fell over more than one difference lately."""

    def __init__(self, fs_hz: float) -> None:
        self._fs_hz = fs_hz
        self._steepness = 0.0

    def taken_out(self, ecg: Floats) -> Floats:
        """Return ecg, shape (n,), without jumps; nothing is taken out of the first and last UNSURE differences."""
        if self._fs_hz < FS_HZ or len(ecg) < CONTEXT:
            return ecg
        steps = np.diff(ecg)
        self._learn(steps)
        for i in (np.flatnonzero(np.abs(steps[UNSURE:-UNSURE]) > self._steepness) + UNSURE).tolist():
            if _alone(np.abs(steps[i - BESIDE : i + BESIDE + 1])):
                jump = steps[i] - (steps[i - 1] + steps[i + 1]) / 2
                ecg = np.where(np.arange(len(ecg)) > i, ecg - jump, ecg)
        return ecg

    def _learn(self, steps: Floats) -> None:
        """A rise goes on for at least two differences, each of which is at least as steep as the smaller one."""
        both = np.where(steps[1:] * steps[:-1] > 0, np.minimum(np.abs(steps[1:]), np.abs(steps[:-1])), 0.0)
        fade = float(np.exp(-len(steps) / (MEMORY_S * self._fs_hz)))
        self._steepness = max(float(both.max()), fade * self._steepness)


def _alone(sizes: Floats) -> bool:
    """Whether the middle one, shape (2 BESIDE + 1,), is far larger than those beside it."""
    return bool(sizes[BESIDE] > ALONE * np.delete(sizes, BESIDE).max())
