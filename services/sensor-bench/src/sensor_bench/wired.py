"""A virtual device behind a wire: switched on and off, plugged in and out, its bytes delayed, spoilt and lost."""

import asyncio
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from sensor_bench.ble.radio import LinkQuality
from sensor_bench.device import Counts, DeviceKeys, Happened, Knobs, VirtualDevice, knob
from sensor_bench.room import Room
from sensor_bench.wire import ADDRESS, ADDRESS_FORM, LONGEST_SOCKET_PATH, wire

TICK_S = 0.015
"""How often bytes come over: RFCOMM hands on every 10 to 16 ms, a USB adapter by FTDI after 16 ms at most."""
LINK = ("latency_s", "jitter_s", "loss")


class Behind(Protocol):
    """What the bytes mean: a pure device. time_s: true time since it was switched on; it never runs backwards."""

    def receive(self, octets: bytes, time_s: float) -> bytes:
        """What it answers at once to what the host wrote."""

    def send(self, time_s: float) -> bytes:
        """What it has sent by itself since it was asked last."""


class Frames:
    """Loses whole frames of a device, and counts what became of their samples since the bench's start.

    loss: probability of each frame. linked: False while nobody is there, and everything is lost.
    """

    def __init__(self, seed: int, loss: float = 0.0) -> None:
        self.loss, self.linked = loss, True
        self.counts: dict[str, Counts] = {}
        self._rng = np.random.default_rng(seed)

    def carry(self, frame: bytes, **samples: int) -> bytes:
        """The frame, or nothing where it is lost. samples: how many of each stream it holds."""
        lost = not self.linked or self._rng.random() < self.loss
        for stream, number in samples.items():
            counts = self.counts.setdefault(stream, Counts())
            counts.samples_lost += number * lost
            counts.samples_sent += number * (not lost)
            counts.frames_lost += lost
            counts.frames_sent += not lost
        return b"" if lost else frame


@dataclass(frozen=True, kw_only=True)
class WireKeys(DeviceKeys):
    """The keys of every device on a wire."""

    at: str
    down: bool = False
    byte_errors: float = 0.0
    link: LinkQuality = field(default_factory=LinkQuality)

    unique: ClassVar[tuple[str, ...]] = ("sensor", "at")
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (("byte_errors", 0, 1),)

    def check(self) -> None:
        super().check()
        if not ADDRESS.fullmatch(self.at) or len(self.at) > LONGEST_SOCKET_PATH:
            raise ValueError(f"at: {self.at!r} is not {ADDRESS_FORM} of at most {LONGEST_SOCKET_PATH} characters")


@dataclass(frozen=True)
class WireKnobs(Knobs):
    """The knobs of every device on a wire."""

    latency_s: float | None = knob("delay of all bytes", 0, 10)
    jitter_s: float | None = knob("mean of a further, exponential delay", 0, 5)
    loss: float | None = knob("probability that a frame is thrown away", 0, 1)
    byte_errors: float | None = knob("probability that a bit of a byte is wrong", 0, 1)
    stall_s: float | None = knob("nothing arrives that long, then everything at once", 0, 60)
    drop: bool | None = knob("true: end the link")
    unplugged: bool | None = knob("the port is gone; the device goes on")
    down: bool | None = knob("switched off; on again, it begins anew, its clock too")
    restart: bool | None = knob("true: off and on so fast that the link stays, as by a reset button")


@dataclass(frozen=True, kw_only=True)
class WireHappened(Happened):
    """What became of its bytes beside its frames."""

    octets_lost: int
    """That the host did not take in time: of frames that are counted as sent."""


class Delayed(NamedTuple):
    """Bytes on their way, and the true time at which they arrive."""

    due_s: float
    octets: bytes


class WireDevice(VirtualDevice):
    """What is the same for all of them; a kind says what it is made of."""

    knobs = WireKnobs

    def __init__(self, room: Room, keys: WireKeys) -> None:
        super().__init__(room, keys)
        self.frames = Frames(room.seed_of(keys.sensor, "frames"), keys.link.loss)
        self.down, self.unplugged, self.restarts = keys.down, False, 0
        self.byte_errors, self._quality = keys.byte_errors, keys.link
        self._wire = wire(keys.at, self._received)
        self._rng = np.random.default_rng(room.seed_of(keys.sensor, "wire"))
        self._way: deque[Delayed] = deque()
        self._stalled_until_s = 0.0
        self._ticking: asyncio.Task[None] | None = None
        self._on_s = room.now_s()
        self.behind = self.power_on(self._on_s)

    @abstractmethod
    def power_on(self, on_s: float) -> Behind:
        """A device that has just been switched on, at that true time since the bench's start; frames go to `frames`."""

    # --- life and knobs ----------------------------------------------------------------------------------------------

    async def start(self) -> None:
        self._plug()
        self._ticking = asyncio.create_task(self._tick())

    async def stop(self) -> None:
        self._wire.unplug()
        if self._ticking is not None:
            self._ticking.cancel()

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {
            **super().turns(),
            "latency_s": lambda value: setattr(self._quality, "latency_s", value),
            "jitter_s": lambda value: setattr(self._quality, "jitter_s", value),
            "loss": lambda value: setattr(self.frames, "loss", value),
            "byte_errors": lambda value: setattr(self, "byte_errors", value),
            "stall_s": lambda value: setattr(self, "_stalled_until_s", self.room.now_s() + value),
            "drop": lambda on: self._drop() if on else None,
            "unplugged": self._set_unplugged,
            "down": self._set_down,
            "restart": lambda on: self._restart() if on else None,
        }

    def standing(self) -> dict[str, Any]:
        return {
            "latency_s": self._quality.latency_s,
            "jitter_s": self._quality.jitter_s,
            "loss": self.frames.loss,
            "byte_errors": self.byte_errors,
            "unplugged": self.unplugged,
            "down": self.down,
            "heart_rate_bpm": self.heart.heart_rate_bpm,
        }

    def link(self) -> tuple[bool, int]:
        return self._wire.connected, self._wire.connections_total

    def happened(self, host_ns: int, window_s: float) -> WireHappened:
        return WireHappened(**vars(super().happened(host_ns, window_s)), octets_lost=self._wire.lost_octets_total)

    def streams(self) -> dict[str, Any]:
        return {name: asdict(counts) for name, counts in self.frames.counts.items()}

    def _plug(self) -> None:
        if not self.down and not self.unplugged:
            self._wire.plug()

    def _drop(self) -> None:
        self._wire.drop()
        self._way.clear()
        self._plug()

    def _set_unplugged(self, unplugged: bool) -> None:
        self.unplugged = unplugged
        if unplugged:
            self._wire.unplug()
            self._way.clear()
        self._plug()

    def _set_down(self, down: bool) -> None:
        if self.down and not down:
            self._restart()
        self.down = down
        if down:
            self._wire.unplug()
            self._way.clear()
        self._plug()

    def _restart(self) -> None:
        self.restarts += 1
        self._on_s = self.room.now_s()
        self.behind = self.power_on(self._on_s)

    # --- bytes -------------------------------------------------------------------------------------------------------

    def _received(self, octets: bytes) -> None:
        if not self.down:
            self._send(self.behind.receive(octets, self.room.now_s() - self._on_s))

    async def _tick(self) -> None:
        while True:
            if not self.down:
                self.frames.linked = self._wire.connected
                self._send(self.behind.send(self.room.now_s() - self._on_s))
            self._arrive()
            await asyncio.sleep(TICK_S)

    def _send(self, octets: bytes) -> None:
        """Put bytes on their way, none overtaking another."""
        if not octets or not self._wire.connected:
            return
        jitter_s = self._rng.exponential(self._quality.jitter_s) if self._quality.jitter_s else 0.0
        due_s = max(self.room.now_s() + self._quality.latency_s + jitter_s, self._way[-1].due_s if self._way else 0.0)
        self._way.append(Delayed(due_s, self._spoilt(octets)))

    def _arrive(self) -> None:
        now_s = self.room.now_s()
        while self._way and self._way[0].due_s <= now_s and self._stalled_until_s <= now_s:
            self._wire.write(self._way.popleft().octets)

    def _spoilt(self, octets: bytes) -> bytes:
        """Flip a bit in some of the bytes."""
        if not self.byte_errors:
            return octets
        wrong = self._rng.random(len(octets)) < self.byte_errors
        bits = np.left_shift(1, self._rng.integers(0, 8, len(octets))) * wrong
        return (np.frombuffer(octets, np.uint8) ^ bits.astype(np.uint8)).tobytes()
