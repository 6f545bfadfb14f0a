"""Jumps of the baseline and pulses of a pacemaker: what goes from one sample to the next as no heart does. No ROS.

An electrode that slips moves the signal by millivolts within one sample. A QRS complex, however steep, is spread over
several at FS_HZ and above. A jump is a difference between neighbours that stands alone; it is taken out before anything
is computed, so it makes no beat and hides none. A pulse is an excursion of one or two samples, from which the signal
comes back to where it was; a QRS complex lasts 60 ms. It is taken out first, wherever it falls.
"""

import numpy as np

from interpreter_ecg.features import Floats

FS_HZ = 120.0  # below, a narrow QRS complex may be as steep as a jump
ALONE = 4.0  # times its neighbours that a jump is
MEMORY_S = 4.0  # in which the steepness of what went before is forgotten to a third
BESIDE_S, LEAST_BESIDE = 0.03, 3  # to either side of it, the differences that are its neighbours: a turn of a harmonic
PULSE, PULSE_SAMPLES, PULSE_S = 4.0, (1, 2), 0.009  # times its neighbours that a pulse is; how long it is at most
CUBIC = {1: np.array([[-1, 4, 4, -1]]) / 6, 2: np.array([[-3, 10, 5, -2], [-2, 5, 10, -3]]) / 10}
"""By the width of a pulse: what a cubic through two samples before and two behind it makes of them in its place."""


class Jumps:
    """Takes jumps out of an ECG: a difference steeper than anything that lately rose or fell over more than one."""

    def __init__(self, fs_hz: float) -> None:
        self._fs_hz = fs_hz
        self._beside = max(round(BESIDE_S * fs_hz), LEAST_BESIDE)
        self.unsure = self._beside + max(PULSE_SAMPLES)  # of the newest samples so many may still change
        self.context = 2 * self.unsure + 1  # samples before the new ones that are needed
        self._steepness = 0.0
        self.pulses: list[tuple[int, float]] = []  # index and height of those of a pacemaker last taken out
        self.jumps: list[int] = []  # index of those last taken out

    def taken_out(self, ecg: Floats) -> Floats:
        """Return ecg, shape (n,), without jumps; nothing is taken out of the first and last `unsure` differences."""
        self.pulses, self.jumps = [], []
        if self._fs_hz < FS_HZ or len(ecg) < self.context:
            return ecg
        ecg = self._without_pulses(ecg)
        steps = ecg[1:] - ecg[:-1]
        sizes = np.abs(steps)
        self._learn(steps, sizes)
        for i in (np.flatnonzero(sizes[self.unsure : -self.unsure] > self._steepness) + self.unsure).tolist():
            if sizes[i] > ALONE * max(sizes[i - self._beside : i].max(), sizes[i + 1 : i + self._beside + 1].max()):
                jump = steps[i] - (steps[i - 1] + steps[i + 1]) / 2
                ecg = np.where(np.arange(len(ecg)) > i, ecg - jump, ecg)
                self.jumps.append(i)
        return ecg

    def _without_pulses(self, ecg: Floats) -> Floats:
        reach = self._beside
        for width in (n for n in PULSE_SAMPLES if n <= max(PULSE_S * self._fs_hz, 1)):
            steps = np.abs(ecg[1:] - ecg[:-1])
            steep = np.minimum(steps[:-width], steps[width:]) > self._steepness
            for i in (np.flatnonzero(steep[reach : len(steep) - reach]) + reach + 1).tolist():
                beside = max(steps[i - 1 - reach : i - 1].max(), steps[i + width : i + width + reach].max())
                level = _across(ecg, i, width)
                height = np.abs(ecg[i : i + width] - level)
                if height.min() > PULSE * beside:
                    self.pulses.append((i, float(height.sum())))
                    ecg = np.concatenate((ecg[:i], level, ecg[i + width :]))
        return ecg

    def _learn(self, steps: Floats, sizes: Floats) -> None:
        """A rise goes on for at least two differences, each of which is at least as steep as the smaller one."""
        both = np.where(steps[1:] * steps[:-1] > 0, np.minimum(sizes[1:], sizes[:-1]), 0.0)
        fade = float(np.exp(-len(steps) / (MEMORY_S * self._fs_hz)))
        self._steepness = max(float(both.max()), fade * self._steepness)


def _across(ecg: Floats, first: int, width: int) -> Floats:
    """What a cubic through the two samples to either side has in place of `width` samples, shape (width,)."""
    last = first + width
    return np.asarray(CUBIC[width] @ np.concatenate((ecg[first - 2 : first], ecg[last : last + 2])))
