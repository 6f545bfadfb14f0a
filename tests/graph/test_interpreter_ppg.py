"""interpreter-ppg as a process, fed by a driver that is not ours, on a private ROS domain."""

import os
import signal
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sense4hri import qos
from sense4hri_msgs.msg import PPG, PhysioDeviceFeature, PhysioFeature, PhysioRaw, PhysioRawChannel

FS_HZ, FRAME, PERIOD_S = 55.0, 36, 0.83
EPOCH_NS = 704_201_975_000_000_000
RECEIVED_NS = 1_650_886_777_000_000_000
CHANNELS = ("ppg_0", "ppg_1", "ppg_2", "ambient")
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-ppg" / "config" / "default.yaml"


def set_time(message: Any, ns: int) -> None:
    message.sec, message.nanosec = divmod(ns, 1_000_000_000)


def to_ns(message: Any) -> int:
    return message.sec * 1_000_000_000 + message.nanosec


class Sensor:
    """An optical sensor as sections 2 to 6 of the contract describe it: reflectance, so upside down."""

    def __init__(self, human_id: str, sensor_id: str) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(f"driver_other_{sensor_id}", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        for name, value in {
            "human_id": human_id,
            "sensor_id": sensor_id,
            **dict.fromkeys(("vendor", "model", "serial_number", "firmware_version", "body_location"), "other"),
            "transport_delay_s": 0.0,
            "ppg.sampling_frequency_hz": FS_HZ,
            "ppg.unit": "counts",
            "ppg.range_min": -8388608.0,
            "ppg.range_max": 8388607.0,
            "ppg.resolution_bits": 22,
            "ppg.channel_names": list(CHANNELS),
        }.items():
            self.node.declare_parameter(name, value)
        base = f"/humans/physiological/{human_id}/ppg/{sensor_id}/"
        self.sensor_id, self.sent = sensor_id, 0
        self.features: list[PPG] = []
        self.raw = self.node.create_publisher(PhysioRaw, base + "raw", qos.RAW)
        self.device = self.node.create_publisher(PhysioDeviceFeature, base + "device", qos.DEVICE)
        self.node.create_subscription(PPG, base + "features", self.features.append, qos.FEATURES)

    def until(self, true: Callable[[], Any], what: str, timeout_s: float = 30.0) -> None:
        """Spin until true() is; fail with `what` at the deadline."""
        deadline = time.monotonic() + timeout_s
        while not true():
            if time.monotonic() > deadline:
                pytest.fail(f"not within {timeout_s} s: {what}")
            self.executor.spin_once(timeout_sec=0.05)

    def heard(self) -> bool:
        return self.raw.get_subscription_count() > 0 and self.device.get_subscription_count() > 0

    def play(self, seconds: float) -> None:
        """Publish that many seconds of signal, each frame when the features of the ones before have come."""
        until = self.sent + seconds * FS_HZ
        while self.sent < until:
            self._frame()
            due = int((self.sent - 1) / FS_HZ)
            self.until(lambda due=due: len(self.features) >= due, f"{due} features")

    def _frame(self) -> None:
        times_s = np.arange(self.sent, self.sent + FRAME) / FS_HZ
        self.sent += FRAME
        last_ns = round(times_s[-1] * 1e9)
        phase = times_s % PERIOD_S
        wave = 3e5 - 4000 * (np.exp(-(((phase - 0.25) / 0.11) ** 2)) + 0.3 * np.exp(-(((phase - 0.52) / 0.15) ** 2)))
        noise = np.random.default_rng(self.sent).normal(0, 4000, (2, FRAME))
        message = PhysioRaw()
        message.header.frame_id = self.sensor_id
        set_time(message.header.stamp, RECEIVED_NS + last_ns + 20_000_000)
        set_time(message.device_timestamp, EPOCH_NS + last_ns)
        samples = (3e5 + noise[0], wave, 3e5 + noise[1], np.full(FRAME, -600.0))
        message.channels = [
            PhysioRawChannel(channel_name=name, samples=array("d", values))
            for name, values in zip(CHANNELS, samples, strict=True)
        ]
        self.raw.publish(message)
        report = PhysioDeviceFeature()
        report.header = message.header
        report.features = [PhysioFeature(name="heart_rate", unit="1/min", values=array("d", [70.0]))]
        self.device.publish(report)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def start(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """start(*arguments) runs the service; its log is log.txt."""
    running: list[subprocess.Popen[bytes]] = []

    def begin(*arguments: str) -> subprocess.Popen[bytes]:
        with (tmp_path / "log.txt").open("wb") as log:
            command = [sys.executable, "-m", "interpreter_ppg", *arguments]
            running.append(subprocess.Popen(command, stderr=log, stdout=log, env=dict(os.environ)))
        return running[-1]

    yield begin
    for process in running:
        if process.poll() is None:
            process.kill()
            process.wait()


@pytest.fixture
def sensors(ros_domain: int) -> Iterator[list[Sensor]]:
    both = [Sensor("p1", "band_1"), Sensor("p2", "band_2")]
    yield both
    for sensor in both:
        sensor.close()


def test_features_of_every_sensor_on_the_graph(start, sensors):
    """One process without parameters serves two participants: pulses at their times, rate, channel, difference."""
    process = start()
    for sensor in sensors:
        sensor.until(sensor.heard, "the service subscribes to raw and device")
    for sensor in sensors:
        sensor.play(45)
    for sensor in sensors:
        last = sensor.features[-1]
        assert last.header.frame_id == sensor.sensor_id
        assert to_ns(last.header.stamp) - RECEIVED_NS - 20_000_000 >= to_ns(last.device_timestamp) - EPOCH_NS
        assert last.window_s == 10.0
        assert last.channel_name == "ppg_1"
        assert last.heart_rate_bpm == pytest.approx(60 / PERIOD_S, abs=0.1)
        assert last.device_heart_rate_difference_bpm == pytest.approx(60 / PERIOD_S - 70, abs=0.1)
        assert last.signal_quality > 0.95
        assert last.pulse_amplitude == pytest.approx(4000, rel=0.1)
        assert last.hrv.rmssd_ms < 3
        assert np.isnan(last.hrv.sdnn_ms)
        times_s = np.array([to_ns(t) - EPOCH_NS for message in sensor.features for t in message.peak_timestamps]) / 1e9
        rr_ms = np.concatenate([message.rr_intervals_ms for message in sensor.features])
        assert len(times_s) == len(rr_ms) > 48
        np.testing.assert_allclose(np.diff(times_s)[5:], PERIOD_S, atol=0.005)
        rise_s = 0.25 - 0.11 / np.sqrt(2)
        np.testing.assert_allclose((times_s % PERIOD_S)[5:], rise_s, atol=0.02)
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == 0


def test_the_defaults_file_and_a_wrong_parameter(start, sensors, tmp_path):
    """The shipped file starts the service; a parameter out of range ends it with 78 and one line that names it."""
    process = start("--ros-args", "--params-file", str(DEFAULTS))
    sensors[0].until(sensors[0].heard, "the service subscribes")
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == 0
    wrong = start("--ros-args", "-p", "polarity:=sideways")
    assert wrong.wait(20) == 78
    assert "polarity" in (tmp_path / "log.txt").read_text()
