"""Acceleration of a wearer who walks a known number of steps, stands and lies."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
GRAVITY = 9.80665


def acceleration(
    seconds: float,
    fs_hz: float,
    walks: Iterable[tuple[float, float, float]] = (),
    up: tuple[float, float, float] = (0.0, 1.0, 0.0),
    noise: float = 0.05,
    strength: float = 2.5,
    seed: int = 0,
) -> Floats:
    """Samples in m/s^2, shape (n, 3), of a sensor whose axis `up` points up. walks: (begin, end in s, steps per min).

    A step shakes the body up and down with two harmonics, left and right not alike, and to the side half as fast.
    """
    rng = np.random.default_rng(seed)
    n = round(seconds * fs_hz)
    times_s = np.arange(n) / fs_hz
    upward = np.array(up) / np.linalg.norm(up)
    aside = np.roll(upward, 1)
    out = rng.normal(0, noise, (n, 3)) + GRAVITY * upward
    for begin_s, end_s, per_min in walks:
        on = (times_s >= begin_s) & (times_s < end_s)
        phase = 2 * np.pi * per_min / 60 * (times_s[on] - begin_s)
        bounce = -np.cos(phase) + 0.4 * np.cos(2 * phase + 1) + 0.15 * np.cos(phase / 2)
        out[on] += strength * bounce[:, None] * upward + 0.4 * strength * np.sin(phase / 2)[:, None] * aside
    return np.asarray(out)
