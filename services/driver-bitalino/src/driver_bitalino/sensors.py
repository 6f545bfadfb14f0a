"""What a converter's counts mean: each sensor's transfer function, as its data sheet prints it, to canonical units.

counts: of a converter of so many bits, that measures 0 to VCC. The nth acquired channel has 10 bits, from the fifth on
6, whichever port it is. Sources and what is not verified: README.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

VCC_V = 3.3
STANDARD_GRAVITY = 9.80665
FULL_BITS = 10
FloatArray = NDArray[np.float64]


class Sensor(NamedTuple):
    """A kind of sensor: what its samples are called, their unit, and values of counts from 0 to 1 of full scale."""

    sensor_type: str
    unit: str
    of_share: Callable[[FloatArray], FloatArray]


def _amplified(gain: float) -> Callable[[FloatArray], FloatArray]:
    """(counts / 2^n - 1/2) * VCC / gain, in uV."""
    return lambda share: (share - 0.5) * VCC_V / gain * 1e6


SENSORS = {
    "ecg": Sensor("ecg", "uV", _amplified(1100)),
    "emg": Sensor("emg", "uV", _amplified(1009)),
    "eeg": Sensor("eeg", "uV", _amplified(41782)),
    "eog": Sensor("eog", "uV", _amplified(2040)),
    "egg": Sensor("egg", "uV", _amplified(6110)),
    "eda": Sensor("eda", "uS", lambda share: share * VCC_V / 0.132),
    "pzt": Sensor("respiration", "a.u.", lambda share: (share - 0.5) * 100),
    "acc": Sensor("accelerometer", "m/s^2", lambda share: share),
    "lux": Sensor("light", "%", lambda share: share * 100),
    "tmp": Sensor("temperature", "degC", lambda share: (share * VCC_V - 0.5) * 100),
    "ppg": Sensor("ppg", "counts", lambda share: share * 2**FULL_BITS),
    "raw": Sensor("analog", "counts", lambda share: share * 2**FULL_BITS),
}


def bits_of(position: int) -> int:
    """Return the bits of the nth acquired channel, counted from 0."""
    return FULL_BITS if position < 4 else 6


def acceleration(low: int, high: int) -> Callable[[FloatArray], FloatArray]:
    """Return the function of an accelerometer's axis that counts low at -1 g and high at 1 g, of 10 bits."""
    return lambda share: ((share * 2**FULL_BITS - low) / (high - low) * 2 - 1) * STANDARD_GRAVITY
