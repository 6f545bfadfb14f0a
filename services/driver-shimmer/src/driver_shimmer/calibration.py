"""Counts of a Shimmer3 to canonical units, with the constants the device keeps; no I/O.

Sources: Shimmer's firmware documents (layout of the constants), its conversion notes (GSR amplifier, battery), the data
sheet of the ADS1292R (gain, reference).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from driver_shimmer.protocol import Counts

Floats = NDArray[np.float64]
ADC_VOLTS, ADC_COUNTS = 3.0, 4095
STANDARD_GAUSS_UT, DEGREE_RAD = 100.0, np.pi / 180
BLOCK = 21  # bytes of one sensor's constants
GSR_OHMS = np.array([40_200.0, 287_000.0, 1_000_000.0, 3_300_000.0])  # feedback of the amplifier, by range
GSR_VOLTS = 0.5  # across the skin
EXG_VOLTS, EXG_HIGH_VOLTS, EXG_COUNTS = 2.42, 4.033, 2**23 - 1
EXG_GAINS = (6, 1, 2, 3, 4, 8, 12)
EXG_ECG = (bytes.fromhex("02a01040402d00000203"), bytes.fromhex("02a01040470000000201"))
EXG_EMG = (bytes.fromhex("02a01069602000000203"), bytes.fromhex("02a01081810000000201"))
BATTERY_V = (3.2, 3.627, 3.681, 3.754, 3.79, 3.826, 3.862, 3.899, 3.935, 3.989, 4.076, 4.167)
BATTERY_PERCENT = (0.0, 6.0, 18.0, 30.0, 37.0, 45.0, 53.0, 61.0, 69.0, 77.0, 85.0, 100.0)


class Kinematic(NamedTuple):
    """Of three axes: offset in counts, shape (3,), and the matrix that makes units of counts, shape (3, 3)."""

    offset: Floats
    matrix: Floats

    def apply(self, counts: Counts) -> Floats:
        """Return the values in units, shape (n, 3). Ferraris, Grimaldi and Parvis 1995: C = R^-1 K^-1 (U - B)."""
        return np.asarray((counts - self.offset) @ self.matrix.T)


# Where a device keeps none: offset, axes as the parts are mounted; counts per m/s^2, degree/s by range, gauss by part.
DEFAULTS = {
    "accelerometer": (2047.0, ((0, -1, 0), (-1, 0, 0), (0, 0, -1))),
    "gyroscope": (0.0, ((0, -1, 0), (-1, 0, 0), (0, 0, -1))),
    "magnetometer": (0.0, ((-1, 0, 0), (0, 1, 0), (0, 0, -1))),
}
LN_PER_MS2, AHTR_PER_GAUSS = 83.0, 667.0
DLHC_PER_GAUSS = (1100.0, 1100.0, 980.0)  # along x, y, z; its data sheet
GYRO_PER_DPS = {250: 131.0, 500: 65.5, 1000: 32.8, 2000: 16.4}
UNITS = {"accelerometer": 1.0, "gyroscope": DEGREE_RAD, "magnetometer": STANDARD_GAUSS_UT}
_PLACES = {"accelerometer": 0, "gyroscope": 1, "magnetometer": 2}
_SENSITIVITY_SCALE = {"gyroscope": 100.0}
SENSITIVITY_TRUST = 0.2  # parts differ by some per cent, ranges by a factor of two


def kinematic(sensor_type: str, stored: bytes, usual_sensitivity: float | tuple[float, ...]) -> tuple[Kinematic, str]:
    """Return the constants of one sensor from the answer 2D, and why they are the usual ones where a block is no good.

    usual_sensitivity: of all axes, or of each. The usual constants are taken where the device keeps none, with nothing
    said, and where a sensitivity cannot be that of the range set. A block: offsets and sensitivities, three big-endian
    int16 each, then the alignment, nine int8 in hundredths.
    """
    block = stored[_PLACES[sensor_type] * BLOCK :][:BLOCK]
    numbers = np.frombuffer(block[:12], ">i2").astype(np.float64)
    alignment = np.frombuffer(block[12:], "i1").reshape(3, 3) / 100
    sensitivity = numbers[3:] / _SENSITIVITY_SCALE.get(sensor_type, 1.0)
    usual = np.broadcast_to(np.array(usual_sensitivity), 3)
    none = set(block) in ({0x00}, {0xFF}) or not np.all(sensitivity) or abs(np.linalg.det(alignment)) < 0.1
    doubt = "" if none else _doubt(sensor_type, sensitivity, usual)
    if none or doubt:
        offset, rows = DEFAULTS[sensor_type]
        numbers, sensitivity, alignment = np.full(3, offset), usual, np.array(rows, float)
    return Kinematic(numbers[:3], UNITS[sensor_type] * np.linalg.inv(alignment) / sensitivity), doubt


def _doubt(sensor_type: str, sensitivity: Floats, usual: Floats) -> str:
    """Say what is wrong where the constants were made for another range, or relative to the local field."""
    if np.all(np.abs(sensitivity / usual - 1) <= SENSITIVITY_TRUST):
        return ""
    kept = ", ".join(f"{each:g}" for each in sensitivity)
    known = ", ".join(dict.fromkeys(f"{each:g}" for each in usual))
    return f"{sensor_type}: the device keeps a sensitivity of {kept}, usual in its range is {known}: it is not taken"


def gsr_ranges(counts: Counts) -> Counts:
    """Return which resistor was in use, 0 to 3: bits 14 and 15."""
    return counts >> 14


def conductance_us(counts: Counts) -> Floats:
    """Return skin conductance in uS. The amplifier gives 0.5 V (1 + R / skin), R by range, to a converter of 12 bits.

    The same skin gives the same conductance in every range. About 0 nothing is between the electrodes.
    """
    volts = (counts & 0x0FFF) * ADC_VOLTS / ADC_COUNTS
    return np.asarray((volts / GSR_VOLTS - 1) / GSR_OHMS[gsr_ranges(counts)] * 1e6)


def exg_uv_per_count(registers: bytes) -> tuple[float, float]:
    """Return what a count of each of the two channels is, from the ten registers of an ADS1292R."""
    volts = EXG_HIGH_VOLTS if registers[1] & 0x10 else EXG_VOLTS
    gains = [EXG_GAINS[min(setting >> 4 & 7, len(EXG_GAINS) - 1)] for setting in registers[3:5]]
    return (volts * 1e6 / EXG_COUNTS / gains[0], volts * 1e6 / EXG_COUNTS / gains[1])


def exg_registers(preset: bytes, rate_hz: float) -> bytes:
    """Return a preset with the converter's rate: the lowest of 125, 250 .. 8000 Hz that is not below the sampling's."""
    steps = max(0, min(6, int(np.ceil(np.log2(max(rate_hz, 125.0) / 125.0)))))
    return bytes([preset[0] & 0xF8 | steps]) + preset[1:]


def battery_percent(content: bytes) -> float:
    """Return the charge, from the answer 94: counts behind a divider by two, and a byte of the charger."""
    volts = 2 * (int.from_bytes(content[:2], "little") & 0x0FFF) * ADC_VOLTS / ADC_COUNTS
    return float(np.interp(volts, BATTERY_V, BATTERY_PERCENT))


def has_ahtr(board: bytes) -> bool:
    """True where the board's number and revision tell of the newer LSM303AHTR. Known from its maker's software."""
    number, revision, special = board[:3]
    since = {31: 6, 37: 3, 38: 3, 47: 3, 48: 3, 49: 2}
    return special == 171 or revision >= since.get(number, 256)
