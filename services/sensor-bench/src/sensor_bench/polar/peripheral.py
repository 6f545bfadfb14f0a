"""A virtual Polar sensor on the air: advertising, one link at a time, commands answered, values sent."""

import asyncio
import contextlib
import logging
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass

from bumble.att import Attribute
from bumble.core import AdvertisingData, BaseBumbleError
from bumble.device import Connection, Device
from bumble.hci import HCI_CONNECTION_TIMEOUT_ERROR

from sensor_bench.ble.radio import Radio
from sensor_bench.polar import pmd
from sensor_bench.polar.body import Identity
from sensor_bench.polar.firmware import Firmware, Outgoing
from sensor_bench.polar.gatt import Gatt
from sensor_bench.polar.models import MTU, POLAR_COMPANY_ID
from sensor_bench.polar.pmd import Measurement

log = logging.getLogger(__name__)

ADVERTISING_INTERVAL_MS = 100.0
COMMAND_TIME_S = 0.015
"""How long the firmware thinks about a control-point command."""
LINK_END_TIMEOUT_S = 1.0
NO_CONTACT_LIMIT_S = 45.0
"""A strap taken off drops its link after that time."""


@dataclass
class Peripheral:
    """One virtual sensor. Create it, `power_on`, and let it live; knobs are its public attributes and methods."""

    device: Device
    identity: Identity
    firmware: Firmware
    radio: Radio
    rssi_dbm: int = -55
    battery_percent: int = 90
    down: bool = False
    connection: Connection | None = None
    connections_total: int = 0

    def __post_init__(self) -> None:
        self._tasks: dict[object, asyncio.Task[None]] = {}
        self._command = asyncio.Lock()
        self._advertising = asyncio.Lock()
        self._gatt = Gatt(self.identity, lambda: self.battery_percent, self._on_command)
        self.device.add_services(self._gatt.services)
        self.device.gatt_server.max_mtu = MTU
        self.device.on("connection", self._on_connection)

    # --- life and knobs --------------------------------------------------------------------------------------------

    async def power_on(self) -> None:
        await self.device.power_on()
        await self.update_advertising()

    async def power_off(self) -> None:
        self.down = True
        await self.drop_link()
        await self.update_advertising()
        await self.device.power_off()

    async def update_advertising(self) -> None:
        """Advertise while on, worn and unconnected, and only then."""
        async with self._advertising:
            await self._update_advertising()

    async def _update_advertising(self) -> None:
        wanted = not self.down and self.firmware.body.wearing.contact and self.connection is None
        if wanted and not self.device.is_advertising:
            await self.device.start_advertising(
                advertising_data=self._advertising_data(),
                advertising_interval_min=ADVERTISING_INTERVAL_MS,
                advertising_interval_max=ADVERTISING_INTERVAL_MS,
            )
        elif not wanted and self.connection is None:
            await self.device.stop_advertising()

    def _advertising_data(self) -> bytes:
        rate = round(self.firmware.body.heart.heart_rate_bpm)
        battery_low, contact = self.battery_percent < 10, self.firmware.body.wearing.contact
        block = bytes([battery_low | contact << 1, 0, rate, rate])
        kinds = AdvertisingData.Type
        return bytes(
            AdvertisingData(
                [
                    (kinds.FLAGS, b"\x06"),
                    (kinds.COMPLETE_LIST_OF_16_BIT_SERVICE_CLASS_UUIDS, struct.pack("<H", 0x180D)),
                    (kinds.MANUFACTURER_SPECIFIC_DATA, struct.pack("<H", POLAR_COMPANY_ID) + block),
                    (kinds.COMPLETE_LOCAL_NAME, self.identity.name.encode()),
                ]
            )
        )

    async def drop_link(self) -> None:
        """The radio link breaks as if the wearer walked away for a moment."""
        if self.connection is None:
            return
        with contextlib.suppress(BaseBumbleError, TimeoutError):
            # no answer comes where the other side ends the link in the same moment
            await asyncio.wait_for(self.connection.disconnect(HCI_CONNECTION_TIMEOUT_ERROR), LINK_END_TIMEOUT_S)

    async def set_down(self, down: bool) -> None:
        """Out of range or switched off: no link, no advertising, until set back."""
        self.down = down
        if down:
            await self.drop_link()
        await self.update_advertising()

    async def set_contact(self, contact: bool) -> None:
        """Put on or take off; without contact the link is given up after 45 s and there is no advertising."""
        self.firmware.body.wearing.contact = contact
        self._cancel("no contact")
        if not contact:
            self._begin("no contact", self._give_up_link())
        await self.update_advertising()

    async def _give_up_link(self) -> None:
        await asyncio.sleep(NO_CONTACT_LIMIT_S)
        await self.drop_link()

    def set_battery(self, percent: int) -> None:
        self.battery_percent = percent
        self._notify(self._gatt.battery, Outgoing(bytes([percent]), self.firmware.host.now_ns()))

    def running_streams(self) -> list[str]:
        """Names of the streams that are being sent."""
        return [s.name for s in self.identity.model.streams if s.measurement in self.firmware.control.running]

    def stop_stream(self, name: str) -> None:
        """The firmware ends a running stream by itself and says so."""
        stream = next(s for s in self.identity.model.streams if s.name == name)
        del self.firmware.control.running[stream.measurement]
        self._cancel(stream.measurement)
        if self.connection is not None:
            notice = self._indication(self.connection, pmd.stopped_by_device([stream.measurement]))
            self.radio.send(notice, self.firmware.host.now_ns())

    # --- link ------------------------------------------------------------------------------------------------------

    def _on_connection(self, connection: Connection) -> None:
        self.connection = connection
        self.connections_total += 1
        connection.on("disconnection", self._on_disconnection)
        self.radio.open()
        self._begin("heart rate", self._send_all(self._gatt.heart_rate, self.firmware.heart_rates()))

    def _on_disconnection(self, reason: int) -> None:
        self.connection = None
        self.firmware.control.link_lost()
        self.radio.close()
        for key in [key for key in self._tasks if key != "no contact"]:
            self._cancel(key)
        self._begin("advertising", self.update_advertising())

    def _begin(self, key: object, work: Awaitable[None]) -> None:
        self._cancel(key)

        async def run() -> None:
            await work

        task = self._tasks[key] = asyncio.create_task(run())
        task.add_done_callback(lambda task: self._on_done(key, task))

    def _on_done(self, key: object, task: asyncio.Task[None]) -> None:
        if self._tasks.get(key) is task:
            del self._tasks[key]
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("%s: %s failed", self.identity.sensor, key, exc_info=error)

    def _cancel(self, key: object) -> None:
        if (task := self._tasks.pop(key, None)) is not None:
            task.cancel()

    async def _send_all(self, characteristic: Attribute[bytes], values: AsyncIterator[Outgoing]) -> None:
        async for outgoing in values:
            self._notify(characteristic, outgoing)

    def _notify(self, characteristic: Attribute[bytes], outgoing: Outgoing) -> None:
        """Send through the radio; its counts learn what became of the frame."""
        connection, counts = self.connection, outgoing.counts
        if connection is None:
            return

        async def deliver() -> None:
            await self.device.notify_subscriber(connection, characteristic, outgoing.value)
            if counts is not None:
                counts.frames_sent += 1
                counts.samples_sent += outgoing.samples

        def on_lost() -> None:
            if counts is not None:
                counts.frames_lost += 1
                counts.samples_lost += outgoing.samples

        self.radio.send(deliver, outgoing.ready_ns, on_lost, may_lose=counts is not None)

    # --- control point ---------------------------------------------------------------------------------------------

    def _on_command(self, connection: Connection, value: bytes) -> None:
        self._begin(object(), self._execute(connection, bytes(value)))

    async def _execute(self, connection: Connection, command: bytes) -> None:
        async with self._command:
            await asyncio.sleep(COMMAND_TIME_S)
            answer = self.firmware.control.answer(command, connection.att_mtu)
            for response in answer.responses:
                self.radio.send(self._indication(connection, response), self.firmware.host.now_ns())
            if answer.stopped is not None:
                self._cancel(answer.stopped.measurement)
            if answer.started is not None:
                stream = answer.started
                settings = self.firmware.control.running[stream.measurement]
                values = (
                    self.firmware.pulse_intervals(stream)
                    if stream.measurement is Measurement.PPI
                    else self.firmware.frames(stream, settings)
                )
                self._begin(stream.measurement, self._send_all(self._gatt.data, values))

    def _indication(self, connection: Connection, value: bytes) -> Callable[[], Awaitable[None]]:
        async def deliver() -> None:
            with contextlib.suppress(TimeoutError):
                await self.device.indicate_subscriber(connection, self._gatt.control, value)

        return deliver
