"""The device's life against a link without Bluetooth."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager

import pytest
from driver_ble_heart_rate import device
from driver_ble_heart_rate.config import Config
from driver_ble_heart_rate.device import CONTINUOUS, SPOT_CHECK, Device
from sense4hri import gatt
from sense4hri.device import Identity, Noted, Reported, Status
from sense4hri.errors import ConfigError, DeviceLost, FrameError


class FakeStrap:
    """Radio and link in one; `sends` are notified as soon as something subscribes to them, unless it is `refused`."""

    name, rssi_dbm, mtu = "HRM 1", -50.0, 23

    def __init__(self, values: dict[str, bytes], sends: dict[str, list[bytes]], refused: Collection[str] = ()) -> None:
        self.values, self.sends, self.refused = values, sends, refused
        self.on_lost: Callable[[str], None]

    @asynccontextmanager
    async def connect(self, on_lost: Callable[[str], None]) -> AsyncIterator["FakeStrap"]:
        self.on_lost = on_lost
        yield self

    async def read(self, characteristic: str) -> bytes | None:
        return self.values.get(characteristic)

    async def write(self, characteristic: str, value: bytes, acknowledged: bool = True) -> None:
        raise AssertionError("nothing is written to such a device")

    async def subscribe(self, characteristic: str, receive: Callable[[bytes], None]) -> bool:
        if characteristic in self.refused:
            raise gatt.Refused(f"subscribing to {characteristic}: refused, Not paired")
        for value in self.sends.get(characteristic, []):
            receive(value)
        return characteristic in self.sends


def items_of(strap: FakeStrap, breaks_s: float = 0.05, **config) -> list:
    """What the device yields before it is lost, and the error it ends with."""
    found = []

    async def run() -> None:
        asyncio.get_running_loop().call_later(breaks_s, lambda: strap.on_lost("the link broke"))
        try:
            async for item in Device(Config(sensor_id="it_1", name="HRM 1", **config), strap).stream():
                found.append(item)  # noqa: PERF401 - what came before an error counts
        except (DeviceLost, ConfigError) as err:
            found.append(err)

    asyncio.run(asyncio.wait_for(run(), 20))
    return found


def test_a_strap_from_identity_to_the_end_of_its_link():
    """What it says of itself, its battery, reports under ecg, a bad value as the error, then the loss."""
    values = {gatt.SERIAL_NUMBER: b"77\0", gatt.BODY_LOCATION: b"\x01", gatt.BATTERY: b"\x42"}
    found = items_of(
        FakeStrap(values, {gatt.HEART_RATE: [bytes.fromhex("163c0004"), b"\x10"], gatt.BATTERY: [b"\x41"]})
    )
    assert Identity(None, None, "77", None, "chest") in found
    assert [each.battery_percent for each in found if isinstance(each, Status) and each.battery_percent] == [66.0, 65.0]
    (report,) = [each for each in found if isinstance(each, Reported)]
    assert report.sensor_type == "ecg"
    assert {each.name: each.values for each in report.features} == {
        "heart_rate": (60.0,), "rr_interval": (1000.0,), "contact": (1.0,),
    }  # fmt: skip
    assert [type(each) for each in found[-2:]] == [FrameError, DeviceLost]


def test_an_interval_of_zero_is_none():
    """Of two intervals the one of 0 ms is left out; where there is no other there is no feature."""
    found = items_of(FakeStrap({}, {gatt.HEART_RATE: [bytes.fromhex("103c00000004"), bytes.fromhex("103c0000")]}))
    told = [{each.name: each.values for each in item.features} for item in found if isinstance(item, Reported)]
    assert told == [{"heart_rate": (60.0,), "rr_interval": (1000.0,)}, {"heart_rate": (60.0,)}]


def test_a_report_that_knows_nothing_is_a_report():
    """A watch off the wrist that tells no contact sends a rate of 0 alone: the link streams, the rate is NaN."""
    found = items_of(FakeStrap({}, {gatt.HEART_RATE: [b"\x00\x00"]}), kind="watch")
    ((feature,),) = [each.features for each in found if isinstance(each, Reported)]
    assert feature[:2] == ("heart_rate", "1/min")
    assert math.isnan(feature.values[0])


def test_a_watch_is_an_optical_sensor():
    """Its reports stand under ppg."""
    found = items_of(FakeStrap({}, {gatt.HEART_RATE: [b"\x00\x40"]}), kind="watch")
    assert [each.sensor_type for each in found if isinstance(each, Reported)] == ["ppg"]


def test_an_oximeter_for_spot_checks_alone_may_be_silent(monkeypatch):
    """It waits for a finger for ever; a continuous one that is silent is lost, and says of what."""
    monkeypatch.setattr(device, "SILENCE_S", 0.02)
    (*_, lost) = items_of(FakeStrap({}, {SPOT_CHECK: []}), kind="oximeter")
    assert str(lost) == "the link broke"
    (*_, lost) = items_of(FakeStrap({}, {CONTINUOUS: []}), 3600.0, kind="oximeter")
    assert "connected, but no" in str(lost)


def test_an_oximeter_that_wants_to_be_paired_for_spot_checks_streams_without_them():
    """One of its two measurements is refused: the other comes, and it is said. Where both are, the device is lost."""
    sends = {CONTINUOUS: [bytes.fromhex("0062004000")], SPOT_CHECK: []}
    found = items_of(FakeStrap({}, sends, refused=[SPOT_CHECK]), kind="oximeter")
    assert [each.features[0].values for each in found if isinstance(each, Reported)] == [(98.0,)]
    assert Noted(f"subscribing to {SPOT_CHECK}: refused, Not paired") in found
    assert str(found[-1]) == "the link broke"
    (*_, lost) = items_of(FakeStrap({}, sends, refused=[SPOT_CHECK, CONTINUOUS]), kind="oximeter")
    assert type(lost) is gatt.Refused
    assert str(lost) == f"subscribing to {CONTINUOUS}: refused, Not paired"


def test_a_device_of_another_kind_is_a_mistake_of_the_configuration():
    """An oximeter that has no oximeter service cannot be waited for."""
    (*_, error) = items_of(FakeStrap({}, {gatt.HEART_RATE: []}), kind="oximeter")
    assert isinstance(error, ConfigError)
    assert "kind oximeter: HRM 1 has none of" in str(error)


@pytest.mark.parametrize("sought", ["HRM-Dual 1234", "hrm-dual 1234", "1234"])
def test_a_sensor_is_found_by_its_name_or_the_id_at_its_end(sought):
    """The id printed on the sensor is enough; part of a word is not."""
    assert Config(sensor_id="it_1", name=sought).is_meant("AA:BB", "HRM-Dual 1234")
    assert not Config(sensor_id="it_1", name="234").is_meant("AA:BB", "HRM-Dual 1234")
