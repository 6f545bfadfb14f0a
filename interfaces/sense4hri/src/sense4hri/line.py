"""What a command needs of ROS: a node that asks a service, hears what it wants, and is gone again."""

import os
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

ANSWER_S = 5.0


class Line:
    """The line of one command to one service, until it is closed.

    command: such as `sense4hri-session`. to: the service's name, for the sentences that say that it is not there.
    The node's name begins with `_`: it takes no part in sessions.
    """

    def __init__(self, command: str, to: str) -> None:
        os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # rclpy's own leave the graph before `close`
        name = f"_{command.replace('-', '_')}_{os.getpid()}"
        self.node = rclpy.create_node(name, enable_rosout=False, start_parameter_services=False)
        self._to = to
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._spinning = self._interrupted = False
        self._before = signal.signal(signal.SIGINT, self.interrupt)

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, as the handler of a signal, once rclpy works on nothing.

        Out of a message that is just being converted it would come as a RuntimeError, which says nothing of it.
        """
        self._interrupted = self._spinning
        if not self._spinning:
            raise KeyboardInterrupt

    def until(self, condition: Callable[[], Any], seconds: float) -> Any:
        """Return the first true result of condition, or what it is after so many seconds."""
        deadline_s = time.monotonic() + seconds
        while not (result := condition()) and time.monotonic() < deadline_s:
            self._spin()
        return result

    def _spin(self) -> None:
        self._spinning = True
        try:
            self._executor.spin_once(timeout_sec=0.05)
        finally:
            self._spinning = False
        if self._interrupted:
            self._interrupted = False
            raise KeyboardInterrupt

    def ask(self, kind: Any, name: str, request: Any, answer_s: float = ANSWER_S) -> Any:
        """Return the answer of a ROS service; ends the program with a sentence where none comes."""
        try:
            return self.answer(kind, name, request, answer_s)
        except TimeoutError as err:
            sys.exit(str(err))

    def answer(self, kind: Any, name: str, request: Any, answer_s: float = ANSWER_S, tries: int = 1) -> Any:
        """Return the answer of a ROS service. Raises TimeoutError where none comes, answer_s being for each try."""
        client = self.node.create_client(kind, name)
        try:
            if not self.until(client.service_is_ready, ANSWER_S):
                raise TimeoutError(f"no {self._to} on ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}")
            for _ in range(tries):
                future = client.call_async(request)
                if self.until(future.done, answer_s):
                    return future.result()
            raise TimeoutError(f"{self._to} did not answer within {answer_s:.0f} s")
        finally:
            self.node.destroy_client(client)

    def close(self) -> None:
        """Leave the graph."""
        signal.signal(signal.SIGINT, self._before)
        self._executor.shutdown()
        self.node.destroy_node()
        try_shutdown()
