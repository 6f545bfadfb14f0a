"""Publishes numbered PhysioRaw messages at a steady rate until SIGTERM, then writes when each was sent.

steady_publisher.py TOPIC MESSAGES_PER_S BYTES SUBSCRIBERS FILE

Begins once so many listen, and says so on standard output. The number is in device_timestamp, the time of sending in
header.stamp; what else is in a message is noise, which no compression makes smaller. Messages are made of bytes, so
that publishing costs as little as it can. FILE: times of sending in ns, as int64.
"""

import signal
import struct
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sense4hri_msgs.msg import PhysioRaw, PhysioRawChannel

_STAMP = struct.Struct("<iI")
HEADER_AT = 4  # of header.stamp in the bytes; device_timestamp follows the header, whose frame_id is empty
DEVICE_AT = HEADER_AT + 8 + 4 + 4  # the empty frame_id is a length, its zero byte, and three to align
VARIANTS = 16


def message_bytes(size: int) -> list[bytearray]:
    """Serialised messages of about this size in bytes."""
    noise = np.random.default_rng(1)
    samples = max(1, round((size - 60) / 8))
    return [
        bytearray(
            serialize_message(
                PhysioRaw(channels=[PhysioRawChannel(channel_name="a", samples=noise.standard_normal(samples))])
            )
        )
        for _ in range(VARIANTS)
    ]


def main() -> None:
    """Publish until SIGTERM."""
    topic, rate, size, subscribers, file = sys.argv[1:]
    rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
    running = True

    def stop(number: int, frame: object) -> None:
        nonlocal running
        running = False

    signal.signal(signal.SIGTERM, stop)
    node = rclpy.create_node("steady_publisher", start_parameter_services=False)
    publisher = node.create_publisher(PhysioRaw, topic, QoSProfile(depth=1000))
    while running and publisher.get_subscription_count() < int(subscribers):
        time.sleep(0.02)
    print("begun", flush=True)
    variants, sent = message_bytes(int(size)), []
    begun = time.monotonic()
    while running:
        ahead_s = begun + len(sent) / float(rate) - time.monotonic()
        if ahead_s > 0:
            time.sleep(ahead_s)
        data = variants[len(sent) % VARIANTS]
        now_ns = time.time_ns()
        _STAMP.pack_into(data, HEADER_AT, *divmod(now_ns, 1_000_000_000))
        _STAMP.pack_into(data, DEVICE_AT, *divmod(len(sent), 1_000_000_000))
        publisher.publish(bytes(data))
        sent.append(now_ns)
    Path(file).write_bytes(np.array(sent, np.int64).tobytes())
    time.sleep(1.0)  # for what has to be sent again
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
