"""A bare rclpy subscription to one raw topic: what any process of this machine could have heard of it, and how late.

bare_listener.py TOPIC FILE

Until SIGTERM; then it writes to FILE, as int64, for every message the time it was sent and the time it was taken, ns.
"""

import signal
import sys
import time
from array import array
from pathlib import Path

import rclpy
from rclpy.qos import QoSProfile
from sense4hri.cdr import stamps_ns
from sense4hri_msgs.msg import PhysioRaw


def main() -> None:
    """Listen until told to stop."""
    topic, file = sys.argv[1:]
    rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
    running, heard = True, array("q")

    def stop(number: int, frame: object) -> None:
        nonlocal running
        running = False

    signal.signal(signal.SIGTERM, stop)
    node = rclpy.create_node("bare_listener", start_parameter_services=False)
    node.create_subscription(
        PhysioRaw,
        topic,
        lambda cdr: heard.extend((stamps_ns(cdr)[0], time.time_ns())),
        QoSProfile(depth=5000),
        raw=True,
    )
    while running:
        rclpy.spin_once(node, timeout_sec=0.1)
    Path(file).write_bytes(heard.tobytes())
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
