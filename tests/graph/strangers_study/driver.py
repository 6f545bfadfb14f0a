"""Somebody else's driver: a breathing belt that exists in this file alone. It keeps the contract, without the kit."""

import math
import signal
import time

import rclpy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel, StreamHealth

RATE_HZ, PER_MESSAGE = 25.0, 5
BREATHS_PER_S = 0.25
UNKNOWN = ("battery_percent", "rssi_dbm", "contact", "latency_s")


def main() -> None:
    """Publish raw samples and health until SIGTERM."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    ended = []
    signal.signal(signal.SIGTERM, lambda *_: ended.append(True))
    node = rclpy.create_node("driver_belt_belt_1")
    sensor_id, human_id = (node.declare_parameter(name, "").value for name in ("sensor_id", "human_id"))
    for name, value in {"sampling_frequency_hz": RATE_HZ, "unit": "a.u.", "channel_names": ["respiration"]}.items():
        node.declare_parameter(f"respiration.{name}", value)
    topic = f"/humans/physiological/{human_id}/respiration/{sensor_id}"
    raw = node.create_publisher(PhysioRaw, f"{topic}/raw", QoSProfile(depth=200))
    health = node.create_publisher(StreamHealth, f"{topic}/health", QoSProfile(depth=1))
    sent, begun_s = 0, time.monotonic()
    while not ended:
        rclpy.spin_once(node, timeout_sec=0.01)
        if time.monotonic() < begun_s + (sent + PER_MESSAGE) / RATE_HZ:
            continue
        phases = [2 * math.pi * BREATHS_PER_S * (sent + i) / RATE_HZ for i in range(PER_MESSAGE)]
        channel = PhysioRawChannel(channel_name="respiration", samples=[math.sin(phase) for phase in phases])
        message = PhysioRaw(channels=[channel])
        message.header.stamp, message.header.frame_id = node.get_clock().now().to_msg(), sensor_id
        message.device_timestamp.sec, rest = divmod(sent + PER_MESSAGE, int(RATE_HZ))
        message.device_timestamp.nanosec = round(rest / RATE_HZ * 1e9)
        raw.publish(message)
        sent += PER_MESSAGE
        if sent % RATE_HZ == 0:
            state = StreamHealth(state=StreamHealth.STREAMING, samples_total=sent, **dict.fromkeys(UNKNOWN, math.nan))
            state.header, state.nominal_rate_hz, state.measured_rate_hz = message.header, RATE_HZ, RATE_HZ
            health.publish(state)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
