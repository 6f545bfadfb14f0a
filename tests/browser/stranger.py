"""A plain node that does everything wrong, made with rclpy and the messages alone; it ends with its standard input."""

import sys
import threading

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sense4hri_msgs.msg import ClockModel, Marker, PhysioRaw, PhysioRawChannel, StreamHealth, UserState
from std_msgs.msg import String

ROOT = "/humans/physiological"
HOSTILE = "<img src=x onerror=\"document.title='owned'\">"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


class Stranger:
    """Publishes ten times a second on topics of wrong name, type and quality, and numbers and texts that nobody has."""

    def __init__(self) -> None:
        self.node = Node("stranger")
        publisher = self.node.create_publisher
        self.raws = [
            publisher(PhysioRaw, f"{ROOT}/p1/ecg/Shimmer_1/raw", 10),
            publisher(PhysioRaw, f"{ROOT}/p1/eda/shimmer_1/raw", BEST_EFFORT),
        ]
        self.big = publisher(PhysioRaw, f"{ROOT}/p1/emg/shimmer_1/raw", 10)
        self.text = publisher(String, f"{ROOT}/p1/ppg/shimmer_1/raw", 10)
        self.health = publisher(StreamHealth, f"{ROOT}/p1/eda/shimmer_1/health", 1)
        self.clock = publisher(ClockModel, f"{ROOT}/p1/eda/shimmer_1/clock", LATCHED)
        self.state = publisher(UserState, f"{ROOT}/p1/state", 10)
        self.markers = publisher(Marker, "/study/markers", 100)
        self.status = publisher(DiagnosticArray, "/diagnostics", 1)
        self.turn = 0
        self.node.create_timer(0.1, self.send)

    def send(self) -> None:
        self.turn += 1
        now = self.node.get_clock().now().to_msg()
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name=HOSTILE, samples=[float(self.turn % 7)] * 10)])
        message.header.stamp = now
        for raw in self.raws:
            raw.publish(message)
        self.text.publish(String(data="no samples"))
        self.health.publish(
            StreamHealth(state=2, battery_percent=float("inf"), measured_rate_hz=1e29, reasons=[HOSTILE])
        )
        self.clock.publish(ClockModel(latency_s=1e307, uncertainty_s=1e29, skew_ppm=float("nan")))
        self.state.publish(
            UserState(human_id="p1", state=HOSTILE, confidence=1e29, heart_rate_bpm=1e29, reasons=["x" * 9000])
        )
        if self.turn % 20 == 1:
            self.big.publish(PhysioRaw(channels=[PhysioRawChannel(samples=[0.0] * 1_000_000)]))
            marker = Marker(name=f"\u202e{HOSTILE} مثير 刺激", value="v" * 60_000)
            marker.header.stamp = now
            self.markers.publish(marker)
            self.markers.publish(Marker(name="m", value="v" * 1_000_000))
            values = [KeyValue(key=key, value="9" * 5000) for key in ("messages", "minutes_left", "free_bytes")]
            status = DiagnosticStatus(name="recorder: recording", level=b"\xff", message=HOSTILE, values=values)
            self.status.publish(DiagnosticArray(status=[status]))


def main() -> None:
    """Run until the end of standard input."""
    rclpy.init()
    stranger = Stranger()
    executor = SingleThreadedExecutor()
    executor.add_node(stranger.node)
    threading.Thread(target=executor.spin, daemon=True).start()
    sys.stdin.read()
    executor.shutdown()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
