"""A TCP connection that may be read late: the kernel stamps what comes (Linux, socket(7), SO_TIMESTAMPNS)."""

import asyncio
import socket
import struct
import time
from contextlib import suppress

from sense4hri.stamps import SECOND_NS

SO_TIMESTAMPNS = 35  # Python's socket module does not name it; it is the kind of what is told, too
TIME = struct.Struct("@ll")  # s and ns of the wall clock
OCTETS = 65536


async def connected(host: str, port: int) -> socket.socket:
    """Return a connection that never waits. Raises OSError."""
    loop = asyncio.get_running_loop()
    family, kind, protocol, _, address = (await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM))[0]
    link = socket.socket(family, kind, protocol)
    try:
        link.setblocking(False)
        with suppress(OSError):  # another system than Linux
            link.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        await loop.sock_connect(link, address)
    except BaseException:
        link.close()
        raise
    return link


def read(link: socket.socket) -> tuple[int, bytes] | None:
    """Return what has come and when the last of it came, None where nothing has. Raises OSError."""
    try:
        octets, told, _, _ = link.recvmsg(OCTETS, socket.CMSG_SPACE(TIME.size))
    except BlockingIOError:
        return None
    for _, kind, content in told:
        if kind == SO_TIMESTAMPNS and len(content) == TIME.size:
            seconds, nanoseconds = TIME.unpack(content)
            return seconds * SECOND_NS + nanoseconds, octets
    return time.time_ns(), octets
