"""Which samples of a channel are a signal at all: not those that are missing, held, or stuck at a rail. Imports no ROS.

A sensor that lost its contact goes on sending: NaN, the last value again and again, an end of its range. None of these
varies, and everything that lives does. What is found here is to be treated as samples that never came.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.stamps import SECOND_NS

LONGEST_HELD_S = 0.2
BY_CHANCE = 1e-6  # of runs that quantisation makes: the more often neighbours are equal, the longer they are
ROUNDED = 1e-12  # by which means of equal values may differ
RARE, ALIVE = 0.01, 0.25  # share of equal neighbours of a sensor that shows its noise; of samples that do

Floats = NDArray[np.float64]


class Stretch(NamedTuple):
    """Neighbouring samples, all of them signal or none. undone: so many samples given before are none after all."""

    alive: bool
    values: Floats
    times_ns: NDArray[np.int64]
    undone: int


def held(values: Floats, longest: float) -> NDArray[np.bool_]:
    """Return which of the values, shape (n, channels), are in a run of more than `longest` equal ones, in samples.

    A coarse resolution makes runs of a signal too: where neighbours are often equal, runs have to be longer.
    """
    n = len(values)
    if n < 2:
        return np.zeros(values.shape, bool)
    number = np.arange(n)[:, None]
    changed = values[1:] != values[:-1]
    first = np.ones((1, values.shape[1]), bool)
    begins = np.maximum.accumulate(np.where(np.concatenate([first, changed]), number, 0), axis=0)
    ends = np.minimum.accumulate(np.where(np.concatenate([changed, first]), number, n)[::-1], axis=0)[::-1]
    equal = np.clip(1 - changed.mean(axis=0), 1e-9, 1 - 1e-9)
    return np.asarray(ends - begins + 1 > np.maximum(longest, np.log(BY_CHANCE) / np.log(equal)))


def frozen(values: Floats, longest: int) -> NDArray[np.bool_]:
    """Return which of the values, shape (n, channels), are in a run of more than `longest` equal ones in all channels.

    For signals that may rest: none where shorter runs come as well, or hardly anything else, as of a coarse resolution.
    A run at either end may be the part of a longer one that is seen: while short it says nothing of the resolution.
    """
    alike = np.isclose(values[1:], values[:-1], rtol=ROUNDED, atol=0.0).all(axis=1)
    same = np.concatenate([[False], alike, [False]])
    edges = np.flatnonzero(same[1:] != same[:-1]).reshape(-1, 2)  # first and last sample of each run
    longer = np.diff(edges, axis=1)[:, 0] >= longest
    out = np.zeros(len(values), bool)
    for first, last in edges[longer].tolist():
        out[first : last + 1] = True
    whole = (edges[:, 0] > 0) & (edges[:, 1] < len(values) - 1)
    by_chance, alive = int(np.diff(edges[~longer & whole], axis=1).sum()), np.count_nonzero(~out)
    return out & (by_chance <= RARE * alive) & (alive > ALIVE * len(out))


class Living:
    """Splits one channel into stretches of signal and of none.

    A value that is not a number is held at the last one. What then stays exactly the same for more than LONGEST_HELD_S
    is no signal, from its first sample on; some of those have been given already, `undone` of the stretch after says
    how many. `interrupted` says that samples are missing between what came and what comes.
    """

    def __init__(self) -> None:
        self._held = 0.0
        self.interrupted()

    def interrupted(self) -> None:
        """Forget what came before: the next sample begins anew."""
        self._since_ns: int | None = None  # the first sample of the run of equal ones that goes on
        self._run = 0  # its samples that were given out as signal

    def split(self, values: Floats, times_ns: NDArray[np.int64]) -> list[Stretch]:
        """Take the next samples, shape (n,) each; return their stretches in order."""
        values = self._filled(values)
        begins = values != np.concatenate(([np.nan if self._since_ns is None else self._held], values[:-1]))
        firsts_ns = np.concatenate(([-1 if self._since_ns is None else self._since_ns], times_ns[begins]))
        begun_ns = firsts_ns[np.cumsum(begins)]
        dead = times_ns - begun_ns > LONGEST_HELD_S * SECOND_NS
        edges = [0, *(np.flatnonzero(dead[1:] != dead[:-1]) + 1).tolist(), len(values)]
        stretches = [
            self._stretch(not dead[a], values[a:b], times_ns[a:b], int(begun_ns[b - 1]))
            for a, b in pairwise(edges)
            if b > a
        ]
        self._held, self._since_ns = float(values[-1]), int(begun_ns[-1])
        return stretches

    def _stretch(self, alive: bool, values: Floats, times_ns: NDArray[np.int64], begun_ns: int) -> Stretch:
        undone = 0 if alive else self._run
        of_run = int(np.count_nonzero(times_ns >= begun_ns))
        whole = of_run == len(times_ns) and begun_ns == self._since_ns
        self._run = (of_run + self._run * whole) if alive else 0
        return Stretch(alive, values, times_ns, undone)

    def _filled(self, values: Floats) -> Floats:
        valid = np.isfinite(values)
        if not valid.all():
            newest = np.maximum.accumulate(np.where(valid, np.arange(len(values)), -1))
            values = np.where(newest >= 0, values[newest], self._held)
        return values
