"""A virtual device that reports a value each second while it is connected: what strap, watch and oximeter share."""

import asyncio
import struct
from abc import abstractmethod
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from bumble.core import AdvertisingData
from bumble.gatt import Characteristic, Service

from sensor_bench.ble.peripheral import NOTIFY, BleKeys, BleKnobs, BlePeripheral, Outgoing, information
from sensor_bench.device import Counts, Happened, knob
from sensor_bench.heart_rate.beats import Beats
from sensor_bench.room import Room

INTERVAL_S = 1.0
MTU = 23
"""Of ATT; such devices need no more."""
NOTES = "name (required, as it advertises), serial_number (of its device information)"


@dataclass(frozen=True, kw_only=True)
class ReporterKeys(BleKeys):
    """One such device; name: as it advertises."""

    name: str
    serial_number: str = "000001"

    unique: ClassVar[tuple[str, ...]] = (*BleKeys.unique, "name")

    def check(self) -> None:
        super().check()
        if not 1 <= len(self.name.encode()) <= 20:
            raise ValueError(f"name: {self.name!r} is not 1 to 20 bytes, which an advertisement can carry")


@dataclass(frozen=True)
class ReporterKnobs(BleKnobs):
    """The knobs of every such device."""

    garbled_frames: float | None = knob("so many reports will be cut off", 0, 1000)


@dataclass(frozen=True, kw_only=True)
class ReporterHappened(Happened):
    """What became of its reports; `beats_host_ns`: R peaks for a strap, systolic peaks of the pulse for the others."""

    reports: Mapping[str, int]
    beats_host_ns: list[int]


class Reporter(BlePeripheral):
    """Advertises `service`, and notifies `reports` each second."""

    knobs = ReporterKnobs
    service: ClassVar[int]
    characteristic: ClassVar[str]

    def __init__(self, room: Room, keys: ReporterKeys, beats: Beats, *more: Characteristic[bytes]) -> None:
        super().__init__(room, keys)
        self._name, self.beats, self.counts, self.garbled_frames = keys.name, beats, Counts(), 0
        self.reports = Characteristic(self.characteristic, NOTIFY, Characteristic.Permissions(0), b"")
        about = information(
            vendor="Sense4HRI bench", model_number=keys.model, serial_number=keys.serial_number, firmware="1.0"
        )
        self.serve(Service(f"{self.service:04X}", [self.reports, *more]), about, mtu=MTU)

    @abstractmethod
    def report(self, since_s: float, now_s: float) -> bytes:
        """The value to notify at now_s, since_s after which nothing has been reported yet."""

    def advertised(self) -> Sequence[tuple[int, bytes]]:
        kinds = AdvertisingData.Type
        return (
            (kinds.COMPLETE_LIST_OF_16_BIT_SERVICE_CLASS_UUIDS, struct.pack("<H", self.service)),
            (kinds.COMPLETE_LOCAL_NAME, self._name.encode()),
        )

    def on_connected(self) -> None:
        self.begin("reports", self.send_all(self.reports, self._values()))

    async def _values(self) -> AsyncIterator[Outgoing]:
        room, since_s = self.room, self.room.now_s()
        while True:
            await asyncio.sleep(INTERVAL_S)
            now_s = room.now_s()
            value = self._garbled(self.report(since_s, now_s))
            since_s = now_s
            yield Outgoing(value, room.host.now_ns(), self.counts)

    def _garbled(self, value: bytes) -> bytes:
        if self.garbled_frames == 0:
            return value
        self.garbled_frames -= 1
        return value[:-1]

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {**super().turns(), "garbled_frames": lambda value: setattr(self, "garbled_frames", round(value))}

    def streams(self) -> dict[str, Any]:
        return {}

    def happened(self, host_ns: int, window_s: float) -> ReporterHappened:
        return ReporterHappened(
            **vars(super().happened(host_ns, window_s)),
            reports={"sent": self.counts.frames_sent, "lost": self.counts.frames_lost},
            beats_host_ns=self.room.beats_ns(self.keys.participant, host_ns, window_s, self.beats.pulse_delay_s),
        )
