"""The rate of a stream by its own stamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

DECLARED_TRUST = 0.03  # share by which the declared rate may differ from that one; the kit follows what is left
ALIKE = 0.1  # share by which the rate of all stamps and of the usual step may differ; losses make it more


def true_rate(declared_hz: float | None, found_hz: float, by_device: bool, usual_hz: float) -> float:
    """The declared rate, but where stamps tell of quite another one, or none is declared.

    usual_hz: by the usual step. Receipt, which jitters, tells it by ALIKE, and only where nothing seems to be lost.
    """
    if declared_hz is None:
        return found_hz
    if not declared_hz or not found_hz or abs(usual_hz / found_hz - 1) > ALIKE:
        return declared_hz
    return found_hz if abs(found_hz / declared_hz - 1) > (DECLARED_TRUST if by_device else ALIKE) else declared_hz


def usual_rate(stamps_ns: ArrayLike, samples: ArrayLike) -> float:
    """Rate by the median step between messages alone; 0 where that is none."""
    steps = np.diff(np.asarray(stamps_ns, np.int64)) * 1e-9
    middle = float(np.median(steps / np.asarray(samples, float)[1:])) if len(steps) else 0.0
    return 1.0 / middle if middle > 0 else 0.0


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
