"""Shell of every service: node, configuration, metrics, what runs beside main and how it fails.

asyncio runs on the main thread, rclpy on one thread of its own (`ros_thread`). ROS callbacks only hand over to one
queue (`inbox`); everything a service does happens on the main thread, in the order in which it came. Where any part of
a service fails, the whole service fails: the process ends with a traceback and is restarted.
"""

import asyncio
import contextlib
import faulthandler
import math
import os
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Collection, Coroutine, Iterable, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.client import Client
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from sense4hri import beats, diagnostics
from sense4hri.calls import Calls
from sense4hri.hearing import Hearing
from sense4hri.http import Http
from sense4hri.inbox import Inbox
from sense4hri.liveness import HUNG_S, Liveness, Pulse
from sense4hri.log import Log
from sense4hri.metrics import Metrics
from sense4hri.namesakes import Namesakes
from sense4hri.parameter_services import ParameterServices
from sense4hri.qos import HEALTH, deep, fitting
from sense4hri.refusals import Refusals
from sense4hri.ros_thread import RosThread
from sense4hri.topics import UNKNOWN_NODE, Changed, Graph, Watch
from sense4hri.version import software_version

HANDLER_TIMEOUT_S = 5.0
STOOD_S, HEAR_FIRST_S = 2.0, 1.5  # by so much too late, the process was stopped; then everybody has spoken once more
Config = TypeVar("Config")


class Service(Generic[Config]):
    """What a service's main coroutine gets: its node, configuration, metrics, HTTP port and the way to ROS."""

    def __init__(self, name: str, node: Node, config: Config, loop: asyncio.AbstractEventLoop) -> None:
        self.node, self.config, self.metrics = node, config, Metrics(name)
        self.log = Log(node.get_logger())
        self.stopped = asyncio.Event()
        self.graph = Graph(node)
        self.refusals = Refusals(self._count_refused, self._publishers, self.log.warning)
        self.ros = RosThread(
            node,
            self._fail_from_thread,
            lambda place, why: self.refuse(place, "unreadable", why),
            lambda: self._soon(self.graph.changed),
        )
        ParameterServices(node, lambda place, why: self.refuse(place, "parameters", why))
        self._loop, self._begun_s = loop, loop.time()
        self._failed: asyncio.Future[None] = loop.create_future()
        self._dropped = 0
        self._inbox = self._counted_inbox()
        self.metrics.gauge("ready", "1 where /readyz answers 200.").set_function(lambda: not self._missing)
        self._calls = Calls(node, loop, self.post, self.start, self.refuse, self._soon)
        self._tasks: set[asyncio.Task[None]] = set()
        self._subscriptions: set[Subscription] = set()
        self._looking: asyncio.Task[None] | None = None
        self._missing: tuple[str, ...] = ("the service has not said that it is ready",)
        self._why = ""
        self.liveness = Liveness({"the main thread": self._soon, "the ROS thread": self.ros.do}, self._end_hung)
        self.http = Http(
            name,
            software_version(name),
            self.metrics,
            self.on_main,
            silent=self.liveness.silent,
            missing=lambda: self._missing,
            warn=self.log.warning,
        )
        self.thread("http", self.http.serve)
        self._run, self._answered = f"{time.time_ns()}", False
        self._namesakes = Namesakes(node.get_name(), node.get_namespace())
        self._beats = self.publisher(DiagnosticArray, diagnostics.TOPIC, HEALTH)

    def look_for_namesakes(self) -> None:
        """Say in the log where another node has this one's name, for longer than one that was killed."""
        if told := self._namesakes.look(self.node.get_node_names_and_namespaces(), time.monotonic()):
            self.log.warning(told)

    def beat(self, ended: bool = False) -> None:
        """Say on `/diagnostics` that the service lives, or which of its threads does not; ended: that it ends."""
        silent = self.unanswered()
        trouble = f"no answer from {' and '.join(silent)}" if silent and not ended else ""
        missing = ": ".join(filter(None, ("; ".join(self._missing), self._why)))
        beat = beats.Beat(self.node.get_name(), self._run, trouble, ended, missing, self._dropped)
        self._beats.publish(diagnostics.message(beat))

    def unanswered(self) -> list[str]:
        """Return which threads have not answered for a while; none before each of them has answered once."""
        silent = self.liveness.silent(beats.UNANSWERED_S)
        self._answered = self._answered or not silent
        return silent if self._answered else []

    def ready(self, ready: bool = True, missing: str = "", why: str = "") -> None:
        """Say on `/readyz` whether the service does its work, and if not, what is missing: a sentence without names.

        why: said with it on the graph alone, for it may name a device.
        """
        self._missing = () if ready else (missing or "the service is not ready",)
        self._why = "" if ready else why

    def publisher(self, message: type, topic: str, qos: QoSProfile) -> Publisher:
        """Return a new publisher."""
        return self.node.create_publisher(message, topic, qos)

    def subscribe(
        self,
        message: type,
        topic: str,
        handler: Callable[..., None],
        qos: QoSProfile,
        *,
        raw: bool = False,
        keep: bool = False,
        with_info: bool = False,
        fit: bool = False,
        within_s: float = 0.0,
    ) -> Subscription:
        """Call handler(message) on the main thread for everything on topic that `intake` lets in.

        raw: the message is its CDR bytes, of which only length and stamps were checked; what else is wrong with it a
        FrameError of the handler says, and it is refused. Where the service falls behind, the oldest messages are
        dropped, except those of a latched topic (it is a state: a session's phase, an assignment) and those to keep.
        with_info: handler(message, info) with rclpy's dict of `received_timestamp`, `source_timestamp` (ns) and more.
        fit: ask for best effort where those who publish now offer no more. within_s: what comes may be handed over so
        much later, together with what else has come by then, which costs less.
        """
        if fit:
            qos = fitting(qos, [publisher.qos_profile for publisher in self.node.get_publishers_info_by_topic(topic)])

        hearing = Hearing(message, topic, handler, self.refuse, raw, with_info)
        droppable = not keep and qos.durability != DurabilityPolicy.TRANSIENT_LOCAL

        def handle(*taken: Any) -> None:
            if subscription in self._subscriptions:
                hearing.handle(*taken)

        guarded = self._guarded(handle)

        def put(cdr: bytes, info: dict[str, Any]) -> None:
            if taken := hearing.checked(cdr, info):
                self._inbox.put(guarded, *taken, droppable_bytes=len(cdr) if droppable else None)

        callback: Any = put  # rclpy counts a callback's arguments
        subscription = self.node.create_subscription(message, topic, callback, qos, raw=True)
        self._subscriptions.add(subscription)
        if within_s:
            self.ros.delay(subscription, within_s)
        return subscription

    def hear_diagnostics(self, handler: Callable[[DiagnosticArray], None]) -> Subscription:
        """Call handler(message) for what everybody says of itself on `/diagnostics`, all of HEARD_WITHIN_S together."""
        queue = deep(HEALTH)
        return self.subscribe(DiagnosticArray, diagnostics.TOPIC, handler, queue, within_s=beats.HEARD_WITHIN_S)

    def refuse(self, place: str, kind: str, why: str) -> None:
        """Count what somebody sent that cannot be used, and say it once; from any thread.

        place: the topic or ROS service. kind: for the metric: a message type or another word of this program's own.
        """
        self.refusals.add(place, kind, why)

    def unsubscribe(self, subscription: Subscription) -> None:
        """End a subscription; what is still waiting of it is not handled any more."""
        self._subscriptions.discard(subscription)
        self.node.destroy_subscription(subscription)

    def watch(
        self,
        globs: Iterable[str],
        changed: Changed,
        types: Collection[str] | None = None,
        exclude: Iterable[str] = (),
    ) -> Watch:
        """Have changed(topic) called whenever the publishers of a topic change; see `Graph.watch`."""
        if self._looking is None:
            self._looking = self.start(self.graph.keep_looking())
        return self.graph.watch(globs, changed, types, exclude)

    def look_every(self, seconds: float) -> None:
        """Look so often at a graph that changes all the time; for who must not miss what is new, more than others."""
        self.ros.tell_graph_every(seconds)

    def post(self, function: Callable[..., None], *args: Any) -> None:
        """Call function(*args) on the main thread, after what is waiting already; from any thread. Never dropped."""
        self._inbox.put(self._guarded(function), *args)

    def serve(self, kind: type, name: str, handler: Callable[[Any, Any], Any]) -> None:
        """Answer a ROS service with handler(request, response) -> response, run on the main thread; see `Calls`."""
        self._calls.serve(kind, name, handler)

    async def call(self, client: Client, request: Any, timeout_s: float) -> Any:
        """Return a ROS service's response. Raises TimeoutError, also where nobody serves it."""
        return await self._calls.ask(client, request, timeout_s)

    def every(self, seconds: float, function: Callable[[], None]) -> None:
        """Call function now, and every so many seconds of host time until the service stops.

        What has the same rhythm has the same beat, so that the process wakes up once for all of it. After a standstill
        of the whole process what has come meanwhile is heard first: nobody is judged by its age.
        """

        async def repeat() -> None:
            due = self._loop.time()
            while not self.stopped.is_set():
                function()
                due = max(_next_beat(self._begun_s, due, seconds), self._loop.time())
                await asyncio.sleep(due - self._loop.time())
                if self._loop.time() - due > STOOD_S:
                    await asyncio.sleep(HEAR_FIRST_S)

        self.start(repeat())

    def start(self, work: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        """Run a coroutine beside main; where it fails, the service fails."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def thread(self, name: str, work: Callable[[], None], pulse: Pulse | None = None) -> threading.Thread:
        """Run work() on a thread of its own; where it raises, the service fails. Returns the running thread.

        name: `top -H` and debuggers show its first 15 letters.
        pulse: work() lets it beat in each of its rounds, and the service fails as well where it no longer does.
        """
        told_as = f"the {name} thread"

        def run_and_tell() -> None:
            _show_name(name)
            try:
                work()
            except Exception as err:  # noqa: BLE001 - handed to until_stopped, which raises it
                self._fail_from_thread(err)
            finally:
                self.liveness.forget(told_as)

        if pulse is not None:
            self.liveness.watch(told_as, pulse.ask)
        thread = threading.Thread(target=run_and_tell, name=name, daemon=True)
        thread.start()
        return thread

    def on_main(self, function: Callable[[], Any]) -> Any:
        """Return function() made on the main thread, or what it returns as a coroutine; from another thread.

        Raises what it raises, or TimeoutError.
        """
        return self._calls.made(function).result(HANDLER_TIMEOUT_S)

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

    def close(self) -> None:
        """End the service's threads; nothing that still waits is handled."""
        self.liveness.close()
        self.http.close()
        self.ros.close()
        self._inbox.close()

    def _counted_inbox(self) -> Inbox:
        """Return the queue to the main thread, with what the metrics say of it."""
        dropped = self.metrics.counter("dropped_messages", "Messages dropped because the service fell behind.")

        def drop() -> None:
            dropped.inc()
            self._dropped += 1

        inbox = Inbox(self._loop, drop)
        self.metrics.counted("handled_calls", "Messages and other calls handled.", lambda: inbox.calls_total)
        self.metrics.counted("busy_seconds", "Time in which they were handled.", lambda: inbox.busy_s)
        waiting = self.metrics.gauge("waiting_calls", "Messages and other calls that wait to be handled.")
        waiting.set_function(lambda: inbox.waiting)
        return inbox

    def _ended(self, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (err := task.exception()) is not None:
            self._fail(err)

    def _fail(self, err: BaseException) -> None:
        if not self._failed.done():
            self._failed.set_exception(err)

    def _fail_from_thread(self, err: BaseException) -> None:
        self._soon(lambda: self._fail(err))

    def _soon(self, function: Callable[[], None]) -> None:
        """Have function called in the event loop's next round, before what waits in the inbox; from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed: the process is ending
            self._loop.call_soon_threadsafe(function)

    def _count_refused(self, kind: str) -> None:
        self.metrics.counter("refused_messages", "Messages and requests refused: not usable.", field=kind).inc()

    def _publishers(self, topic: str) -> list[str]:
        try:
            publishers = self.node.get_publishers_info_by_topic(topic)
        except (ValueError, InvalidHandle):  # a ROS service's name, or the node is going
            return []
        known = [each for each in publishers if each.node_name != UNKNOWN_NODE]
        return [f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in known]

    def _end_hung(self, names: Sequence[str]) -> None:
        """End a process that turns no more: nothing of it can be trusted to end it in order."""
        print(f"no answer from {', '.join(names)} for {HUNG_S:.0f} s: this process ends", file=sys.stderr, flush=True)
        faulthandler.dump_traceback()
        os._exit(1)

    def _guarded(self, function: Callable[..., None]) -> Callable[..., None]:
        """Return function with its failure made the service's failure: a handler never fails in silence."""

        def call(*args: Any) -> None:
            try:
                function(*args)
            except Exception as err:  # noqa: BLE001 - handed to until_stopped, which raises it
                self._fail(err)

        return call


def _next_beat(begun_s: float, now_s: float, seconds: float) -> float:
    """Return the next time after now_s that lies a multiple of so many seconds after begun_s."""
    return begun_s + (math.floor((now_s - begun_s) / seconds + 1e-6) + 1) * seconds


def _show_name(name: str) -> None:
    """Let the operating system know this thread by its name; only Linux has it as a file."""
    with contextlib.suppress(OSError):
        Path(f"/proc/self/task/{threading.get_native_id()}/comm").write_text(name)
