"""BioHarness straps as a kind of the bench: the keys of one, its knobs, and what it is made of."""

import datetime
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from sensor_bench.bioharness.firmware import VirtualBioHarness, Worn
from sensor_bench.device import Kind, knob
from sensor_bench.room import Room
from sensor_bench.signals.waveforms import stored
from sensor_bench.wired import Behind, WireDevice, WireKeys, WireKnobs


@dataclass(frozen=True, kw_only=True)
class BioHarnessKeys(WireKeys):
    """One strap as the configuration describes it."""

    serial_number: str = "BHT000001"
    skew_ppm: float = 0.0
    clock_start: str = "2026-01-01T08:00:00"
    """What its calendar shows when it is switched on."""
    battery_percent: int = 80

    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        *WireKeys.ranges,
        ("skew_ppm", -1e4, 1e4),
        ("battery_percent", 0, 100),
    )

    def check(self) -> None:
        super().check()
        try:
            datetime.datetime.fromisoformat(self.clock_start)
        except ValueError as error:
            raise ValueError(f"clock_start: {error}") from error


@dataclass(frozen=True)
class BioHarnessKnobs(WireKnobs):
    """The knobs of a strap."""

    worn: int | None = knob("0 worn well .. 3 not worn", 0, 3)
    battery_percent: int | None = knob("charge of its battery", 0, 100)


class BioHarness(WireDevice):
    """One strap."""

    knobs = BioHarnessKnobs

    def __init__(self, room: Room, keys: BioHarnessKeys) -> None:
        self._own, self._waveforms = keys, stored()
        self._worn = Worn(keys.battery_percent)
        super().__init__(room, keys)

    def power_on(self, on_s: float) -> Behind:
        begins = datetime.datetime.fromisoformat(self._own.clock_start)
        own = self._own
        return VirtualBioHarness(
            self.heart, self._waveforms, self._worn, self.frames.carry, begins, on_s, own.skew_ppm, own.serial_number
        )

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {
            **super().turns(),
            "worn": lambda value: setattr(self._worn, "level", value),
            "battery_percent": lambda value: setattr(self._worn, "battery_percent", value),
        }

    def standing(self) -> dict[str, Any]:
        return super().standing() | {"worn": self._worn.level, "battery_percent": self._worn.battery_percent}


BIOHARNESS = Kind(
    ("BioHarness3",),
    BioHarnessKeys,
    BioHarness,
    'skew_ppm 0, clock_start "2026-01-01T08:00:00", serial_number, battery_percent 80',
)
