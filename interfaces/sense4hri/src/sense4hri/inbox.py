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
TURN_S = 0.02


class _Call(NamedTuple):
    number: int
    function: Callable[..., None]
    args: tuple[Any, ...]


class Inbox:
    """Calls to be made on the main thread, in the order in which they were put in; filled from any thread.

    At most `most_samples` droppable calls wait; one more pushes out the oldest of them, and on_drop() is called.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, on_drop: Callable[[], None], most_samples: int = MOST_SAMPLES
    ) -> None:
        self._loop, self._on_drop, self._most_samples = loop, on_drop, most_samples
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

    def put(self, function: Callable[..., None], *args: Any, droppable: bool = False) -> None:
        """Have function(*args) called on the main thread; from any thread."""
        with self._lock:
            if self._closed:
                return
            self._number += 1
            (self._samples if droppable else self._kept).append(_Call(self._number, function, args))
            if len(self._samples) > self._most_samples:
                self._samples.popleft()
                self._on_drop()
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
                return min(queues, key=lambda queue: queue[0].number).popleft()
            self._scheduled = False
            return None
