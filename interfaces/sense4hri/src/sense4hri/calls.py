"""ROS services, answered and asked, and work of the main thread whose result another thread waits for."""

import asyncio
import inspect
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from sense4hri import intake
from sense4hri.errors import Refusal, Refused


class Calls:
    """post(function, *args): call it on the main thread. start(coroutine): run it there, beside main.

    soon(function): call it there before all that waits. refuse(name, kind, why): count a request that cannot be used,
    and say it.
    """

    def __init__(
        self,
        node: Node,
        loop: asyncio.AbstractEventLoop,
        post: Callable[..., None],
        start: Callable[[Coroutine[Any, Any, None]], object],
        refuse: Callable[[str, str, str], None],
        soon: Callable[[Callable[[], None]], object],
    ) -> None:
        self._node, self._loop, self._post, self._start, self._refuse = node, loop, post, start, refuse
        self._soon = soon

    def serve(self, kind: type, name: str, handler: Callable[[Any, Any], Any]) -> None:
        """Answer a ROS service with handler(request, response) -> response, run on the main thread.

        The handler may be a coroutine. Meanwhile the node hears and asks others.
        """

        def answer(request: Any, response: Any) -> "Future[Any]":
            return self.made(lambda: self._answered(kind, name, handler, request, response))

        self._node.create_service(kind, name, answer)

    async def ask(self, client: Client, request: Any, timeout_s: float) -> Any:
        """Return a ROS service's response, ahead of samples. Raises TimeoutError, also where nobody serves it."""
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
        pending.add_done_callback(lambda future: self._soon(lambda: settle(future.result())))
        try:
            async with asyncio.timeout(max(0.05, deadline - self._loop.time())):
                return await done
        except TimeoutError:
            client.remove_pending_request(pending)
            raise TimeoutError(f"{client.srv_name} did not answer within {max(timeout_s, 0.0):g} s") from None

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

    def _answered(self, kind: type, name: str, handler: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
        """Return the response, or a coroutine that will; of a request that is refused, the response with the reason."""

        def refused(err: Exception) -> Any:
            self._refuse(name, kind.__name__, str(err))
            if hasattr(response, "message"):
                response.message = str(err)
            return response

        async def later(work: Coroutine[Any, Any, Any]) -> Any:
            try:
                return await work
            except (Refused, Refusal, ValueError) as err:
                return refused(err)

        try:
            intake.check(request)
            made = handler(request, response)
        except (Refused, Refusal, ValueError) as err:
            return refused(err)
        return later(made) if inspect.iscoroutine(made) else made
