"""Medians and quantiles where they are taken thousands of times in a minute of signal. Pure."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def median(values: Floats) -> float:
    """Return what np.median does of values, shape (n,), at least one and none NaN, in less time."""
    return float(medians(values))


def medians(rows: Floats) -> Floats:
    """Return the median along the last axis of rows, shape (..., n), at least one and none NaN."""
    parted, half = rows.copy(), rows.shape[-1] // 2
    if rows.shape[-1] % 2:
        parted.partition(half)
        return np.asarray(parted[..., half])
    parted.partition((half - 1, half))
    return np.asarray((parted[..., half - 1] + parted[..., half]) / 2)


def quantile(values: Floats, share: float) -> float:
    """Return what np.quantile does of values, shape (n,), at least one and none NaN, in less time; share: 0..1."""
    at = share * (len(values) - 1)
    below = int(at)
    above = min(below + 1, len(values) - 1)
    parted = values.copy()
    parted.partition((below, above))
    low, high, part = float(parted[below]), float(parted[above]), at - below
    return low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part)
