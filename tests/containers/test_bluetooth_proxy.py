"""A driver behind the D-Bus proxy of a study with real sensors; the bus behind it is the sensor-bench's."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from docker_study import Study
from processes import wait_for

RAW = "/humans/physiological/p1/ecg/h10_1/raw"
ASK = """
import asyncio, sys
from dbus_fast import Message, MessageType
from dbus_fast.aio import MessageBus

async def main():
    bus = await MessageBus(bus_address="unix:path=/run/dbus/system_bus_socket").connect()
    async def call(to, interface, member, signature="", body=()):
        message = Message(destination=to, path="/", interface=interface, member=member)
        message.signature, message.body = signature, list(body)
        return await bus.call(message)
    if sys.argv[1] == "own":
        await call("org.freedesktop.DBus", "org.freedesktop.DBus", "RequestName", "su", ("org.example.secret", 0))
        print("owned", flush=True)
        await asyncio.sleep(60)
    names = (await call("org.freedesktop.DBus", "org.freedesktop.DBus", "ListNames")).body[0]
    print(sorted(name for name in names if name[0] != ":"))
    told = await call("org.example.secret", "org.freedesktop.DBus.Peer", "Ping")
    print(told.error_name if told.message_type == MessageType.ERROR else "it answered")

asyncio.run(main())
"""


@pytest.fixture(scope="module")
def study() -> Iterator[Study]:
    study = Study(str(Path(__file__).with_name("proxied_study.yaml")))
    try:
        study.start()
        yield study
    finally:
        study.remove()


@pytest.fixture
def secret(study: Study) -> Iterator[subprocess.Popen[str]]:
    """Somebody else's name on the bus behind the proxy."""
    wait_for(lambda: study.count(RAW), 90, f"{RAW} seen")
    owner = study.begin("sensor-bench", "python", "-c", ASK, "own")
    try:
        assert owner.stdout is not None
        assert owner.stdout.readline().strip() == "owned"
        yield owner
    finally:
        owner.kill()
        owner.wait(60)
        owner.communicate()


def test_a_driver_streams_through_the_proxy_and_sees_bluez_alone(study, secret):
    """A strap is found, connected and read through it; another name on the bus is neither listed nor reached."""
    behind = study.compose("exec", "-T", "sensor-bench", "python", "-c", ASK, "ask").splitlines()
    assert "org.example.secret" in behind[0]
    shown = study.compose("exec", "-T", "h10-1", "python", "-c", ASK, "ask").splitlines()
    assert shown == ["['org.bluez', 'org.freedesktop.DBus']", "org.freedesktop.DBus.Error.ServiceUnknown"]
    more = study.count(RAW) + 3
    wait_for(lambda: study.count(RAW) >= more, 60, "the strap goes on")
