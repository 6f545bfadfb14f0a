"""A virtual Bluetooth LE device of any maker on the air: advertising, one link, values sent through a radio."""

import asyncio
import contextlib
import logging
import re
from abc import abstractmethod
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, NamedTuple

from bumble.att import Attribute
from bumble.core import AdvertisingData, BaseBumbleError
from bumble.device import Connection
from bumble.gatt import Characteristic, CharacteristicValue, Service
from bumble.hci import HCI_CONNECTION_TIMEOUT_ERROR

from sensor_bench.ble.controller import radio_device
from sensor_bench.ble.radio import LinkQuality, Radio
from sensor_bench.device import Counts, DeviceKeys, Knobs, VirtualDevice, knob
from sensor_bench.room import Room

log = logging.getLogger(__name__)

ADVERTISING_INTERVAL_MS = 100.0
LINK_END_TIMEOUT_S = 1.0
LINK = ("latency_s", "jitter_s", "connection_interval_s", "loss")
ADDRESS = re.compile(r"([0-9A-F]{2}:){5}[0-9A-F]{2}")
READ, NOTIFY = Characteristic.Properties.READ, Characteristic.Properties.NOTIFY
READABLE, WRITEABLE = Characteristic.READABLE, Characteristic.WRITEABLE
INFORMATION = {
    "vendor": "2A29",
    "model_number": "2A24",
    "serial_number": "2A25",
    "hardware": "2A27",
    "firmware": "2A26",
    "software": "2A28",
}
"""Characteristics of the device information service 180A."""


@dataclass(frozen=True, kw_only=True)
class BleKeys(DeviceKeys):
    """The keys of every Bluetooth LE device."""

    address: str
    battery_percent: int = 90
    rssi_dbm: int = -55
    contact: bool = True
    down: bool = False
    link: LinkQuality = field(default_factory=LinkQuality)

    unique: ClassVar[tuple[str, ...]] = ("sensor", "address")
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (("battery_percent", 0, 100), ("rssi_dbm", -127, 20))

    def check(self) -> None:
        super().check()
        if not ADDRESS.fullmatch(self.address):
            raise ValueError(f"address: {self.address!r} is no upper-case Bluetooth address")


@dataclass(frozen=True)
class BleKnobs(Knobs):
    """The knobs of every Bluetooth LE device."""

    latency_s: float | None = knob("delay of every packet", 0, 10)
    jitter_s: float | None = knob("mean of a further, exponential delay", 0, 5)
    connection_interval_s: float | None = knob("packets arrive on this grid only; 0: off", 0, 4)
    loss: float | None = knob("probability that a data frame is thrown away", 0, 1)
    stall_s: float | None = knob("nothing arrives that long, then everything at once", 0, 60)
    drop: bool | None = knob("true: end the link")
    down: bool | None = knob("switched off: no link, no advertisement")
    contact: bool | None = knob("worn on skin")
    battery_percent: float | None = knob("state of the battery", 0, 100)
    rssi_dbm: float | None = knob("strength of its signal", -127, 20)
    abort_connects: float | None = knob("so many attempts to connect will fail", 0, 1000)


class Outgoing(NamedTuple):
    """A value that is ready to be sent at ready_ns of host time; counts: of the stream whose samples it carries."""

    value: bytes
    ready_ns: int
    counts: Counts | None = None
    samples: int = 0


def information(**texts: str) -> Service:
    """The device information service; texts by the names in INFORMATION."""
    return Service(
        "180A", [Characteristic(INFORMATION[name], READ, READABLE, text.encode()) for name, text in texts.items()]
    )


class BlePeripheral(VirtualDevice):
    """What is the same in all of them; a kind says what it advertises, serves and sends."""

    knobs = BleKnobs
    notified_bytes: ClassVar[int] = 512
    """A longer value is notified in parts of so many bytes."""

    def __init__(self, room: Room, keys: BleKeys) -> None:
        super().__init__(room, keys)
        self.address = keys.address
        self.rssi_dbm, self.battery_percent, self.down = keys.rssi_dbm, keys.battery_percent, keys.down
        self.contact = keys.contact
        self.connection: Connection | None = None
        self.connections_total = 0
        self.radio = Radio(room.host, keys.link, room.seed_of(keys.sensor, "radio"))
        self.device = radio_device(room.medium, keys.sensor, keys.address)
        self.device.on("connection", self._on_connection)
        self._tasks: dict[object, asyncio.Task[None]] = {}
        self._advertising = asyncio.Lock()
        self._battery: Characteristic[bytes] = Characteristic(
            "2A19", READ | NOTIFY, READABLE, CharacteristicValue(read=lambda _: bytes([self.battery_percent]))
        )

    # --- what a kind says --------------------------------------------------------------------------------------------

    @abstractmethod
    def advertised(self) -> Sequence[tuple[int, bytes]]:
        """Type and value of what it advertises beside its flags."""

    def on_connected(self) -> None:
        """A client is there: `begin` what is sent by itself."""

    def on_disconnected(self) -> None:
        """The link is gone; everything that was begun has ended."""

    def wants_to_be_seen(self) -> bool:
        """Whether it advertises while nobody is connected."""
        return True

    def serve(self, *services: Service, mtu: int) -> None:
        """Offer these services and the battery's, at this ATT MTU."""
        self.device.add_services([*services, Service("180F", [self._battery])])
        self.device.gatt_server.max_mtu = mtu

    # --- life and knobs ----------------------------------------------------------------------------------------------

    async def start(self) -> None:
        await self.device.power_on()
        await self.update_advertising()

    async def stop(self) -> None:
        self.down = True
        await self.drop_link()
        await self.update_advertising()
        await self.device.power_off()

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        def link(name: str) -> Callable[[Any], None]:
            return lambda value: setattr(self.radio.quality, name, value)

        return {
            **super().turns(),
            **{name: link(name) for name in LINK},
            "stall_s": self.radio.stall,
            "drop": lambda on: self.drop_link() if on else None,
            "down": self.set_down,
            "contact": self.set_contact,
            "battery_percent": lambda value: self.set_battery(round(value)),
            "rssi_dbm": lambda value: setattr(self, "rssi_dbm", round(value)),
            "abort_connects": lambda value: self.room.bluez.links.aborts.update({self.address: round(value)}),
        }

    def link(self) -> tuple[bool, int]:
        return self.connection is not None, self.connections_total

    def standing(self) -> dict[str, Any]:
        return asdict(self.radio.quality) | {
            "battery_percent": self.battery_percent,
            "rssi_dbm": self.rssi_dbm,
            "contact": self.contact,
            "heart_rate_bpm": self.heart.heart_rate_bpm,
            "down": self.down,
        }

    async def update_advertising(self) -> None:
        """Advertise while on, unconnected and willing, and only then."""
        async with self._advertising:
            wanted = not self.down and self.wants_to_be_seen() and self.connection is None
            if wanted and not self.device.is_advertising:
                await self.device.start_advertising(
                    advertising_data=bytes(
                        AdvertisingData([(AdvertisingData.Type.FLAGS, b"\x06"), *self.advertised()])
                    ),
                    advertising_interval_min=ADVERTISING_INTERVAL_MS,
                    advertising_interval_max=ADVERTISING_INTERVAL_MS,
                )
            elif not wanted and self.connection is None:
                await self.device.stop_advertising()

    async def drop_link(self) -> None:
        """The radio link breaks as if the wearer walked away for a moment."""
        if self.connection is None:
            return
        with contextlib.suppress(BaseBumbleError, TimeoutError):
            # no answer comes where the other side ends the link in the same moment
            async with asyncio.timeout(LINK_END_TIMEOUT_S):
                await self.connection.disconnect(HCI_CONNECTION_TIMEOUT_ERROR)

    async def set_down(self, down: bool) -> None:
        """Out of range or switched off: no link, no advertising, until set back."""
        self.down = down
        if down:
            await self.drop_link()
        await self.update_advertising()

    async def set_contact(self, contact: bool) -> None:
        """Put on or take off."""
        self.contact = contact
        await self.update_advertising()

    def set_battery(self, percent: int) -> None:
        self.battery_percent = percent
        self.notify(self._battery, Outgoing(bytes([percent]), self.room.host.now_ns()))

    # --- link --------------------------------------------------------------------------------------------------------

    def _on_connection(self, connection: Connection) -> None:
        self.connection = connection
        self.connections_total += 1
        connection.on("disconnection", self._on_disconnection)
        self.radio.open()
        self.on_connected()

    def _on_disconnection(self, reason: int) -> None:
        self.connection = None
        self.radio.close()
        for key in [key for key in self._tasks if key not in self.beyond_the_link]:
            self.cancel(key)
        self.on_disconnected()
        self.begin("advertising", self.update_advertising())

    beyond_the_link: ClassVar[tuple[str, ...]] = ()
    """Keys of what was begun and goes on without a link."""

    def begin(self, key: object, work: Awaitable[None]) -> None:
        """Run until done, cancelled by the same key, or the link is gone; what was begun under the key ends."""
        self.cancel(key)

        async def run() -> None:
            await work

        task = self._tasks[key] = asyncio.create_task(run())
        task.add_done_callback(lambda task: self._on_done(key, task))

    def _on_done(self, key: object, task: asyncio.Task[None]) -> None:
        if self._tasks.get(key) is task:
            del self._tasks[key]
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("%s: %s failed", self.keys.sensor, key, exc_info=error)

    def cancel(self, key: object) -> None:
        if (task := self._tasks.pop(key, None)) is not None:
            task.cancel()

    async def send_all(self, characteristic: Attribute[bytes], values: AsyncIterator[Outgoing]) -> None:
        """Notify each value when it is ready, for ever."""
        async for outgoing in values:
            self.notify(characteristic, outgoing)

    def notify(self, characteristic: Attribute[bytes], outgoing: Outgoing) -> None:
        """Send through the radio; its counts learn what became of the frame."""
        connection, counts = self.connection, outgoing.counts
        if connection is None:
            return

        async def deliver() -> None:
            for at in range(0, len(outgoing.value), self.notified_bytes):
                part = outgoing.value[at : at + self.notified_bytes]
                await self.device.notify_subscriber(connection, characteristic, part)
            if counts is not None:
                counts.frames_sent += 1
                counts.samples_sent += outgoing.samples

        def on_lost() -> None:
            if counts is not None:
                counts.frames_lost += 1
                counts.samples_lost += outgoing.samples

        self.radio.send(deliver, outgoing.ready_ns, on_lost, may_lose=counts is not None)

    def indicate(self, characteristic: Attribute[bytes], value: bytes) -> None:
        """Send a value through the radio that the client must confirm."""
        connection = self.connection
        if connection is None:
            return

        async def deliver() -> None:
            with contextlib.suppress(TimeoutError):
                await self.device.indicate_subscriber(connection, characteristic, value)

        self.radio.send(deliver, self.room.host.now_ns())
