"""A Bluetooth LE device by its emulator's file: one service with characteristics that notify or are written to.

The file has `SERVICE` (its UUID), `NOTIFIES` (the UUID of each characteristic that notifies, and the sensor type of its
samples), and `VirtualDevice` with `send(time_s)`: what it has notified since the last call, each value with its
characteristic and the number of samples in it, at a time in s since it was switched on. A device that must be told to
start has `WRITTEN` (UUIDs) too, and `VirtualDevice.receive(characteristic, value)`. The battery is the bench's.
"""

import asyncio
from collections.abc import AsyncIterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, ClassVar

from bumble.core import UUID, AdvertisingData
from bumble.device import Connection
from bumble.gatt import Characteristic, CharacteristicValue, Service

from sensor_bench.ble.peripheral import NOTIFY, WRITEABLE, BleKeys, BlePeripheral, Outgoing, information
from sensor_bench.device import Counts, Kind
from sensor_bench.emulated.file import loaded
from sensor_bench.room import Room

TICK_S = 0.02
MTU = 247
LONGEST_NAME = 26
"""Bytes that an advertisement has room for."""
WRITES = Characteristic.Properties.WRITE | Characteristic.Properties.WRITE_WITHOUT_RESPONSE


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
        file = loaded(keys.emulator, "SERVICE", "NOTIFIES", "VirtualDevice")
        self._name, self._types = keys.name, dict[str, str](file.NOTIFIES)
        self._counts = {sensor_type: Counts() for sensor_type in self._types.values()}
        self._emulator = file.VirtualDevice()
        nothing = Characteristic.Permissions(0)
        self._notifying = {each: Characteristic(UUID(each), NOTIFY, nothing, b"") for each in self._types}
        written = [
            Characteristic(UUID(each), WRITES, WRITEABLE, CharacteristicValue(write=partial(self._on_write, each)))
            for each in getattr(file, "WRITTEN", ())
        ]
        about = information(vendor="Sense4HRI bench", model_number=keys.name, serial_number=keys.sensor)
        self.serve(Service(UUID(file.SERVICE), [*self._notifying.values(), *written]), about, mtu=MTU)

    def advertised(self) -> Sequence[tuple[int, bytes]]:
        return ((AdvertisingData.Type.COMPLETE_LOCAL_NAME, self._name.encode()),)

    def on_connected(self) -> None:
        self._emulator.send(self.room.now_s())
        self.begin("data", self._keep_sending())

    def _on_write(self, characteristic: str, connection: Connection, value: bytes) -> None:
        self._emulator.receive(characteristic, bytes(value))

    async def _keep_sending(self) -> None:
        async for characteristic, outgoing in self._values():
            self.notify(self._notifying[characteristic], outgoing)

    async def _values(self) -> AsyncIterator[tuple[str, Outgoing]]:
        while True:
            await asyncio.sleep(TICK_S)
            for characteristic, value, samples in self._emulator.send(self.room.now_s()):
                counts = self._counts[self._types[characteristic]]
                yield characteristic, Outgoing(value, self.room.host.now_ns(), counts, samples)

    def streams(self) -> dict[str, Any]:
        return {sensor_type: asdict(counts) for sensor_type, counts in self._counts.items()}


BLE = Kind(
    ("EmulatedBle",),
    EmulatedBleKeys,
    EmulatedBle,
    "name (required, as it advertises), emulator (required: the driver's emulator.py, see emulated/ble.py)",
)
