"""The resolution of a channel, as its samples show it. Imports no ROS."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def least_step(values: Floats) -> Floats:
    """Return the least difference of neighbours that differ, shape (channels,), of values, shape (n, channels).

    NaN where none do. Of a converter it is its resolution; of one much finer than its noise next to nothing.
    """
    steps = np.abs(np.diff(values, axis=0))
    steps = np.where(steps > 0, steps, np.inf).min(axis=0, initial=np.inf)
    return np.asarray(np.where(np.isfinite(steps), steps, np.nan))
