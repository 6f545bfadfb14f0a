"""The radio between a virtual device and the host: when a notification arrives, and whether it does."""

import asyncio
import logging
import math
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from bumble.core import BaseBumbleError

from sensor_bench.clock import HostClock

log = logging.getLogger(__name__)

QUEUE_PACKETS = 256
"""What the device can hold back while the link stalls; beyond it the oldest packet is thrown away."""


@dataclass
class LinkQuality:
    """Knobs of one link; all may change while it is up."""

    latency_s: float = 0.03
    """Delay of every packet beside its wait for a connection event."""
    jitter_s: float = 0.01
    """Mean of an exponentially distributed extra delay; packets never overtake one another."""
    connection_interval_s: float = 0.0
    """Packets arrive only on this grid of host time; 0 = at once."""
    loss: float = 0.0
    """Probability that the device throws a data frame away before it is sent."""


class Packet(NamedTuple):
    due_ns: int
    deliver: Callable[[], Awaitable[None]]
    on_lost: Callable[[], None]


class Radio:
    """One connection's way to the host: first in, first out, with delay, stall and loss."""

    def __init__(self, clock: HostClock, quality: LinkQuality, seed: int) -> None:
        self._clock = clock
        self.quality = quality
        self._rng = np.random.default_rng(seed)
        self._queue: deque[Packet] = deque()
        self._wake = asyncio.Event()
        self._worker: asyncio.Task[None] | None = None
        self._last_due_ns = 0
        self._stalled_until_ns = 0

    def open(self) -> None:
        self._last_due_ns = 0
        self._worker = asyncio.create_task(self._run())

    def close(self) -> None:
        """The link is gone; what was waiting is lost."""
        if self._worker is not None:
            self._worker.cancel()
            self._worker = None
        while self._queue:
            self._queue.popleft().on_lost()

    def stall(self, seconds: float) -> None:
        """Hold everything back that long, then deliver it in one burst."""
        self._stalled_until_ns = self._clock.now_ns() + round(seconds * 1e9)

    def send(
        self,
        deliver: Callable[[], Awaitable[None]],
        ready_ns: int,
        on_lost: Callable[[], None] = lambda: None,
        may_lose: bool = False,
    ) -> None:
        """Hand over a packet that is ready at `ready_ns` (host time, at most a moment ago)."""
        if self._worker is None or (may_lose and self._rng.random() < self.quality.loss):
            on_lost()
            return
        if len(self._queue) >= QUEUE_PACKETS:
            self._queue.popleft().on_lost()
        self._queue.append(Packet(self._due_ns(ready_ns), deliver, on_lost))
        self._wake.set()

    def _due_ns(self, ready_ns: int) -> int:
        quality = self.quality
        delay_s = quality.latency_s + (self._rng.exponential(quality.jitter_s) if quality.jitter_s > 0 else 0.0)
        due_ns = max(ready_ns + round(delay_s * 1e9), self._last_due_ns)
        if quality.connection_interval_s > 0:
            interval_ns = round(quality.connection_interval_s * 1e9)
            due_ns = math.ceil(due_ns / interval_ns) * interval_ns
        self._last_due_ns = due_ns
        return due_ns

    async def _run(self) -> None:
        while True:
            while not self._queue:
                self._wake.clear()
                await self._wake.wait()
            wait_ns = max(self._queue[0].due_ns, self._stalled_until_ns) - self._clock.now_ns()
            if wait_ns > 0:
                await asyncio.sleep(wait_ns * 1e-9)
                continue
            packet = self._queue.popleft()
            try:
                await packet.deliver()
            except BaseBumbleError as error:
                # the link went in this very moment
                log.info("packet not delivered: %r", error)
                packet.on_lost()
