"""Runs inside a study's network: prints what comes over DDS, one JSON line per second.

Each line maps a topic to {"count", "stamp_s" (header.stamp of the newest message), and of health "state"}.
"""

import json
import sys
import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from sense4hri import qos
from sense4hri.message_types import message_class
from sense4hri.names import ROOT, StreamName
from sense4hri.stamps import SECOND_NS, to_ns

PROFILES = {
    "raw": qos.RAW,
    "features": qos.FEATURES,
    "device": qos.DEVICE,
    "health": qos.HEALTH,
    "clock": qos.CLOCK,
    "state": qos.STATE,
}


def profile_of(topic: str) -> Any:
    """QoS of a topic that is listened to; None of any other."""
    parsed = StreamName.parse(topic)
    of_a_person = topic.startswith(ROOT) and topic.endswith("/state")
    return PROFILES.get(parsed[1] if parsed else "state" if of_a_person else "")


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("container_test")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    seen: dict[str, dict[str, Any]] = {}

    def follow(topic: str, kind: type, profile: Any) -> None:
        entry = seen.setdefault(topic, {"count": 0, "stamp_s": 0.0})

        def take(message: Any) -> None:
            entry["count"] += 1
            entry["stamp_s"] = to_ns(message.header.stamp) / SECOND_NS
            if hasattr(message, "state"):
                entry["state"] = message.state

        node.create_subscription(kind, topic, take, qos.deep(profile, 500))

    def look() -> None:
        for topic, types in node.get_topic_names_and_types():
            if topic not in seen and (profile := profile_of(topic)) and (kind := message_class(types[0])):
                follow(topic, kind, profile)

    node.create_timer(0.5, look)
    next_line = time.monotonic()
    while rclpy.ok():
        executor.spin_once(timeout_sec=0.1)
        if time.monotonic() >= next_line:
            next_line += 1.0
            print(json.dumps(seen), flush=True)


if __name__ == "__main__":
    try:
        main()
    except (KeyboardInterrupt, BrokenPipeError):
        sys.exit(0)
