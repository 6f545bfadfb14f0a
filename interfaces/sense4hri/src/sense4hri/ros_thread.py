"""The one thread in which rclpy works: callbacks, timers, parameter services."""

import threading
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

CLOSE_S = 1.0


class RosThread:
    """Spins one node from `start` to `close`.

    on_failure(error) is called, on that thread, where it ends before: a node that no longer spins looks alive and
    hears nothing, so the service must end with it. on_unreadable(name, sentence): what somebody sent to a topic or ROS
    service could not be turned into a message; it is left out.
    """

    def __init__(
        self, node: Node, on_failure: Callable[[BaseException], None], on_unreadable: Callable[[str, str], None]
    ) -> None:
        self._node, self._on_failure = node, on_failure
        self._executor = _Executor(on_unreadable)
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="ros", daemon=True)

    def start(self) -> None:
        """Begin to spin."""
        self._executor.add_node(self._node)
        self._thread.start()

    def do(self, function: Callable[[], None]) -> None:
        """Have function called on the ROS thread, when its turn comes; from any thread."""
        self._executor.create_task(function)

    def close(self) -> None:
        """End the thread."""
        self._closing = True
        self._executor.shutdown(timeout_sec=CLOSE_S)
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        try:
            self._spin()
        except Exception as err:  # noqa: BLE001 - handed on: the service fails with it
            self._failed(err)
        else:
            self._failed(RuntimeError("rclpy stopped spinning"))

    def _failed(self, err: BaseException) -> None:
        if not self._closing:
            err.add_note("The ROS thread has ended: nothing would be heard any more.")
            self._on_failure(err)

    def _spin(self) -> None:
        """Spin until shutdown; what the main thread destroys just before the executor waits for it is no failure."""
        while True:
            try:
                self._executor.spin()
                return
            except ExternalShutdownException:
                return
            except InvalidHandle:
                continue


class _Executor(SingleThreadedExecutor):
    """rclpy's, which would end with the first message that it cannot turn into Python."""

    def __init__(self, on_unreadable: Callable[[str, str], None]) -> None:
        super().__init__()
        self._on_unreadable = on_unreadable

    def _take_subscription(self, sub: Any) -> Any:
        return self._taken(super()._take_subscription, sub, sub.topic)

    def _take_service(self, srv: Any) -> Any:
        return self._taken(super()._take_service, srv, srv.srv_name)

    def _take_client(self, client: Any) -> Any:
        return self._taken(super()._take_client, client, client.srv_name)

    def _taken(self, take: Callable[[Any], Any], entity: Any, name: str) -> Any:
        """Return what take(entity) returns; None, nothing to be done, where what came cannot be read."""
        try:
            return take(entity)
        except (RuntimeError, ValueError, OverflowError, SystemError) as err:
            self._on_unreadable(name, f"it cannot be read: {err}")
            return None
