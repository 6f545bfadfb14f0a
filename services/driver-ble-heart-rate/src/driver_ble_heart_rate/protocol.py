"""Bytes of the Pulse Oximeter service (0x1822) to numbers; no I/O, no clock. Heart rate (0x2A37) is `sense4hri.gatt`'s.

Source: Bluetooth SIG, Pulse Oximeter Service 1.0.1, and IEEE 11073-20601 for SFLOAT. Two measurements:

continuous (0x2A5F): flags, SpO2, pulse rate, [both fast], [both slow], [status], [device status], [amplitude]
spot check (0x2A5E): flags, SpO2, pulse rate, [date and time], [status], [device status], [amplitude]
"""

import math
import struct
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import NamedTuple

from sense4hri.device import Feature
from sense4hri.errors import FrameError

SPECIAL = {
    0x07FF: "not_a_number",
    0x0800: "not_at_this_resolution",
    0x07FE: "positive_infinity",
    0x0802: "negative_infinity",
    0x0801: "reserved",
}
"""SFLOAT values that are no numbers."""
STATUS = {
    5: "measurement_ongoing",
    6: "early_estimate",
    7: "validated",
    8: "fully_qualified",
    9: "from_storage",
    10: "demonstration",
    11: "testing",
    12: "calibration_ongoing",
    13: "measurement_unavailable",
    14: "questionable_measurement",
    15: "invalid_measurement",
}
"""Bits of the measurement status."""
DEVICE_STATUS = {
    0: "display_update_ongoing",
    1: "equipment_malfunction",
    2: "signal_irregular",
    3: "inadequate_signal",
    4: "poor_signal",
    5: "low_perfusion",
    6: "erratic_signal",
    7: "nonpulsatile_signal",
    8: "questionable_pulse",
    9: "signal_analysis_ongoing",
    10: "sensor_interference",
    11: "sensor_not_on_user",
    12: "unknown_sensor",
    13: "sensor_displaced",
    14: "sensor_malfunction",
    15: "sensor_disconnected",
}
"""Bits of the device and sensor status."""
OFF_USER = 1 << 11 | 1 << 15
PAIRS = ("", "_fast", "_slow")
FAST, SLOW, WITH_STATUS, WITH_DEVICE_STATUS, WITH_AMPLITUDE = 0x01, 0x02, 0x04, 0x08, 0x10
SPOT_TIME, SPOT_STATUS, SPOT_DEVICE_STATUS, SPOT_AMPLITUDE, CLOCK_NOT_SET = 0x01, 0x02, 0x04, 0x08, 0x10
DATE_TIME = struct.Struct("<HBBBBB")


class Oximetry(NamedTuple):
    """One measurement. device_ns: when, on the device's own calendar, as ns since 1970; None where it does not say.

    contact: whether the sensor is on the user, None where the device does not say.
    """

    device_ns: int | None
    contact: bool | None
    features: tuple[Feature, ...]


def decode_sfloat(word: int) -> tuple[float, str]:
    """Return the number in 16 bits (4 of exponent, 12 of mantissa, both signed, base 10); NaN with why it is none."""
    if word in SPECIAL:
        return math.nan, SPECIAL[word]
    mantissa, exponent = word & 0x0FFF, word >> 12
    mantissa -= (mantissa & 0x0800) << 1
    exponent -= (exponent & 0x8) << 1
    return mantissa * 10.0**exponent if exponent >= 0 else mantissa / 10.0**-exponent, ""


def decode_continuous(value: bytes) -> Oximetry:
    """Return a continuous measurement (0x2A5F). Raises FrameError where the flags do not fit the length."""
    fields = _Fields("continuous measurement", value)
    pairs = [0, *(index for index, flag in enumerate((FAST, SLOW), 1) if fields.flags & flag)]
    features = [one for index in pairs for one in fields.pair(PAIRS[index])]
    return fields.rest(None, features, WITH_STATUS, WITH_DEVICE_STATUS, WITH_AMPLITUDE)


def decode_spot_check(value: bytes) -> Oximetry:
    """Return a spot check (0x2A5E). Raises FrameError where the flags do not fit the length."""
    fields = _Fields("spot check", value)
    features = list(fields.pair(""))
    device_ns = _calendar_ns(fields.take(DATE_TIME.size)) if fields.flags & SPOT_TIME else None
    if fields.flags & CLOCK_NOT_SET:
        device_ns = None
        features.append(Feature("clock_not_set", "1", (1.0,)))
    return fields.rest(device_ns, features, SPOT_STATUS, SPOT_DEVICE_STATUS, SPOT_AMPLITUDE)


class _Fields:
    """Reads a value field by field; what is missing at its end, or left over, is a FrameError."""

    def __init__(self, what: str, value: bytes) -> None:
        self._what, self._value, self._at = what, value, 0
        self.flags = self.take(1)[0]

    def take(self, size: int) -> bytes:
        self._at += size
        if self._at > len(self._value):
            raise self._misfit()
        return self._value[self._at - size : self._at]

    def word(self, size: int) -> int:
        return int.from_bytes(self.take(size), "little")

    def pair(self, which: str) -> Iterator[Feature]:
        yield from self.sfloat(f"spo2{which}", "%", zero_is_none=True)
        yield from self.sfloat(f"heart_rate{which}", "1/min", zero_is_none=True)

    def sfloat(self, name: str, unit: str, zero_is_none: bool = False) -> Iterator[Feature]:
        """A number; where it is none, NaN and a feature whose name says why."""
        number, why = decode_sfloat(self.word(2))
        if zero_is_none and number == 0.0:
            number, why = math.nan, "zero"
        yield Feature(name, unit, (number,))
        if why:
            yield Feature(f"{name}_{why}", "1", (1.0,))

    def rest(
        self, device_ns: int | None, features: list[Feature], status: int, device: int, amplitude: int
    ) -> Oximetry:
        """Read what stands at the end of both measurements; the three flags say which of it is there."""
        contact = None
        if self.flags & status:
            features += _bits("measurement_status", self.word(2), STATUS)
        if self.flags & device:
            word = self.word(3)
            contact = not word & OFF_USER
            features += _bits("device_status", word, DEVICE_STATUS)
        if self.flags & amplitude:
            features += self.sfloat("pulse_amplitude_index", "%")
        if self._at != len(self._value):
            raise self._misfit()
        return Oximetry(device_ns, contact, tuple(features))

    def _misfit(self) -> FrameError:
        length, shown = len(self._value), self._value.hex()
        return FrameError(f"{self._what} of {length} bytes does not fit its flags ({shown})")


def _bits(name: str, word: int, meanings: dict[int, str]) -> list[Feature]:
    """The word itself, and each set bit by its name."""
    told = [meaning for bit, meaning in meanings.items() if word >> bit & 1]
    return [Feature(name, "1", (float(word),)), *(Feature(each, "1", (1.0,)) for each in told)]


def _calendar_ns(octets: bytes) -> int | None:
    """Date and time of the device, whatever zone it means, as if in UTC; None where it is none (0 = not known)."""
    try:
        year, month, day, hour, minute, second = DATE_TIME.unpack(octets)
        return round(datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp()) * 1_000_000_000
    except ValueError:
        return None
