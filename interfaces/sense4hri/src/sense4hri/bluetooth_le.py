"""A Bluetooth LE connection through bleak: finds one sensor, keeps others off it, says in words how its link fails.

The only place that knows bleak. Drivers that use it declare `bleak` and `dbus-fast`; the kit does not.
"""

import asyncio
import hashlib
import os
import socket
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import Any

from bleak import BleakAdapter, BleakClient, BleakScanner
from bleak.backends.bluezdbus.manager import get_global_bluez_manager
from bleak.backends.bluezdbus.utils import get_dbus_authenticator
from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.device import BLEDevice
from bleak.backends.scanner import AdvertisementData
from bleak.exc import BleakDBusError, BleakError, BleakGATTProtocolError
from bleak.uuids import normalize_uuid_str
from dbus_fast import BusType, Message
from dbus_fast.aio import MessageBus
from dbus_fast.errors import AuthError, DBusFastError

from sense4hri.errors import DeviceLost
from sense4hri.gatt import BluetoothConfig, Refused

CONNECT_TIMEOUT_S = 20.0
DISCONNECT_TIMEOUT_S = 4.0
TAKE_OVER_S = 3.0  # another driver that has just connected listens by then
NAMESAKES_S = 1.0
"""How much longer to listen for another device of the same name; most advertise several times a second."""
SMALLEST_MTU = 23
NO_RSSI = (-127, 127)
UNKNOWN_OBJECT = "org.freedesktop.DBus.Error.UnknownObject"
EXPLAINED = {
    "org.freedesktop.DBus.Error.ServiceUnknown": "bluetoothd does not run",
    "org.freedesktop.DBus.Error.NameHasNoOwner": "bluetoothd does not run",
    "org.freedesktop.DBus.Error.AccessDenied": "D-Bus does not let this user reach bluetoothd",
    "org.bluez.Error.NotReady": "Bluetooth is off",
}

REFUSED = tuple(f"org.bluez.Error.{name}" for name in ("NotPermitted", "NotAuthorized", "NotSupported"))


@contextmanager
def link_errors(doing: str, unknown: str = "the link broke") -> Iterator[None]:
    """Turn every way a link fails into DeviceLost that says what was being done.

    unknown: what it means that BlueZ no longer knows what it was asked about.
    """
    try:
        yield
    except BleakDBusError as err:
        explained = EXPLAINED | {UNKNOWN_OBJECT: unknown}
        raise DeviceLost(f"{doing}: {explained.get(err.dbus_error, str(err))}") from err
    except TimeoutError as err:
        raise DeviceLost(f"{doing}: timed out") from err
    except (BleakError, DBusFastError, EOFError) as err:
        shut_out = "D-Bus does not let this user in: " if isinstance(err.__cause__ or err, AuthError) else ""
        raise DeviceLost(f"{doing}: {shut_out}{err.args[0] if err.args else type(err).__name__}") from err
    except OSError as err:
        bus = os.environ.get("DBUS_SYSTEM_BUS_ADDRESS", "the system's")
        raise DeviceLost(f"{doing}: no D-Bus to reach Bluetooth through ({bus}: {err.strerror or err})") from err


class BleakLink:
    """A Link over a connected bleak client."""

    def __init__(self, client: BleakClient, rssi_dbm: float | None) -> None:
        self._client = client
        self.name = client.name
        self.rssi_dbm = rssi_dbm
        self._characteristics = sorted(client.services.characteristics.values(), key=lambda each: each.handle)
        payloads = [each.max_write_without_response_size for each in self._characteristics]
        self.mtu = max(payloads, default=SMALLEST_MTU - 3) + 3

    async def read(self, characteristic: str) -> bytes | None:
        found = self._first(characteristic, {"read"})
        if found is None:
            return None
        with self._asking(f"reading {characteristic}"):
            return bytes(await self._client.read_gatt_char(found))

    async def write(self, characteristic: str, value: bytes, acknowledged: bool = True) -> None:
        with link_errors(f"writing {value.hex(' ')}"):
            await self._client.write_gatt_char(characteristic, value, response=acknowledged)

    async def subscribe(self, characteristic: str, receive: Callable[[bytes], None]) -> bool:
        found = self._first(characteristic, {"notify", "indicate"})
        if found is None:
            return False
        with self._asking(f"subscribing to {characteristic}"):
            await self._client.start_notify(found, lambda _, value: receive(bytes(value)))
        return True

    @contextmanager
    def _asking(self, doing: str) -> Iterator[None]:
        """Raise Refused where the link stands, and DeviceLost where it does not."""
        with link_errors(doing):
            try:
                yield
            except (BleakGATTProtocolError, BleakDBusError) as err:
                if self._client.is_connected and _is_refusal(err):
                    raise Refused(f"{doing}: refused, {err}") from err
                raise

    def _first(self, characteristic: str, properties: set[str]) -> BleakGATTCharacteristic | None:
        """Return the first one that has any of the properties: a device may have several, as of two batteries."""
        fit = (each for each in self._characteristics if properties & set(each.properties))
        return next((each for each in fit if each.uuid == characteristic), None)


def _is_refusal(err: BleakError) -> bool:
    """Whether it is the device that has answered, or BlueZ for one that is not paired or does not notify."""
    return isinstance(err, BleakGATTProtocolError) or (isinstance(err, BleakDBusError) and err.dbus_error in REFUSED)


class BleakRadio:
    """A Radio that finds the configured sensor with bleak.

    services: UUIDs, short or whole, by which a sensor of this kind is known, also when it is connected already. data:
    characteristics of which another program here that is notified uses the sensor.
    """

    def __init__(self, config: BluetoothConfig, services: Sequence[str], data: Sequence[str]) -> None:
        self._config, self._data = config, frozenset(map(normalize_uuid_str, data))
        self._services = [normalize_uuid_str(service) for service in services]
        self._only = config.address.lower()
        """Address of the one device that is meant, as far as is known."""
        self._bluez: Any = {"adapter": config.adapter} if config.adapter else {}

    @asynccontextmanager
    async def connect(self, on_lost: Callable[[str], None]) -> AsyncIterator[BleakLink]:
        with link_errors("looking for the sensor", unknown="the Bluetooth adapter is gone"):
            device, rssi_dbm = await self._find()
        link: BleakLink | None = None

        def disconnected(_: BleakClient) -> None:
            if link is not None:  # bleak also tells of an attempt that BlueZ aborts, and connects once more
                on_lost("the link broke")

        with _claimed(device):
            client = BleakClient(device, disconnected, timeout=CONNECT_TIMEOUT_S, bluez=self._bluez)
            try:
                with link_errors(f"connecting to {device.name or device.address}"):
                    await client.connect()
                    link = BleakLink(client, rssi_dbm)
                yield link
            finally:
                with suppress(DeviceLost), link_errors("disconnecting"):
                    async with asyncio.timeout(DISCONNECT_TIMEOUT_S):
                        await client.disconnect()

    async def _find(self) -> tuple[BLEDevice, float | None]:
        """Return the sensor and its signal strength. Raises DeviceLost where there is none, or more than one."""
        adapter = await BleakAdapter.get(bluez=self._bluez)
        for device in await adapter.get_connected_devices(self._services):
            if self._is_meant(device):  # a connected sensor does not advertise
                await _check_unused(device, self._data)
                await asyncio.sleep(TAKE_OVER_S)
                await _check_unused(device, self._data)
                return device, None
        return await self._scan()

    async def _scan(self) -> tuple[BLEDevice, float | None]:
        similar: dict[str, str] = {}
        meant: dict[str, tuple[BLEDevice, float]] = {}
        first = asyncio.Event()

        def heard(device: BLEDevice, advertisement: AdvertisementData) -> None:
            if set(advertisement.service_uuids) & set(self._services):
                similar[device.address] = device.name or device.address
            if self._is_meant(device):
                meant[device.address] = device, float(advertisement.rssi)
                first.set()

        timeout_s, wanted = self._config.scan_timeout_s, self._config.address or self._config.name
        async with BleakScanner(heard, bluez=self._bluez):
            with suppress(TimeoutError):
                async with asyncio.timeout(timeout_s):
                    await first.wait()
            if meant and self._only not in map(str.lower, meant):
                await asyncio.sleep(NAMESAKES_S)
            missed = not meant and await self._is_heard_by_bluez()
        if missed:
            await _forget_bluez()
            raise DeviceLost(f"{wanted} is heard by BlueZ and bleak has missed it: looking again")
        if not meant:
            raise DeviceLost(
                f"{wanted} does not advertise within {timeout_s:g} s: out of range, not worn, empty, or connected "
                f"elsewhere (sensors of this kind heard: {', '.join(sorted(similar.values())) or 'none'})"
            )
        found, rssi_dbm = self._one_of(meant)
        return found, None if rssi_dbm in NO_RSSI else rssi_dbm

    async def _is_heard_by_bluez(self) -> bool:
        """Whether BlueZ hears the sensor at this moment, while it listens.

        bleak 3.1 forgets a device that BlueZ finds, for another program that listens, in the moment in which bleak
        takes over BlueZ's list of devices; it does not see that device again until it reads the list anew.
        """
        known = [objects.get("org.bluez.Device1", {}) for objects in (await _bluez_objects()).values()]
        devices = [{name: value.value for name, value in properties.items()} for properties in known]
        heard = [device for device in devices if "RSSI" in device]
        return any(self._config.is_meant(device["Address"], device.get("Name", "")) for device in heard)

    def _one_of(self, meant: dict[str, tuple[BLEDevice, float]]) -> tuple[BLEDevice, float]:
        """Return the only device; of several the one that was alone with its name before. Raises DeviceLost."""
        known = [each for address, each in meant.items() if address.lower() == self._only]
        if not known and len(meant) > 1:
            addresses = ", ".join(sorted(meant))
            raise DeviceLost(f"{len(meant)} devices are called {self._config.name} ({addresses}): give `address`")
        found = known[0] if known else next(iter(meant.values()))
        self._only = found[0].address.lower()
        return found

    def _is_meant(self, device: BLEDevice) -> bool:
        return self._config.is_meant(device.address, device.name or "")


@contextmanager
def _claimed(device: BLEDevice) -> Iterator[None]:
    """Keep other drivers of this machine off the sensor, from before the first attempt to connect.

    A driver whose attempt fails cancels everybody's: two that start together would never get anywhere. The claim is an
    abstract socket, which the kernel lets go of however the process ends; containers have their own, and rely on
    `_check_unused`.
    """
    bus = os.environ.get("DBUS_SYSTEM_BUS_ADDRESS", "")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
        try:
            claim.bind("\0sense4hri-" + hashlib.sha256(f"{bus} {device.address}".encode()).hexdigest()[:32])
        except OSError as err:
            raise DeviceLost(f"{device.name or device.address} is in use by another driver here") from err
        yield


async def _check_unused(device: BLEDevice, data: frozenset[str]) -> None:
    """Raise DeviceLost where another process of this computer receives the sensor's data.

    BlueZ lets any number of processes share a connection, and lets each of them cut it. A connection nobody receives
    from is what a killed driver leaves behind; that one is taken over.
    """
    for path, interfaces in (await _bluez_objects()).items():
        values = {name: value.value for name, value in interfaces.get("org.bluez.GattCharacteristic1", {}).items()}
        belongs = path.startswith(device.details["path"] + "/") and values.get("UUID") in data
        if belongs and values.get("Notifying"):
            raise DeviceLost(f"{device.name or device.address} is in use by another driver or program here")


async def _bluez_objects() -> dict[str, Any]:
    """Path -> interface -> properties of everything BlueZ knows, asked over a connection of its own."""
    bus = MessageBus(bus_type=BusType.SYSTEM, auth=get_dbus_authenticator())
    try:
        await bus.connect()
        reply = await bus.call(
            Message("org.bluez", "/", "org.freedesktop.DBus.ObjectManager", member="GetManagedObjects")
        )
    finally:
        bus.disconnect()
    return reply.body[0] if reply and reply.body and isinstance(reply.body[0], dict) else {}


async def _forget_bluez() -> None:
    """End bleak's connection to BlueZ; it makes another one, and reads all objects, when it is next asked anything."""
    if (bus := (await get_global_bluez_manager())._bus) is not None:
        bus.disconnect()
        await bus.wait_for_disconnect()
