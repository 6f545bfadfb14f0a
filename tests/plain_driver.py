"""A driver of plain rclpy, without the kit, as somebody in another language would write it; right, or with one fault.

    plain_driver.py belt_1                   the sensor
    plain_driver.py belt_1 "best effort"     with a fault

A breathing belt of p9 at 25 Hz whose messages hold now four, now six samples. Its device is played in it.
"""

import math
import signal
import socket
import sys
import time
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel, StreamHealth

FAULTS = (
    "node name",
    "best effort",
    "latched",
    "frame id",
    "first sample",
    "stamps go back",
    "invented time",
    "unit",
    "whole number",
    "missing parameter",
    "rate",
    "no health",
    "counts",
    "loss in silence",
    "sensor id settable",
    "wearer stays",
)
RATE_HZ = 25.0
SIZES = (4, 6)


class Belt(Node):
    """The driver's node. fault: what it does wrong, empty = nothing."""

    def __init__(self, sensor_id: str, fault: str = "") -> None:
        if fault not in ("", *FAULTS):
            raise ValueError(f"no fault {fault!r}")
        self.fault, self.sensor_id = fault, sensor_id
        super().__init__("belt" if fault == "node name" else f"driver_belt_{sensor_id}")
        self._declare("sensor_id", sensor_id)
        self.human_id = self._declare("human_id", "p9")
        for name in ("vendor", "model", "serial_number", "firmware_version", "body_location"):
            self._declare(name, "x")
        self._declare("transport_delay_s", 0.0)
        self._declare_stream()
        self.add_on_set_parameters_callback(self._on_set)
        self.sent = self.taken = self.messages = 0
        self.begun_s = time.monotonic()
        self.health_at_s = self.begun_s
        self._publish_under(self.human_id)

    def work(self) -> None:
        """Publish what is due, all of it: on a slow machine late, never slower than the device."""
        now_s = time.monotonic()
        while now_s >= self.begun_s + (self.taken + (size := SIZES[self.messages % 2])) / RATE_HZ:
            self._take(size)
        if now_s >= self.health_at_s and self.fault != "no health":
            self.health_at_s += 1.0
            self.health.publish(self._health())

    def _declare(self, name: str, value: Any) -> Any:
        return self.declare_parameter(name, value, ParameterDescriptor(description=f"{name} of the belt")).value

    def _declare_stream(self) -> None:
        values: dict[str, Any] = {
            "sampling_frequency_hz": 50.0 if self.fault == "rate" else RATE_HZ,
            "unit": "mV" if self.fault == "unit" else "a.u.",
            "range_min": -1.0,
            "range_max": 1 if self.fault == "whole number" else 1.0,
            "resolution_bits": 12,
            "channel_names": ["respiration"],
        }
        if self.fault == "missing parameter":
            del values["resolution_bits"]
        for name, value in values.items():
            self._declare(f"respiration.{name}", value)

    def _publish_under(self, human_id: str) -> None:
        topic = f"/humans/physiological/{human_id}/respiration/{self.sensor_id}"
        profile = QoSProfile(depth=200)
        if self.fault == "best effort":
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        if self.fault == "latched":
            profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
        self.raw = self.create_publisher(PhysioRaw, f"{topic}/raw", profile)
        self.health = self.create_publisher(StreamHealth, f"{topic}/health", QoSProfile(depth=1))

    def _on_set(self, changes: list[Any]) -> SetParametersResult:
        for change in changes:
            if change.name != "human_id" and self.fault != "sensor id settable":
                return SetParametersResult(successful=False, reason=f"{change.name} cannot be set at run time")
            if change.name == "human_id" and not str(change.value).isidentifier():
                return SetParametersResult(successful=False, reason=f"{change.value!r} is no human_id")
            if change.name == "human_id" and self.fault != "wearer stays":
                self.destroy_publisher(self.raw)
                self.destroy_publisher(self.health)
                self._publish_under(change.value)
        return SetParametersResult(successful=True)

    def _take(self, size: int) -> None:
        """Take samples of the device; publish them."""
        first, self.taken, self.messages = self.taken, self.taken + size, self.messages + 1
        if self.fault == "loss in silence" and self.messages % 20 == 0:
            return
        phases = [2 * math.pi * 0.25 * index / RATE_HZ for index in range(first, self.taken)]
        message = PhysioRaw(
            channels=[PhysioRawChannel(channel_name="respiration", samples=list(map(math.sin, phases)))]
        )
        message.header.frame_id = "belt" if self.fault == "frame id" else self.sensor_id
        message.header.stamp = self.get_clock().now().to_msg()
        self._stamp(message, first)
        self.raw.publish(message)
        self.sent += size

    def _stamp(self, message: PhysioRaw, first: int) -> None:
        index = first if self.fault == "first sample" else self.taken - 1
        if self.fault == "stamps go back" and self.messages % 10 == 0:
            index -= 50
        if self.fault == "invented time":
            message.device_timestamp = message.header.stamp
            return
        stamp_ns = round((100 + index / RATE_HZ) * 1e9)
        message.device_timestamp.sec, message.device_timestamp.nanosec = divmod(stamp_ns, 1_000_000_000)

    def _health(self) -> StreamHealth:
        state = StreamHealth(
            state=StreamHealth.STREAMING,
            host=socket.gethostname(),
            realtime_minus_monotonic_ns=time.time_ns() - time.monotonic_ns(),
            nominal_rate_hz=50.0 if self.fault == "rate" else RATE_HZ,
            measured_rate_hz=RATE_HZ,
            samples_total=self.sent * (2 if self.fault == "counts" else 1),
            **dict.fromkeys(("battery_percent", "rssi_dbm", "contact", "latency_s"), math.nan),
        )
        state.header.frame_id, state.header.stamp = self.sensor_id, self.get_clock().now().to_msg()
        return state


def main() -> None:
    """Work until SIGTERM."""
    ended: list[bool] = []
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, lambda *_: ended.append(True))
    belt = Belt(*sys.argv[1:])
    executor = SingleThreadedExecutor()
    executor.add_node(belt)
    while not ended:
        executor.spin_once(timeout_sec=0.02)
        belt.work()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
