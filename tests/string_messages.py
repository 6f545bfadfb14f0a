"""Serialised std_msgs/String messages on a channel, for tests of what writes or reads recordings without ROS."""

import struct
from typing import Any

from sense4hri_recording.rosbag2 import Channel

START_NS = 1_700_000_000 * 10**9
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
QOS = {
    "history": "unknown",
    "depth": 0,
    "reliability": "reliable",
    "durability": "transient_local",
    "deadline": {"sec": 9223372036, "nsec": 854775807},
    "lifespan": {"sec": 9223372036, "nsec": 854775807},
    "liveliness": "automatic",
    "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
    "avoid_ros_namespace_conventions": False,
}


def cdr_string(text: str) -> bytes:
    """A String as the middleware sends it."""
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def string_channel(topic: str = "/study/x", qos: dict[str, Any] | None = None) -> Channel:
    """A topic of Strings."""
    return Channel(topic, "std_msgs/msg/String", STRING_HASH, [qos or QOS], "string data\n")
