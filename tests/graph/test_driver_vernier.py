"""driver-vernier as a real process, through unmodified bleak and a real D-Bus, against sensor-bench."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from processes import Process, poll
from rcl_interfaces.srv import GetParameters
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw, StreamHealth
from sensor_bench_process import BenchProcess

DEVICES = """
participants: {p1: {respiration_hz: 0.25}}
devices:
  - {sensor: belt_1, model: GDX-RB, participant: p1, address: "F1:4A:30:00:00:01", device_id: 0K1002A1,
     battery_percent: 77}
"""
BELT = {"sensor_id": "belt_1", "human_id": "p1", "name": "0K1002A1", "respiration.sampling_frequency_hz": 20.0}
NAME = StreamName("p1", "respiration", "belt_1")


@pytest.fixture
def drive(bench: BenchProcess, start: Callable[..., Process]) -> Callable[..., Process]:
    def begin(parameters: dict[str, Any]) -> Process:
        return start("driver_vernier", env={"DBUS_SYSTEM_BUS_ADDRESS": bench.address}, **parameters)

    return begin


def test_a_belt_is_asked_started_counted_and_stopped(drive, ears, bench) -> None:
    """Force at the wanted rate, the belt's own rate, exact loss, odd bytes told, a new link, silence after SIGTERM."""
    raw = ears.hear(PhysioRaw, NAME.topic("raw"), qos.RAW)
    device = ears.hear(PhysioDeviceFeature, NAME.topic("device"), qos.DEVICE)
    health = ears.hear(StreamHealth, NAME.topic("health"), qos.HEALTH)
    driver = drive(BELT)
    ears.until(lambda: len(raw) >= 30 and device, "force and rate")
    assert [feature.name for feature in device[0].features] == ["respiration_rate"]
    assert device[0].features[0].values[0] == 15.0
    assert {channel.channel_name for message in raw for channel in message.channels} == {"respiration"}
    force = np.array([value for message in raw for value in message.channels[0].samples])
    assert 7.0 < force.min() < force.max() < 13.0
    assert all(to_ns(message.device_timestamp) == 0 for message in raw)
    spans_s = np.diff([to_ns(message.header.stamp) for message in raw]) * 1e-9
    assert spans_s.mean() == pytest.approx(0.1, rel=0.1)
    asked = GetParameters.Request(names=["serial_number", "model", "firmware_version", "vendor"])
    told = ears.ask(GetParameters, "/driver_vernier_belt_1/get_parameters", asked).values
    assert [each.string_value for each in told] == ["0K1002A1", "GDX-RB", "1.7", "Vernier"]
    ears.until(lambda: health and health[-1].battery_percent == 77.0, "its battery")
    assert health[-1].lost_samples_total == 0

    bench.knobs("belt_1", loss=0.3)
    poll(lambda: bench.truth("belt_1")["streams"]["respiration"]["samples_lost"] >= 10, "samples are lost")
    bench.knobs("belt_1", loss=0.0)
    lost = bench.truth("belt_1")["streams"]["respiration"]["samples_lost"]
    ears.until(lambda: health[-1].lost_samples_total == lost, "each lost sample is counted")
    bench.knobs("belt_1", garbled_frames=1)
    ears.until(lambda: health[-1].lost_samples_total == lost + 2, "a garbled frame is lost, and told")
    assert health[-1].extra[0].name == "undecodable_frames_total"
    assert health[-1].extra[0].values[0] >= 1.0

    before = len(raw)
    bench.knobs("belt_1", drop=True)
    ears.until(lambda: health[-1].reconnects_total == 1 and len(raw) > before + 5, "it is back")
    assert health[-1].lost_samples_total == lost + 2
    assert driver.stop_within() == 0, driver.log()
    poll(lambda: not bench.device("belt_1")["connected"], "the link is closed")
    assert not any(math.isnan(value) for message in device for each in message.features for value in each.values)
