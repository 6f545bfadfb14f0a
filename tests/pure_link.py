"""A pure virtual device (`receive`, `send`) at the end of a link whose time is made up: ten minutes are a second."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Protocol

from sense4hri.arrivals import Arrival, Arrivals

IDLE_S = 0.001
START_NS = 1_700_000_000_000_000_000


class Pure(Protocol):
    """A device as the sensor-bench has them."""

    def receive(self, octets: bytes, time_s: float) -> bytes: ...

    def send(self, time_s: float) -> bytes: ...


class PureLink:
    """What the driver connects to; time goes on in steps of step_s while it sends;
    while it does not, in steps of idle_s, by default as always.

    spoil(octets): what arrives of what was sent. every(now_s): called at each step, for whoever wants to interfere.
    """

    def __init__(
        self,
        device: Pure,
        step_s: float = 0.05,
        idle_s: float = IDLE_S,
        spoil: Callable[[bytes], bytes] = lambda octets: octets,
        every: Callable[[float], None] = lambda now_s: None,
    ) -> None:
        self.device, self.now_s, self.on_s = device, 0.0, 0.0
        self.written: list[bytes] = []
        self._step_s, self._idle_s, self._spoil, self._every = step_s, idle_s, spoil, every
        self._arrivals: Arrivals[bytes] = Arrivals()

    def clock_ns(self) -> int:
        """The host's steady clock."""
        return round(self.now_s * 1e9)

    def write(self, octets: bytes) -> None:
        """The host's command; what was sent before comes before its answer."""
        self.written.append(octets)
        time_s = self.now_s - self.on_s
        self._arrive(self._spoil(self.device.send(time_s)) + self.device.receive(octets, time_s))

    @asynccontextmanager
    async def connect(self) -> AsyncIterator[tuple["PureLink", Arrivals[bytes]]]:
        """As a driver's transport connects."""
        self._arrivals = Arrivals()
        going = asyncio.create_task(self._go())
        try:
            yield self, self._arrivals
        finally:
            going.cancel()
            with suppress(asyncio.CancelledError):
                await going

    async def _go(self) -> None:
        while True:
            await asyncio.sleep(0)
            octets = self.device.send(self.now_s - self.on_s)
            if octets:
                self._arrive(self._spoil(octets))
                self.now_s += self._step_s
            else:  # it waits for a command: time is the driver's own
                await asyncio.sleep(IDLE_S if self._idle_s == IDLE_S else 0)
                self.now_s += self._idle_s
            self._every(self.now_s)

    def _arrive(self, octets: bytes) -> None:
        if octets:
            self._arrivals.put(Arrival(START_NS + self.clock_ns(), octets))
