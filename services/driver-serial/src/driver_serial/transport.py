"""The link to a board: opened, started and stopped as its description says."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from sense4hri.arrivals import Arrivals
from sense4hri.errors import DeviceLost
from sense4hri.serial_port import SerialPort, linked

from driver_serial.description import ONE_BYTE_EACH, Description


@asynccontextmanager
async def connected(address: str, described: Description) -> AsyncIterator[tuple[SerialPort, Arrivals[bytes]]]:
    """Open the link and start the board for the length of the context; give what arrives. Raises DeviceLost."""
    async with linked(address, described.baud_rate) as (port, arrivals):
        await asyncio.sleep(described.start_after_s)
        port.write(described.start.encode(ONE_BYTE_EACH))
        try:
            yield port, arrivals
        finally:
            with suppress(DeviceLost):
                port.write(described.stop.encode(ONE_BYTE_EACH))
