"""Whether veog only wanders, as 1/f noise and a random walk do and no eye. Stateless; arrays are on the grid of 100 Hz.

Eyes and lids rest and then move fast: most changes are small, a few are great. What is the sum of many small steps
changes as a normal distribution does. Lids go one way, and what wanders goes both, also where it comes and goes.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from interpreter_eog.features import GRID_HZ

CHANGE_S = 0.1  # about as long as a lid closes
RESTS = 5.0  # kurtosis of the changes above which something rests: noise 3, up to 5 in ten seconds; blinks 7 to 240
PIECE_S = 10.0  # in which noise that swells and fades is nearly as strong throughout
WALKS = 1.6  # power of changes over twice that time over theirs: of white noise 1, of a walk 2 and more
BOTH_WAYS, LEAST_HUMPS = 0.4, 3  # power of the humps of one side over that of the other; so many on either side
SIDEWAYS = 2.0  # sum of the heights on heog over that on veog, where lids are on the former
ONE_WAY = 3.0  # times what heights of signs by chance would sum up to: from 9 like blinks on
DOUBT = 0.3  # by which the quality is multiplied: less than 0.7 is left, also of the mean with a good heog

Floats = NDArray[np.float64]


def wanders(levels: Sequence[Floats], heights: Sequence[float]) -> bool:
    """Return whether no eye moves so. levels: stretches without a hole; heights: of all humps in them, signed.

    Without a hump it has to go somewhere, step by step: an eye that is still shows the noise of its electrodes.
    """
    humps, changes = np.asarray(heights), _changes(levels, CHANGE_S)
    if len(humps):
        return not _one_way(humps) and (_both_ways(humps) or _tail(changes) <= RESTS)
    pieces = np.array_split(changes, max(1, round(len(changes) / (PIECE_S * GRID_HZ))))
    walks = float(np.var(_changes(levels, 2 * CHANGE_S))) > WALKS * float(np.var(changes))
    return walks and float(np.mean([_tail(piece) for piece in pieces])) <= RESTS


def lids_are_sideways(heog: Sequence[float], veog: Sequence[float]) -> bool:
    """Return whether the humps of heog, signed heights as those of veog, are the lids': many, one way, and greater."""
    humps = np.asarray(heog)
    many = len(humps) > 0 and _one_way(humps)
    return many and abs(float(humps.sum())) >= SIDEWAYS * abs(float(np.sum(veog)))


def _changes(levels: Sequence[Floats], over_s: float) -> Floats:
    lag = round(over_s * GRID_HZ)
    return np.concatenate([np.empty(0), *(level[lag:] - level[:-lag] for level in levels)])


def _tail(changes: Floats) -> float:
    """The kurtosis of changes, shape (n,); NaN where they do not differ."""
    if not len(changes):
        return np.nan
    off = changes - changes.mean()
    power = float(np.mean(off**2))
    return float(np.mean(off**4)) / power**2 if power > 0 else np.nan


def _both_ways(heights: Floats) -> bool:
    """Whether humps of both sides are many and alike."""
    sides = heights[heights > 0], heights[heights < 0]
    weaker, stronger = sorted(float(side @ side) for side in sides)
    return min(map(len, sides)) >= LEAST_HUMPS and weaker >= BOTH_WAYS * stronger


def _one_way(heights: Floats) -> bool:
    """Whether humps point one way, as lids do, and not both, as noise does."""
    return abs(float(heights.sum())) >= ONE_WAY * float(np.sqrt(heights @ heights))
