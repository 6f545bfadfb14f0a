"""A virtual Go Direct respiration belt round its participant's chest."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from bumble.core import AdvertisingData
from bumble.device import Connection
from bumble.gatt import Characteristic, CharacteristicValue, Service

from sensor_bench.ble.peripheral import NOTIFY, WRITEABLE, BleKeys, BleKnobs, BlePeripheral, Outgoing
from sensor_bench.device import Counts, Kind, knob
from sensor_bench.room import Room
from sensor_bench.signals.sources import Noise
from sensor_bench.vernier.firmware import Commands, measurement, sealed

SERVICE = "D91714EF-28B9-4F91-BA16-F0D9A604F112"
WRITE, ANSWERS = "F4BF14A6-C7D5-4B6D-8AA8-DF1A7C83ADCB", "B41E6675-A329-40E0-AA01-44D2F444BABE"
MTU = 23
FRAME_SAMPLES = 2
REST_N, BREATH_N, NOISE_N = 10.0, 2.5, 0.02
RATE_KNOWN_AFTER_S = 5.0
"""Until then the belt's own rate of respiration is NaN."""


@dataclass(frozen=True, kw_only=True)
class BeltKeys(BleKeys):
    """One belt; device_id: the end of its name, as in "GDX-RB 0K1002A1"."""

    device_id: str
    rate_factor: float = 1.0

    unique: ClassVar[tuple[str, ...]] = (*BleKeys.unique, "device_id")
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (*BleKeys.ranges, ("rate_factor", 0.9, 1.1))

    def check(self) -> None:
        super().check()
        if not (self.device_id.isalnum() and len(self.device_id) == 8):
            raise ValueError(f"device_id: {self.device_id!r} is not eight letters and digits, as in 0K1002A1")


@dataclass(frozen=True)
class BeltKnobs(BleKnobs):
    """The knobs of a belt."""

    garbled_frames: float | None = knob("one bit of so many frames will be wrong", 0, 1000)


class Belt(BlePeripheral):
    """Answers Go Direct commands; while started it sends force and respiration rate, two samples a frame."""

    knobs = BeltKnobs
    notified_bytes = 20

    def __init__(self, room: Room, keys: BeltKeys) -> None:
        super().__init__(room, keys)
        self._belt, self.counts, self.garbled_frames, self._number = keys, Counts(), 0, 0
        self._noise = Noise(room.seed_of(keys.sensor, "respiration"), 1)
        self._commands = Commands(keys.device_id, lambda: self.battery_percent)
        unacknowledged = Characteristic.Properties.WRITE | Characteristic.Properties.WRITE_WITHOUT_RESPONSE
        write: Characteristic[bytes] = Characteristic(
            WRITE, unacknowledged, WRITEABLE, CharacteristicValue(write=self._on_write)
        )
        self._answers: Characteristic[bytes] = Characteristic(ANSWERS, NOTIFY, Characteristic.Permissions(0), b"")
        self.serve(Service(SERVICE, [write, self._answers]), mtu=MTU)

    def advertised(self) -> Sequence[tuple[int, bytes]]:
        return ((AdvertisingData.Type.COMPLETE_LOCAL_NAME, f"GDX-RB {self._belt.device_id}".encode()),)

    def _on_write(self, connection: Connection, value: bytes) -> None:
        for answer in self._commands.receive(bytes(value)):
            self.notify(self._answers, Outgoing(sealed(0x98, self._next(), answer), self.room.host.now_ns()))
            if answer[0] == 0x18:
                self.begin("measurements", self.send_all(self._answers, self._measurements()))
        if not self._commands.mask:
            self.cancel("measurements")

    def _next(self) -> int:
        self._number += 1
        return self._number

    async def _measurements(self) -> AsyncIterator[Outgoing]:
        room, fs_hz = self.room, 1e6 / self._commands.period_us * self._belt.rate_factor
        index, begun_s = int(room.now_s() * fs_hz) + 1, room.now_s()
        while True:
            last_ns = room.start_ns + round((index + FRAME_SAMPLES - 1) / fs_hz * 1e9)
            await asyncio.sleep(max(0.0, (last_ns - room.host.now_ns()) * 1e-9))
            known = room.now_s() - begun_s > RATE_KNOWN_AFTER_S and self.contact
            frame = measurement(self._next(), self._commands.mask, self._values(index, fs_hz, known))
            yield Outgoing(self._garbled(frame), last_ns, self.counts, FRAME_SAMPLES)
            index += FRAME_SAMPLES

    def _values(self, index: int, fs_hz: float, known: bool) -> list[list[float]]:
        """One row per sample, one column per channel that was started."""
        times_s = np.arange(index, index + FRAME_SAMPLES) / fs_hz
        breath = self.heart.breathing(times_s) if self.contact else np.zeros(FRAME_SAMPLES)
        force = REST_N * self.contact + BREATH_N * breath + NOISE_N * self._noise.at(index, FRAME_SAMPLES)[:, 0]
        rate = 60.0 * self.heart.respiration_hz if known else float("nan")
        started = [channel for channel in range(32) if self._commands.mask >> channel & 1]
        return [[{1: float(newton), 2: rate}.get(channel, 0.0) for channel in started] for newton in force]

    def _garbled(self, frame: bytes) -> bytes:
        if self.garbled_frames == 0:
            return frame
        self.garbled_frames -= 1
        return frame[:10] + bytes([frame[10] ^ 0x10]) + frame[11:]

    def on_disconnected(self) -> None:
        self._commands.reset()

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {**super().turns(), "garbled_frames": lambda value: setattr(self, "garbled_frames", round(value))}

    def streams(self) -> dict[str, Any]:
        return {"respiration": asdict(self.counts) | {"rate_factor": self._belt.rate_factor}}


BELT = Kind(
    ("GDX-RB",),
    BeltKeys,
    Belt,
    'device_id (required: eight letters and digits of "GDX-RB 0K1002A1"), rate_factor 1',
)
