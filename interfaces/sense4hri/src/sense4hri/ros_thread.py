"""The one thread in which ROS works: callbacks, parameter services."""

import threading
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from sense4hri.executor import Executor

CLOSE_S = 1.0


class RosThread:
    """Spins one node from `start` to `close`.

    on_failure(error) is called, on that thread, where it ends before: a node that no longer spins looks alive and
    hears nothing, so the service must end with it. on_unreadable(name, sentence): what somebody sent to a topic or ROS
    service could not be turned into a message; it is left out. on_graph(): the graph has changed (`Executor`).
    """

    def __init__(
        self,
        node: Node,
        on_failure: Callable[[BaseException], None],
        on_unreadable: Callable[[str, str], None],
        on_graph: Callable[[], None] = lambda: None,
    ) -> None:
        self._node, self._on_failure = node, on_failure
        self._executor = Executor(node, on_unreadable, on_graph)
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="ros", daemon=True)

    def start(self) -> None:
        """Begin to spin."""
        waking: Any = self._executor  # all that rclpy asks of a node's executor is to be woken
        self._node.executor = waking
        self._thread.start()

    def do(self, function: Callable[[], None]) -> None:
        """Have function called on the ROS thread, when its turn comes; from any thread."""
        self._executor.create_task(function)

    def delay(self, subscription: Subscription, within_s: float) -> None:
        """Have what comes of a subscription handed over so much later at the most (`Executor.delay`)."""
        self._executor.delay(subscription, within_s)

    def tell_graph_every(self, seconds: float) -> None:
        """Have a change of the graph told so often at the most."""
        self._executor.graph_every_s = seconds

    def close(self) -> None:
        """End the thread."""
        self._closing = True
        self._executor.shutdown()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        try:
            self._executor.spin()
        except Exception as err:  # noqa: BLE001 - handed on: the service fails with it
            self._failed(err)
        else:
            self._failed(RuntimeError("the executor stopped spinning"))

    def _failed(self, err: BaseException) -> None:
        if not self._closing:
            err.add_note("The ROS thread has ended: nothing would be heard any more.")
            self._on_failure(err)
