"""sensor_bench.ble.patient_bus: what is sent faster than the bus takes it."""

import asyncio
import os
import signal
from pathlib import Path

from dbus_fast import Message
from dbus_fast.aio import MessageBus
from sensor_bench.ble import patient_bus
from sensor_bench.ble.bus import PrivateBus

SIGNALS = 2000
MATCH = Message(
    destination="org.freedesktop.DBus",
    path="/org/freedesktop/DBus",
    interface="org.freedesktop.DBus",
    member="AddMatch",
    signature="s",
    body=["type='signal',interface='test.Full'"],
)


def test_a_bus_that_takes_nothing_for_a_while_loses_nothing(tmp_path):
    """2 MB of signals to a daemon that stands still: the connection lasts, and all of them come, in order."""
    assert asyncio.run(received(tmp_path)) == list(range(SIGNALS))


async def received(folder: Path) -> list[int]:
    daemon = PrivateBus(folder / "bus")
    await daemon.start()
    try:
        got: list[int] = []
        listener = await MessageBus(bus_address=daemon.address).connect()
        listener.add_message_handler(lambda message: got.extend(message.body[:1]) if message.path == "/full" else None)
        await listener.call(MATCH)
        sender = await patient_bus.connect(daemon.address)
        assert daemon._process is not None
        os.kill(daemon._process.pid, signal.SIGSTOP)
        for number in range(SIGNALS):
            sender.send(Message.new_signal("/full", "test.Full", "Told", "us", [number, "x" * 1000]))
        os.kill(daemon._process.pid, signal.SIGCONT)
        assert sender.connected
        async with asyncio.timeout(60):
            while len(got) < SIGNALS:
                await asyncio.sleep(0.01)
        sender.disconnect()
        listener.disconnect()
        return got
    finally:
        await daemon.stop()
