"""The pulses of the window that an update speaks of."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Beat(NamedTuple):
    """A pulse of the chosen channel."""

    time_ns: int
    rr_ms: float
    trusted: bool  # both pulses that the interval lies between look like their predecessors
    amplitude: float


class Window(NamedTuple):
    """The pulses of the newest window_s, and of each, shape (n,), what the rate is made from."""

    window_s: float
    beats: list[Beat]
    rr_ms: Floats
    trusted: NDArray[np.bool_]
