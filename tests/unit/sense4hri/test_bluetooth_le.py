"""How a sensor is found among what advertises, without Bluetooth."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from bleak.backends.device import BLEDevice
from bleak.exc import BleakDBusError, BleakError, BleakGATTProtocolError
from sense4hri import bluetooth_le, gatt
from sense4hri.bluetooth_le import BleakLink, BleakRadio
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


class Client:
    """A connected bleak client whose every read and every subscription fails."""

    name = "HRM"

    def __init__(self, error: Exception, is_connected: bool = True) -> None:
        self._error, self.is_connected = error, is_connected
        found = SimpleNamespace(max_write_without_response_size=20, properties=["read", "notify"])
        self.services = SimpleNamespace(characteristics={1: found}, get_characteristic=lambda _: found)

    async def read_gatt_char(self, characteristic: str) -> bytearray:
        raise self._error

    async def start_notify(self, characteristic: str, callback: Callable[[Any, bytearray], None]) -> None:
        raise self._error


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
    with pytest.raises(DeviceLost, match="reading 2a37: refused"):
        asyncio.run(link.read("2a37"))


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
    with pytest.raises(DeviceLost, match="subscribing to 2a37: refused"):
        asyncio.run(link.subscribe("2a37", lambda value: None))


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
