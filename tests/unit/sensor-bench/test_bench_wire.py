"""A virtual device behind a wire: its bytes reach whoever opens the port, and all that happens to real ones happens."""

import asyncio
import os
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from sense4hri.errors import DeviceLost
from sense4hri.serial_port import SerialPort
from sensor_bench.ble.radio import LinkQuality
from sensor_bench.clock import HostClock
from sensor_bench.room import Participant, Room
from sensor_bench.signals.hearts import Heart
from sensor_bench.wire import HELD_OCTETS, wire
from sensor_bench.wired import Behind, Frames, WireDevice, WireKeys

SOON_S = 5.0


class Ticker:
    """Sends a line for each tenth of a second since it was switched on; answers what it is asked, in capitals."""

    def __init__(self, frames: Frames) -> None:
        self._frames, self._sent = frames, 0

    def receive(self, octets: bytes, time_s: float) -> bytes:
        return octets.upper()

    def send(self, time_s: float) -> bytes:
        due, self._sent = range(self._sent, int(time_s * 10)), max(self._sent, int(time_s * 10))
        return b"".join(self._frames.carry(b"%d\n" % number, tick=1) for number in due)


class Toy(WireDevice):
    """The ticker on a wire."""

    def power_on(self, on_s: float) -> Behind:
        return Ticker(self.frames)


@asynccontextmanager
async def toy(at: str, **keys: Any) -> AsyncIterator[Toy]:
    """One on a wire, without delay."""
    host = HostClock()
    nothing: Any = None
    room = Room({"p1": Participant()}, 1, host, host.now_ns(), nothing, nothing, {"p1": Heart(1)})
    device = Toy(room, WireKeys(sensor="toy", model="Toy", participant="p1", at=at, link=LinkQuality(0, 0), **keys))
    await device.start()
    try:
        yield device
    finally:
        await device.stop()


async def until(true: Callable[[], Any]) -> Any:
    """Wait until it is true."""
    async with asyncio.timeout(SOON_S):
        while not (found := true()):
            await asyncio.sleep(0.005)
    return found


async def read_until(port: SerialPort, wanted: bytes) -> bytes:
    """What comes, until the wanted bytes are among it."""
    octets = b""
    async with asyncio.timeout(SOON_S):
        while wanted not in octets:
            octets += b"".join(each.value for each in await asyncio.to_thread(port.read))
    return octets


async def opened(address: str) -> SerialPort:
    return await asyncio.to_thread(SerialPort, address)


@pytest.mark.parametrize("kind", ["unix", "pty", "tcp"])
def test_a_driver_hears_and_asks(tmp_path: Path, kind: str) -> None:
    """What the device sends comes through any wire, and what is written is answered; GET /devices says who is there."""
    at, address = {
        "unix": (f"{tmp_path}/box", f"{tmp_path}/box"),
        "pty": (f"pty:{tmp_path}/tty", f"{tmp_path}/tty"),
        "tcp": ("socket://127.0.0.1:28917", "socket://127.0.0.1:28917"),
    }[kind]

    async def go() -> None:
        async with toy(at) as device:
            port = await opened(address)
            port.write(b"hello")
            heard = await read_until(port, b"HELLO") + await read_until(port, b"9\n")
            whole, _, _ = heard.replace(b"HELLO", b"").rpartition(b"\n")
            numbers = [int(line) for line in whole.split()]
            assert numbers == list(range(numbers[0], numbers[-1] + 1))
            assert numbers[-1] >= 9
            assert device.shown().connected
            port.close()

    asyncio.run(go())


def test_a_port_is_one_driver_s(tmp_path: Path) -> None:
    """A second one is hung up on while the first goes on; after it has left there is room again."""

    async def go() -> None:
        async with toy(f"{tmp_path}/box") as device:
            first = await opened(f"{tmp_path}/box")
            await until(lambda: device.shown().connected)
            second = await opened(f"{tmp_path}/box")
            with pytest.raises(DeviceLost):
                await read_until(second, b"never")
            await read_until(first, b"\n")
            first.close()
            await until(lambda: not device.shown().connected)
            third = await opened(f"{tmp_path}/box")
            await read_until(third, b"\n")
            second.close()
            third.close()
            assert device.happened(0, 1.0).connections_total == 2

    asyncio.run(go())


@pytest.mark.parametrize("at", ["box", "pty:tty"])
def test_unplugged_the_device_goes_on_switched_off_it_begins_anew(tmp_path: Path, at: str) -> None:
    """The port goes away and comes back; the ticks go on after the one, and begin at 0 after the other."""
    kind, _, path = at.rpartition(":")
    path = f"{tmp_path}/{path}"

    async def go() -> None:
        async with toy(f"{kind}:{path}" if kind else path) as device:
            for knob, begins in (("unplugged", False), ("down", True)):
                port = await opened(path)
                await read_until(port, b"4\n")
                device.turns()[knob](True)
                with pytest.raises(DeviceLost):
                    await read_until(port, b"never")
                port.close()
                with pytest.raises(DeviceLost):
                    await opened(path)
                device.turns()[knob](False)
                port = await opened(path)
                first = int((await read_until(port, b"\n")).split()[0])
                assert (first < 4) == begins, (knob, first)
                port.close()

    asyncio.run(go())


def test_a_reset_button_leaves_the_link(tmp_path: Path) -> None:
    """After a restart the ticks begin at 0 on the same link."""

    async def go() -> None:
        async with toy(f"{tmp_path}/box") as device:
            port = await opened(f"{tmp_path}/box")
            await read_until(port, b"2\n")
            device.turns()["restart"](True)
            ticks = [int(line) for line in (await read_until(port, b"\n1\n")).split()]
            assert 0 in ticks
            assert device.restarts == 1
            port.close()

    asyncio.run(go())


def test_what_is_lost_is_counted() -> None:
    """Of a thousand frames of three samples what is carried and what is lost is a thousand, to the sample."""
    frames = Frames(7, loss=0.1)
    carried = sum(bool(frames.carry(b"frame", ecg=3)) for _ in range(1000))
    counts = frames.counts["ecg"]
    assert (counts.frames_sent, counts.samples_sent) == (carried, 3 * carried)
    assert (counts.frames_lost, counts.samples_lost) == (1000 - carried, 3 * (1000 - carried))
    assert 60 < counts.frames_lost < 140
    frames.linked = False
    assert frames.carry(b"frame", ecg=3) == b""


def test_a_host_that_does_not_read_holds_a_socket_up_and_loses_nothing(tmp_path: Path) -> None:
    """More than the kernel takes waits for the host, and comes whole and in order once it reads."""

    async def go() -> None:
        end = wire(f"{tmp_path}/box", lambda octets: None)
        end.plug()
        port = await opened(f"{tmp_path}/box")
        await until(lambda: end.connected)
        sent = b"".join(number.to_bytes(4, "big") for number in range(200_000))
        for at in range(0, len(sent), 10_000):
            end.write(sent[at : at + 10_000])
        heard = bytearray()
        async with asyncio.timeout(SOON_S):
            while len(heard) < len(sent):
                heard += b"".join(each.value for each in await asyncio.to_thread(port.read))
        assert heard == sent
        assert end.lost_octets_total == 0
        port.close()
        end.unplug()

    asyncio.run(go())


@pytest.mark.parametrize(("at", "most"), [("pty:{}", 0), ("{}", HELD_OCTETS)])
def test_what_a_host_never_reads_is_lost_and_counted(tmp_path: Path, at: str, most: int) -> None:
    """What the host can still read and what is counted as lost is all that was sent, to the byte."""

    async def go() -> None:
        end = wire(at.format(tmp_path / "box"), lambda octets: None)
        end.plug()
        fd = port = None
        if most:
            port = await opened(f"{tmp_path}/box")
        else:
            fd = os.open(tmp_path / "box", os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        await until(lambda: end.connected)
        sent = most + 1_000_000
        for _ in range(sent // 1000):
            end.write(bytes(range(200)) * 5)
        sent -= sent % 1000
        lost = end.lost_octets_total
        assert 0 < lost < sent
        heard = 0
        async with asyncio.timeout(SOON_S):
            while heard < sent - lost:
                if port:
                    heard += sum(len(each.value) for each in await asyncio.to_thread(port.read))
                else:
                    with suppress(BlockingIOError):
                        heard += len(os.read(fd or 0, 65536))
        assert heard == sent - lost
        assert end.lost_octets_total == lost
        end.unplug()
        port.close() if port else os.close(fd or 0)

    asyncio.run(go())


def test_what_the_host_did_not_take_is_among_what_happened(tmp_path: Path) -> None:
    """GET /truth tells of it: the frames were sent, their bytes did not arrive."""

    async def go() -> None:
        async with toy(f"pty:{tmp_path}/tty") as device:
            device.behind.receive = lambda octets, time_s: bytes(1_000_000)  # type: ignore[method-assign]
            port = await opened(f"{tmp_path}/tty")
            port.write(b"all")
            await until(lambda: device.happened(0, 1.0).octets_lost)
            port.close()

    asyncio.run(go())


def test_spoilt_bytes_differ_in_one_bit(tmp_path: Path) -> None:
    """With byte_errors 1 each byte that arrives is another one, by one bit."""

    async def go() -> None:
        async with toy(f"{tmp_path}/box", byte_errors=1.0) as device:
            port = await opened(f"{tmp_path}/box")
            await until(lambda: device.shown().connected)
            device.behind = Ticker(Frames(1, loss=1.0))  # nothing but the answer
            port.write(b"\0" * 50)
            octets = b""
            while len(octets) < 50:
                octets += b"".join(each.value for each in await asyncio.to_thread(port.read))
            assert all(each.bit_count() == 1 for each in octets[-50:])
            port.close()

    asyncio.run(go())


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [({"at": "ttyS0"}, "at: 'ttyS0' is not a path"), ({"at": "/box", "byte_errors": 2.0}, "byte_errors: 2.0 is not")],
)
def test_what_cannot_be_a_wire_is_named(keys: dict[str, Any], wrong: str) -> None:
    """The key and what it must be."""
    with pytest.raises(ValueError, match=wrong):
        WireKeys(sensor="toy", model="Toy", participant="p1", **keys).check()


@pytest.mark.parametrize("form", ["{}", "pty:{}"])
def test_a_wire_takes_no_file_of_somebody_s_away(tmp_path, form):
    """An address by mistake costs no data: refused, and the file is as it was."""
    (tmp_path / "data.csv").write_text("mine")
    with pytest.raises(FileExistsError, match="no wire of a virtual device"):
        wire(form.format(tmp_path / "data.csv"), lambda octets: None).plug()
    assert (tmp_path / "data.csv").read_text() == "mine"
