"""A study of third-party drivers and services on the real graph, made with rclpy and the messages alone.

Every participant wears a strap (ecg, accelerometer) and an armband (ppg), the second of two also a glove,
whose sensor type nobody here has heard of and which alone moves its topics when its `human_id` is set; device
clocks, beats and states are known from `synthetic_signals`.
Commands are read from standard input, one per line:

    cut SENSOR        the sensor falls silent and says LOST
    resume SENSOR     it comes back
    marker NAME       a marker now
    quit
"""

import argparse
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import rclpy
import synthetic_signals as signals
from builtin_interfaces.msg import Time
from hri_msgs.msg import Expression
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sense4hri_msgs.msg import (
    ECG,
    PPG,
    ClockModel,
    Marker,
    PhysioDeviceFeature,
    PhysioFeature,
    PhysioRaw,
    PhysioRawChannel,
    StreamHealth,
    UserState,
)

ROOT = "/humans/physiological"
HOSTILE = "<img src=x onerror=\"document.title='owned'\">"  # must be shown, never become part of the page
LATENCY_S = 0.03
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RATES_BPM = {"p1": 72.0, "p2": 64.0}


@dataclass
class Kind:
    """One stream of a sensor."""

    sensor_type: str
    rate_hz: float
    samples: int  # per message
    unit: str
    channels: tuple[str, ...]
    make: Callable[[np.ndarray, float], np.ndarray]


def _ppg(times_s: np.ndarray, rate_bpm: float) -> np.ndarray:
    one = signals.ppg_counts(times_s, rate_bpm)
    return np.column_stack([one, one, one, 0 * one + 400])


def _eeg(channels: int, times_s: np.ndarray) -> np.ndarray:
    return 60 * np.sin(2 * np.pi * np.outer(times_s, 8 + np.arange(channels) / 16))


STRAP = (
    Kind("ecg", 130.0, 13, "uV", ("ecg",), lambda t, rate: signals.ecg_uv(t, rate)[:, None]),
    Kind("accelerometer", 50.0, 5, "m/s^2", ("x", "y", "z"), lambda t, rate: signals.acceleration(t)),
)
ARMBAND = (Kind("ppg", 55.0, 5, "counts", ("ppg_0", "ppg_1", "ppg_2", "ambient"), _ppg),)
GLOVE = (
    Kind("flexion", 40.0, 4, "%", ("thumb", "index"), lambda t, rate: 50 + 30 * np.sin(np.stack([t, 2 * t], axis=1))),
)


def cap(channels: int) -> tuple[Kind, ...]:
    """Return an EEG cap at 1 kHz."""
    names = tuple(f"C{c}" for c in range(channels))
    return (Kind("eeg", 1000.0, 20, "uV", names, lambda t, rate: _eeg(channels, t)),)


def stamp(seconds: float) -> Time:
    """Return seconds as a Time."""
    ns = round(seconds * 1e9)
    return Time(sec=ns // 10**9, nanosec=ns % 10**9)


@dataclass
class Sensor:
    """A driver node of one device whose clock runs `ahead_s` behind ROS time."""

    human: str
    sensor_id: str
    kinds: tuple[Kind, ...]
    behind_s: float
    moves: bool = False
    cut: bool = False
    _sent: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.node = Node(f"driver_fake_{self.sensor_id}")
        self.rate_bpm = RATES_BPM.get(self.human, 70.0)
        own = {"human_id": self.human, "sensor_id": self.sensor_id, "vendor": "Third Party", "model": HOSTILE}
        own |= {"serial_number": "", "firmware_version": "", "body_location": "chest", "transport_delay_s": 0.0}
        for kind in self.kinds:
            prefix = kind.sensor_type
            own |= {f"{prefix}.unit": kind.unit, f"{prefix}.sampling_frequency_hz": kind.rate_hz}
            own |= {f"{prefix}.range_min": -1e6, f"{prefix}.range_max": 1e6, f"{prefix}.resolution_bits": 24}
            self.node.declare_parameter(f"{prefix}.channel_names", list(kind.channels))
        for name, value in own.items():
            self.node.declare_parameter(name, value)
        self.advertise()
        self.node.add_post_set_parameters_callback(self.move)
        self.node.create_timer(0.02, self.send)
        self.node.create_timer(1.0, self.report)
        self._start_s = time.time()

    def advertise(self) -> None:
        self.publishers = {
            (kind.sensor_type, name): self.node.create_publisher(message, self.topic(kind, name), qos)
            for kind in self.kinds
            for name, message, qos in (
                ("raw", PhysioRaw, 200),
                ("health", StreamHealth, 1),
                ("device", PhysioDeviceFeature, 50),
                ("clock", ClockModel, LATCHED),
            )
        }

    def move(self, parameters: list[Parameter]) -> None:
        """Take the topics to another human_id."""
        for parameter in parameters:
            if parameter.name == "human_id" and self.moves:
                for publisher in self.publishers.values():
                    self.node.destroy_publisher(publisher)
                self.human = parameter.value
                self.advertise()

    def topic(self, kind: Kind, name: str) -> str:
        return f"{ROOT}/{self.human}/{kind.sensor_type}/{self.sensor_id}/{name}"

    def send(self) -> None:
        """Publish every block of samples that is complete by now."""
        for kind in self.kinds:
            due = int((time.time() - LATENCY_S - self._start_s) * kind.rate_hz)
            while due - self._sent.setdefault(kind.sensor_type, 0) >= kind.samples:
                first = self._sent[kind.sensor_type]
                self._sent[kind.sensor_type] = first + kind.samples
                if not self.cut:
                    self.publishers[kind.sensor_type, "raw"].publish(self.block(kind, first))

    def block(self, kind: Kind, first: int) -> PhysioRaw:
        times_s = self._start_s + np.arange(first, first + kind.samples) / kind.rate_hz
        samples = kind.make(times_s, self.rate_bpm)
        message = PhysioRaw(device_timestamp=stamp(times_s[-1] - self.behind_s))
        message.header.stamp, message.header.frame_id = stamp(time.time()), HOSTILE
        message.channels = [
            PhysioRawChannel(channel_name=name, samples=samples[:, i].tolist()) for i, name in enumerate(kind.channels)
        ]
        return message

    def report(self) -> None:
        """Publish health, clock model and, of the device, its heart rate."""
        now_s = time.time()
        for kind in self.kinds:
            health = StreamHealth(
                state=StreamHealth.LOST if self.cut else StreamHealth.STREAMING,
                host="lab",
                nominal_rate_hz=kind.rate_hz,
                measured_rate_hz=kind.rate_hz,
                latency_s=LATENCY_S,
                battery_percent=84.0,
                rssi_dbm=-61.0,
                contact=1.0,
                reasons=["link timed out"] if self.cut else [],
            )
            health.header.stamp = stamp(now_s)
            self.publishers[kind.sensor_type, "health"].publish(health)
            model = ClockModel(
                device_reference=stamp(now_s - self.behind_s),
                offset_ns=round(self.behind_s * 1e9),
                uncertainty_s=0.0009,
                latency_s=LATENCY_S,
                segment=1,
                state=ClockModel.LOCKED,
            )
            self.publishers[kind.sensor_type, "clock"].publish(model)
            if kind.sensor_type in ("ecg", "ppg") and not self.cut:
                rate = PhysioFeature(name="heart_rate", unit="1/min", values=[round(self.rate_bpm)])
                self.publishers[kind.sensor_type, "device"].publish(PhysioDeviceFeature(features=[rate]))


class Services:
    """Stand-ins for interpreters, fusion and the robot."""

    def __init__(self, sensors: list[Sensor]) -> None:
        self.node = Node("fake_services")
        self.sensors = sensors
        self._until_s = time.time()
        self.markers = self.node.create_publisher(Marker, "/study/markers", 100)
        self.faces = self.node.create_publisher(Expression, "/humans/faces/face_1/expression", 10)
        self.features, self.states = {}, {}
        for sensor in sensors:
            for kind in sensor.kinds:
                if kind.sensor_type in ("ecg", "ppg"):
                    message = ECG if kind.sensor_type == "ecg" else PPG
                    key = sensor.sensor_id, kind.sensor_type
                    self.features[key] = self.node.create_publisher(message, sensor.topic(kind, "features"), 50)
            topic = f"{ROOT}/{sensor.human}/state"
            self.states.setdefault(sensor.human, self.node.create_publisher(UserState, topic, 10))
        self.node.create_timer(1.0, self.update)

    def update(self) -> None:
        start_s, self._until_s = self._until_s, time.time() - 0.5
        for sensor in self.sensors:
            for kind in sensor.kinds:
                publisher = self.features.get((sensor.sensor_id, kind.sensor_type))
                if publisher and not sensor.cut:
                    publisher.publish(self.feature_message(sensor, kind, start_s))
        for human, publisher in self.states.items():
            state = UserState(
                human_id=human,
                state="calm_relaxed",
                confidence=0.8,
                face_id="face_1",
                expression="neutral",
                heart_rate_bpm=RATES_BPM.get(human, 70.0),
                reasons=["expression neutral", HOSTILE],
            )
            publisher.publish(state)
        self.faces.publish(Expression(expression="happy"))

    def feature_message(self, sensor: Sensor, kind: Kind, start_s: float) -> ECG | PPG:
        peaks_s = signals.beats(start_s, self._until_s, sensor.rate_bpm)
        if kind.sensor_type == "ppg":
            peaks_s = peaks_s + signals.PULSE_DELAY_S + 0.1
        message = ECG() if kind.sensor_type == "ecg" else PPG(channel_name="ppg_1")
        message.peak_timestamps = [stamp(peak - sensor.behind_s) for peak in peaks_s]
        message.rr_intervals_ms = [60_000 / sensor.rate_bpm] * len(peaks_s)
        message.window_s, message.peak_count = 10.0, 12
        message.heart_rate_bpm = sensor.rate_bpm
        message.rr_interval_ms = 60_000 / sensor.rate_bpm
        message.hrv.window_s, message.hrv.rmssd_ms, message.hrv.sdnn_ms = 43.0, 31.0, float("nan")
        message.signal_quality = 0.91
        return message

    def mark(self, name: str) -> None:
        marker = Marker(name=name, source="test")
        marker.header.stamp = stamp(time.time())
        self.markers.publish(marker)


def main() -> None:
    """Run until `quit` or the end of standard input."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--participants", type=int, default=2)
    parser.add_argument("--cap", type=int, default=0, help="so many channels at 1 kHz instead of straps and armbands")
    asked = parser.parse_args()
    rclpy.init()
    sensors = []
    for i in range(1, asked.participants + 1):
        if asked.cap:
            sensors.append(Sensor(f"p{i}", f"cap_{i}", cap(asked.cap), 12.0 * i))
        else:
            sensors.append(Sensor(f"p{i}", f"h10_{i}", STRAP, 3.2 * i))
            sensors.append(Sensor(f"p{i}", f"verity_{i}", ARMBAND, 1000.5 * i))
    if not asked.cap and asked.participants == 2:
        sensors.append(Sensor("p2", "glove_1", GLOVE, 5.0, moves=True))
    services = Services(sensors)
    executor = SingleThreadedExecutor()
    for node in (*(sensor.node for sensor in sensors), services.node):
        executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    by_id = {sensor.sensor_id: sensor for sensor in sensors}
    for line in sys.stdin:
        command, _, argument = line.strip().partition(" ")
        if command == "quit":
            break
        if command in ("cut", "resume"):
            by_id[argument].cut = command == "cut"
        elif command == "marker":
            services.mark(argument)
    executor.shutdown()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
