"""BITalino boards as a kind of the bench."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from sensor_bench.bitalino.firmware import Board, Panel
from sensor_bench.bitalino.ports import NOTHING, PLUGGED, Port
from sensor_bench.device import Kind, knob
from sensor_bench.room import Room
from sensor_bench.signals.measures import measures
from sensor_bench.wired import Behind, WireDevice, WireKeys, WireKnobs

PORTS = ("A1", "A2", "A3", "A4", "A5", "A6")


@dataclass(frozen=True, kw_only=True)
class BitalinoKeys(WireKeys):
    """One board as the configuration describes it."""

    ports: Mapping[str, str] = field(default_factory=lambda: {"A1": "emg", "A2": "ecg", "A3": "eda"})
    """What is plugged in where."""
    rate_factor: float = 1.0
    battery_v: float = 3.9

    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        *WireKeys.ranges,
        ("rate_factor", 0.9, 1.1),
        ("battery_v", 3.0, 4.3),
    )

    def check(self) -> None:
        super().check()
        for port, sensor in self.ports.items():
            if port not in PORTS or sensor not in PLUGGED:
                raise ValueError(f"ports: {port}: {sensor!r} is not A1 to A6 with one of {', '.join(PLUGGED)}")


@dataclass(frozen=True)
class BitalinoKnobs(WireKnobs):
    """The knobs of a board."""

    pressed: bool | None = knob("the button at I1 is held down")
    battery_v: float | None = knob("voltage of its battery", 3.0, 4.3)


class Bitalino(WireDevice):
    """One board."""

    knobs = BitalinoKnobs

    def __init__(self, room: Room, keys: BitalinoKeys) -> None:
        self._panel = Panel(battery_v=keys.battery_v)
        self._rate_factor = keys.rate_factor
        transit_s = room.participants[keys.participant].pulse_transit_s
        found = measures(room.hearts[keys.participant], room.seed_of(keys.sensor, "signals"), transit_s)
        self._ports = [_port(keys.ports.get(name), found) for name in PORTS]
        super().__init__(room, keys)

    def power_on(self, on_s: float) -> Behind:
        return Board(self._ports, self._panel, self.frames, on_s, self._rate_factor)

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {
            **super().turns(),
            "pressed": lambda value: setattr(self._panel, "pressed", value),
            "battery_v": lambda value: setattr(self._panel, "battery_v", value),
        }

    def standing(self) -> dict[str, Any]:
        return super().standing() | vars(self._panel)


def _port(sensor: str | None, found: Mapping[str, Any]) -> Port:
    if sensor is None:
        return NOTHING
    plugged = PLUGGED[sensor]
    return Port(plugged.stream, found[plugged.measure], plugged.volts)


BITALINO = Kind(
    ("BITalino",),
    BitalinoKeys,
    Bitalino,
    "ports {A1: emg, A2: ecg, A3: eda} (also eeg, eog, pzt, acc, lux, tmp, ppg), rate_factor 1, battery_v 3.9",
)
