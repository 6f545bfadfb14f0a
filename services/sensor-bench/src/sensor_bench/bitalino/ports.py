"""What is plugged into a board's ports: a measure of the wearer, and the voltage that its sensor makes of it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor_bench.signals.measures import Measure
from sensor_bench.signals.waveforms import FloatArray

SUPPLY_V = 3.3
STEPS = 1024
MIDDLE_V = SUPPLY_V / 2


class Plugged(NamedTuple):
    """A kind of sensor: name of its samples, what it measures, and the volts of a value."""

    stream: str
    measure: str
    volts: Callable[[FloatArray], FloatArray]


def _electrodes(stream: str, gain: float) -> Plugged:
    return Plugged(stream, stream, lambda microvolts: MIDDLE_V + microvolts * 1e-6 * gain)


PLUGGED = {
    "ecg": _electrodes("ecg", 1100),
    "emg": _electrodes("emg", 1009),
    "eeg": _electrodes("eeg", 41782),
    "eog": _electrodes("eog", 2040),
    "eda": Plugged("eda", "eda", lambda microsiemens: 0.132 * microsiemens),
    "pzt": Plugged("respiration", "breath", lambda breath: MIDDLE_V + 0.8 * breath),
    "acc": Plugged("accelerometer", "gravity", lambda gravity: (500 + 100 * gravity) * SUPPLY_V / STEPS),
    "lux": Plugged("light", "light", lambda percent: percent / 100 * SUPPLY_V),
    "tmp": Plugged("temperature", "warmth", lambda degrees: 0.5 + 0.01 * degrees),
    "ppg": Plugged("ppg", "pulse", lambda pulse: MIDDLE_V + 0.5 * pulse),
}


class Port(NamedTuple):
    """A port of the board."""

    stream: str
    measure: Measure
    volts: Callable[[FloatArray], FloatArray]

    def counts(self, first: int, count: int, fs_hz: float) -> NDArray[np.int64]:
        """What the converter of ten bits says of these samples."""
        steps = np.rint(self.volts(self.measure(first, count, fs_hz)) / SUPPLY_V * STEPS)
        return np.clip(steps, 0, STEPS - 1).astype(np.int64)


NOTHING = Port("analog", lambda first, count, fs_hz: np.zeros(count), lambda value: value)
