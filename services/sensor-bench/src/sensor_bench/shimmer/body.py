"""What the parts of a Shimmer3 count while a participant wears it; the constants of its calibration are its own.

| part | counts |
|---|---|
| low-noise accelerometer | 12 bits around 2047, about 83 per m/s^2 |
| gyroscope | 16 bits, by range |
| magnetometer LSM303DLHC | 16 bits, 1100 per gauss |
| GSR amplifier | 0.5 V (1 + R / skin), R = 40.2, 287, 1000, 3300 kOhm, to 12 bits of 3 V |
| ADS1292R | 24 bits, 2.42 V / gain |
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor_bench.signals.hearts import Rhythm
from sensor_bench.signals.skin import Skin
from sensor_bench.signals.sources import EcgSource, PpgSource, Wearing
from sensor_bench.signals.waveforms import FloatArray, Waveforms

Counts = NDArray[np.int64]
FEEDBACK_KOHM = (40.2, 287.0, 1000.0, 3300.0)
GYRO_PER_DPS = (131.0, 65.5, 32.8, 16.4)
GAIN_CODES = {0: 6, 1: 1, 2: 2, 3: 3, 4: 4, 5: 8, 6: 12}


@dataclass(frozen=True)
class Constants:
    """As the factory found them: counts = offset + sensitivity * (alignment @ what is measured), per axis."""

    offset: tuple[int, int, int]
    sensitivity: tuple[float, float, float]
    alignment: tuple[tuple[float, float, float], ...]

    def counts(self, measured: FloatArray) -> FloatArray:
        return np.asarray(self.offset) + (measured @ np.asarray(self.alignment).T) * np.asarray(self.sensitivity)

    def stored(self, scale: float = 1.0) -> bytes:
        """The 21 bytes in which a Shimmer keeps them."""
        big = np.array([*self.offset, *(round(each * scale) for each in self.sensitivity)], ">i2")
        rows = np.rint(np.array(self.alignment) * 100).astype("i1")
        return big.tobytes() + rows.tobytes()


LN_ACCELEROMETER = Constants(
    (2042, 2051, 2033), (83.0, 84.0, 82.0), ((0.0, -1.0, 0.02), (-1.0, 0.0, 0.0), (0.0, 0.03, -1.0))
)
MAGNETOMETER = Constants((12, -30, 7), (1100.0, 1096.0, 980.0), ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)))


def gyroscope(of_range: int) -> Constants:
    per_dps = GYRO_PER_DPS[of_range]
    return Constants((21, -8, 40), (per_dps,) * 3, ((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)))


class Body:
    """The participant under the electrodes, and the parts' counts of it at true times in s."""

    def __init__(
        self, heart: Rhythm, skin: Skin, waveforms: Waveforms, wearing: Wearing, transit_s: float = 0.28
    ) -> None:
        self.heart, self.skin, self.wearing = heart, skin, wearing
        self.ecg = EcgSource(heart, wearing, waveforms, 1)
        self.ppg = PpgSource(heart, wearing, waveforms, 2, transit_s)
        self._resistor = 1

    def acceleration(self, times_s: FloatArray) -> FloatArray:
        """In m/s^2, shape (n, 3): at rest, moved by the breath."""
        return np.array([0.3, 1.2, 9.7]) + self.heart.breathing(times_s)[:, None] * np.array([0.05, 0.02, 0.1])

    def rotation(self, times_s: FloatArray) -> FloatArray:
        """In degrees per s, shape (n, 3)."""
        return self.heart.breathing(times_s)[:, None] * np.array([2.0, -1.0, 0.5])

    def field(self, times_s: FloatArray) -> FloatArray:
        """In gauss, shape (n, 3)."""
        return np.tile(np.array([0.2, 0.05, -0.42]), (len(times_s), 1))

    def gsr(self, times_s: FloatArray) -> Counts:
        """Words of the amplifier: the resistor in use above, the counts below; it changes where the counts go out."""
        conductance_us = self.skin.at(times_s) if self.wearing.contact else np.zeros(len(times_s))
        return np.array([self._gsr_word(each) for each in conductance_us.tolist()], np.int64)

    def _gsr_word(self, conductance_us: float) -> int:
        counts = gsr_counts(conductance_us, self._resistor)
        if counts > 3900 and self._resistor > 0:
            self._resistor -= 1
        elif counts < 1100 and self._resistor < 3:
            self._resistor += 1
        return self._resistor << 14 | gsr_counts(conductance_us, self._resistor)

    def optical(self, times_s: FloatArray) -> Counts:
        """Counts of the pulse sensor on the GSR+ board, 12 bits: more blood, more counts."""
        height = 300 if self.wearing.contact else 0
        return np.rint(2000 + height * self.ppg.pulse(times_s)).astype(np.int64)

    def exg_uv(self, chip: int, channel: int, times_s: FloatArray, muscle: bool) -> FloatArray:
        """What is between the electrodes of a converter's channel: leads II, I, nothing, V; or two muscles."""
        if muscle:
            phase = 2 * np.pi * times_s * (87.0 + 31.0 * channel)
            return np.asarray(np.where(times_s % 10 < 4, 200.0, 5.0) * np.sin(phase))
        share = ((1.0, 0.6), (0.0, 0.8))[chip][channel]
        return share * self.ecg.at(times_s)


def gsr_counts(conductance_us: float, resistor: int) -> int:
    volts = 0.5 * (1 + FEEDBACK_KOHM[resistor] * conductance_us / 1000)
    return min(4095, max(0, round(volts / 3.0 * 4095)))
