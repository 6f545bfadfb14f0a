"""From a device's library to its driver: what arrived, stamped, in order, with the failure last. Imports no ROS.

A library that calls back puts what comes into `Arrivals`; one that blocks (a vendor's SDK) is read by `from_thread`,
and opened by `in_thread`; one that gathers what it reads (a serial port), by `gathered_from_thread`. `Silence` notices
a device that is connected and sends nothing.
"""

import asyncio
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import asynccontextmanager
from typing import Any, Generic, NamedTuple, TypeVar

from sense4hri.errors import DeviceLost

LENGTH = 2000  # arrivals: minutes of a strap's notifications
ASLEEP_S, AWAKE_S = 0.5, 1.0  # a process that looks later than this was stopped; it then listens for so long first
CLOSE_S = 2.0  # within which a read must return once it is told to end
Value = TypeVar("Value")


class Arrival(NamedTuple, Generic[Value]):
    """One value, and the host's wall clock in ns when it came."""

    received_ns: int
    value: Value


class Arrivals(Generic[Value]):
    """What came, oldest first; a failure is read after everything that came before it. For the thread of its loop."""

    def __init__(self, length: int = LENGTH) -> None:
        self._waiting: deque[Arrival[Value]] = deque(maxlen=length)
        self._failure: Exception | None = None
        self._news = asyncio.Event()

    def receive(self, value: Value) -> None:
        """Stamp first, then queue. Where the queue is full the oldest goes, and shows as a gap in device time."""
        self.put(Arrival(time.time_ns(), value))

    def put(self, arrival: Arrival[Value]) -> None:
        """Queue what was stamped elsewhere; nothing comes after a failure."""
        if self._failure is not None:
            return
        self._waiting.append(arrival)
        self._news.set()

    def fail(self, err: Exception) -> None:
        """Let the reader fail with err once it has read everything; the first failure counts."""
        self._failure = self._failure or err
        self._news.set()

    async def get(self) -> Arrival[Value]:
        """Return the next arrival. Raises the failure, DeviceLost where the link was lost."""
        while not self._waiting:
            if self._failure is not None:
                raise self._failure
            self._news.clear()
            await self._news.wait()
        return self._waiting.popleft()

    async def together(self) -> list[Arrival[Value]]:
        """Return the next arrival and all that have come since: many are waited for once. Raises as `get` does."""
        came = [await self.get(), *self._waiting]
        self._waiting.clear()
        return came

    def __aiter__(self) -> "Arrivals[Value]":
        return self

    async def __anext__(self) -> Arrival[Value]:
        return await self.get()


class Silence:
    """Notices that one of several streams of a connected device has been silent for too long.

    streams: names of those that send all the time. limit_s: how long each may be silent, by its name where they
    differ. Counted from now on. A process that was stopped meanwhile first reads what has come: its own sleep is not
    the device's silence. clock_s: the clock of the event loop.
    """

    def __init__(
        self,
        streams: Iterable[str],
        limit_s: float | Mapping[str, float],
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._heard_s = dict.fromkeys(streams, clock_s())
        self._limits_s = limit_s if isinstance(limit_s, Mapping) else dict.fromkeys(self._heard_s, limit_s)
        self._clock_s = clock_s
        self._alarm_s = 0.0  # not before, by the monotonic clock

    def broken_by(self, stream: str) -> None:
        """Something came of this stream; of one that is not watched nothing is noted."""
        if stream in self._heard_s:
            self._heard_s[stream] = self._clock_s()

    async def watch(self, arrival: Awaitable[Value]) -> Value:
        """Return what is awaited. Raises DeviceLost where a stream stays silent for longer than its limit."""
        if not self._heard_s:
            return await arrival
        due_s, stream = min((heard_s + self._limits_s[each], each) for each, heard_s in self._heard_s.items())
        try:
            async with asyncio.timeout(None) as limit:
                with _Alarm(max(due_s, self._alarm_s), limit) as alarm:
                    return await arrival
        except TimeoutError as err:
            raise DeviceLost(f"connected, but no {stream} for {self._limits_s[stream]:g} s") from err
        finally:
            self._alarm_s = alarm.at_s


class _Alarm:
    """Ends a timeout at a moment of the monotonic clock; AWAKE_S later where nobody could look at that moment."""

    def __init__(self, at_s: float, limit: asyncio.Timeout) -> None:
        self._loop, self.at_s, self._limit = asyncio.get_running_loop(), at_s, limit

    def __enter__(self) -> "_Alarm":
        self._timer = self._loop.call_at(self.at_s, self._ring)
        return self

    def __exit__(self, *exc: object) -> None:
        self._timer.cancel()

    def _ring(self) -> None:
        if self._loop.time() > self.at_s + ASLEEP_S:
            self.at_s = self._loop.time() + AWAKE_S
            self._timer = self._loop.call_at(self.at_s, self._ring)
        else:
            self._limit.reschedule(self._loop.time())


async def in_thread(work: Callable[[], Value]) -> Value:
    """Return what a blocking function returns, or raise what it raises; the event loop goes on meanwhile.

    On a thread that nobody waits for when the driver is told to stop; those of a plain event loop are waited for.
    """
    done: Future[Value] = Future()
    done.set_running_or_notify_cancel()

    def run() -> None:
        try:
            done.set_result(work())
        except Exception as err:  # noqa: BLE001 - raised where it is awaited
            done.set_exception(err)

    threading.Thread(target=run, name="blocking", daemon=True).start()
    return await asyncio.wrap_future(done)


@asynccontextmanager
async def from_thread(
    read: Callable[[], Value | None], interrupt: Callable[[], object] = lambda: None, length: int = LENGTH
) -> AsyncIterator[Arrivals[Value]]:
    """Call a blocking read again and again in a thread of its own for the length of the context; give the arrivals.

    read: returns what came, stamped on its return, or None where nothing has come for a while. What it raises is raised
    where the arrivals are read, after everything read before: DeviceLost where the device went away, so that the kit
    tries again; anything else is a mistake in the driver and ends it. interrupt: called once when the context ends; it
    must make a waiting read return (`cancel_read` of pyserial), and is not needed where read waits for a while only.
    Close the port after the context. Raises RuntimeError where read has not returned CLOSE_S after the interrupt:
    nobody could open that port again.
    """

    def stamped() -> list[Arrival[Value]]:
        value = read()
        return [] if value is None else [Arrival(time.time_ns(), value)]

    async with gathered_from_thread(stamped, interrupt, length) as arrivals:
        yield arrivals


@asynccontextmanager
async def gathered_from_thread(
    read: Callable[[], Sequence[Arrival[Value]]], interrupt: Callable[[], object] = lambda: None, length: int = LENGTH
) -> AsyncIterator[Arrivals[Value]]:
    """As `from_thread`; read stamps what comes itself, and returns what came within a moment together.

    The event loop is woken once for all of it, which costs more than a read does.
    """
    reader = _Reader(read, asyncio.get_running_loop(), Arrivals[Value](length))
    reader.start()
    try:
        yield reader.arrivals
    finally:
        reader.ending.set()
        interrupt()
        await reader.gone()


class _Reader(Generic[Value]):
    """The thread that reads; `ending` tells it to read no more."""

    def __init__(
        self,
        read: Callable[[], Sequence[Arrival[Value]]],
        loop: asyncio.AbstractEventLoop,
        arrivals: Arrivals[Value],
    ) -> None:
        self.arrivals, self.ending = arrivals, threading.Event()
        self._read, self._loop, self._ended = read, loop, asyncio.Event()
        self._thread = threading.Thread(target=self._work, name="device", daemon=True)

    def start(self) -> None:
        self._thread.start()

    async def gone(self) -> None:
        try:
            async with asyncio.timeout(CLOSE_S):
                await self._ended.wait()
        except TimeoutError as err:
            raise RuntimeError(f"a blocking read has not returned {CLOSE_S:g} s after it was told to end") from err
        self._thread.join()  # what is left of it is its last line

    def _work(self) -> None:
        try:
            while not self.ending.is_set():
                if came := self._read():
                    self._tell(self._put, came)
        except Exception as err:  # noqa: BLE001 - raised where the arrivals are read
            self._tell(self.arrivals.fail, err)
        finally:
            self._tell(self._ended.set)

    def _put(self, came: Sequence[Arrival[Value]]) -> None:
        for arrival in came:
            self.arrivals.put(arrival)

    def _tell(self, function: Callable[..., None], *args: Any) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *args)
        except RuntimeError:  # the loop is closed: the process is ending
            return
