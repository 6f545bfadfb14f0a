"""A virtual device of any kind: its keys in the `devices` text, its life on the bench, its knobs, its truth."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

from sense4hri.errors import Refusal
from sense4hri.schema import parameter

from sensor_bench.room import Room
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.recordings import Playback

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def check_identifier(name: str, where: str) -> None:
    """Raise ValueError where a name cannot stand in a path."""
    if not IDENTIFIER.fullmatch(name):
        raise ValueError(f"{where}: {name!r} is no identifier (letters, digits, underscore; a letter first)")


@dataclass(frozen=True, kw_only=True)
class DeviceKeys:
    """The keys that every device has; a kind's own dataclass inherits from this and adds its own."""

    sensor: str
    """The bench's name for it; part of HTTP paths."""
    model: str
    participant: str

    unique: ClassVar[tuple[str, ...]] = ("sensor",)
    """Keys whose value no two devices may share."""
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = ()
    """Lowest and highest value of keys that have them."""

    def check(self) -> None:
        """Raise ValueError, "key: what is wrong with it", where a value cannot be."""
        check_identifier(self.sensor, "sensor")
        for name, low, high in self.ranges:
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name}: {getattr(self, name)!r} is not within {low}..{high}")

    def recordings(self) -> Mapping[str, Playback]:
        """The recordings that it plays; the heart in one of them becomes the participant's."""
        return {}

    def playing(self, recordings: Mapping[str, Playback]) -> Self:
        """The same device, playing what it can of these."""
        return self


def knob(text: str, low: float | None = None, high: float | None = None) -> Any:
    """A field of a request that leaves a knob as it is where it is not given."""
    return parameter(None, help=text, low=low, high=high)


@dataclass(frozen=True)
class Knobs:
    """The knobs that every device has; a kind's own dataclass inherits from this and adds its own."""

    heart_rate_bpm: float | None = knob("of a simulated participant", 25, 240)


@dataclass
class Counts:
    """What became of a stream's samples since the bench's start."""

    samples_sent: int = 0
    samples_lost: int = 0
    frames_sent: int = 0
    frames_lost: int = 0


@dataclass(frozen=True)
class Shown:
    """A device in `GET /devices`; kinds add what they have."""

    sensor: str
    model: str
    connected: bool
    knobs: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Happened:
    """A device in `GET /truth`; kinds add what they have."""

    participant: str
    connected: bool
    connections_total: int
    streams: Mapping[str, Any]
    """By name: samples_sent, samples_lost, frames_sent, frames_lost since the start, and what else a kind counts."""


class VirtualDevice(ABC):
    """One device on the bench."""

    knobs: ClassVar[type[Knobs]] = Knobs
    """What `POST /devices/<sensor>/knobs` takes."""

    def __init__(self, room: Room, keys: DeviceKeys) -> None:
        self.room, self.keys = room, keys
        self.heart = room.hearts[keys.participant]

    @abstractmethod
    async def start(self) -> None:
        """Switch it on."""

    @abstractmethod
    async def stop(self) -> None:
        """Switch it off, and leave nothing behind."""

    @abstractmethod
    def link(self) -> tuple[bool, int]:
        """Whether it is connected, and how often it was since the start."""

    @abstractmethod
    def standing(self) -> dict[str, Any]:
        """Where its knobs stand."""

    @abstractmethod
    def streams(self) -> dict[str, Any]:
        """Counts and what else its kind tells of each stream, by name."""

    def shown(self) -> Shown:
        """What it is and where its knobs stand."""
        connected, _ = self.link()
        return Shown(self.keys.sensor, self.keys.model, connected, self.standing())

    def happened(self, host_ns: int, window_s: float) -> Happened:
        """What really happened until now, host_ns, with the events of the last window_s."""
        connected, connections_total = self.link()
        return Happened(
            participant=self.keys.participant,
            connected=connected,
            connections_total=connections_total,
            streams=self.streams(),
        )

    def check(self, wanted: Mapping[str, Any]) -> None:
        """Refuse what this device cannot do now; kinds and ranges are checked already. Nothing is turned yet."""
        if "heart_rate_bpm" in wanted and not isinstance(self.heart, Heart):
            raise Refusal("heart_rate_bpm: this participant's heart is a recording's", "heart_rate_bpm")

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        """What turns each knob; a coroutine that comes back is run."""
        return {"heart_rate_bpm": lambda value: setattr(self.heart, "heart_rate_bpm", value)}


class Kind(NamedTuple):
    """One kind of device: the models it makes, its keys, and its maker."""

    models: tuple[str, ...]
    keys: type[DeviceKeys]
    make: Callable[[Room, Any], VirtualDevice]
    """make(room, keys)."""
    notes: str = ""
    """Its own keys with their defaults, for who writes the `devices` text; empty where it has none of its own."""
