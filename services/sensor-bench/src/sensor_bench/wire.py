"""The wire between a virtual device and the host: a pseudo-terminal, a Unix socket or TCP, plugged in and out.

For the event loop that it is plugged in on. A socket holds the device up where the host does not read, as radio links
and networks do; a serial line has no such hold. Bytes that do not fit are lost, and counted.
"""

import asyncio
import os
import re
import socket
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

LONGEST_SOCKET_PATH = 100
ADDRESS = re.compile(r"(pty:)?/.+|socket://([^:/]+):([1-9]\d{0,4})")
ADDRESS_FORM = "a path (a Unix socket), pty:path or socket://host:port"
OCTETS = 4096
HELD_OCTETS = 1 << 20  # by a socket: minutes of a device


class Wire(ABC):
    """One end of a link; the other is the host's. received(octets) gets what the host writes."""

    held_octets = 0
    """What may wait for a host that does not read."""

    def __init__(self, received: Callable[[bytes], None]) -> None:
        self._received = received
        self._fd: int | None = None
        self._waiting = bytearray()
        self.connections_total = self.lost_octets_total = 0

    @property
    def connected(self) -> bool:
        """Whether somebody could hear."""
        return self._fd is not None

    @abstractmethod
    def plug(self) -> None:
        """Let the host connect."""

    @abstractmethod
    def unplug(self) -> None:
        """Vanish from the host."""

    def write(self, octets: bytes) -> None:
        """Send to the host, behind what waits for it; where too much waits the newest is lost, and counted."""
        if self._fd is not None:
            self._waiting += octets
            self._send(self._fd)

    def _send(self, fd: int) -> None:
        with suppress(OSError):
            del self._waiting[: os.write(fd, self._waiting)]
        if (lost := len(self._waiting) - self.held_octets) > 0:
            self.lost_octets_total += lost
            del self._waiting[-lost:]
        loop = asyncio.get_running_loop()
        if self._waiting:
            loop.add_writer(fd, self._send, fd)
        else:
            loop.remove_writer(fd)

    def drop(self) -> None:
        """End the link; the host may connect again."""
        if self._fd is not None:
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._fd)
            loop.remove_writer(self._fd)
            os.close(self._fd)
            self._fd = None
            self._waiting.clear()

    def _link(self, fd: int) -> None:
        os.set_blocking(fd, False)
        self._fd = fd
        self.connections_total += 1
        asyncio.get_running_loop().add_reader(fd, self._read)

    def _read(self) -> None:
        octets = b""
        with suppress(OSError):
            octets = os.read(self._fd or 0, OCTETS)
        if octets:
            self._received(octets)
        else:
            self.drop()


class Pty(Wire):
    """A pseudo-terminal, found under a path; nobody can tell whether its other end is open."""

    def __init__(self, path: Path, received: Callable[[bytes], None]) -> None:
        super().__init__(received)
        self._path, self._own_end = path, -1

    def plug(self) -> None:
        if self._fd is not None:
            return
        fd, self._own_end = os.openpty()
        tty.setraw(self._own_end)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        _clear(self._path)
        self._path.symlink_to(os.ttyname(self._own_end))
        self._link(fd)

    def unplug(self) -> None:
        self.drop()

    def drop(self) -> None:
        if self._fd is not None:
            self._path.unlink(missing_ok=True)
            os.close(self._own_end)
        super().drop()


class Listening(Wire):
    """A socket that takes one client at a time, as a serial port does."""

    held_octets = HELD_OCTETS

    def __init__(self, listen: Callable[[], socket.socket], received: Callable[[bytes], None]) -> None:
        super().__init__(received)
        self._listen = listen
        self._server: socket.socket | None = None

    def plug(self) -> None:
        if self._server is None:
            self._server = self._listen()
            self._server.setblocking(False)
            asyncio.get_running_loop().add_reader(self._server, self._accept)

    def unplug(self) -> None:
        self.drop()
        if self._server is not None:
            asyncio.get_running_loop().remove_reader(self._server)
            self._server.close()
            self._server = None

    def _accept(self) -> None:
        with suppress(OSError):
            client = (self._server or socket.socket()).accept()[0]
            if self.connected:
                client.close()
            else:
                self._link(client.detach())


def wire(at: str, received: Callable[[bytes], None]) -> Wire:
    """The wire with this address (see ADDRESS_FORM). Raises OSError when it is plugged in and cannot be."""
    if at.startswith("pty:"):
        return Pty(Path(at.removeprefix("pty:")), received)
    if at.startswith("socket:"):
        host, _, port = at.removeprefix("socket://").partition(":")
        return Listening(lambda: socket.create_server((host, int(port))), received)
    return Listening(lambda: _unix(Path(at)), received)


def _clear(path: Path) -> None:
    """Take away what an earlier run has left. Raises FileExistsError where it is a file of somebody's."""
    if path.is_symlink() or path.is_socket():
        path.unlink()
    elif path.exists():
        raise FileExistsError(f"{path} is there and no wire of a virtual device: it is left as it is")


def _unix(path: Path) -> socket.socket:
    """A socket at a path that whoever sees the path may open: drivers run under users of their own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    _clear(path)
    server = socket.socket(socket.AF_UNIX)
    server.bind(str(path))
    path.chmod(0o666)
    server.listen()
    return server
