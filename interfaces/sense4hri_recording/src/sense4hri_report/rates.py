"""The rate of a stream by its own stamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

DECLARED_TRUST = 0.03  # share by which the declared rate may differ from that one; the kit follows what is left


def true_rate(declared_hz: float | None, found_hz: float, by_device: bool) -> float:
    """The declared rate, but where a device's stamps tell of quite another one, or none is declared."""
    if declared_hz is None:
        return found_hz
    differs = bool(declared_hz and found_hz) and abs(found_hz / declared_hz - 1) > DECLARED_TRUST
    return found_hz if by_device and differs else declared_hz


def rate_by_stamps(stamps_ns: ArrayLike, samples: ArrayLike, by_device: bool) -> float:
    """Rate by the median step between messages; 0 where there are fewer than three, or their stamps are unsteady.

    stamps_ns, samples: of each message, its stamp and how many samples it brought.
    """
    stamps, counts = np.asarray(stamps_ns, np.int64), np.asarray(samples, float)
    steps = np.diff(stamps) * 1e-9
    good = steps > 0
    if good.sum() < 3:
        return 0.0
    per_sample = steps[good] / counts[1:][good]
    middle = float(np.median(per_sample))
    if by_device and np.median(np.abs(per_sample / middle - 1)) > 0.2:
        return 0.0  # irregular
    if by_device:
        return 1.0 / middle
    return float(counts[1:].sum() / ((stamps[-1] - stamps[0]) * 1e-9)) if stamps[-1] > stamps[0] else 0.0
