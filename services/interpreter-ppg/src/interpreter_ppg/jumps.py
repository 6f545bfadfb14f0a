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


def places(ppg: Floats, fs_hz: float) -> list[int]:
    """Return after which samples of ppg, shape (n,), evenly spaced and finite, the level jumps.

    Where most neighbours are equal (a signal of few counts) there are none. A pop, which comes back, is none.
    """
    beside = max(round(BESIDE_S * fs_hz), LEAST_BESIDE)
    sizes = np.abs(ppg[1:] - ppg[:-1])
    if len(sizes) <= 2 * beside or not (steep := STEEP * quantile(sizes, STEEP_SHARE)) > 0:
        return []
    candidates = ((sizes[beside:-beside] > steep).nonzero()[0] + beside).tolist()
    return [
        i
        for i in candidates
        if sizes[i] > ALONE * max(sizes[i - beside : i].max(), sizes[i + 1 : i + beside + 1].max())
    ]


def taken_out(ppg: Floats, jumps: list[int]) -> Floats:
    """Return ppg without the jumps after these samples, at the level of its first sample."""
    rises = ppg[1:] - ppg[:-1]
    for i in jumps:
        jump = rises[i] - (rises[i - 1] + rises[i + 1]) / 2
        ppg = np.where(np.arange(len(ppg)) > i, ppg - jump, ppg)
    return ppg
