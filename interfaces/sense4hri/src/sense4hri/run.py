"""A service from its start to a clean end: signals, parameters, node, main coroutine, exit status."""

import asyncio
import gc
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor
from functools import partial
from typing import TypeVar, TypeVarTuple

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from sense4hri import beats, parameters
from sense4hri.arrivals import in_thread
from sense4hri.errors import ConfigError
from sense4hri.memory import TRIM_EVERY_S, trim
from sense4hri.namesakes import LOOK_S
from sense4hri.service import Service
from sense4hri.version import software_version

EX_CONFIG = 78
STOP_TIMEOUT_S = 2.0
FEWER = ("--ros-args", "-p", "start_type_description_service:=false", "--")
"""Nobody asks for it, and every process of a study learns of its two endpoints; a study that says so has it."""
MOST_BLOCKING = 16  # functions at a time, each on a thread of its own
SETUP_TURNS = 3  # of the event loop, in which main comes to its first wait: nobody is answered before it is set up
Config = TypeVar("Config")
Result = TypeVar("Result")
Given = TypeVarTuple("Given")


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
    gc.freeze()  # what is imported stays: the search for garbage in it took a tenth of what a start and an end compute
    signal.signal(signal.SIGTERM, _stop_before_start)
    try:
        _begin_ros()
        with asyncio.Runner(loop_factory=_Loop) as runner:
            runner.run(_run(name, schema, main, node_name, stop_timeout_s))
    except ConfigError as err:
        print(f"{name}: configuration: {err}", file=sys.stderr, flush=True)
        return EX_CONFIG
    finally:
        try_shutdown()
    return 0


def _begin_ros() -> None:
    """Let ROS read its words. Raises ConfigError where it cannot: parameters or a file of them, or ROS_DOMAIN_ID."""
    try:
        rclpy.init(args=[*sys.argv[:1], *FEWER, *sys.argv[1:]], signal_handler_options=SignalHandlerOptions.NO)
    except RCLError as err:
        why, _, _ = str(err).removeprefix("failed to initialize rcl: ").partition(", at /")
        raise ConfigError(why) from err
    except UnknownROSArgsError as err:
        raise ConfigError(f"ROS does not know {err}") from err


class _Loop(asyncio.SelectorEventLoop):
    """At its end nobody waits for a function that still blocks, as asyncio would: a name is looked up for 20 s."""

    def __init__(self) -> None:
        super().__init__()
        self._few = asyncio.Semaphore(MOST_BLOCKING)

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[*Given], Result], *args: *Given
    ) -> asyncio.Future[Result]:
        """Return the future of what func(*args) returns."""
        if executor is not None:
            return super().run_in_executor(executor, func, *args)
        return self.create_task(self._in_thread(partial(func, *args)))

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        async with self._few:
            return await in_thread(work)


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
    node = rclpy.create_node(_final_name(name, schema, node_name), start_parameter_services=False)
    service = None
    try:
        about = ParameterDescriptor(description="version of the package", read_only=True)
        node.declare_parameter("software_version", software_version(name), about, ignore_override=True)
        config = parameters.load(node, schema)
        loop = asyncio.get_running_loop()
        service = Service(name, node, config, loop)
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, service.stopped.set)
        service.log.info(f"{node.get_name()} (process {os.getpid()}) shows its metrics on port {service.http.port}")
        await _main(service, main, stop_timeout_s)
    finally:
        if service is not None:
            service.close()
        node.destroy_node()


async def _main(
    service: Service[Config],
    main: Callable[[Service[Config]], Awaitable[None]],
    stop_timeout_s: float,
) -> None:
    work = asyncio.ensure_future(service.until_stopped(main(service)))
    stop = asyncio.ensure_future(service.stopped.wait())
    for _ in range(SETUP_TURNS):
        await asyncio.sleep(0)
    service.ros.start()
    if not service.http.held:
        service.http.all_served()
    service.thread("liveness", service.liveness.keep_asking)
    service.every(beats.EVERY_S, service.beat)
    service.every(LOOK_S, service.look_for_namesakes)
    service.every(TRIM_EVERY_S, trim)
    await asyncio.wait({work, stop}, return_when=asyncio.FIRST_COMPLETED)
    if told := stop.done():
        service.beat(ended=True)
    try:
        ended, _ = await asyncio.wait({work}, timeout=stop_timeout_s)
        if ended:
            await work  # raises what main raised, a TimeoutError too
        else:
            service.log.error(f"stopped before everything was finished: {stop_timeout_s} s were not enough")
            work.cancel()
    finally:
        stop.cancel()
        service.cancel()
    if not told:  # it has ended by itself, in order as well
        service.beat(ended=True)


def _final_name(name: str, schema: type[Config], node_name: Callable[[Config], str] | None) -> str:
    """Return the node's name; where it depends on parameters, a short-lived silent node reads them first."""
    if node_name is None:
        return name
    probe = rclpy.create_node(name, enable_rosout=False, start_parameter_services=False)
    try:
        return node_name(parameters.load(probe, schema))
    finally:
        probe.destroy_node()
