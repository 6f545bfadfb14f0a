"""What Bluetooth LE devices of all makers have in common: how they are found, said to be, and their standard values.

Pure: a `Link` and a `Radio` are what a device's code needs of a connection; `bluetooth_le` makes them of bleak, tests
have their own. Layouts: Bluetooth SIG, Heart Rate Service 1.0, Device Information 1.1, Battery Service 1.0.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from sense4hri.device import DriverConfig, Feature, Identity, Item, Reported, Status
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.schema import parameter

_ADDRESS = r"[0-9A-Fa-f]{2}(:[0-9A-Fa-f]{2}){5}|[0-9A-Fa-f]{8}(-[0-9A-Fa-f]{4}){3}-[0-9A-Fa-f]{12}"  # macOS: a UUID


def standard(short: str) -> str:
    """Return the whole UUID of a number that the Bluetooth SIG has given, as in `2a37`."""
    return f"0000{short}-0000-1000-8000-00805f9b34fb"


HEART_RATE, BODY_LOCATION, BATTERY = standard("2a37"), standard("2a38"), standard("2a19")
VENDOR, MODEL, SERIAL_NUMBER, FIRMWARE = (standard(short) for short in ("2a29", "2a24", "2a25", "2a26"))
BODY_LOCATIONS = ("other", "chest", "wrist", "finger", "hand", "ear lobe", "foot")
WIDE, CONTACT, CONTACT_SUPPORTED, ENERGY, INTERVALS = 0x01, 0x02, 0x04, 0x08, 0x10


@dataclass(frozen=True, kw_only=True)
class BluetoothConfig(DriverConfig):
    """Parameters of every driver over Bluetooth LE: which device it is."""

    address: str = parameter(
        "",
        help="Bluetooth address; this or `name` must be given",
        matches=f"|{_ADDRESS}",
        form="six pairs of hexadecimal digits, as in A0:9E:1A:00:00:00",
    )
    name: str = parameter("", help="advertised name, or the id at its end as printed on the sensor")
    adapter: str = parameter("", help="Bluetooth adapter, e.g. hci1; empty = the first powered one")
    scan_timeout_s: float = parameter(
        10.0, help="how long to look for the sensor before a new try", unit="s", low=0.1, high=300
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.address) == bool(self.name):
            raise ValueError("address or name: give one of the two, so that the driver knows its sensor")

    def is_meant(self, address: str, name: str) -> bool:
        """True for the device with this address and advertised name."""
        if self.address:
            return address.lower() == self.address.lower()
        return self.name.lower() in (name.lower(), *name.lower().split()[-1:])


class Refused(DeviceLost):
    """The device refuses one characteristic while the link stands: who cannot do without it has lost the device."""


class Link(Protocol):
    """One open connection. Every method raises DeviceLost when the link fails."""

    name: str
    rssi_dbm: float | None
    """When the device was found; a connected device does not advertise."""
    mtu: int
    """Of ATT, bytes."""

    async def read(self, characteristic: str) -> bytes | None:
        """Return the value, None where the device has no such characteristic. Raises Refused."""

    async def write(self, characteristic: str, value: bytes, acknowledged: bool = True) -> None:
        """Write; wait for the acknowledgement where there is to be one."""

    async def subscribe(self, characteristic: str, receive: Callable[[bytes], None]) -> bool:
        """Hand every notification or indication to receive; False where there is none such. Raises Refused."""


class Radio(Protocol):
    """Finds and connects the one sensor of a driver."""

    def connect(self, on_lost: Callable[[str], None]) -> AbstractAsyncContextManager[Link]:
        """Connect for the length of the context. on_lost(reason) is called when the link breaks.

        Raises DeviceLost that says why: no Bluetooth, sensor not found, in use by another driver.
        """


class HeartRate(NamedTuple):
    """One Heart Rate Measurement (0x2A37), about once a second; the characteristic carries no device time.

    bpm: 0 while the device knows no rate. contact: None where the device cannot tell. energy_kj: None where not sent.
    rr_ms: oldest first, any number of them, not rounded (the device counts in 1/1024 s).
    """

    bpm: int
    contact: bool | None
    energy_kj: int | None
    rr_ms: tuple[float, ...]


def decode_heart_rate(value: bytes) -> HeartRate:
    """Return the measurement; raise FrameError where the fields the flags announce do not fill the value exactly."""
    flags = value[0] if value else 0
    head = 1 + (2 if flags & WIDE else 1) + (2 if flags & ENERGY else 0)
    rest = len(value) - head
    if rest < 0 or rest % 2 or (rest and not flags & INTERVALS):
        raise FrameError(f"heart rate measurement of {len(value)} bytes does not fit its flags ({value.hex()})")
    wide = 3 if flags & WIDE else 2
    return HeartRate(
        bpm=int.from_bytes(value[1:wide], "little"),
        contact=bool(flags & CONTACT) if flags & CONTACT_SUPPORTED else None,
        energy_kj=int.from_bytes(value[wide:head], "little") if flags & ENERGY else None,
        rr_ms=tuple(int.from_bytes(value[at : at + 2], "little") * 1000 / 1024 for at in range(head, len(value), 2)),
    )


def heart_rate_items(measured: HeartRate, sensor_type: str, received_ns: int) -> Iterator[Item]:
    """Report rate and RR intervals; they carry no device time; a rate or an interval of 0 is none and left out.

    A report of which nothing is left, as of a watch off the wrist, is one all the same: its rate is NaN.
    """
    features = []
    if measured.bpm:
        features.append(feature("heart_rate", "1/min", measured.bpm))
    if intervals_ms := [each for each in measured.rr_ms if each]:
        features.append(feature("rr_interval", "ms", *intervals_ms))
    if measured.energy_kj is not None:
        features.append(feature("energy_expended", "kJ", measured.energy_kj))
    if measured.contact is not None:
        features.append(feature("contact", "1", measured.contact))
        yield Status(contact=float(measured.contact))
    yield Reported(sensor_type, received_ns, None, tuple(features or [feature("heart_rate", "1/min", math.nan)]))


def feature(name: str, unit: str, *values: float) -> Feature:
    """Return a value, or several, that the device computed itself."""
    return Feature(name, unit, tuple(float(value) for value in values))


def battery_status(value: bytes) -> Status:
    """Return the charge in a Battery Level (0x2A19). Raises FrameError."""
    if len(value) != 1 or value[0] > 100:
        raise FrameError(f"battery level {value.hex()!r} is no percentage in one byte")
    return Status(battery_percent=float(value[0]))


async def battery_of(link: Link) -> Status | FrameError:
    """Read the charge: no news where the device does not say, and where it says nonsense the error that tells."""
    value = await _said(link, BATTERY)
    try:
        return Status() if value is None else battery_status(value)
    except FrameError as err:
        return err


async def subscribe_to_battery(link: Link, receive: Callable[[bytes], None]) -> None:
    """Have receive told of every change of the charge, where the device does that."""
    with suppress(Refused):
        await link.subscribe(BATTERY, receive)


async def identity_of(link: Link) -> Identity:
    """Read what the device says of itself: vendor, model, serial number, firmware, where it is worn."""
    vendor, model, serial_number, firmware = [
        text(await _said(link, each)) for each in (VENDOR, MODEL, SERIAL_NUMBER, FIRMWARE)
    ]
    where = await _said(link, BODY_LOCATION)
    location = BODY_LOCATIONS[where[0]] if where and where[0] < len(BODY_LOCATIONS) else None
    return Identity(vendor, model, serial_number, firmware, location)


async def _said(link: Link, characteristic: str) -> bytes | None:
    """Return a value that a device may keep to itself, as until it is paired: None where it has none or refuses it."""
    try:
        return await link.read(characteristic)
    except Refused:
        return None


def text(value: bytes | None) -> str | None:
    """Return a characteristic as text, None where there is none in it."""
    return (value or b"").decode("utf-8", "replace").strip("\0 ") or None
