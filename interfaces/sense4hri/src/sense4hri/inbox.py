"""The queue between the thread that receives and the main thread that works. Pure.

Two kinds of calls wait in it. Samples may be dropped when the service has fallen behind for too long: what is lost is
counted. Everything else (a session's phase, an assignment, an answer to a call) is kept, whatever comes.
"""

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

MOST_SAMPLES = 20_000
MOST_BYTES = 32 << 20
TURN_S = 0.02


class _Call(NamedTuple):
    number: int
    function: Callable[..., None]
    args: tuple[Any, ...]
    size_bytes: int


class Inbox:
    """Calls to be made on the main thread, in the order in which they were put in; filled from any thread.

    At most `most_samples` calls that may be dropped wait, of `most_bytes` together; what is more pushes out the oldest
    of them, and for each on_drop() is called.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        on_drop: Callable[[], None],
        most_samples: int = MOST_SAMPLES,
        most_bytes: int = MOST_BYTES,
    ) -> None:
        self._loop, self._on_drop = loop, on_drop
        self._most_samples, self._most_bytes = most_samples, most_bytes
        self._bytes = 0  # of the samples that wait
        self._samples: deque[_Call] = deque()
        self._kept: deque[_Call] = deque()
        self._number = 0  # of the newest call, in the order of both queues together
        self._lock, self._scheduled, self._closed = threading.Lock(), False, False
        self.calls_total, self.busy_s = 0, 0.0
        """Calls made so far, and the time they took."""

    @property
    def waiting(self) -> int:
        """Calls that wait to be made."""
        return len(self._kept) + len(self._samples)

    def put(self, function: Callable[..., None], *args: Any, droppable_bytes: int | None = None) -> None:
        """Have function(*args) called on the main thread; from any thread.

        droppable_bytes: the size of a sample, which may be dropped; None for what is to be kept.
        """
        with self._lock:
            if self._closed:
                return
            self._number += 1
            call = _Call(self._number, function, args, droppable_bytes or 0)
            (self._kept if droppable_bytes is None else self._samples).append(call)
            self._bytes += call.size_bytes
            self._drop_oldest()
            if self._scheduled:
                return
            self._scheduled = True
        try:
            self._loop.call_soon_threadsafe(self._make_calls)
        except RuntimeError:  # the loop is closed: the process is ending
            return

    def close(self) -> None:
        """Make none of the waiting calls, nor any that comes: what they work on is being taken down."""
        with self._lock:
            self._closed = True
            self._samples.clear()
            self._kept.clear()
            self._bytes = 0

    def _drop_oldest(self) -> None:
        while len(self._samples) > self._most_samples or self._bytes > self._most_bytes:
            self._bytes -= self._samples.popleft().size_bytes
            self._on_drop()

    def _make_calls(self) -> None:
        """Make the waiting calls for at most TURN_S, so that other tasks of the main thread are not kept waiting.

        What is left after that is made in the event loop's next round.
        """
        begun_s = now_s = time.monotonic()
        while now_s < begun_s + TURN_S:
            call = self._next()
            if call is None:
                return
            call.function(*call.args)
            self.calls_total += 1
            self.busy_s += time.monotonic() - now_s
            now_s = time.monotonic()
        self._loop.call_soon(self._make_calls)

    def _next(self) -> _Call | None:
        """Take out the oldest call; None where nothing waits: the next `put` schedules the work again."""
        with self._lock:
            queues = [queue for queue in (self._kept, self._samples) if queue]
            if queues:
                call = min(queues, key=lambda queue: queue[0].number).popleft()
                self._bytes -= call.size_bytes
                return call
            self._scheduled = False
            return None
