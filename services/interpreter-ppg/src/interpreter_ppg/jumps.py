"""Jumps of the level: what goes from one sample to the next as no pulse does. Pure.

A sensor that slips, a lamp or an LED that is set anew moves the level by many pulses within one sample. A pulse rises
for a tenth of a second. A jump is a difference between neighbours that stands alone, and steeper than all pulses.
"""

import numpy as np
from numpy.typing import NDArray
from sense4hri.medians import quantile

Floats = NDArray[np.float64]

ALONE = 4.0  # times the differences beside it that a jump is
BESIDE_S, LEAST_BESIDE = 0.02, 3  # to either side of it, the differences that are its neighbours
STEEP, STEEP_SHARE = 3.0, 0.95  # times what this share of all differences stays below: the rises are a tenth of them


def without_jumps(ppg: Floats, fs_hz: float) -> Floats:
    """Return ppg, shape (n,), evenly spaced and finite, brought to the level of its first sample.

    Where most neighbours are equal (a signal of few counts) nothing is taken out. Nor is a pop, which comes back.
    """
    beside = max(round(BESIDE_S * fs_hz), LEAST_BESIDE)
    rises = ppg[1:] - ppg[:-1]
    sizes = np.abs(rises)
    if len(sizes) <= 2 * beside or not (steep := STEEP * quantile(sizes, STEEP_SHARE)) > 0:
        return ppg
    for i in ((sizes[beside:-beside] > steep).nonzero()[0] + beside).tolist():
        if sizes[i] > ALONE * max(sizes[i - beside : i].max(), sizes[i + 1 : i + beside + 1].max()):
            jump = rises[i] - (rises[i - 1] + rises[i + 1]) / 2
            ppg = np.where(np.arange(len(ppg)) > i, ppg - jump, ppg)
    return ppg
