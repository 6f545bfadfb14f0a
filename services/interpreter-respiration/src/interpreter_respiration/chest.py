"""Breathing as an accelerometer at the chest or abdomen feels it: gravity tilts with every breath."""

import numpy as np
from numpy.typing import NDArray

from interpreter_respiration.features import breathing, spread_of

AXES = ("x", "y", "z")
UNKNOWN = ("", "other", "unknown")
PLACES = ("chest", "thorax", "sternum", "torso", "trunk", "abdomen", "belly", "stomach", "waist", "rib")
GRAVITY = (7.0, 12.5)  # m/s^2, length of the median acceleration of who sits, lies or walks
CLIPPED = 3.0  # robust standard deviations; a greater movement turns the direction no further

Floats = NDArray[np.float64]


class Tilt:
    """The direction that breathing moves, followed from update to update so that its sign does not change."""

    def __init__(self) -> None:
        self._direction = np.zeros(3)

    def along(self, acceleration: Floats, newest: int) -> Floats:
        """Return acceleration, shape (n, 3), along the direction in which the newest points breathe most."""
        waves = breathing(acceleration)[-newest:]
        most = CLIPPED * np.array([spread_of(wave) for wave in waves.T])
        waves = np.clip(waves, -most, most)
        direction = np.linalg.eigh(waves.T @ waves)[1][:, -1]
        against = direction @ self._direction if self._direction.any() else direction[np.abs(direction).argmax()]
        self._direction = direction if against >= 0 else -direction
        return acceleration @ self._direction


def check_place(body_location: str) -> None:
    """Raise ValueError where a device is worn where no breath is felt; of an unknown place its signal decides."""
    place = body_location.lower()
    if place not in UNKNOWN and not any(known in place for known in PLACES):
        raise ValueError(f"body_location is {body_location!r}: breathing is felt at chest or abdomen only")


def feels_gravity(acceleration: Floats) -> bool:
    """Return whether the median of acceleration in m/s^2, shape (n, 3), is about as long as gravity."""
    return bool(GRAVITY[0] <= np.linalg.norm(np.median(acceleration, axis=0)) <= GRAVITY[1])
