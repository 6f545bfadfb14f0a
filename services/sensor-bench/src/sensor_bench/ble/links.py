"""Links to devices: set up, their services discovered and exported, ended by anybody's hand."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from typing import Any

from bumble.core import BaseBumbleError
from bumble.device import Connection, Device, Peer
from bumble.hci import HCI_CONNECTION_TERMINATED_BY_LOCAL_HOST_ERROR, Address, HCI_LE_Create_Connection_Cancel_Command
from dbus_fast import Message, Variant

from sensor_bench.ble.gatt_calls import GattCalls
from sensor_bench.ble.listening import Listening
from sensor_bench.ble.names import DEVICE, GATT_SERVICE, HIDDEN_SERVICES, BluezError, mac_of, uuid128
from sensor_bench.ble.object_tree import ObjectTree
from sensor_bench.ble.remotes import Call, Remote, Remotes

log = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 20.0
"""The kernel's limit for an LE connection attempt."""
LINK_SETUP_TIMEOUT_S = 5.0
LINK_END_TIMEOUT_S = 1.0
CLIENT_MTU = 517
ABORTED = "le-connection-abort-by-local"


class Links:
    """Answers the calls to Device1. require_power() raises while Bluetooth is off; spawn(work) runs it beside."""

    def __init__(
        self,
        central: Device,
        tree: ObjectTree,
        remotes: Remotes,
        gatt: GattCalls,
        listening: Listening,
        require_power: Callable[[], None],
        spawn: Callable[[Any], asyncio.Task[Any]],
    ) -> None:
        self._central, self._tree, self._remotes, self._gatt = central, tree, remotes, gatt
        self._listening, self._require_power, self._spawn = listening, require_power, spawn
        self._connecting = asyncio.Lock()
        self.aborts: dict[str, int] = {}
        """Address -> how many of the next Connect calls are cut off with le-connection-abort-by-local."""

    def calls(self) -> dict[tuple[str, str], Call]:
        """(interface, member) -> handler."""
        return {
            (DEVICE, "Connect"): self._connect,
            (DEVICE, "Disconnect"): self._disconnect,
            (DEVICE, "Pair"): self._pair,
        }

    def on_client_gone(self, sender: str) -> None:
        """End the notifications of a client that left the bus, and the links that nobody else uses."""
        for remote in self._remotes.values():
            self._gatt.on_client_gone(remote, sender)
            if sender in remote.users:
                remote.users.discard(sender)
                if not remote.users:
                    self._spawn(self.drop(remote))

    async def _connect(self, message: Message) -> Message:
        remote = self._remotes.of(message)
        self._require_power()
        if remote.attempt is not None:
            raise BluezError("InProgress", "Operation already in progress")
        remote.users.add(message.sender or "")
        if remote.connection is not None:
            return Message.new_method_return(message)
        remote.attempt = self._spawn(self._establish(remote))
        try:
            await asyncio.wait({remote.attempt}, timeout=CONNECT_TIMEOUT_S)
            if not remote.attempt.done():
                remote.attempt.cancel()
                await asyncio.wait({remote.attempt})
            if remote.attempt.cancelled():
                raise BluezError("Failed", ABORTED)
        finally:
            remote.attempt = None
            if remote.connection is None:
                remote.users.discard(message.sender or "")
        if remote.connection is None:
            raise BluezError("Failed", ABORTED)
        return Message.new_method_return(message)

    async def _establish(self, remote: Remote) -> None:
        """Wait until the device advertises, then set up the link; other devices' attempts go on meanwhile."""
        while remote.connection is None:
            remote.advertised.clear()
            async with self._listening.on():
                await remote.advertised.wait()
            async with self._connecting:
                try:
                    connection = await self._link_to(remote.address)
                except (BaseBumbleError, TimeoutError) as error:
                    log.info("link to %s not set up: %r", remote.address, error)
                    continue
            self._on_link_up(remote, connection)
        mac = mac_of(remote.address)
        if self.aborts.get(mac, 0) > 0:
            self.aborts[mac] -= 1
            await self._end(remote)
            return
        self._spawn(self._resolve(remote, remote.connection))

    async def _link_to(self, address: Address) -> Connection:
        """Set up a link. Raises BaseBumbleError, TimeoutError; an attempt that is given up leaves no link behind."""
        attempt = asyncio.ensure_future(self._central.connect(address, timeout=None))
        try:
            async with asyncio.timeout(LINK_SETUP_TIMEOUT_S):
                return await asyncio.shield(attempt)
        except (TimeoutError, asyncio.CancelledError):
            await asyncio.shield(self._spawn(self._give_up(attempt)))
            raise

    async def _give_up(self, attempt: asyncio.Future[Connection]) -> None:
        """Cancel an attempt, and end the link where it has come up in the same moment."""
        with contextlib.suppress(BaseBumbleError):
            await self._central.send_sync_command(HCI_LE_Create_Connection_Cancel_Command())
        with contextlib.suppress(BaseBumbleError):
            await end_link(await attempt)

    def _on_link_up(self, remote: Remote, connection: Connection) -> None:
        remote.connection = connection
        connection.on("disconnection", lambda reason: self._on_link_lost(remote, connection, reason))
        self._tree.change(remote.path, DEVICE, Connected=Variant("b", True))

    async def _resolve(self, remote: Remote, connection: Connection) -> None:
        """Exchange the MTU, discover services, export them."""
        peer = Peer(connection)
        try:
            mtu = await connection.cancel_on_disconnection(self._discover(peer))
        except (BaseBumbleError, asyncio.CancelledError, TimeoutError) as error:
            log.info("services of %s not resolved: %r", remote.address, error)
            return
        if remote.connection is not connection:
            return
        for service in peer.services:
            if (uuid := uuid128(service.uuid)) not in HIDDEN_SERVICES:
                path = f"{remote.path}/service{service.handle:04x}"
                properties = {
                    "UUID": Variant("s", uuid),
                    "Device": Variant("o", remote.path),
                    "Primary": Variant("b", True),
                    "Includes": Variant("ao", []),
                }
                self._tree.add(path, {GATT_SERVICE: properties})
                for characteristic in service.characteristics:
                    self._gatt.add(remote, path, characteristic, mtu)
        uuids = sorted(uuid128(service.uuid) for service in peer.services)
        self._tree.change(remote.path, DEVICE, UUIDs=Variant("as", uuids))
        self._tree.change(remote.path, DEVICE, ServicesResolved=Variant("b", True))

    @staticmethod
    async def _discover(peer: Peer) -> int:
        mtu = await peer.request_mtu(CLIENT_MTU)
        await peer.discover_services()
        await peer.discover_characteristics()
        for service in peer.services:
            for characteristic in service.characteristics:
                await peer.discover_descriptors(characteristic)
        return int(mtu)

    async def _disconnect(self, message: Message) -> Message:
        remote = self._remotes.of(message)
        if remote.connection is None and remote.attempt is None:
            raise BluezError("NotConnected", "Not Connected")
        await self.drop(remote)
        return Message.new_method_return(message)

    async def drop(self, remote: Remote) -> None:
        """Give up an attempt to connect, or end the link."""
        if remote.attempt is not None:
            remote.attempt.cancel()
        await self._end(remote)

    async def _end(self, remote: Remote) -> None:
        if (connection := remote.connection) is not None:
            await end_link(connection)
            self._on_link_lost(remote, connection, HCI_CONNECTION_TERMINATED_BY_LOCAL_HOST_ERROR)

    def _on_link_lost(self, remote: Remote, connection: Connection, reason: int) -> None:
        """Forget everything about the link; what comes late about one that is already forgotten is ignored."""
        if remote.connection is not connection:
            return
        log.info("link to %s ended, reason 0x%02x", remote.address, reason)
        remote.connection = None
        remote.seen_s = time.monotonic()
        remote.users.clear()
        for characteristic in remote.characteristics.values():
            if characteristic.pipe is not None:
                characteristic.pipe.close()
        remote.characteristics.clear()
        remote.descriptors.clear()
        self._tree.change(remote.path, DEVICE, ServicesResolved=Variant("b", False), Connected=Variant("b", False))
        self._tree.remove_below(remote.path)

    async def _pair(self, message: Message) -> Message:
        raise BluezError("AuthenticationFailed", "Authentication Failed")


async def end_link(connection: Connection) -> None:
    """Disconnect; bumble never answers where the other side did so in the same moment, hence the limit."""
    with contextlib.suppress(BaseBumbleError, TimeoutError):
        async with asyncio.timeout(LINK_END_TIMEOUT_S):
            await connection.disconnect()
