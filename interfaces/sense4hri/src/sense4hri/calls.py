"""ROS services, answered and asked, and work of the main thread whose result another thread waits for."""

import asyncio
import inspect
import types
from collections.abc import Callable, Coroutine, Generator
from concurrent.futures import Future
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.node import Node

from sense4hri import intake
from sense4hri.errors import Refusal, Refused


class Calls:
    """post(function, *args): call it on the main thread. start(coroutine): run it there, beside main.

    wake(function): call it on the ROS thread. refuse(name, kind, why): count a request that cannot be used, and say it.
    """

    def __init__(
        self,
        node: Node,
        loop: asyncio.AbstractEventLoop,
        post: Callable[..., None],
        start: Callable[[Coroutine[Any, Any, None]], object],
        wake: Callable[[Callable[[], None]], None],
        refuse: Callable[[str, str, str], None],
    ) -> None:
        self._node, self._loop, self._post, self._start = node, loop, post, start
        self._wake, self._refuse = wake, refuse

    def serve(self, kind: type, name: str, handler: Callable[[Any, Any], Any]) -> None:
        """Answer a ROS service with handler(request, response) -> response, run on the main thread.

        The handler may be a coroutine. Meanwhile the node hears and asks others.
        """

        async def answer(request: Any, response: Any) -> Any:
            try:
                intake.check(request)
                result = self.made(lambda: handler(request, response))
                result.add_done_callback(lambda done: self._wake(lambda: None))  # rclpy looks when something happens
                await _done(result)
                return result.result()
            except (Refused, Refusal) as err:
                self._refuse(name, kind.__name__, str(err))
                if hasattr(response, "message"):
                    response.message = str(err)
                return response

        self._node.create_service(kind, name, answer, callback_group=ReentrantCallbackGroup())

    async def ask(self, client: Client, request: Any, timeout_s: float) -> Any:
        """Return a ROS service's response. Raises TimeoutError, also where nobody serves it."""
        deadline = self._loop.time() + timeout_s
        while not client.service_is_ready():
            if self._loop.time() > deadline:
                raise TimeoutError(f"{client.srv_name} is not served")
            await asyncio.sleep(0.05)
        done: asyncio.Future[Any] = self._loop.create_future()

        def settle(result: Any) -> None:
            if not done.done():
                done.set_result(result)

        pending = client.call_async(request)
        pending.add_done_callback(lambda future: self._post(settle, future.result()))
        try:
            return await asyncio.wait_for(done, max(0.05, deadline - self._loop.time()))
        except TimeoutError:
            client.remove_pending_request(pending)
            raise TimeoutError(f"{client.srv_name} did not answer within {timeout_s} s") from None

    def made(self, function: Callable[[], Any]) -> "Future[Any]":
        """Return what function() will have returned on the main thread, or what the coroutine that it returns will.

        A ValueError goes to who waits; any other error ends the service. From any thread.
        """
        result: Future[Any] = Future()

        async def finish(work: Coroutine[Any, Any, Any]) -> None:
            try:
                result.set_result(await work)
            except ValueError as err:
                result.set_exception(err)

        def begin() -> None:
            try:
                made = function()
            except ValueError as err:
                result.set_exception(err)
                return
            self._start(finish(made)) if inspect.iscoroutine(made) else result.set_result(made)

        self._post(begin)
        return result


@types.coroutine
def _done(result: "Future[Any]") -> Generator[None, None, None]:
    """Wait for a result in a callback of rclpy's, which turns to it again after everything else it does."""
    while not result.done():
        yield
