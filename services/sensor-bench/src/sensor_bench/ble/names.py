"""BlueZ's names and vocabulary on D-Bus: interfaces, flags, errors, and properties made of what the radio says."""

from typing import Any

from bumble.core import AdvertisingData
from bumble.hci import Address
from dbus_fast import Variant

SERVICE = "org.bluez"
ROOT = "/org/bluez"
OBJECT_MANAGER = "org.freedesktop.DBus.ObjectManager"
PROPERTIES = "org.freedesktop.DBus.Properties"
INTROSPECTABLE = "org.freedesktop.DBus.Introspectable"
ADAPTER = f"{SERVICE}.Adapter1"
DEVICE = f"{SERVICE}.Device1"
GATT_SERVICE = f"{SERVICE}.GattService1"
CHARACTERISTIC = f"{SERVICE}.GattCharacteristic1"
DESCRIPTOR = f"{SERVICE}.GattDescriptor1"
AGENT_MANAGER = f"{SERVICE}.AgentManager1"

BASE_UUID = "-0000-1000-8000-00805f9b34fb"
HIDDEN_SERVICES = {f"0000{short}{BASE_UUID}" for short in ("1800", "1801")}
"""Generic Access and Generic Attribute: bluetoothd keeps them to itself."""
FLAGS = {
    0x01: "broadcast",
    0x02: "read",
    0x04: "write-without-response",
    0x08: "write",
    0x10: "notify",
    0x20: "indicate",
}

SIGNATURES = {
    "Get": "ss",
    "GetAll": "s",
    "Set": "ssv",
    "SetDiscoveryFilter": "a{sv}",
    "RemoveDevice": "o",
    "ReadValue": "a{sv}",
    "WriteValue": "aya{sv}",
    "AcquireNotify": "a{sv}",
    "RegisterAgent": "os",
    "UnregisterAgent": "o",
    "RequestDefaultAgent": "o",
}
"""Arguments of the calls that have any."""

Properties = dict[str, Variant]


class BluezError(Exception):
    """A call is refused; becomes the D-Bus error `org.bluez.Error.<name>`."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__(f"{name}: {text}")
        self.name, self.text = name, text


class UnknownObject(KeyError):
    """The object path does not exist (any more)."""


def mac_of(address: Address) -> str:
    return address.to_string(with_type_qualifier=False)


def uuid128(uuid: Any) -> str:
    raw = uuid.to_bytes()[::-1].hex()
    if len(raw) == 4:
        return f"0000{raw}{BASE_UUID}"
    return f"{raw[:8]}-{raw[8:12]}-{raw[12:16]}-{raw[16:20]}-{raw[20:]}"


def offset(options: dict[str, Variant]) -> int:
    return int(options["offset"].value) if "offset" in options else 0


def att_error(code: int) -> tuple[str, str]:
    """BlueZ's error name and text for an ATT error code."""
    known = {
        0x02: ("NotPermitted", "Read not permitted"),
        0x03: ("NotPermitted", "Write not permitted"),
        0x05: ("NotPermitted", "Not paired"),
        0x06: ("NotSupported", "Operation is not supported"),
        0x07: ("InvalidOffset", "Invalid offset"),
        0x0D: ("InvalidValueLength", "Invalid Length"),
        0x0F: ("NotPermitted", "Not paired"),
    }
    return known.get(code, ("Failed", f"Operation failed with ATT error: 0x{code:02x}"))


def advertised(data: AdvertisingData) -> tuple[str, list[str], Variant]:
    """Name, 128-bit service UUIDs and manufacturer data of an advertisement."""
    name = data.get(AdvertisingData.Type.COMPLETE_LOCAL_NAME) or ""
    uuids = data.get(AdvertisingData.Type.COMPLETE_LIST_OF_16_BIT_SERVICE_CLASS_UUIDS) or []
    manufacturer = data.get(AdvertisingData.Type.MANUFACTURER_SPECIFIC_DATA)
    by_company = {int(manufacturer[0]): Variant("ay", bytes(manufacturer[1]))} if manufacturer else {}
    return str(name), [uuid128(uuid) for uuid in uuids], Variant("a{qv}", by_company)


def passes(wanted: dict[str, Any], uuids: list[str], rssi: int) -> bool:
    """Whether a session with this discovery filter wants to know about the device."""
    if wanted.get("Transport") == "bredr":
        return False
    if rssi < wanted.get("RSSI", -128):
        return False
    asked = {uuid.lower() for uuid in wanted.get("UUIDs", [])}
    return not asked or bool(asked & set(uuids))


def device_properties(
    adapter: str, mac: str, name: str, uuids: list[str], rssi: int, manufacturer: Variant
) -> Properties:
    properties = {
        "Address": Variant("s", mac),
        "AddressType": Variant("s", "random"),
        "Alias": Variant("s", name or mac.replace(":", "-")),
        "Paired": Variant("b", False),
        "Bonded": Variant("b", False),
        "Trusted": Variant("b", False),
        "Blocked": Variant("b", False),
        "LegacyPairing": Variant("b", False),
        "Connected": Variant("b", False),
        "ServicesResolved": Variant("b", False),
        "UUIDs": Variant("as", uuids),
        "Adapter": Variant("o", adapter),
        "RSSI": Variant("n", rssi),
    }
    if name:
        properties["Name"] = Variant("s", name)
    if manufacturer.value:
        properties["ManufacturerData"] = manufacturer
    return properties


def adapter_properties(address: str, powered: bool) -> Properties:
    """What Adapter1 shows of the one adapter."""
    return {
        "Address": Variant("s", address),
        "AddressType": Variant("s", "public"),
        "Name": Variant("s", "sensor-bench"),
        "Alias": Variant("s", "sensor-bench"),
        "Class": Variant("u", 0),
        "Powered": Variant("b", powered),
        "Discoverable": Variant("b", False),
        "DiscoverableTimeout": Variant("u", 180),
        "Pairable": Variant("b", True),
        "PairableTimeout": Variant("u", 0),
        "Discovering": Variant("b", False),
        "UUIDs": Variant("as", []),
        "Roles": Variant("as", ["central"]),
    }
