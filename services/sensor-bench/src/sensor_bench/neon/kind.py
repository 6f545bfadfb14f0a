"""Neon and Invisible as a kind of the bench: keys, knobs, truth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from sensor_bench.clock import DeviceClock
from sensor_bench.device import DeviceKeys, Happened, Kind, Knobs, knob
from sensor_bench.neon.app import VirtualApp
from sensor_bench.neon.server import AppServer
from sensor_bench.room import Room
from sensor_bench.served import ServedDevice


@dataclass(frozen=True, kw_only=True)
class AppKeys(DeviceKeys):
    """One phone with its glasses as the configuration describes it."""

    port: int
    address: str = "127.0.0.1"
    """Of the machine it listens on."""
    gaze_hz: float = 200.0
    ahead_s: float = 0.3
    """By how much the phone's clock is ahead of the host's when the bench starts."""
    skew_ppm: float = 0.0

    unique: ClassVar[tuple[str, ...]] = (*DeviceKeys.unique, "port")
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        ("port", 1, 65535),
        ("gaze_hz", 10, 200),
        ("ahead_s", -1e6, 1e6),
        ("skew_ppm", -1e4, 1e4),
    )


@dataclass(frozen=True)
class AppKnobs(Knobs):
    """What can be turned on a virtual Companion app."""

    down: bool | None = knob("closed; opened again, its clock goes on")
    loss: float | None = knob("share of gaze that never leaves", 0, 1)
    skew_ppm: float | None = knob("of the phone's clock", -1e4, 1e4)
    worn: bool | None = knob("the glasses are worn")
    battery_percent: float | None = knob("of the phone", 0, 100)


@dataclass(frozen=True, kw_only=True)
class AppHappened(Happened):
    """A virtual Companion app in `GET /truth`. events: got from others."""

    unix_ns: int
    skew_ppm: float
    events: int


class AppDevice(ServedDevice):
    """A virtual Companion app at its port."""

    knobs: ClassVar[type[Knobs]] = AppKnobs

    def __init__(self, room: Room, keys: AppKeys) -> None:
        clock = DeviceClock(room.start_ns, room.start_ns + round(keys.ahead_s * 1e9), keys.skew_ppm)
        seed = room.seed_of(keys.sensor, "network")
        self.app = VirtualApp(clock, room.start_ns, keys.model, keys.gaze_hz, seed)
        super().__init__(room, keys, AppServer(self.app, room.host, keys.address, keys.port))

    def standing(self) -> dict[str, Any]:
        app = self.app
        return {"down": self.down, "loss": app.loss, "worn": app.worn, "battery_percent": app.battery_percent}

    def streams(self) -> dict[str, Any]:
        counts = vars(self.app.counts)
        return {"eye_tracking": counts} | ({"pupillometry": counts} if self.keys.model == "Neon" else {})

    def happened(self, host_ns: int, window_s: float) -> AppHappened:
        segment = self.app.clock.at(host_ns)
        return AppHappened(
            **vars(super().happened(host_ns, window_s)),
            unix_ns=segment.read_ns(host_ns),
            skew_ppm=segment.skew_ppm,
            events=len(self.app.events),
        )

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        app = self.app
        return {
            **super().turns(),
            "down": self.switch_off,
            "loss": lambda share: setattr(app, "loss", share),
            "skew_ppm": lambda ppm: app.clock.set_skew(self.room.host.now_ns(), ppm),
            "worn": lambda on: setattr(app, "worn", on),
            "battery_percent": lambda percent: setattr(app, "battery_percent", round(percent)),
        }


NEON = Kind(
    ("Neon", "Invisible"),
    AppKeys,
    AppDevice,
    "port (required), address 127.0.0.1, gaze_hz 200, ahead_s 0.3 (of the phone's clock), skew_ppm 0",
)
