"""How a BioHarness is reached: Bluetooth Classic, or whatever else is a serial link; the only place that opens one."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Protocol

from sense4hri.arrivals import Arrivals, from_thread
from sense4hri.serial_port import opened


class Port(Protocol):
    """What commands are written to."""

    def write(self, octets: bytes) -> None:
        """Send all of it. Raises DeviceLost."""


@asynccontextmanager
async def connect(port: str) -> AsyncIterator[tuple[Port, Arrivals[bytes]]]:
    """Open the link for the length of the context; give what commands are written to, and what comes."""
    async with opened(port) as link, from_thread(link.read) as arrivals:
        yield link, arrivals
