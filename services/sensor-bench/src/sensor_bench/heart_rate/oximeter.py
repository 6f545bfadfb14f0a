"""A virtual fingertip pulse oximeter: the Pulse Oximeter service (0x1822)."""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from bumble.gatt import Characteristic

from sensor_bench.ble.peripheral import READ, READABLE
from sensor_bench.ble.values import sfloat
from sensor_bench.device import Kind, knob
from sensor_bench.heart_rate.beats import Beats
from sensor_bench.heart_rate.reporter import NOTES, Reporter, ReporterKeys, ReporterKnobs
from sensor_bench.room import Room

EVERYTHING = 0x1F
"""Flags: fast and slow pair, status, device status, amplitude."""
SPOT = 0x07
"""Flags: time, status, device status."""
ONGOING, UNAVAILABLE, SPOT_DONE = 1 << 5, 1 << 13, 1 << 8
OFF_USER = 1 << 11
AMPLITUDE_PERCENT = 3.5


@dataclass(frozen=True)
class OximeterKnobs(ReporterKnobs):
    """The knobs of an oximeter."""

    spo2_percent: float | None = knob("saturation of the wearer's blood", 0, 100)
    device_status: float | None = knob("bits of the device and sensor status that are set beside its own", 0, 0xFFFFFF)
    spot_check: bool | None = knob("true: one spot check, by the device's date and time, is indicated now")


class Oximeter(Reporter):
    """Saturation and pulse rate each second, spot checks when asked for; off the finger NaN and the status bit."""

    knobs = OximeterKnobs
    service, characteristic = 0x1822, "2A5F"

    def __init__(self, room: Room, keys: ReporterKeys) -> None:
        indicate = Characteristic.Properties.INDICATE
        self._spot = Characteristic("2A5E", indicate, Characteristic.Permissions(0), b"")
        features = Characteristic("2A60", READ, READABLE, bytes.fromhex("3f00"))
        transit_s = room.participants[keys.participant].pulse_transit_s
        super().__init__(room, keys, Beats(room, keys.participant, transit_s), self._spot, features)
        self.spo2_percent, self.device_status = 97.4, 0

    def report(self, since_s: float, now_s: float) -> bytes:
        status = struct.pack("<H", ONGOING if self.contact else UNAVAILABLE)
        amplitude = sfloat(AMPLITUDE_PERCENT if self.contact else None)
        return bytes([EVERYTHING]) + 3 * self._pair(now_s) + status + self._device_bits() + amplitude

    def _pair(self, now_s: float) -> bytes:
        rate = self.beats.rate_bpm(now_s)
        known = self.contact and rate > 0
        return sfloat(round(self.spo2_percent, 1)) + sfloat(float(rate)) if known else 2 * sfloat(None)

    def _device_bits(self) -> bytes:
        return (self.device_status | (0 if self.contact else OFF_USER)).to_bytes(3, "little")

    def _check_now(self, wanted: bool) -> None:
        now = datetime.fromtimestamp(self.room.host.now_ns() // 10**9, tz=UTC)
        when = struct.pack("<HBBBBB", now.year, now.month, now.day, now.hour, now.minute, now.second)
        if wanted:
            status = struct.pack("<H", SPOT_DONE)
            self.indicate(
                self._spot, bytes([SPOT]) + self._pair(self.room.now_s()) + when + status + self._device_bits()
            )

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {
            **super().turns(),
            "spo2_percent": lambda value: setattr(self, "spo2_percent", value),
            "device_status": lambda value: setattr(self, "device_status", round(value)),
            "spot_check": self._check_now,
        }


OXIMETER = Kind(("PulseOximeter",), ReporterKeys, Oximeter, NOTES)
