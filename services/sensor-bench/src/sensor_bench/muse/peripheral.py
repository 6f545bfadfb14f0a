"""A virtual Muse 2 on the air: commands answered, packets sent, losses counted by whole packets."""

import asyncio
import logging
import math
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from bumble.core import AdvertisingData
from bumble.device import Connection
from bumble.gatt import Characteristic, CharacteristicValue, Service

from sensor_bench.ble.peripheral import NOTIFY, BleKeys, BlePeripheral, Outgoing
from sensor_bench.device import Counts, Shown
from sensor_bench.muse.packets import EEG, MOTION, PPG, SENSOR_TYPES, SHAPES, Band, answer, command_of
from sensor_bench.room import Room

log = logging.getLogger(__name__)

SERVICE = 0xFE8D
MTU = 185
CONTROL = 1
NUMBERS = {EEG: (3, 4, 5, 6), MOTION: (0xA, 9), PPG: (0x10, 0x11)}
SILENT = (7, 0xF)
"""The right auxiliary electrode, and the third light: BrainFlow expects two of the three."""
WITH_PPG = ("p50", "p51", "p60", "p61")
WRITE = Characteristic.Properties.WRITE | Characteristic.Properties.WRITE_WITHOUT_RESPONSE


@dataclass(frozen=True, kw_only=True)
class MuseKeys(BleKeys):
    """One headband as the configuration describes it."""

    name: str = "Muse-1A2B"
    """As it advertises itself."""
    counter_start: int = 0
    """Number of the first packet of each stream after it is started."""

    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (*BleKeys.ranges, ("counter_start", 0, 65535))


@dataclass(frozen=True)
class MuseShown(Shown):
    """A headband in `GET /devices`."""

    name: str
    address: str
    streaming: list[str]


def uuid(number: int) -> str:
    """Return the UUID of a characteristic of Muse's own."""
    return f"273E00{number:02X}-4C4D-454D-96BE-F03BAC821358"


class Headband(BlePeripheral):
    """One virtual headband."""

    def __init__(self, room: Room, keys: MuseKeys) -> None:
        super().__init__(room, keys)
        transit_s = room.participants[keys.participant].pulse_transit_s
        self.band = Band(self.heart, room.seed_of(keys.sensor, "muse") % 2**31, transit_s)
        self._name, self._counter_start, self._preset = keys.name, keys.counter_start, "p21"
        self._streaming: tuple[str, ...] = ()
        self._counts = {each: Counts() for names in SENSOR_TYPES.values() for each in names}
        self._control: Characteristic[bytes] = Characteristic(
            uuid(CONTROL), WRITE | NOTIFY, Characteristic.WRITEABLE, CharacteristicValue(write=self._on_command)
        )
        self._data = {
            stream: [Characteristic(uuid(number), NOTIFY, Characteristic.Permissions(0), b"") for number in numbers]
            for stream, numbers in NUMBERS.items()
        }
        data = [each for characteristics in self._data.values() for each in characteristics]
        silent = [Characteristic(uuid(number), NOTIFY, Characteristic.Permissions(0), b"") for number in SILENT]
        self.serve(Service(f"{SERVICE:04X}", [self._control, *data, *silent]), mtu=MTU)

    def advertised(self) -> Sequence[tuple[int, bytes]]:
        kinds = AdvertisingData.Type
        return (
            (kinds.COMPLETE_LIST_OF_16_BIT_SERVICE_CLASS_UUIDS, struct.pack("<H", SERVICE)),
            (kinds.COMPLETE_LOCAL_NAME, self._name.encode()),
        )

    def shown(self) -> MuseShown:
        streaming = [each for stream in self._streaming for each in SENSOR_TYPES[stream]]
        return MuseShown(**vars(super().shown()), name=self._name, address=self.address, streaming=streaming)

    def streams(self) -> dict[str, Any]:
        return {name: asdict(counts) for name, counts in self._counts.items() if counts.frames_sent}

    def on_disconnected(self) -> None:
        self._streaming = ()

    def _on_command(self, connection: Connection, value: bytes) -> None:
        try:
            command = command_of(bytes(value))
        except ValueError as err:
            log.warning("%s: %s", self.keys.sensor, err)
            return
        if command.startswith("p"):
            self._preset = command
        if command == "d":
            self._start()
        if command == "h":
            self._stop()
        told = {"bp": self.battery_percent} if command == "s" else {"fw": "1.2.13"} if command == "v1" else {}
        for piece in answer(rc=0, **told):
            self.notify(self._control, Outgoing(piece, self.room.host.now_ns()))

    def _start(self) -> None:
        self._streaming = (EEG, MOTION, PPG) if self._preset in WITH_PPG else (EEG, MOTION)
        for stream in self._streaming:
            self.begin(stream, self._send(stream))

    def _stop(self) -> None:
        for stream in self._streaming:
            self.cancel(stream)
        self._streaming = ()

    async def _send(self, stream: str) -> None:
        """Send a stream's packets when their last sample is taken, for ever."""
        shape, counter = SHAPES[stream], self._counter_start
        first = math.ceil(self.room.now_s() * shape.fs_hz)
        while True:
            taken_s = (first + shape.samples) / shape.fs_hz
            await asyncio.sleep(max(0.0, taken_s - self.room.now_s()))
            self._put(stream, self.band.packets(stream, counter, first), taken_s)
            counter, first = counter + 1, first + shape.samples

    def _put(self, stream: str, packets: list[bytes], taken_s: float) -> None:
        """Send the packets of one counter: all of them come, or all are lost."""
        connection, shape = self.connection, SHAPES[stream]
        counts = [self._counts[each] for each in SENSOR_TYPES[stream]]
        if connection is None:
            return

        async def deliver() -> None:
            for characteristic, packet in zip(self._data[stream], packets, strict=True):
                await self.device.notify_subscriber(connection, characteristic, packet)
            for each in counts:
                each.frames_sent += 1
                each.samples_sent += shape.samples

        def on_lost() -> None:
            for each in counts:
                each.frames_lost += 1
                each.samples_lost += shape.samples

        ready_ns = self.room.start_ns + round(taken_s * 1e9)
        self.radio.send(deliver, ready_ns, on_lost, may_lose=True)
