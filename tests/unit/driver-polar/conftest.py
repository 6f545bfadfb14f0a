"""A small virtual Polar sensor without Bluetooth, D-Bus or ROS: it answers commands and logs them."""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest
from driver_polar.session import PMD_CONTROL, PMD_DATA
from sense4hri import gatt
from sense4hri.errors import DeviceLost

SDK_MODE = 9
H10_SETTINGS = {
    0x00: bytes.fromhex("00018200 01010e00"),
    0x02: bytes.fromhex("0004190032006400c800 01011000 0203020004000800"),
}
VERITY_SETTINGS = {
    0x01: bytes.fromhex("00013700 01011600 040104"),
    0x02: bytes.fromhex("00013400 01011000 02010800 040103"),
    0x05: bytes.fromhex("00013400 01011000 0201d007 040103"),
    0x06: bytes.fromhex("00040a00140032006400 01011000 02013200 040103"),
}
VERITY_SDK_SETTINGS = {
    0x01: bytes.fromhex("00051c002c0037008700b000 01011600 040104"),
    0x02: bytes.fromhex("00051a0034006800d000a001 01011000 02040200040008001000 040103"),
}


class FakeLink:
    """One connection to the fake sensor."""

    def __init__(self, sensor: "FakeSensor", on_lost: Callable[[str], None]) -> None:
        self.name, self.rssi_dbm, self.mtu = sensor.name, -61.0, sensor.mtu
        self._sensor, self._on_lost = sensor, on_lost
        self.receivers: dict[str, Callable[[bytes], None]] = {}
        self.open = True

    async def read(self, characteristic: str) -> bytes | None:
        self._check()
        return self._sensor.values.get(characteristic)

    async def write(self, characteristic: str, value: bytes, acknowledged: bool = True) -> None:
        self._check()
        assert characteristic == PMD_CONTROL
        self._sensor.log.append(value.hex())
        for answer in self._sensor.answers(value):
            asyncio.get_running_loop().call_soon(self.receivers[PMD_CONTROL], answer)

    async def subscribe(self, characteristic: str, receive: Callable[[bytes], None]) -> bool:
        self._check()
        if characteristic in self._sensor.missing:
            return False
        self.receivers[characteristic] = receive
        return True

    def data(self, *frames: bytes) -> None:
        """Notify measurement data."""
        for frame in frames:
            self.receivers[PMD_DATA](frame)

    def drop(self) -> None:
        """The link breaks."""
        self.open = False
        self._on_lost("the link broke")

    def _check(self) -> None:
        if not self.open:
            raise DeviceLost("not connected")


class FakeSensor:
    """Also its own radio. What the driver commanded is in `log`, a disconnection too.

    refuse: statuses that the next commands beginning with these two bytes get. silent: commands never answered.
    """

    def __init__(self, name: str, features: str, settings: dict[int, bytes], start_answers: dict[int, bytes]) -> None:
        self.name, self.settings, self.mtu = name, dict(settings), 232
        self.sdk_settings: dict[int, bytes] = {}
        self.start_answers = start_answers
        self.values = {
            PMD_CONTROL: bytes.fromhex(features) + bytes(14),
            gatt.BATTERY: bytes([73]),
            gatt.BODY_LOCATION: bytes([1]),
            gatt.VENDOR: b"Polar Electro Oy",
            gatt.SERIAL_NUMBER: name.split()[-1].encode() + b"\0",
        }
        self.missing: set[str] = set()
        self.refuse: dict[str, list[int]] = {}
        self.silent: set[str] = set()
        self.odd_answers: dict[str, bytes] = {}
        self.page_bytes = 200
        self.log: list[str] = []
        self.running: set[int] = set()
        self.links: list[FakeLink] = []

    @asynccontextmanager
    async def connect(self, on_lost: Callable[[str], None]) -> AsyncIterator[FakeLink]:
        self.links.append(FakeLink(self, on_lost))
        try:
            yield self.links[-1]
        finally:
            self.log.append("disconnected")

    @property
    def link(self) -> FakeLink:
        return self.links[-1]

    def answers(self, command: bytes) -> list[bytes]:
        """What the control point indicates after a command."""
        key, op, kind = command[:2].hex(), command[0], command[1]
        if key in self.silent:
            return []
        if key in self.odd_answers:
            return [self.odd_answers[key]]
        if refusals := self.refuse.get(key):
            return [bytes([0xF0, op, kind, refusals.pop(0), 0])]
        if op in (1, 4):
            whole = (self.sdk_settings if op == 4 else self.settings)[kind]
            pages = [whole[at : at + self.page_bytes] for at in range(0, len(whole), self.page_bytes)]
            return [bytes([0xF0, op, kind, 0, page is not pages[-1]]) + page for page in pages]
        if kind == SDK_MODE and self.running - {SDK_MODE}:  # not while anything streams
            return [bytes([0xF0, op, kind, 12, 0])]
        was_running = kind in self.running
        if op == 2:
            self.running.add(kind)
            return [bytes([0xF0, op, kind, 6 if was_running else 0, 0]) + self.start_answers.get(kind, b"")]
        assert op == 3, f"the driver sent {command.hex()}"
        self.running.discard(kind)
        return [bytes([0xF0, op, kind, 0 if was_running else 6, 0])]


@pytest.fixture
def h10() -> FakeSensor:
    """A chest strap."""
    return FakeSensor("Polar H10 B5E3A222", "0f0500", H10_SETTINGS, {0x00: b"\x00", 0x02: b"\x01"})


@pytest.fixture
def verity() -> FakeSensor:
    """An optical arm band with SDK mode."""
    factors = {0x02: bytes.fromhex("050140da7f39"), 0x05: bytes.fromhex("0501") + struct.pack("<f", 0.0625)}
    sensor = FakeSensor("Polar Sense 9E123456", "0f6e02", VERITY_SETTINGS, factors)
    sensor.sdk_settings = VERITY_SDK_SETTINGS
    return sensor
