"""Nodes of a host, each a participant of DDS like a process, until each knows all of another: crowd.py own other."""

import sys
import time

import rclpy
from rclpy.context import Context

NODES = 6
"""More than the four of a peer that Fast DDS asks for unless told."""
HEARD_S = 60.0


def main() -> None:
    """Print `all heard`, or who has not heard whom; then stay for the other host's nodes."""
    own, other = sys.argv[1:]
    nodes = []
    for number in range(NODES):
        context = Context()
        rclpy.init(context=context)
        nodes.append(rclpy.create_node(f"{own}_{number}", context=context))
    wanted = {f"{other}_{number}" for number in range(NODES)}
    until_s = time.monotonic() + HEARD_S
    while time.monotonic() < until_s and any(wanted - {*node.get_node_names()} for node in nodes):
        time.sleep(0.1)
    print({node.get_name(): missing for node in nodes if (missing := wanted - {*node.get_node_names()})} or "all heard")
    sys.stdout.flush()
    time.sleep(HEARD_S)


if __name__ == "__main__":
    main()
