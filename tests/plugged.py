"""A pure virtual device at a Unix socket, in real time, for unit tests of a driver's `stream`."""

import asyncio
import time
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from processes import DEADLINE_S
from sense4hri.arrivals import Arrival
from sense4hri.device import Item, Samples
from sense4hri.errors import DeviceLost
from sense4hri.serial_port import SerialPort
from sensor_bench.wire import Wire, wire
from sensor_bench.wired import Behind

TICK_S = 0.01


@asynccontextmanager
async def plugged(path: Path, device: Behind) -> AsyncIterator[Wire]:
    """The device behind the path, from the moment it is entered; time 0 is that moment."""
    begun_s = time.monotonic()

    def received(octets: bytes) -> None:
        link.write(device.receive(octets, time.monotonic() - begun_s))

    async def tick() -> None:
        while True:
            link.write(device.send(time.monotonic() - begun_s))
            await asyncio.sleep(TICK_S)

    link = wire(str(path), received)
    link.plug()
    ticking = asyncio.create_task(tick())
    try:
        yield link
    finally:
        ticking.cancel()
        link.unplug()


async def let_go(link: Wire) -> None:
    """Wait until the driver has closed its end; TimeoutError at the deadline."""
    async with asyncio.timeout(DEADLINE_S):
        while link.connected:
            await asyncio.sleep(TICK_S)


async def until_unplugged(path: Path, device: Behind, stream: AsyncGenerator[Item, None]) -> tuple[list[Item], bytes]:
    """What a driver makes of a device that is unplugged once some of its samples have come, and what that had sent."""
    items, sent = list[Item](), list[bytes]()

    def send(time_s: float) -> bytes:
        sent.append(device.send(time_s))
        return sent[-1]

    def pull() -> None:
        link.unplug()
        behind.send = lambda time_s: b""

    behind = SimpleNamespace(receive=device.receive, send=send)
    async with plugged(path, behind) as link:
        with suppress(DeviceLost):
            async for item in stream:
                items.append(item)
                if isinstance(item, Samples):
                    asyncio.get_running_loop().call_later(5 * TICK_S, pull)  # with a part of the next message
    return items, b"".join(sent)


async def wakes_per_message(
    monkeypatch: pytest.MonkeyPatch, stream: AsyncGenerator[Item, None], sensor_type: str
) -> float:
    """How often the link's thread hands bytes on while ten messages come, once two have."""
    read, handed = SerialPort.read, list[int]()

    def counted(port: SerialPort) -> list[Arrival[bytes]]:
        if came := read(port):
            handed.append(len(came))
        return came

    monkeypatch.setattr(SerialPort, "read", counted)
    messages = list[int]()
    while len(messages) < 12:
        item = await anext(stream)
        if isinstance(item, Samples) and item.sensor_type == sensor_type:
            messages.append(len(handed))
    await stream.aclose()
    return (messages[-1] - messages[1]) / 10
