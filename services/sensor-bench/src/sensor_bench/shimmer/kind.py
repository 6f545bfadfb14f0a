"""Shimmer3 as a kind of the bench: the keys of a device, its knobs, and what it is made of."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from sensor_bench.device import Kind, knob
from sensor_bench.room import Room
from sensor_bench.shimmer.body import Body
from sensor_bench.shimmer.firmware import Memory, VirtualShimmer
from sensor_bench.signals.skin import Skin
from sensor_bench.signals.sources import Wearing
from sensor_bench.signals.waveforms import stored
from sensor_bench.wired import Behind, WireDevice, WireKeys, WireKnobs


@dataclass(frozen=True, kw_only=True)
class ShimmerKeys(WireKeys):
    """One Shimmer3 as the configuration describes it."""

    serial_number: str = "0a1b2c3d4e5f6071"
    skew_ppm: float = 0.0
    clock_start: int = 0
    """Ticks of 1/32768 s that its clock shows when it is switched on; 16777216 is where it wraps."""
    battery_v: float = 3.9
    contact: bool = True

    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        *WireKeys.ranges,
        ("skew_ppm", -1e4, 1e4),
        ("clock_start", 0, (1 << 24) - 1),
        ("battery_v", 3.0, 4.3),
    )

    def check(self) -> None:
        super().check()
        try:
            right = len(bytes.fromhex(self.serial_number)) == 8
        except ValueError:
            right = False
        if not right:
            raise ValueError(f"serial_number: {self.serial_number!r} is not 16 hexadecimal digits")


@dataclass(frozen=True)
class ShimmerKnobs(WireKnobs):
    """The knobs of a Shimmer3."""

    contact: bool | None = knob("the electrodes are on the skin")
    battery_v: float | None = knob("voltage of its battery", 3.0, 4.3)


class Shimmer(WireDevice):
    """One Shimmer3; what it was told stays with it while it is off."""

    knobs = ShimmerKnobs

    def __init__(self, room: Room, keys: ShimmerKeys) -> None:
        self._skew_ppm, self._clock_start = keys.skew_ppm, keys.clock_start
        self._memory = Memory(serial_number=bytes.fromhex(keys.serial_number), battery_v=keys.battery_v)
        self._wearing = Wearing(keys.contact)
        transit_s = room.participants[keys.participant].pulse_transit_s
        skin = Skin(room.seed_of(keys.participant, "skin"))
        self._body = Body(room.hearts[keys.participant], skin, stored(), self._wearing, transit_s)
        super().__init__(room, keys)

    def power_on(self, on_s: float) -> Behind:
        start = 0 if self.restarts else self._clock_start
        return VirtualShimmer(self._body, self._memory, self.frames.carry, on_s, self._skew_ppm, start)

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {
            **super().turns(),
            "contact": lambda value: setattr(self._wearing, "contact", value),
            "battery_v": lambda value: setattr(self._memory, "battery_v", value),
        }

    def standing(self) -> dict[str, Any]:
        return super().standing() | {"contact": self._wearing.contact, "battery_v": self._memory.battery_v}


SHIMMER = Kind(
    ("Shimmer3",),
    ShimmerKeys,
    Shimmer,
    "skew_ppm 0, clock_start 0 (ticks of 1/32768 s; it wraps at 16777216), serial_number (16 hex digits), "
    "battery_v 3.9, contact true",
)
