"""A serial link to a device: a tty, a Unix socket, TCP or Bluetooth Classic, under one address. Imports no ROS.

| address | what it is |
|---|---|
| `/dev/ttyUSB0`, `/dev/rfcomm0` | a serial port, also a pseudo-terminal |
| `/radio/box_1` | a Unix socket, where the path is one |
| `socket://host:port` | TCP: a serial server, ser2net |
| `rfcomm://AA:BB:CC:DD:EE:FF/1` | Bluetooth Classic, channel 1 unless given; the device has been paired |

`linked` connects and reads, for as long as its context lasts; `decoded` hands on what a driver makes of the bytes. What
goes wrong is DeviceLost and says what to do.
"""

import errno
import fcntl
import os
import re
import select
import socket
import stat
import termios
import time
import tty
from collections.abc import AsyncGenerator, AsyncIterator, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager, suppress
from glob import glob
from pathlib import Path
from typing import Protocol

from sense4hri.arrivals import Arrival, Arrivals, Silence, gathered_from_thread, in_thread
from sense4hri.device import Item, Samples
from sense4hri.errors import ConfigError, DeviceLost

READ_S = 0.1  # that a read waits at most
GATHER_S = 0.03  # in which bytes are handed on together, each read with its own receipt, unless a driver says more
WRITE_S = 1.0  # within which a command must be gone
CONNECT_S = 8.0  # Bluetooth pages a device for 5 s
OCTETS = 65536  # that a read returns at most
PORTS = ("/dev/serial/by-id/*", "/dev/ttyUSB*", "/dev/ttyACM*", "/dev/rfcomm*")
BAUD_RATES = {int(name[1:]): getattr(termios, name) for name in dir(termios) if re.fullmatch(r"B[1-9]\d*", name)}
_RFCOMM = re.compile(r"rfcomm://((?:[0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2})(?:/([1-9]|[12]\d|30))?")
_TCP = re.compile(r"socket://(\[[^\]]+\]|[^:/]+):([1-9]\d{0,4})")
ADDRESS = rf"/.+|{_TCP.pattern}|{_RFCOMM.pattern}"
ADDRESS_FORM = "a path, socket://host:port or rfcomm://AA:BB:CC:DD:EE:FF/channel"


_NO_BLUETOOTH = (
    "this kernel or container has no Bluetooth Classic: start it on the host's network (network_mode: host) of a "
    "computer with an adapter, or bind the device to /dev/rfcomm0 there and give that path"
)
_FORBIDDEN = "may not be opened by this user: add them to group dialout (sudo usermod -aG dialout NAME, log in again)"
_IN_USE = "in use by another program: end it, or give this driver a port of its own"
_EXPLAINED = {
    errno.EACCES: _FORBIDDEN,
    errno.EPERM: _FORBIDDEN,
    errno.EAGAIN: _IN_USE,  # the lock is another's
    errno.EBUSY: _IN_USE,
    errno.ENOTTY: "is no serial port",
    errno.EISDIR: "is no serial port",
    errno.EIO: "the device was unplugged or switched off",
    errno.ENODEV: "the device was unplugged",
    errno.ENXIO: "no device is behind this port",
    errno.ECONNREFUSED: "nobody listens there: is the device, or the server before it, switched on?",
    errno.EHOSTDOWN: "does not answer: is it switched on, near, and paired (bluetoothctl pair)?",
    errno.EHOSTUNREACH: "cannot be reached: is the address right, and the network or Bluetooth on?",
    errno.ENETUNREACH: "cannot be reached: this computer is in no network that leads there",
    errno.ECONNRESET: "the link broke",
    errno.EPIPE: "the link broke",
}


class Port(Protocol):
    """What commands are written to.

    gather_s: bytes that come within it are handed on together. enough: so many are, without waiting for more.
    """

    gather_s: float
    enough: int

    def write(self, octets: bytes) -> None:
        """Send all of it. Raises DeviceLost."""


class Decoder(Protocol):
    """What makes items of the bytes of one connection, and may let some of them wait for more."""

    @property
    def missing(self) -> int:
        """Bytes that complete what waits; as many as a read returns where nothing does."""

    def items(self, arrival: Arrival[bytes]) -> Iterator[Item]:
        """Yield what is complete."""

    def rest(self) -> Iterator[Item]:
        """Yield what waits for more, of a device that is gone."""


async def decoded(
    port: Port, arrivals: Arrivals[bytes], decoder: Decoder, silence: Silence, sends: str = "frame"
) -> AsyncGenerator[Item, None]:
    """Yield all that a device sends, until the link is lost: what waited for more, and then DeviceLost.

    sends: what silence calls that which comes with samples all the time.
    """
    while True:
        port.enough = decoder.missing
        try:
            came = await silence.watch(arrivals.together())
        except DeviceLost:
            for item in decoder.rest():
                yield item
            raise
        for arrival in came:
            for item in decoder.items(arrival):
                silence.broken_by(sends if isinstance(item, Samples) else "")
                yield item


Linked = AbstractAsyncContextManager[tuple[Port, Arrivals[bytes]]]
"""A link for the length of the context: what commands are written to, and what comes."""


@asynccontextmanager
async def linked(address: str, baud_rate: int = 115200) -> AsyncIterator[tuple["SerialPort", Arrivals[bytes]]]:
    """Open the link and read it on a thread of its own, for the length of the context. Raises DeviceLost."""
    port = await in_thread(lambda: SerialPort(address, baud_rate))
    try:
        async with gathered_from_thread(port.read) as arrivals:
            yield port, arrivals
    finally:
        port.close()


class SerialPort:
    """One open link, which no other program that asks may open at the same time.

    baud_rate: of a tty, 8 data bits, no parity, 1 stop bit, no flow control; of no meaning to the others.
    Raises DeviceLost where it cannot be opened now, ConfigError where a tty never runs at this rate.
    """

    def __init__(self, address: str, baud_rate: int = 115200) -> None:
        self.address, self.gather_s, self.enough = address, GATHER_S, OCTETS
        with _explained(address):
            self._fd = _open(address, baud_rate)

    def read(self) -> list[Arrival[bytes]]:
        """Wait a moment for bytes; return them with what comes in the next gather_s, each read as it came.

        Nothing comes: an empty list. Raises DeviceLost, after what came before it.
        """
        came = self._arrived(READ_S)
        begun_s, octets = time.monotonic(), sum(len(each.value) for each in came)
        with suppress(DeviceLost):  # the next read finds it again
            while 0 < octets < self.enough and (left_s := begun_s + self.gather_s - time.monotonic()) > 0:
                more = self._arrived(left_s)
                came, octets = came + more, octets + sum(len(each.value) for each in more)
        return came

    def _arrived(self, wait_s: float) -> list[Arrival[bytes]]:
        """Return what comes next, none where nothing comes in time. Raises DeviceLost."""
        with _explained(self.address):
            try:
                octets = os.read(self._fd, OCTETS) if select.select([self._fd], [], [], wait_s)[0] else None
            except BlockingIOError:  # somebody else has read it
                octets = None
        if octets == b"":
            raise DeviceLost(f"{self.address}: hung up; the device was switched off or unplugged")
        return [] if octets is None else [Arrival(time.time_ns(), octets)]

    def write(self, octets: bytes) -> None:
        """Send all of it. Raises DeviceLost, also where the device takes no more for a second."""
        end_s = time.monotonic() + WRITE_S
        with _explained(self.address):
            while octets:
                if not select.select([], [self._fd], [], max(0.0, end_s - time.monotonic()))[1]:
                    raise DeviceLost(f"{self.address}: takes no more bytes")
                octets = octets[os.write(self._fd, octets) :]

    def close(self) -> None:
        """Let go of the link."""
        os.close(self._fd)


def ports() -> list[str]:
    """Return the serial ports of this machine, by the names that stay with a device first."""
    return [path for pattern in PORTS for path in sorted(glob(pattern))]


def wrong_with(address: str) -> str:
    """Return why a link cannot be opened, as far as it shows without opening it; empty where nothing is seen."""
    if address.startswith("rfcomm:"):
        return "" if hasattr(socket, "AF_BLUETOOTH") and _has_bluetooth() else _NO_BLUETOOTH
    if address.startswith("socket:"):
        return ""
    if not Path(address).exists():
        return f"no such port; {_there(address)}"
    return "" if os.access(address, os.R_OK | os.W_OK) else _FORBIDDEN


def _open(address: str, baud_rate: int) -> int:
    """Return the file descriptor, which never waits. Raises OSError, DeviceLost, ConfigError."""
    if found := _RFCOMM.fullmatch(address):
        if wrong := wrong_with(address):
            raise DeviceLost(f"{address}: {wrong}")
        link = socket.socket(socket.AF_BLUETOOTH, socket.SOCK_STREAM, socket.BTPROTO_RFCOMM)
        return _connected(link, (found[1], int(found[2] or 1)))
    if found := _TCP.fullmatch(address):
        link = socket.create_connection((found[1].strip("[]"), int(found[2])), CONNECT_S)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return _never_waiting(link)
    if stat.S_ISSOCK(os.stat(address).st_mode):
        return _connected(socket.socket(socket.AF_UNIX), address)
    return _tty(address, baud_rate)


def _connected(link: socket.socket, to: tuple[str, int] | str) -> int:
    link.settimeout(CONNECT_S)
    try:
        link.connect(to)
    except OSError:
        link.close()
        raise
    return _never_waiting(link)


def _never_waiting(link: socket.socket) -> int:
    link.setblocking(False)
    return link.detach()


def _tty(path: str, baud_rate: int) -> int:
    """Open a serial port raw and for this program alone. Raises OSError, ConfigError."""
    if baud_rate not in BAUD_RATES:
        raise ConfigError(f"baud rate {baud_rate}: {path} knows {', '.join(map(str, sorted(BAUD_RATES)))}")
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(
            fd, fcntl.LOCK_EX | fcntl.LOCK_NB
        )  # as pyserial asks for it; gone with the program, however it ends
        tty.setraw(fd)
        mode = termios.tcgetattr(fd)
        mode[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
        mode[4] = mode[5] = BAUD_RATES[baud_rate]
        termios.tcsetattr(fd, termios.TCSANOW, mode)
        termios.tcflush(fd, termios.TCIOFLUSH)
    except termios.error as err:
        os.close(fd)
        raise OSError(*err.args) from err
    except OSError:
        os.close(fd)
        raise
    return fd


def _has_bluetooth() -> bool:
    try:
        socket.socket(socket.AF_BLUETOOTH, socket.SOCK_STREAM, socket.BTPROTO_RFCOMM).close()
    except OSError:
        return False
    return True


@contextmanager
def _explained(address: str) -> Iterator[None]:
    """Turn every way a link fails into DeviceLost that says what to do."""
    try:
        yield
    except TimeoutError as err:
        raise DeviceLost(f"{address}: no answer: is it switched on and near?") from err
    except socket.gaierror as err:
        raise DeviceLost(f"{address}: no computer of that name is known ({err.strerror})") from err
    except UnicodeError as err:  # a part of the name is empty or longer than 63 characters
        raise DeviceLost(f"{address}: no computer of that name can be ({err})") from err
    except FileNotFoundError as err:
        raise DeviceLost(f"{address}: no such port; {_there(address)}") from err
    except OverflowError as err:
        raise DeviceLost(f"{address}: {err}") from err
    except OSError as err:
        raise DeviceLost(f"{address}: {_EXPLAINED.get(err.errno or 0, err.strerror or str(err))}") from err


def _there(address: str) -> str:
    if address.startswith("/dev/rfcomm"):
        return f"pair the device, then: rfcomm bind {address} ITS-ADDRESS"
    found = ", ".join(ports())
    return f"there is {found}" if found else "plug it in; this computer or container has no serial port now"
