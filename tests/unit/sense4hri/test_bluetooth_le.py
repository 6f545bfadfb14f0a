"""How a sensor is found among what advertises, without Bluetooth."""

import asyncio
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest
from bleak.backends.device import BLEDevice
from bleak.exc import (
    BleakBluetoothNotAvailableError,
    BleakBluetoothNotAvailableReason,
    BleakDBusError,
    BleakError,
    BleakGATTProtocolError,
)
from dbus_fast.errors import AuthError
from sense4hri import bluetooth_le, gatt
from sense4hri.bluetooth_le import BleakLink, BleakRadio, link_errors
from sense4hri.device import Identity, Status
from sense4hri.errors import DeviceLost
from sense4hri.gatt import BluetoothConfig

FIRST, SECOND = "F1:00:00:00:00:01", "F1:00:00:00:00:02"


@pytest.fixture
def radio(monkeypatch) -> Callable[..., BleakRadio]:
    """A radio that hears devices of these addresses, all called HRM; its `heard` may be changed."""
    heard: list[str] = []

    class Scanner:
        def __init__(self, callback: Callable[[Any, Any], None], bluez: dict[str, str]) -> None:
            self._callback = callback

        async def __aenter__(self) -> None:
            for place, address in enumerate(heard):
                said = SimpleNamespace(service_uuids=[], rssi=-50 - place)
                asyncio.get_running_loop().call_later(0.01 * place, self._callback, BLEDevice(address, "HRM", {}), said)

        async def __aexit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(bluetooth_le, "BleakScanner", Scanner)

    async def nothing_known() -> dict[str, Any]:
        return {}

    monkeypatch.setattr(bluetooth_le, "NAMESAKES_S", 0.2)
    monkeypatch.setattr(bluetooth_le, "_bluez_objects", nothing_known)

    def make(*addresses: str, **config: Any) -> BleakRadio:
        heard[:] = addresses
        made = BleakRadio(BluetoothConfig(sensor_id="it_1", scan_timeout_s=0.2, **config), ("180d",), ("2a37",))
        made.heard = heard
        return made

    return make


def found(radio: BleakRadio) -> tuple[str, float | None]:
    device, rssi_dbm = asyncio.run(radio._scan())
    return device.address, rssi_dbm


def test_a_name_that_two_devices_have_is_refused_with_their_addresses(radio):
    """Whichever answers first would else be the participant's; an address says which is meant."""
    with pytest.raises(DeviceLost) as lost:
        found(radio(FIRST, SECOND, name="HRM"))
    assert str(lost.value) == f"2 devices are called HRM ({FIRST}, {SECOND}): give `address`"
    assert found(radio(FIRST, SECOND, address=SECOND)) == (SECOND, -51.0)


def test_a_device_that_was_alone_with_its_name_is_known_again(radio):
    """A second strap that is switched on later does not keep the first from coming back; nor is it taken for it."""
    one = radio(FIRST, name="HRM")
    assert found(one) == (FIRST, -50.0)
    one.heard.append(SECOND)
    assert found(one) == (FIRST, -50.0)


def test_a_sensor_that_does_not_advertise_is_said_to_be_missing(radio):
    """The sentence names it."""
    with pytest.raises(DeviceLost, match="HRM does not advertise within"):
        found(radio(name="HRM"))


def characteristic(handle: int, uuid: str, *properties: str) -> SimpleNamespace:
    return SimpleNamespace(handle=handle, uuid=uuid, properties=properties, max_write_without_response_size=20)


EVERYTHING = [
    characteristic(handle, uuid, "read", "notify")
    for handle, uuid in enumerate(
        (gatt.HEART_RATE, gatt.BATTERY, gatt.VENDOR, gatt.MODEL, gatt.SERIAL_NUMBER, gatt.FIRMWARE, gatt.BODY_LOCATION)
    )
]


class Client:
    """A connected bleak client; where there is an error, every read and every subscription fails with it."""

    name = "HRM"

    def __init__(
        self, error: Exception | None, is_connected: bool = True, has: Sequence[SimpleNamespace] = EVERYTHING
    ) -> None:
        self._error, self.is_connected, self.subscribed = error, is_connected, list[int]()
        self.services = SimpleNamespace(characteristics={each.handle: each for each in has})

    async def read_gatt_char(self, found: SimpleNamespace) -> bytearray:
        if self._error is not None:
            raise self._error
        return bytearray([found.handle])

    async def start_notify(self, found: SimpleNamespace, callback: Callable[[Any, bytearray], None]) -> None:
        if self._error is not None:
            raise self._error
        self.subscribed.append(found.handle)


@pytest.mark.parametrize(
    "error",
    [
        BleakDBusError("org.bluez.Error.NotPermitted", ["Not paired"]),
        BleakDBusError("org.bluez.Error.NotAuthorized", ["Not authorized"]),
        BleakGATTProtocolError(0x05),
    ],
)
def test_what_a_device_keeps_to_itself_costs_no_link(error):
    """A strap that wants to be paired before it tells its charge or its serial number streams without them."""
    link = BleakLink(Client(error), None)
    assert asyncio.run(gatt.battery_of(link)) == Status()
    assert asyncio.run(gatt.identity_of(link)) == Identity()
    with pytest.raises(DeviceLost, match=f"reading {gatt.HEART_RATE}: refused"):
        asyncio.run(link.read(gatt.HEART_RATE))


@pytest.mark.parametrize(
    "error",
    [
        BleakDBusError("org.bluez.Error.NotSupported", ["Operation is not supported"]),
        BleakDBusError("org.bluez.Error.NotPermitted", ["Not paired"]),
        BleakGATTProtocolError(0x03),
        BleakGATTProtocolError(0xFD),
    ],
)
def test_a_battery_that_does_not_notify_costs_no_link(error):
    """A strap that announces notifications of its charge and refuses them streams; refused samples lose it."""
    link = BleakLink(Client(error), None)
    asyncio.run(gatt.subscribe_to_battery(link, lambda value: None))
    with pytest.raises(DeviceLost, match=f"subscribing to {gatt.HEART_RATE}: refused"):
        asyncio.run(link.subscribe(gatt.HEART_RATE, lambda value: None))


@pytest.mark.parametrize(
    "client",
    [
        Client(BleakDBusError("org.bluez.Error.Failed", ["Not connected"])),
        Client(BleakDBusError("org.bluez.Error.NotPermitted", ["Not paired"]), is_connected=False),
        Client(BleakError("Not connected")),
        Client(TimeoutError()),
    ],
)
def test_a_link_that_breaks_while_a_device_says_who_it_is_is_lost(client):
    """Only what the device itself refuses is left out."""
    for read in (gatt.battery_of, gatt.identity_of, lambda link: gatt.subscribe_to_battery(link, lambda value: None)):
        with pytest.raises(DeviceLost):
            asyncio.run(read(BleakLink(client, None)))


def test_of_two_batteries_the_first_is_told():
    """Ear pieces have two of a characteristic, in any order of discovery: the first that can be read, or notifies."""
    has = [
        characteristic(60, gatt.BATTERY, "read", "notify"),
        characteristic(50, gatt.BATTERY, "read"),
        characteristic(40, gatt.BATTERY, "notify"),
    ]
    client = Client(None, has=has)
    link = BleakLink(client, None)
    assert asyncio.run(link.read(gatt.BATTERY)) == bytes([50])
    assert asyncio.run(link.subscribe(gatt.BATTERY, lambda value: None))
    assert client.subscribed == [40]
    assert asyncio.run(link.read(gatt.HEART_RATE)) is None
    assert not asyncio.run(link.subscribe(gatt.HEART_RATE, lambda value: None))


class AbortedOnce(Client):
    """What bleak makes of an attempt that BlueZ aborts: the link breaks, bleak says so and connects once more."""

    def __init__(self, device: BLEDevice, on_disconnected: Callable[[Any], None], **_: Any) -> None:
        super().__init__(None)
        self._on_disconnected = on_disconnected

    async def connect(self) -> None:
        self._on_disconnected(self)

    async def disconnect(self) -> None:
        self._on_disconnected(self)


def test_an_attempt_that_is_repeated_is_no_lost_link(radio, monkeypatch):
    """The link that stands is not given up for the one before it; that it breaks is told."""
    monkeypatch.setattr(bluetooth_le, "BleakClient", AbortedOnce)
    one, lost = radio(FIRST, name="HRM"), list[str]()
    monkeypatch.setattr(one, "_find", one._scan)

    async def connect() -> None:
        async with one.connect(lost.append):
            assert lost == []

    asyncio.run(connect())
    assert lost == ["the link broke"]


def said(error: Exception) -> str:
    """The sentence for what went wrong while something was done."""
    with pytest.raises(DeviceLost) as lost, link_errors("reading"):
        raise error
    return str(lost.value)


def test_who_may_not_reach_bluetooth_is_told_so():
    """Neither the wording of D-Bus's policies nor "authentication failed", which might be the sensor's."""
    denied = BleakDBusError("org.freedesktop.DBus.Error.AccessDenied", ["Rejected send message, 2 matched rules; ..."])
    assert said(denied) == "reading: D-Bus does not let this user reach bluetoothd"
    refused = AuthError("authentication failed: REJECTED: ['EXTERNAL']")
    by_bleak = BleakBluetoothNotAvailableError(str(refused), BleakBluetoothNotAvailableReason.DENIED_BY_SYSTEM)
    by_bleak.__cause__ = refused
    assert said(refused) == said(by_bleak) == f"reading: D-Bus does not let this user in: {refused}"


def test_an_adapter_that_goes_while_a_sensor_is_sought_broke_no_link(radio, monkeypatch):
    """Of what BlueZ no longer knows the sentence says what it was."""
    gone = BleakDBusError("org.freedesktop.DBus.Error.UnknownObject", ["no such object: /org/bluez/hci0"])
    monkeypatch.setattr(BleakRadio, "_find", lambda _: Client(gone).read_gatt_char(EVERYTHING[0]))

    async def seek() -> None:
        async with radio(FIRST, name="HRM").connect(lambda reason: None):
            pass

    with pytest.raises(DeviceLost) as lost:
        asyncio.run(seek())
    assert str(lost.value) == "looking for the sensor: the Bluetooth adapter is gone"
    assert said(gone) == "reading: the link broke"
