"""A serial link: whatever it goes over, bytes come and go; whatever is wrong with it is said with what to do."""

import asyncio
import os
import socket
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from sense4hri import serial_port
from sense4hri.arrivals import Arrival, Arrivals, Silence
from sense4hri.chunk import Chunk
from sense4hri.device import Item, Samples
from sense4hri.errors import ConfigError, DeviceLost, FrameError
from sense4hri.serial_port import SerialPort, decoded, linked, wrong_with


class Other(NamedTuple):
    """The other end of a link: its address, a descriptor once the link is open, what ends it."""

    address: str
    fd: Callable[[], int]
    end: Callable[[], object]


def pty_end() -> Iterator[Other]:
    fd, own = os.openpty()
    yield Other(os.ttyname(own), lambda: fd, lambda: (os.close(own), os.close(fd)))


def socket_end(server: socket.socket, address: str) -> Iterator[Other]:
    peers: list[socket.socket] = []

    def fd() -> int:
        if not peers:
            peers.append(server.accept()[0])
        return peers[0].fileno()

    yield Other(address, fd, lambda: [each.close() for each in (*peers, server)])
    for each in (*peers, server):
        each.close()


@pytest.fixture(params=["pty", "unix", "tcp"])
def other(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Other]:
    """The other end of each kind of link."""
    if request.param == "pty":
        yield from pty_end()
    elif request.param == "unix":
        server = socket.socket(socket.AF_UNIX)
        server.bind(str(tmp_path / "box"))
        server.listen()
        yield from socket_end(server, str(tmp_path / "box"))
    else:
        server = socket.create_server(("127.0.0.1", 0))
        yield from socket_end(server, f"socket://127.0.0.1:{server.getsockname()[1]}")


def read_all(port: SerialPort, count: int) -> bytes:
    """What comes within two seconds, until it is so many bytes."""
    octets, end_s = b"", time.monotonic() + 2
    while len(octets) < count and time.monotonic() < end_s:
        octets += b"".join(each.value for each in port.read())
    return octets


def test_bytes_come_and_go_as_they_are(other: Other) -> None:
    """All 256 values pass in both directions, line ends and control characters among them; where none come, none."""
    every = bytes(range(256))
    port = SerialPort(other.address)
    fd = other.fd()
    assert port.read() == []
    os.write(fd, every)
    assert read_all(port, 256) == every
    port.write(every)
    assert os.read(fd, 1000) == every
    port.close()
    other.end()


def test_a_link_that_ends_is_a_lost_device(other: Other) -> None:
    """Unplugged, hung up or closed by the other side: DeviceLost with the address, for who reads and who writes."""
    port = SerialPort(other.address)
    other.fd()
    other.end()
    with pytest.raises(DeviceLost, match=r"unplugged|switched off|broke"):
        read_all(port, 1)
    with pytest.raises(DeviceLost, match=other.address):
        port.write(b"x" * 1_000_000)
    port.close()


def test_a_device_that_takes_no_more_is_lost(tmp_path: Path) -> None:
    """A command that cannot be sent ends after a second; it does not hold the driver."""
    server = socket.socket(socket.AF_UNIX)
    server.bind(str(tmp_path / "box"))
    server.listen()
    port = SerialPort(str(tmp_path / "box"))
    with pytest.raises(DeviceLost, match="takes no more bytes"):
        port.write(b"x" * 10_000_000)
    port.close()
    server.close()


def test_one_program_at_a_time() -> None:
    """The second driver of a port is told so; once the first has let go it may."""
    fd, own = os.openpty()
    first = SerialPort(os.ttyname(own))
    with pytest.raises(DeviceLost, match="in use by another program"):
        SerialPort(os.ttyname(own))
    first.close()
    SerialPort(os.ttyname(own)).close()
    os.close(fd)
    os.close(own)


def test_a_tty_is_raw_at_its_baud_rate() -> None:
    """Eight bits, no parity, no flow control, no echo, at the rate asked for."""
    fd, own = os.openpty()
    tty.setcbreak(own)
    port = SerialPort(os.ttyname(own), 57600)
    mode = termios.tcgetattr(own)
    assert (mode[4], mode[5]) == (termios.B57600, termios.B57600)
    assert mode[2] & termios.CSIZE == termios.CS8
    assert not mode[2] & (termios.PARENB | termios.CSTOPB | termios.CRTSCTS)
    assert not mode[3] & (termios.ECHO | termios.ICANON | termios.ISIG)
    port.close()
    os.close(fd)
    os.close(own)


def test_what_is_wrong_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No such port names those that are there; nobody who listens, a name that nobody knows and a file are named."""
    monkeypatch.setattr(serial_port, "ports", lambda: ["/dev/ttyACM3"])
    (tmp_path / "file").touch()
    stale = socket.socket(socket.AF_UNIX)
    stale.bind(str(tmp_path / "stale"))
    free = socket.create_server(("127.0.0.1", 0))
    said = {
        "/dev/ttyNO7": "no such port; there is /dev/ttyACM3",
        "/dev/rfcomm77": "no such port; pair the device, then: rfcomm bind /dev/rfcomm77 ITS-ADDRESS",
        str(tmp_path / "file"): "is no serial port",
        str(tmp_path / "stale"): "nobody listens there",
        f"socket://127.0.0.1:{free.getsockname()[1]}": "nobody listens there",
        "socket://no-such-name.invalid:1": "no computer of that name",
        "socket://lab..example:1": "no computer of that name",
        f"socket://{'x' * 64}:1": "no computer of that name",
        "socket://127.0.0.1:99999": "99999|0-65535",
    }
    free.close()
    stale.close()
    for address, why in said.items():
        with pytest.raises(DeviceLost, match=why):
            SerialPort(address)


@pytest.mark.parametrize("failure", [PermissionError(13, "Permission denied"), OSError(16, "Device or resource busy")])
def test_a_port_that_may_not_be_opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, failure: OSError) -> None:
    """The group that helps, or that somebody else has it."""

    def refuse(*_: object) -> int:
        raise failure

    (tmp_path / "tty").touch()
    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(DeviceLost, match=r"group dialout|in use by another program"):
        SerialPort(str(tmp_path / "tty"))


def test_a_kernel_without_bluetooth_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the kernel has no Bluetooth Classic the operator is told where it would work."""
    monkeypatch.setattr(serial_port, "_has_bluetooth", lambda: False)
    assert "no Bluetooth Classic" in wrong_with("rfcomm://00:11:22:33:44:55")
    with pytest.raises(DeviceLost, match="network_mode: host"):
        SerialPort("rfcomm://00:11:22:33:44:55/2")


def test_an_rfcomm_address_is_connected_to_its_channel(monkeypatch: pytest.MonkeyPatch) -> None:
    """The device and its channel, 1 where none is given."""
    asked: list[object] = []
    monkeypatch.setattr(serial_port, "_has_bluetooth", lambda: True)
    for name, value in {"AF_BLUETOOTH": socket.AF_UNIX, "BTPROTO_RFCOMM": 0}.items():
        monkeypatch.setattr(socket, name, value, raising=False)
    ends = [os.pipe() for _ in range(2)]
    monkeypatch.setattr(serial_port, "_connected", lambda link, to: asked.append(to) or link.close() or ends.pop()[0])
    for address in ("rfcomm://00:11:22:33:44:55", "rfcomm://00:11:22:33:44:55/12"):
        SerialPort(address).close()
    assert asked == [("00:11:22:33:44:55", 1), ("00:11:22:33:44:55", 12)]


def test_a_driver_that_is_stopped_lets_go(tmp_path: Path) -> None:
    """Opened and read beside an event loop that goes on; after the context the link is closed for the other side."""

    async def drive(address: str) -> bytes:
        async with linked(address) as (port, arrivals):
            port.write(b"i")
            return (await arrivals.get()).value

    server = socket.socket(socket.AF_UNIX)
    server.bind(str(tmp_path / "box"))
    server.listen()

    async def box() -> bytes:
        driving = asyncio.ensure_future(drive(str(tmp_path / "box")))
        peer = (await asyncio.to_thread(server.accept))[0]
        asked = await asyncio.to_thread(peer.recv, 10)
        peer.send(b"box 7")
        answered = await driving
        assert await asyncio.to_thread(peer.recv, 10) == b""
        peer.close()
        return asked + answered

    assert asyncio.run(box()) == b"ibox 7"
    server.close()


def test_what_comes_soon_after_comes_with_it_each_with_its_own_receipt(
    other: Other, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gathering spares the driver wake-ups; it does not move the time at which bytes came."""
    port = SerialPort(other.address)
    fd = other.fd()
    port.gather_s = 1.0
    os.write(fd, b"first")
    taken, sent_ns, arrived = threading.Event(), list[int](), port._arrived

    def arrived_and_said(wait_s: float) -> list[Arrival[bytes]]:
        came = arrived(wait_s)
        if came:
            taken.set()
        return came

    def send_once_the_first_was_taken() -> None:
        assert taken.wait(20)
        sent_ns.append(time.time_ns())
        os.write(fd, b"second")

    monkeypatch.setattr(port, "_arrived", arrived_and_said)
    sending = threading.Thread(target=send_once_the_first_was_taken)
    sending.start()
    came = port.read()
    sending.join()
    assert [each.value for each in came] == [b"first", b"second"]
    assert came[0].received_ns <= sent_ns[0] <= came[1].received_ns
    port.close()
    other.end()


def test_enough_is_handed_on_without_waiting_for_more(other: Other) -> None:
    """So many bytes as its driver needs come at once, however long it would have waited for them."""
    port = SerialPort(other.address)
    fd = other.fd()
    port.gather_s, port.enough = 3600.0, 5
    sending = threading.Thread(target=lambda: [os.write(fd, b"abc"), os.write(fd, b"defg")])
    sending.start()
    assert b"".join(each.value for each in port.read()).startswith(b"abcde")
    sending.join()
    port.close()
    other.end()


def test_what_came_before_the_link_was_lost_is_read_first(other: Other) -> None:
    """A device that says something and is gone is heard, then lost."""
    port = SerialPort(other.address)
    if other.address.startswith("/dev"):
        pytest.skip("a pty that is closed throws away what waits in it")
    os.write(other.fd(), b"last words")
    other.end()
    assert b"".join(each.value for each in port.read()) == b"last words"
    with pytest.raises(DeviceLost):
        port.read()
    port.close()


def test_a_baud_rate_that_no_tty_has_is_the_operators_and_told_with_those_there_are() -> None:
    fd, own = os.openpty()
    try:
        with pytest.raises(ConfigError, match=r"baud rate 250000: /dev/\S+ knows 50, 75, .*115200"):
            SerialPort(os.ttyname(own), 250000)
    finally:
        os.close(own)
        os.close(fd)


class Pairs:
    """Two bytes are a message; an odd one waits."""

    def __init__(self) -> None:
        self._waiting = b""

    @property
    def missing(self) -> int:
        return 2 - len(self._waiting)

    def items(self, arrival: Arrival[bytes]) -> Iterator[Item]:
        self._waiting += arrival.value
        if len(self._waiting) >= 2:
            yield from self.rest()

    def rest(self) -> Iterator[Item]:
        values, self._waiting = np.frombuffer(self._waiting, np.uint8)[:, None].astype(np.float64), b""
        if len(values):
            yield Samples("eda", Chunk(("eda",), values, None, 1))


class Errors(Pairs):
    """Every byte is an error."""

    def items(self, arrival: Arrival[bytes]) -> Iterator[Item]:
        yield FrameError(repr(arrival.value))


def test_a_device_is_decoded_to_its_last_byte() -> None:
    """A read is as long as a message needs it; what waits when the link is lost comes before the loss."""
    port, came, needed = SimpleNamespace(), [], []

    async def drive() -> None:
        arrivals = Arrivals[bytes]()
        arrivals.receive(b"\x01\x02\x03")
        arrivals.receive(b"\x04")
        async for item in decoded(port, arrivals, Pairs(), Silence(["frame"], 5.0)):
            needed.append(port.enough)
            came.append(item.chunk.samples[:, 0].tolist())
            if len(came) == 1:
                arrivals.fail(DeviceLost("unplugged"))

    with pytest.raises(DeviceLost, match="unplugged"):
        asyncio.run(drive())
    assert came == [[1.0, 2.0, 3.0], [4.0]]
    assert needed == [2, 1]


def test_samples_alone_end_a_silence() -> None:
    """A device that says things, and samples nothing, is silent."""

    async def drive() -> None:
        arrivals = Arrivals[bytes]()
        saying = asyncio.create_task(say(arrivals))
        try:
            async for _ in decoded(SimpleNamespace(), arrivals, Errors(), Silence(["frame"], 0.2)):
                pass
        finally:
            saying.cancel()

    with pytest.raises(DeviceLost, match=r"connected, but no frame for 0\.2 s"):
        asyncio.run(asyncio.wait_for(drive(), 20))


async def say(arrivals: Arrivals[bytes]) -> None:
    """Send a byte every 20 ms."""
    while True:
        arrivals.receive(b"?")
        await asyncio.sleep(0.02)
