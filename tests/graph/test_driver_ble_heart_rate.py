"""driver-ble-heart-rate as a real process, through unmodified bleak and a real D-Bus, against sensor-bench."""

import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from processes import Process
from rcl_interfaces.srv import GetParameters
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import PhysioDeviceFeature, StreamHealth
from sensor_bench_process import BenchProcess

DEVICES = """
participants: {p1: {}}
devices:
  - {sensor: strap_1, model: HeartRateStrap, participant: p1, address: "F1:4A:20:00:00:01", name: HRM-Dual 1234,
     rssi_dbm: -57, battery_percent: 66}
  - {sensor: finger_1, model: PulseOximeter, participant: p1, address: "F1:4A:20:00:00:02", name: Nonin 99}
"""
STRAP = {"sensor_id": "strap_1", "human_id": "p1", "kind": "strap", "name": "HRM-Dual 1234"}
OXIMETER = {"sensor_id": "finger_1", "human_id": "p1", "kind": "oximeter", "address": "F1:4A:20:00:00:02"}
COUNT_MS = 1000 / 1024


@pytest.fixture
def drive(bench: BenchProcess, start: Callable[..., Process]) -> Callable[..., Process]:
    def begin(parameters: dict[str, Any]) -> Process:
        return start("driver_ble_heart_rate", env={"DBUS_SYSTEM_BUS_ADDRESS": bench.address}, **parameters)

    return begin


def name(parameters: dict[str, Any], sensor_type: str) -> StreamName:
    return StreamName(parameters["human_id"], sensor_type, parameters["sensor_id"])


def values(messages: list[PhysioDeviceFeature], feature: str) -> list[float]:
    return [value for message in messages for each in message.features if each.name == feature for value in each.values]


def test_a_strap_tells_the_beats_of_its_wearer(drive, ears, bench) -> None:
    """RR intervals are the heart's to a 1024th of a second; it streams from its first report; faults are told."""
    device = ears.hear(PhysioDeviceFeature, name(STRAP, "ecg").topic("device"), qos.DEVICE)
    health = ears.hear(StreamHealth, name(STRAP, "ecg").topic("health"), qos.HEALTH)
    begun_ns = time.time_ns()
    driver = drive(STRAP)
    ears.until(lambda: len(values(device, "rr_interval")) >= 4, "intervals")
    ears.until(lambda: health and health[-1].state == StreamHealth.STREAMING, "it streams")
    beats_ns = bench.truth("strap_1")["beats_host_ns"]
    true_ms = [(after - before) * 1e-6 for before, after in pairwise(beats_ns)]
    told_ms = values(device, "rr_interval")[:4]
    assert told_ms == [round(ms / COUNT_MS) * COUNT_MS for ms in told_ms]
    places = [at for at in range(len(true_ms)) if true_ms[at : at + 4] == pytest.approx(told_ms, abs=COUNT_MS)]
    assert len(places) == 1, (told_ms, true_ms)
    assert set(values(device, "contact")) == {1.0}
    assert all(to_ns(message.device_timestamp) == 0 for message in device)
    assert all(begun_ns < to_ns(message.header.stamp) <= time.time_ns() for message in device)
    assert (health[-1].battery_percent, health[-1].rssi_dbm, health[-1].contact) == (66.0, -57.0, 1.0)
    asked = GetParameters.Request(names=["serial_number", "model", "body_location"])
    told = ears.ask(GetParameters, "/driver_ble_heart_rate_strap_1/get_parameters", asked).values
    assert [each.string_value for each in told] == ["000001", "HeartRateStrap", "chest"]

    bench.knobs("strap_1", contact=False, garbled_frames=1)
    ears.until(lambda: health[-1].contact == 0.0, "off the skin is told")
    undecodable = lambda: {each.name: each.values for each in health[-1].extra}  # noqa: E731
    ears.until(lambda: list(undecodable().get("undecodable_frames_total", [0.0])) == [1.0], "the odd bytes are counted")
    bench.knobs("strap_1", contact=True, drop=True)
    ears.until(lambda: health[-1].reconnects_total == 1 and health[-1].state == StreamHealth.STREAMING, "it is back")
    assert driver.stop_within() == 0, driver.log()
    assert not bench.device("strap_1")["connected"]


def test_a_strap_that_is_not_there_is_seen(drive, ears, bench) -> None:
    """Its health comes each second from the start, CONNECTING; nothing was reported yet."""
    absent = STRAP | {"sensor_id": "strap_2", "name": "HRM-Dual 9999"}
    health = ears.hear(StreamHealth, name(absent, "ecg").topic("health"), qos.HEALTH)
    driver = drive(absent)
    ears.until(lambda: [each.state for each in health][-2:] == [StreamHealth.CONNECTING] * 2, "its health")
    assert driver.stop_within() == 0, driver.log()


def test_an_oximeter_tells_saturation_and_what_is_wrong(drive, ears, bench) -> None:
    """Values with a decimal, NaN with why off the finger, a spot check with its own date and time."""
    device = ears.hear(PhysioDeviceFeature, name(OXIMETER, "ppg").topic("device"), qos.DEVICE)
    drive(OXIMETER)
    ears.until(lambda: [value for value in values(device, "spo2") if value == 97.4], "saturation")
    assert values(device, "spo2_fast")[-1] == values(device, "spo2")[-1]
    bench.knobs("finger_1", spot_check=True)
    ears.until(lambda: any(to_ns(each.device_timestamp) for each in device), "the spot check")
    spot = next(each for each in device if to_ns(each.device_timestamp))
    assert abs(to_ns(spot.device_timestamp) - to_ns(spot.header.stamp)) < 5e9
    assert values([spot], "fully_qualified") == [1.0]
    bench.knobs("finger_1", contact=False)
    ears.until(lambda: values(device, "sensor_not_on_user"), "off the finger")
    last = device[-1:]
    assert values(last, "spo2") != values(last, "spo2")
    assert values(last, "spo2_not_a_number") == values(last, "measurement_unavailable") == [1.0]
    assert values(last, "contact") == [0.0]
