"""A sensor that bleak has missed, over a real D-Bus: BlueZ finds it in the moment in which bleak reads its devices."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from dbus_fast import BusType, Message, MessageType, Variant
from dbus_fast.aio import MessageBus
from sense4hri.bluetooth_le import BleakRadio
from sense4hri.errors import DeviceLost
from sense4hri.gatt import BluetoothConfig
from sensor_bench.ble.bus import PrivateBus
from sensor_bench.ble.names import adapter_properties, device_properties

ADDRESS = "F1:00:00:00:00:01"
ADAPTER = "/org/bluez/hci0"
DEVICE = f"{ADAPTER}/dev_{ADDRESS.replace(':', '_')}"
DEADLINE_S = 10.0


class Bluez(threading.Thread):
    """Owns `org.bluez` on a bus of its own; finds one strap right behind its first answer to GetManagedObjects.

    The client's loop is held up until both have been sent, so that it reads them together, as a busy one does.
    """

    def __init__(self, socket: Path) -> None:
        super().__init__()
        self.address = f"unix:path={socket}"
        self.serves, self.over, self._relayed = threading.Event(), threading.Event(), threading.Event()
        self.client: asyncio.AbstractEventLoop | None = None
        self._socket = socket
        self._objects = {ADAPTER: {"org.bluez.Adapter1": adapter_properties("00:00:00:00:00:01", powered=True)}}

    def run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        private = PrivateBus(self._socket)
        await private.start()
        bus = await MessageBus(bus_address=self.address, bus_type=BusType.SYSTEM).connect()
        bus.add_message_handler(lambda message: self._answer(bus, message))
        await bus.call(
            Message(
                destination="org.freedesktop.DBus",
                path="/org/freedesktop/DBus",
                interface="org.freedesktop.DBus",
                member="AddMatch",
                signature="s",
                body=["type='signal',member='InterfacesAdded'"],
            )
        )
        await bus.request_name("org.bluez")
        self.serves.set()
        while not self.over.is_set():
            await asyncio.sleep(0.05)
            if DEVICE in self._objects:
                news = ["org.bluez.Device1", {"RSSI": Variant("n", -50)}, []]
                bus.send(signal(DEVICE, "org.freedesktop.DBus.Properties", "PropertiesChanged", "sa{sv}as", news))
        bus.disconnect()
        await private.stop()

    def _answer(self, bus: MessageBus, message: Message) -> Message | bool | None:
        if message.member == "InterfacesAdded":
            self._relayed.set()
        if message.message_type is not MessageType.METHOD_CALL:
            return None
        if message.member != "GetManagedObjects":
            return Message.new_method_return(message)
        reply = Message.new_method_return(message, "a{oa{sa{sv}}}", [dict(self._objects)])
        if DEVICE in self._objects:
            return reply
        assert self.client is not None
        self.client.call_soon_threadsafe(self._relayed.wait, DEADLINE_S)
        services = ["0000180d-0000-1000-8000-00805f9b34fb"]
        strap = device_properties(ADAPTER, ADDRESS, "HRM", services, -50, Variant("a{qv}", {}))
        self._objects[DEVICE] = {"org.bluez.Device1": strap}
        bus.send(reply)
        found = [DEVICE, self._objects[DEVICE]]
        bus.send(signal("/", "org.freedesktop.DBus.ObjectManager", "InterfacesAdded", "oa{sa{sv}}", found))
        return True


def signal(path: str, interface: str, member: str, signature: str, body: list) -> Message:
    """A signal of D-Bus."""
    return Message(
        message_type=MessageType.SIGNAL, path=path, interface=interface, member=member, signature=signature, body=body
    )


@pytest.fixture
def bluez(tmp_path, monkeypatch) -> Iterator[Bluez]:
    """A BlueZ that runs; clients reach it as that of the system."""
    one = Bluez(tmp_path / "bus")
    monkeypatch.setenv("DBUS_SYSTEM_BUS_ADDRESS", one.address)
    one.start()
    assert one.serves.wait(DEADLINE_S)
    yield one
    one.over.set()
    one.join(DEADLINE_S)


def test_a_sensor_that_bleak_has_missed_is_found_by_the_next_attempt(bluez):
    """Two drivers that start together do it to each other; the second would look in vain for ever."""

    async def look() -> tuple[str, float | None]:
        bluez.client = asyncio.get_running_loop()
        radio = BleakRadio(BluetoothConfig(sensor_id="it_1", scan_timeout_s=1.0, name="HRM"), ("180d",), ("2a37",))
        with suppress(DeviceLost):
            await radio._find()  # in vain where bleak has missed it
        device, rssi_dbm = await radio._find()
        return device.address, rssi_dbm

    assert asyncio.run(look()) == (ADDRESS, -50.0)
