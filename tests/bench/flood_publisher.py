"""A stranger: one node with many raw topics of nobody in the study, or with topics that only the recorder hears.

flood_publisher.py TOPICS MESSAGES_PER_S BYTES SECONDS [STUDY_NAME]

STUDY_NAME: the node is called so; its topics are /study/STUDY_NAME_0 and so on, to a recorder the study's own; and it
publishes only once its standard input has ended.
MESSAGES_PER_S is over all topics together; 0 = silent. At the end it prints `sent N`.
"""

import sys
import time

import rclpy
from rclpy.qos import QoSProfile
from sense4hri_msgs.msg import PhysioRaw
from steady_publisher import message_bytes


def main() -> None:
    """Publish for so long, then leave."""
    topics, rate, size, seconds = (float(word) for word in sys.argv[1:5])
    own = sys.argv[5] if len(sys.argv) > 5 else ""
    rclpy.init()
    node = rclpy.create_node(own or "flood", start_parameter_services=False)
    forms = f"/study/{own}_{{}}" if own else "/humans/physiological/x/ecg/flood_{}/raw"
    names = [forms.format(i) for i in range(int(topics))]
    publishers = [node.create_publisher(PhysioRaw, name, QoSProfile(depth=10)) for name in names]
    print("there", flush=True)
    if own:
        sys.stdin.read()
    data, sent, begun_s = bytes(message_bytes(int(size))[0]), 0, time.monotonic()
    while rclpy.ok() and (now_s := time.monotonic() - begun_s) < seconds:
        while sent < now_s * rate and time.monotonic() - begun_s < seconds:
            publishers[sent % len(publishers)].publish(data)
            sent += 1
        time.sleep(0.005)
    print(f"sent {sent}", flush=True)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
