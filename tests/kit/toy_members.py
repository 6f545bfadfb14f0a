"""Many light services that do nothing but take part in sessions, in one process: `toy_members.py first count`.

`TOY_MEMBERS` changes them: `unready` (never ready), `stuck` (never finished), `deaf` (hears, but never answers).
"""

import os
import signal
import sys
import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sense4hri import qos
from sense4hri_msgs.msg import SessionAck, SessionState


class Member:
    """A service in another language would do this much: acknowledge each phase, again where it is waited for."""

    def __init__(self, node: Node, faults: set[str]) -> None:
        self._node, self._faults = node, faults
        self._acks = node.create_publisher(SessionAck, "/study/ack", qos.ACK)
        self._state = SessionState()
        node.create_subscription(SessionState, "/study/session", self._hear, qos.SESSION)
        node.create_timer(0.5, self._again)

    def _hear(self, state: SessionState) -> None:
        new = (state.session_id, state.phase) != (self._state.session_id, self._state.phase)
        self._state = state
        if new:
            self._say()

    def _again(self) -> None:
        if any(entry.partition(":")[0] == self._node.get_name() for entry in self._state.waiting_for):
            self._say()

    def _say(self) -> None:
        phase = self._state.phase
        if phase == SessionState.IDLE or "deaf" in self._faults:
            return
        ack = SessionAck(session_id=self._state.session_id, service=self._node.get_name(), phase=phase, ok=True)
        if phase == SessionState.PREPARING and "unready" in self._faults:
            ack.ok, ack.detail = False, "the toy is not wound up"
        if phase == SessionState.STOPPING and "stuck" in self._faults:
            ack.ok, ack.detail = False, "the toy is stuck"
        self._acks.publish(ack)


def main() -> None:
    first, count = int(sys.argv[1]), int(sys.argv[2])
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    faults = set(filter(None, os.environ.get("TOY_MEMBERS", "").split(",")))
    nodes = [rclpy.create_node(f"toy_member_{first + k}", enable_rosout=False) for k in range(count)]
    for node in nodes:
        Member(node, faults)
        executor.add_node(node)
    print("members are there", file=sys.stderr, flush=True)
    while not stop.is_set():
        executor.spin_once(timeout_sec=0.2)
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
