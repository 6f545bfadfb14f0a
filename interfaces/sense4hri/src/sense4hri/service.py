"""Shell of every service: node, configuration, metrics, a clean end.

asyncio runs on the main thread, the rclpy executor on one thread of its own. ROS callbacks only hand over to one
bounded queue; everything a service does happens on the main thread, in the order in which it came.
"""

import asyncio
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.client import Client
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.utilities import try_shutdown

from sense4hri import parameters
from sense4hri.errors import ConfigError
from sense4hri.http import Http
from sense4hri.metrics import Metrics
from sense4hri.version import software_version

EX_CONFIG = 78
STOP_TIMEOUT_S = 2.0
QUEUE_LENGTH = 20_000
HANDLER_TIMEOUT_S = 5.0
SETUP_TURNS = 3  # of the event loop, in which main comes to its first wait: nobody is answered before it is set up
Config = TypeVar("Config")


class Inbox:
    """A bounded queue from the ROS thread to the main thread; when full, the oldest entry is dropped and counted."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, on_drop: Callable[[], None], length: int = QUEUE_LENGTH
    ) -> None:
        self._loop, self._on_drop = loop, on_drop
        self._calls: deque[tuple[Callable[..., None], tuple[Any, ...]]] = deque()
        self._length, self._lock, self._woken = length, threading.Lock(), False

    def put(self, function: Callable[..., None], *args: Any) -> None:
        """Have function(*args) called on the main thread; from any thread."""
        with self._lock:
            if len(self._calls) >= self._length:
                self._calls.popleft()
                self._on_drop()
            self._calls.append((function, args))
            if self._woken:
                return
            self._woken = True
        try:
            self._loop.call_soon_threadsafe(self._work)
        except RuntimeError:  # the loop is closed: the process is ending
            return

    def _work(self) -> None:
        """Make what has been waiting for a moment, then let other tasks have their turn."""
        give_way_at = time.monotonic() + 0.02
        while time.monotonic() < give_way_at:
            with self._lock:
                if not self._calls:
                    self._woken = False
                    return
                function, args = self._calls.popleft()
            function(*args)
        self._loop.call_soon(self._work)


class Service(Generic[Config]):
    """What a service's main coroutine gets: its node, configuration, metrics, HTTP port and the way to ROS."""

    def __init__(
        self, node: Node, config: Config, metrics: Metrics, http: Http, loop: asyncio.AbstractEventLoop
    ) -> None:
        self.node, self.config, self.metrics, self.http = node, config, metrics, http
        self.log = node.get_logger()
        self.stopped = asyncio.Event()
        self._ready = False
        self._loop = loop
        self._failed: asyncio.Future[None] = loop.create_future()
        dropped = metrics.counter("dropped_messages", "Messages dropped because the service fell behind.")
        self._inbox = Inbox(loop, dropped.inc)
        self._tasks: set[asyncio.Task[None]] = set()

    def ready(self, ready: bool = True) -> None:
        """Say on `/readyz` whether the service does its work."""
        self._ready = ready

    def missing(self) -> tuple[str, ...]:
        """Return what the service still lacks to do its work."""
        return () if self._ready else ("the service has not said that it is ready",)

    def alive(self) -> bool:
        """Return whether the main thread answers; from another thread."""
        try:
            return bool(self.on_main(lambda: True))
        except TimeoutError:
            return False

    def publisher(self, message: type, topic: str, qos: QoSProfile) -> Publisher:
        """Return a new publisher."""
        return self.node.create_publisher(message, topic, qos)

    def subscribe(
        self, message: type, topic: str, handler: Callable[[Any], None], qos: QoSProfile, *, raw: bool = False
    ) -> Subscription:
        """Call handler(message) on the main thread for everything on topic; with raw the message is its CDR bytes."""
        guarded = self._guarded(handler)
        return self.node.create_subscription(message, topic, lambda m: self._inbox.put(guarded, m), qos, raw=raw)

    def unsubscribe(self, subscription: Subscription) -> None:
        """End a subscription; what it has delivered already is still handled."""
        self.node.destroy_subscription(subscription)

    def post(self, function: Callable[..., None], *args: Any) -> None:
        """Call function(*args) on the main thread, after what is waiting already; from any thread."""
        self._inbox.put(self._guarded(function), *args)

    def serve(self, kind: type, name: str, handler: Callable[[Any, Any], Any]) -> None:
        """Answer a ROS service with handler(request, response) -> response, run on the main thread."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return self.on_main(lambda: handler(request, response))
            except TimeoutError:
                self.log.error(f"{name}: no answer within {HANDLER_TIMEOUT_S:.0f} s")
                return response

        self.node.create_service(kind, name, answer)

    async def call(self, client: Client, request: Any, timeout_s: float) -> Any:
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
        pending.add_done_callback(lambda future: self._inbox.put(settle, future.result()))
        try:
            return await asyncio.wait_for(done, max(0.05, deadline - self._loop.time()))
        except TimeoutError:
            client.remove_pending_request(pending)
            raise TimeoutError(f"{client.srv_name} did not answer within {timeout_s} s") from None

    def every(self, seconds: float, function: Callable[[], None]) -> None:
        """Call function every so many seconds of host time until the service stops."""

        async def repeat() -> None:
            due = self._loop.time()
            while not self.stopped.is_set():
                function()
                due = max(due + seconds, self._loop.time())
                await asyncio.sleep(due - self._loop.time())

        self.start(repeat())

    def start(self, work: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        """Run a coroutine beside main; where it fails, the service fails."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def on_main(self, function: Callable[[], Any]) -> Any:
        """Return function() made on the main thread; from another thread. Raises what it raises, or TimeoutError."""
        result: Future[Any] = Future()

        def work() -> None:
            try:
                result.set_result(function())
            except ValueError as err:
                result.set_exception(err)

        self.post(work)
        return result.result(HANDLER_TIMEOUT_S)

    async def until_stopped(self, main: Awaitable[None]) -> None:
        """Wait for main; raise what main or any part of the service raised."""
        task = asyncio.ensure_future(main)
        await asyncio.wait({task, self._failed}, return_when=asyncio.FIRST_COMPLETED)
        if self._failed.done():
            task.cancel()
            await self._failed
        await task

    def cancel(self) -> None:
        """End what runs beside main."""
        for task in self._tasks:
            task.cancel()

    def _ended(self, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (err := task.exception()) is not None:
            self._fail(err)

    def _fail(self, err: BaseException) -> None:
        if not self._failed.done():
            self._failed.set_exception(err)

    def _guarded(self, function: Callable[..., None]) -> Callable[..., None]:
        """Return function with its failure made the service's failure: a handler never fails in silence."""

        def call(*args: Any) -> None:
            try:
                function(*args)
            except Exception as err:  # noqa: BLE001 - handed to until_stopped, which raises it
                self._fail(err)

        return call


def run(
    name: str,
    schema: type[Config],
    main: Callable[[Service[Config]], Awaitable[None]],
    *,
    node_name: Callable[[Config], str] | None = None,
    stop_timeout_s: float = STOP_TIMEOUT_S,
) -> int:
    """Run main until it returns or the process is told to stop; return the exit status.

    SIGTERM and SIGINT set `stopped`; main then has stop_timeout_s to return. A ConfigError is one line and status 78.
    """
    signal.signal(signal.SIGTERM, _stop_before_start)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        asyncio.run(_run(name, schema, main, node_name, stop_timeout_s))
    except ConfigError as err:
        print(f"{name}: configuration: {err}", file=sys.stderr, flush=True)
        return EX_CONFIG
    finally:
        try_shutdown()
    return 0


def _stop_before_start(number: int, frame: object) -> None:
    """End at once with status 0 where SIGTERM comes before there is anything to lose."""
    raise SystemExit(0)


async def _run(
    name: str,
    schema: type[Config],
    main: Callable[[Service[Config]], Awaitable[None]],
    node_name: Callable[[Config], str] | None,
    stop_timeout_s: float,
) -> None:
    loop = asyncio.get_running_loop()
    node = rclpy.create_node(_final_name(name, schema, node_name))
    executor = SingleThreadedExecutor()
    thread = threading.Thread(target=_spin, args=(executor,), name="ros", daemon=True)
    http = None
    try:
        about = ParameterDescriptor(description="version of the package", read_only=True)
        node.declare_parameter("software_version", software_version(name), about, ignore_override=True)
        config = parameters.load(node, schema)
        metrics = Metrics(name)
        calls: list[Service[Config]] = []
        http = Http(
            name,
            software_version(name),
            metrics,
            lambda function: calls[0].on_main(function),
            alive=lambda: calls[0].alive(),
            missing=lambda: calls[0].missing(),
            warn=node.get_logger().warning,
        )
        service = Service(node, config, metrics, http, loop)
        calls.append(service)
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, service.stopped.set)
        service.log.info(f"{node.get_name()} (process {os.getpid()}) shows its metrics on port {http.port}")
        executor.add_node(node)
        await _main(service, main, thread.start, stop_timeout_s)
    finally:
        executor.shutdown(timeout_sec=1.0)
        if thread.is_alive():
            thread.join(1.0)
        if http is not None:
            http.close()
        node.destroy_node()


async def _main(
    service: Service[Config],
    main: Callable[[Service[Config]], Awaitable[None]],
    spin: Callable[[], None],
    stop_timeout_s: float,
) -> None:
    work = asyncio.ensure_future(service.until_stopped(main(service)))
    stop = asyncio.ensure_future(service.stopped.wait())
    for _ in range(SETUP_TURNS):
        await asyncio.sleep(0)
    spin()
    await asyncio.wait({work, stop}, return_when=asyncio.FIRST_COMPLETED)
    try:
        await asyncio.wait_for(work, None if work.done() else stop_timeout_s)
    except TimeoutError:
        service.log.error(f"stopped before everything was finished: {stop_timeout_s} s were not enough")
    finally:
        stop.cancel()
        service.cancel()


def _final_name(name: str, schema: type[Config], node_name: Callable[[Config], str] | None) -> str:
    """Return the node's name; where it depends on parameters, a short-lived silent node reads them first."""
    if node_name is None:
        return name
    probe = rclpy.create_node(name, enable_rosout=False, start_parameter_services=False)
    try:
        return node_name(parameters.load(probe, schema))
    finally:
        probe.destroy_node()


def _spin(executor: SingleThreadedExecutor) -> None:
    """Serve ROS until the end; what the main thread destroys just before the executor waits for it is no failure."""
    while True:
        try:
            executor.spin()
            return
        except ExternalShutdownException:
            return
        except InvalidHandle:
            continue
