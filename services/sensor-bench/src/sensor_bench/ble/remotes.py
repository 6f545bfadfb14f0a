"""Devices that were seen: their links, what was discovered on them, and who uses them."""

import asyncio
import contextlib
import socket
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field

from bumble.device import Connection
from bumble.gatt_client import CharacteristicProxy, DescriptorProxy
from bumble.hci import Address
from dbus_fast import Message

from sensor_bench.ble.names import BluezError, UnknownObject

Call = Callable[[Message], Awaitable[Message]]


@dataclass
class Characteristic:
    """A remote characteristic, who listens to it, and which operations are under way."""

    remote: CharacteristicProxy
    flags: list[str]
    listeners: set[str] = field(default_factory=set)
    pipe: socket.socket | None = None
    """Our end of the socket that AcquireNotify handed out."""
    on_value: Callable[[bytes], None] | None = None
    busy: set[str] = field(default_factory=set)

    @contextlib.contextmanager
    def exclusive(self, operation: str) -> Iterator[None]:
        """One operation of a kind at a time, as in bluetoothd."""
        if operation in self.busy:
            raise BluezError("InProgress", "In Progress")
        self.busy.add(operation)
        try:
            yield
        finally:
            self.busy.discard(operation)


@dataclass
class Remote:
    """A device that was seen, with its link while there is one."""

    path: str
    address: Address
    seen_s: float
    connection: Connection | None = None
    attempt: asyncio.Task[None] | None = None
    users: set[str] = field(default_factory=set)
    characteristics: dict[str, Characteristic] = field(default_factory=dict)
    descriptors: dict[str, DescriptorProxy] = field(default_factory=dict)
    advertised: asyncio.Event = field(default_factory=asyncio.Event)


class Remotes(dict[str, Remote]):
    """Object path -> device."""

    def of(self, message: Message) -> Remote:
        """The device that a call is about, by the first part of its path. Raises UnknownObject."""
        remote = self.get("/".join((message.path or "").split("/")[:5]))
        if remote is None:
            raise UnknownObject(message.path)
        return remote
