"""A connection to a bus that waits where its socket is full: dbus-fast (5.2) takes that for its end."""

import select
import socket
from collections.abc import Iterable
from typing import Any, cast

from dbus_fast import BusType
from dbus_fast.aio import MessageBus
from dbus_fast.errors import AuthError

WAIT_S = 5.0
LOST = (OSError, EOFError, AuthError)
"""What dbus-fast raises where a connection ends, or is not made."""


class _PatientSocket:
    """What dbus-fast's writer needs of a socket; a full one takes nothing for now, and the writer goes on later."""

    def __init__(self, own: socket.socket) -> None:
        self._own = own

    def send(self, data: memoryview) -> int:
        try:
            return self._own.send(data)
        except BlockingIOError:
            return 0

    def sendmsg(self, buffers: Iterable[memoryview], ancillary: Any) -> int:
        """Wait for room, for the descriptors go with the first byte; BlockingIOError where there is none for long."""
        select.select([], [self._own], [], WAIT_S)
        return self._own.sendmsg(buffers, ancillary)


async def connect(address: str) -> MessageBus:
    """Return a connection to the bus at this address that passes descriptors too. Raises what dbus-fast does."""
    bus = await MessageBus(bus_address=address, bus_type=BusType.SYSTEM, negotiate_unix_fd=True).connect()
    assert bus._writer is not None
    assert bus._sock is not None
    bus._writer.sock = cast(socket.socket, _PatientSocket(bus._sock))
    return bus
