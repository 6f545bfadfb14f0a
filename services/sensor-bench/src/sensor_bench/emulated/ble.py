"""A Bluetooth LE device by its emulator's file: one service with one characteristic that notifies.

The file has `SERVICE` and `DATA` (their UUIDs), `SENSOR_TYPE`, and `VirtualDevice` with `send(time_s)`: what it has
notified since the last call, each value with the number of samples in it, at a time in s since it was switched on.
"""

import asyncio
from collections.abc import AsyncIterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from bumble.core import UUID, AdvertisingData
from bumble.gatt import Characteristic, Service

from sensor_bench.ble.peripheral import NOTIFY, BleKeys, BlePeripheral, Outgoing, information
from sensor_bench.device import Counts, Kind
from sensor_bench.emulated.file import loaded
from sensor_bench.room import Room

TICK_S = 0.02
MTU = 247
LONGEST_NAME = 26
"""Bytes that an advertisement has room for."""


@dataclass(frozen=True, kw_only=True)
class EmulatedBleKeys(BleKeys):
    """One device; name: as it advertises; emulator: path of its file."""

    name: str
    emulator: str

    unique: ClassVar[tuple[str, ...]] = (*BleKeys.unique, "name")

    def check(self) -> None:
        super().check()
        if not 1 <= len(self.name.encode()) <= LONGEST_NAME:
            raise ValueError(f"name: {self.name!r} is not 1 to {LONGEST_NAME} bytes, which an advertisement can carry")


class EmulatedBle(BlePeripheral):
    """Notifies what its emulator sends while somebody is connected; what it sends otherwise nobody hears."""

    def __init__(self, room: Room, keys: EmulatedBleKeys) -> None:
        super().__init__(room, keys)
        self._file = loaded(keys.emulator, "SERVICE", "DATA", "SENSOR_TYPE", "VirtualDevice")
        self._name, self._counts = keys.name, Counts()
        self._emulator = self._file.VirtualDevice()
        nothing = Characteristic.Permissions(0)
        self._data: Characteristic[bytes] = Characteristic(UUID(self._file.DATA), NOTIFY, nothing, b"")
        about = information(vendor="Sense4HRI bench", model_number=keys.name, serial_number=keys.sensor)
        self.serve(Service(UUID(self._file.SERVICE), [self._data]), about, mtu=MTU)

    def advertised(self) -> Sequence[tuple[int, bytes]]:
        return ((AdvertisingData.Type.COMPLETE_LOCAL_NAME, self._name.encode()),)

    def on_connected(self) -> None:
        self._emulator.send(self.room.now_s())
        self.begin("data", self.send_all(self._data, self._values()))

    async def _values(self) -> AsyncIterator[Outgoing]:
        while True:
            await asyncio.sleep(TICK_S)
            for value, samples in self._emulator.send(self.room.now_s()):
                yield Outgoing(value, self.room.host.now_ns(), self._counts, samples)

    def streams(self) -> dict[str, Any]:
        return {self._file.SENSOR_TYPE: asdict(self._counts)}


BLE = Kind(
    ("EmulatedBle",),
    EmulatedBleKeys,
    EmulatedBle,
    "name (required, as it advertises), emulator (required: the driver's emulator.py, see emulated/ble.py)",
)
