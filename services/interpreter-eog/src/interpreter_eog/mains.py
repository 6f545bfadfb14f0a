"""Mains that sampling folds among the movements of eyes, taken out of raw samples as they come."""

import numpy as np
from numpy.typing import NDArray
from sense4hri.harmonics import lines_at, lines_seen
from sense4hri.hum import folds_hz
from sense4hri.windows import windows

PASSES_HZ = 40.0  # what is faster is smoothed away
LEAST_HZ = 1.5  # slower lines cannot be told from what eyes do
PAST_S = 4.0  # by which the mains are fitted
STANDS_OUT = 4.0  # times the amplitude beside it
REMEMBERED_S = 20.0  # a line stays, also where a blink hides it
WANDER_S = 0.5  # what is slower than this is no mains

Floats = NDArray[np.float64]


class Mains:
    """One channel sampled at fs_hz; `restart` forgets everything, `interrupted` where in its period a line was."""

    def __init__(self, fs_hz: float) -> None:
        self._fs_hz = fs_hz
        self._folded = any(hz < PASSES_HZ for hz in folds_hz(fs_hz))
        self.restart()

    def restart(self) -> None:
        """The next sample begins anew."""
        self.interrupted()
        self._seen = 0
        self._lines: dict[float, int] = {}  # Hz: the sample where it was seen

    def interrupted(self) -> None:
        """Samples are missing before the next one."""
        self._past: Floats = np.empty(0)

    def without(self, samples: Floats) -> Floats:
        """Take the next samples, shape (n,), NaN where there is none; return them without the mains."""
        if not self._folded or not len(samples):
            return samples
        self._seen += len(samples)
        self._past = np.append(self._past, samples)[-max(len(samples), round(PAST_S * self._fs_hz)) :]
        past = _calm(self._past, self._fs_hz)
        self._lines |= dict.fromkeys(lines_seen(past, self._fs_hz, STANDS_OUT), self._seen)
        lines = [hz for hz, seen in self._lines.items() if self._seen - seen <= REMEMBERED_S * self._fs_hz]
        shown = sorted(hz for hz in lines if hz >= LEAST_HZ)
        return samples - lines_at(past[:, None], self._fs_hz, shown)[-len(samples) :, 0]


def _calm(values: Floats, fs_hz: float) -> Floats:
    """The values without their wander; 0 where there is none."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(len(values))
    filled = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    reach = max(1, round(WANDER_S * fs_hz / 2))
    wide = windows(np.pad(filled, reach, mode="edge"), 2 * reach + 1)
    return np.where(known, filled - np.median(wide, axis=1), 0.0)
