"""interpreter-ecg as a process, fed by drivers that are not ours, on a private ROS domain."""

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
from sense4hri_msgs.msg import ECG, PhysioDeviceFeature, PhysioFeature, PhysioRaw, PhysioRawChannel

FS_HZ, FRAME, PERIOD_S = 130.0, 73, 0.75
EPOCH_NS = 599_616_000_000_000_000
RECEIVED_NS = 1_700_000_000_000_000_000
DEFAULTS = Path(__file__).resolve().parents[2] / "services" / "interpreter-ecg" / "config" / "default.yaml"


def set_time(message: Any, ns: int) -> None:
    message.sec, message.nanosec = divmod(ns, 1_000_000_000)


def to_ns(message: Any) -> int:
    return message.sec * 1_000_000_000 + message.nanosec


class Strap:
    """A chest strap as sections 2 to 6 of the contract describe it; its R peaks are at k * PERIOD_S + 0.5 s."""

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
            "ecg.sampling_frequency_hz": FS_HZ,
            "ecg.unit": "uV",
            "ecg.range_min": -20000.0,
            "ecg.range_max": 20000.0,
            "ecg.resolution_bits": 14,
            "ecg.channel_names": ["ecg"],
        }.items():
            self.node.declare_parameter(name, value)
        self.sensor_id, self.sent = sensor_id, 0
        self.wear(human_id)

    def wear(self, human_id: str) -> None:
        """Publish under this name from now on, as a driver does when its human_id is set."""
        if hasattr(self, "raw"):
            for publisher in (self.raw, self.device):
                self.node.destroy_publisher(publisher)
            self.node.destroy_subscription(self.subscription)
        base = f"/humans/physiological/{human_id}/ecg/{self.sensor_id}/"
        features: list[ECG] = []
        self.features = features
        self.raw = self.node.create_publisher(PhysioRaw, base + "raw", qos.RAW)
        self.device = self.node.create_publisher(PhysioDeviceFeature, base + "device", qos.DEVICE)
        self.subscription = self.node.create_subscription(ECG, base + "features", features.append, qos.FEATURES)

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
        """Publish that many seconds of signal, waiting for the features so that no queue overflows."""
        before, first = len(self.features), self.sent
        while self.sent < first + seconds * FS_HZ:
            self._frame()
            due = int((self.sent - first - 2) / FS_HZ)
            self.until(lambda due=due: len(self.features) - before >= due, f"update {due} of {self.sensor_id}")

    def _frame(self) -> None:
        t_s = (self.sent + np.arange(FRAME)) / FS_HZ
        phase_s = (t_s - 0.5 + PERIOD_S / 2) % PERIOD_S - PERIOD_S / 2
        ecg = 1000 * np.exp(-0.5 * (phase_s / 0.012) ** 2) + 200 * np.exp(-0.5 * ((phase_s - 0.25) / 0.05) ** 2)
        self.sent += FRAME
        last_ns = round((self.sent - 1) / FS_HZ * 1e9)
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=array("d", ecg.tobytes()))])
        message.header.frame_id = self.sensor_id
        set_time(message.header.stamp, RECEIVED_NS + last_ns)
        set_time(message.device_timestamp, EPOCH_NS + last_ns)
        self.raw.publish(message)

    def report(self, rate: float) -> None:
        """Publish a heart rate of the device's own, received with the newest frame."""
        message = PhysioDeviceFeature(features=[PhysioFeature(name="heart_rate", unit="1/min", values=[rate])])
        set_time(message.header.stamp, RECEIVED_NS + round((self.sent - 1) / FS_HZ * 1e9))
        self.device.publish(message)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def strap(ros_domain: int) -> Iterator[Callable[[str, str], Strap]]:
    """Makes straps; closes them after the test."""
    straps: list[Strap] = []

    def make(human_id: str, sensor_id: str) -> Strap:
        straps.append(Strap(human_id, sensor_id))
        return straps[-1]

    yield make
    for each in straps:
        each.close()


@pytest.fixture
def service(ros_domain: int) -> Iterator[subprocess.Popen[bytes]]:
    """The service with its default parameters."""
    arguments = [sys.executable, "-m", "interpreter_ecg", "--ros-args", "--params-file", str(DEFAULTS)]
    process = subprocess.Popen(arguments, env=dict(os.environ))
    yield process
    if process.poll() is None:
        process.kill()
        process.wait()


def test_features_of_a_foreign_strap(service: subprocess.Popen[bytes], strap: Callable[[str, str], Strap]) -> None:
    """A driver in nobody's books gets its beats, rate, variability and difference, and the service ends cleanly."""
    worn = strap("p1", "bar_1")
    worn.until(worn.heard, "the service subscribes")
    worn.play(25)
    worn.report(82.0)
    worn.play(12)
    last = worn.features[-1]
    assert last.header.frame_id == "bar_1"
    assert to_ns(last.header.stamp) - to_ns(last.device_timestamp) == pytest.approx(RECEIVED_NS - EPOCH_NS, abs=6e8)
    assert last.heart_rate_bpm == pytest.approx(80.0, abs=0.1)
    assert last.rr_interval_ms == pytest.approx(750.0, abs=1)
    assert last.signal_quality > 0.95
    assert last.hrv.rmssd_ms < 1
    assert np.isnan(last.hrv.sdnn_ms)
    assert any("sdnn_ms needs 120 s" in reason for reason in last.reasons)
    assert last.extra[0].name == "r_amplitude"
    assert last.extra[0].values[0] == pytest.approx(1000, rel=0.1)
    differences = [message.device_heart_rate_difference_bpm for message in worn.features]
    assert np.nanmin(differences) == pytest.approx(-2.0, abs=0.2)
    peaks_ns = [to_ns(time) - EPOCH_NS for message in worn.features for time in message.peak_timestamps]
    truth_ns = [round((0.5 + k * PERIOD_S) * 1e9) for k in range(len(peaks_ns))]
    assert np.abs(np.array(peaks_ns) - truth_ns).max() < 1e6
    service.send_signal(signal.SIGTERM)
    assert service.wait(5) == 0


def test_streams_come_and_move(service: subprocess.Popen[bytes], strap: Callable[[str, str], Strap]) -> None:
    """A second participant is served while the first goes on; a strap that changes hands starts afresh."""
    first = strap("p1", "bar_1")
    first.until(first.heard, "the service subscribes to the first")
    first.play(6)
    second = strap("p2", "bar_2")
    second.until(second.heard, "the service subscribes to the second")
    second.play(6)
    first.play(3)
    assert first.features[-1].hrv.window_s > 7
    first.wear("Ada")
    first.until(first.heard, "the service follows the new name")
    first.play(6)
    assert first.features[0].hrv.window_s < 2
    assert second.features[-1].heart_rate_bpm == pytest.approx(80, abs=0.5)


@pytest.mark.parametrize(("parameter", "value"), [("window_s", "-1.0"), ("hrv_min_quality", "high")])
def test_wrong_parameter(ros_domain: int, parameter: str, value: str) -> None:
    """A parameter that cannot be ends the service with 78 and one line that names it."""
    arguments = [sys.executable, "-m", "interpreter_ecg", "--ros-args", "-p", f"{parameter}:={value}"]
    done = subprocess.run(arguments, capture_output=True, timeout=30, check=False)
    assert done.returncode == 78
    assert parameter in done.stderr.decode()
