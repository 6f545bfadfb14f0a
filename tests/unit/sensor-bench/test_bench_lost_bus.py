"""sensor_bench.bench: a connection to the bus that ends, with its daemon or while that lives."""

import asyncio
import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from dbus_fast import Message
from dbus_fast.aio import MessageBus
from sensor_bench.bench import Bench
from sensor_bench.config import parse

STRAP = """
participants: {p1: {}}
devices: [{sensor: h10_1, model: H10, participant: p1, address: "A0:9E:1A:00:00:01", device_id: 1A2B3C01}]
"""
OBJECTS = "org.freedesktop.DBus.ObjectManager"
DEADLINE_S = 30.0


def cut(bench: Bench) -> None:
    """End the bench's connection, as a daemon does that has had enough of it."""
    assert bench.bluez._bus is not None
    assert bench.bluez._bus._sock is not None
    bench.bluez._bus._sock.shutdown(socket.SHUT_RDWR)


def kill(bench: Bench) -> None:
    """End the daemon."""
    assert bench.bus._process is not None
    os.kill(bench.bus._process.pid, signal.SIGKILL)


@pytest.mark.parametrize("end", [cut, kill])
def test_a_bench_that_lost_its_bus_is_on_it_again(tmp_path: Path, end: Callable[[Bench], None]) -> None:
    """With its adapter, and again where it is lost once more; also where the daemon lived on."""
    asyncio.run(lost_and_back(tmp_path, end))


async def lost_and_back(folder: Path, end: Callable[[Bench], None]) -> None:
    bench = Bench(parse(STRAP), folder / "bus")
    await bench.start()
    keeping = asyncio.ensure_future(bench.keep_bus())
    try:
        for _ in range(2):
            assert "/org/bluez/hci0" in await objects(bench)
            end(bench)
            async with asyncio.timeout(DEADLINE_S):
                while await objects(bench):  # until it is noticed
                    await asyncio.sleep(0.01)
                while not await objects(bench):
                    await asyncio.sleep(0.05)
        assert "/org/bluez/hci0" in await objects(bench)
    finally:
        keeping.cancel()
        await bench.stop()


async def objects(bench: Bench) -> set[str]:
    """The paths that a client finds at `org.bluez` now; none where nobody has that name, or there is no bus."""
    try:
        client = await MessageBus(bus_address=bench.bus.address).connect()
        told = await client.call(
            Message(destination="org.bluez", path="/", interface=OBJECTS, member="GetManagedObjects")
        )
        client.disconnect()
    except (OSError, EOFError):
        return set()
    return set(told.body[0]) if told.body and isinstance(told.body[0], dict) else set()
