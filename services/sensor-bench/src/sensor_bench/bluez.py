"""An `org.bluez` stand-in: the part of BlueZ's D-Bus interface that GATT clients use, in front of a bumble central.

Object paths, properties, signals and errors are those of bluetoothd 5.66 as far as clients such as bleak or SimpleBLE
can tell; the README lists what is left out. The one deliberate addition: a device whose last user vanishes from the
bus is disconnected, so that a killed driver does not leave its strap held.
"""

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from bumble.att import ATT_Error
from bumble.core import BaseBumbleError
from bumble.device import Advertisement, Connection, Device, Peer
from bumble.hci import HCI_CONNECTION_TERMINATED_BY_LOCAL_HOST_ERROR
from dbus_fast import BusType, Message, MessageType, Variant
from dbus_fast.aio import MessageBus

from .bluez_names import (
    ADAPTER,
    AGENT_MANAGER,
    DEVICE,
    GATT_SERVICE,
    HIDDEN_SERVICES,
    INTROSPECTABLE,
    OBJECT_MANAGER,
    PROPERTIES,
    ROOT,
    SERVICE,
    SIGNATURES,
    BluezError,
    Properties,
    UnknownObject,
    adapter_properties,
    advertised,
    att_error,
    device_properties,
    mac_of,
    passes,
    uuid128,
)
from .gatt_calls import Call, GattCalls, Remote
from .object_tree import ObjectTree

log = logging.getLogger(__name__)

FILTER_KEYS = {"UUIDs", "RSSI", "Pathloss", "Transport", "DuplicateData", "Discoverable", "Pattern"}
CONNECT_TIMEOUT_S = 20.0
"""The kernel's limit for an LE connection attempt."""
DEVICE_TIMEOUT_S = 30.0
"""bluetoothd forgets an unpaired device that long after it was last seen."""
LINK_SETUP_TIMEOUT_S = 5.0
LINK_END_TIMEOUT_S = 1.0
CLIENT_MTU = 517
ABORTED = "le-connection-abort-by-local"


class BluezStandIn:
    """Owns the name `org.bluez` on the bus that `DBUS_SYSTEM_BUS_ADDRESS` (or `bus_address`) names."""

    def __init__(
        self,
        central: Device,
        bus_address: str,
        rssi_of: Callable[[str], int],
        adapter: str = "hci0",
        device_timeout_s: float = DEVICE_TIMEOUT_S,
    ) -> None:
        self._central = central
        self._bus_address = bus_address
        self._rssi_of = rssi_of
        self._device_timeout_s = device_timeout_s
        self._adapter_path = f"{ROOT}/{adapter}"
        self._bus: MessageBus | None = None
        self._tree = ObjectTree(self._send)
        self._tree.add(ROOT, {AGENT_MANAGER: {}})
        self._gatt = GattCalls(self._tree, self._remote, self._spawn)
        self._remotes: dict[str, Remote] = {}
        self._sessions: dict[str, dict[str, Any]] = {}
        self._filters: dict[str, dict[str, Any]] = {}
        self._connecting = asyncio.Lock()
        self._scanners = 0
        self._scan_lock = asyncio.Lock()
        self._tasks: set[asyncio.Task[Any]] = set()
        self.aborts: dict[str, int] = {}
        """Address -> how many of the next Connect calls are cut off with le-connection-abort-by-local."""
        self._calls: dict[tuple[str, str], Call] = {
            (ADAPTER, "SetDiscoveryFilter"): self._set_discovery_filter,
            (ADAPTER, "GetDiscoveryFilters"): self._get_discovery_filters,
            (ADAPTER, "StartDiscovery"): self._start_discovery,
            (ADAPTER, "StopDiscovery"): self._stop_discovery,
            (ADAPTER, "RemoveDevice"): self._remove_device,
            (DEVICE, "Connect"): self._connect,
            (DEVICE, "Disconnect"): self._disconnect,
            (DEVICE, "Pair"): self._pair,
            (PROPERTIES, "Get"): self._get_property,
            (PROPERTIES, "GetAll"): self._get_properties,
            (PROPERTIES, "Set"): self._set_property,
            (INTROSPECTABLE, "Introspect"): self._introspect,
            (AGENT_MANAGER, "RegisterAgent"): self._accept,
            (AGENT_MANAGER, "UnregisterAgent"): self._accept,
            (AGENT_MANAGER, "RequestDefaultAgent"): self._accept,
            **self._gatt.calls(),
        }

    # --- life ------------------------------------------------------------------------------------------------------

    async def start(self) -> None:
        self._central.on("advertisement", self._on_advertisement)
        self._add_adapter(powered=True)
        bus = MessageBus(bus_address=self._bus_address, bus_type=BusType.SYSTEM, negotiate_unix_fd=True)
        self._bus = await bus.connect()
        self._bus.add_message_handler(self._on_message)
        rule = "type='signal',sender='org.freedesktop.DBus',member='NameOwnerChanged'"
        await self._bus.call(
            Message(
                destination="org.freedesktop.DBus",
                path="/org/freedesktop/DBus",
                interface="org.freedesktop.DBus",
                member="AddMatch",
                signature="s",
                body=[rule],
            )
        )
        await self._bus.request_name(SERVICE)
        self._spawn(self._forget_unseen())

    async def stop(self) -> None:
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.gather(*(self._drop(remote) for remote in list(self._remotes.values())))
        if self._bus is not None and self._bus.connected:
            self._bus.disconnect()
            await self._bus.wait_for_disconnect()

    def _spawn(self, work: Any) -> asyncio.Task[Any]:
        task: asyncio.Task[Any] = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._on_task_done)
        return task

    def _on_task_done(self, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("stand-in task failed", exc_info=error)

    # --- adapter: knobs of the bench -------------------------------------------------------------------------------

    @property
    def present(self) -> bool:
        return self._adapter_path in self._tree

    @property
    def powered(self) -> bool:
        return self.present and bool(self._tree[self._adapter_path][ADAPTER]["Powered"].value)

    async def set_present(self, present: bool) -> None:
        """Plug the adapter in or pull it out; when it goes, its devices go with it."""
        if present and not self.present:
            self._add_adapter(powered=True)
        elif not present and self.present:
            await self._stop_everything()
            for remote in list(self._remotes.values()):
                self._remove_remote(remote)
            self._tree.remove(self._adapter_path)

    async def set_powered(self, powered: bool) -> None:
        """Bluetooth on or off; off ends all links and discovery."""
        if not self.present or powered == self.powered:
            return
        if not powered:
            await self._stop_everything()
        self._tree.change(self._adapter_path, ADAPTER, Powered=Variant("b", powered))

    async def _stop_everything(self) -> None:
        for sender in list(self._sessions):
            await self._end_session(sender)
        await asyncio.gather(*(self._drop(remote) for remote in list(self._remotes.values())))

    def _add_adapter(self, powered: bool) -> None:
        properties = adapter_properties(mac_of(self._central.random_address), powered)
        self._tree.add(self._adapter_path, {ADAPTER: properties})

    def _send(self, message: Message) -> None:
        if self._bus is not None and self._bus.connected:
            self._bus.send(message)

    # --- calls -----------------------------------------------------------------------------------------------------

    def _on_message(self, message: Message) -> Message | bool | None:
        if message.message_type is MessageType.SIGNAL:
            if message.member == "NameOwnerChanged" and message.body and not message.body[2]:
                self._on_client_gone(message.body[0])
            return None
        if message.message_type is not MessageType.METHOD_CALL:
            return None
        path = message.path or ""
        if path == "/" and message.interface == OBJECT_MANAGER and message.member == "GetManagedObjects":
            return Message.new_method_return(message, "a{oa{sa{sv}}}", [self._tree.all()])
        if path != "/" and path != "/org" and not path.startswith(ROOT):
            return None
        self._spawn(self._answer(message))
        return True

    async def _answer(self, message: Message) -> None:
        call = self._calls.get((message.interface or "", message.member or ""))
        try:
            if message.interface not in (PROPERTIES, INTROSPECTABLE):
                self._require_object(message)
            if call is None:
                reply = Message.new_error(
                    message, "org.freedesktop.DBus.Error.UnknownMethod", f"{message.interface}.{message.member}"
                )
            elif message.signature != SIGNATURES.get(message.member or "", ""):
                reply = Message.new_error(
                    message, "org.freedesktop.DBus.Error.InvalidArgs", f"not the arguments of {message.member}"
                )
            else:
                reply = await call(message)
        except BluezError as error:
            reply = Message.new_error(message, f"{SERVICE}.Error.{error.name}", error.text)
        except ATT_Error as error:
            name, text = att_error(int(error.error_code))
            reply = Message.new_error(message, f"{SERVICE}.Error.{name}", text)
        except (BaseBumbleError, asyncio.CancelledError) as error:
            reply = Message.new_error(message, f"{SERVICE}.Error.Failed", str(error) or "Not connected")
        except UnknownObject as error:
            reply = Message.new_error(
                message, "org.freedesktop.DBus.Error.UnknownObject", f"no such object: {error.args[0]}"
            )
        self._send(reply)

    def _require_object(self, message: Message) -> None:
        path = message.path or ""
        if path not in self._tree or message.interface not in self._tree[path]:
            raise UnknownObject(path)

    async def _accept(self, message: Message) -> Message:
        return Message.new_method_return(message)

    async def _introspect(self, message: Message) -> Message:
        path = message.path or ""
        prefix = path.rstrip("/") + "/"
        children = {known[len(prefix) :].split("/")[0] for known in self._tree if known.startswith(prefix)}
        nodes = "".join(f'<node name="{name}"/>' for name in sorted(children))
        interfaces = "".join(f'<interface name="{name}"/>' for name in self._tree.all().get(path, {}))
        return Message.new_method_return(message, "s", [f"<node>{interfaces}{nodes}</node>"])

    def _properties(self, message: Message) -> Properties:
        try:
            return self._tree[message.path or ""][message.body[0]]
        except KeyError:
            raise UnknownObject(message.path) from None

    async def _get_properties(self, message: Message) -> Message:
        return Message.new_method_return(message, "a{sv}", [self._properties(message)])

    async def _get_property(self, message: Message) -> Message:
        value = self._properties(message).get(message.body[1])
        if value is None:
            return Message.new_error(message, "org.freedesktop.DBus.Error.InvalidArgs", "No such property")
        return Message.new_method_return(message, "v", [value])

    async def _set_property(self, message: Message) -> Message:
        interface, name, value = message.body
        if name not in self._properties(message):
            return Message.new_error(message, "org.freedesktop.DBus.Error.InvalidArgs", "No such property")
        if (interface, name) == (ADAPTER, "Powered"):
            await self.set_powered(bool(value.value))
        elif (interface, name) in {(DEVICE, "Trusted"), (DEVICE, "Alias"), (ADAPTER, "Alias"), (DEVICE, "Blocked")}:
            self._tree.change(message.path or "", interface, **{name: value})
        else:
            return Message.new_error(message, "org.freedesktop.DBus.Error.PropertyReadOnly", name)
        return Message.new_method_return(message)

    # --- discovery -------------------------------------------------------------------------------------------------

    async def _set_discovery_filter(self, message: Message) -> Message:
        wanted = {name: value.value for name, value in message.body[0].items()}
        if unknown := set(wanted) - FILTER_KEYS:
            raise BluezError("InvalidArguments", f"Invalid arguments in method call: {', '.join(sorted(unknown))}")
        sender = message.sender or ""
        self._filters[sender] = wanted
        if sender in self._sessions:
            self._sessions[sender] = wanted
        return Message.new_method_return(message)

    async def _get_discovery_filters(self, message: Message) -> Message:
        return Message.new_method_return(message, "as", [sorted(FILTER_KEYS)])

    async def _start_discovery(self, message: Message) -> Message:
        self._require_power()
        sender = message.sender or ""
        if sender in self._sessions:
            raise BluezError("InProgress", "Operation already in progress")
        self._sessions[sender] = self._filters.get(sender, {})
        await self._scan(+1)
        if len(self._sessions) == 1:
            self._tree.change(self._adapter_path, ADAPTER, Discovering=Variant("b", True))
        return Message.new_method_return(message)

    async def _stop_discovery(self, message: Message) -> Message:
        self._require_power()
        if (message.sender or "") not in self._sessions:
            raise BluezError("Failed", "No discovery started")
        await self._end_session(message.sender or "")
        return Message.new_method_return(message)

    async def _end_session(self, sender: str) -> None:
        if self._sessions.pop(sender, None) is None:
            return
        await self._scan(-1)
        if not self._sessions:
            self._tree.change(self._adapter_path, ADAPTER, Discovering=Variant("b", False))
            for path in self._remotes:
                self._tree.invalidate(path, DEVICE, "RSSI")

    async def _scan(self, change: int) -> None:
        """Count who needs the radio to listen, and switch it at the first and the last."""
        async with self._scan_lock:
            was, self._scanners = self._scanners, self._scanners + change
            if was == 0 and self._scanners > 0:
                await self._central.start_scanning(filter_duplicates=False)
            elif was > 0 and self._scanners == 0:
                await self._central.stop_scanning()

    def _on_advertisement(self, advertisement: Advertisement) -> None:
        if not self.powered:
            return
        mac = mac_of(advertisement.address)
        path = f"{self._adapter_path}/dev_{mac.replace(':', '_')}"
        if (remote := self._remotes.get(path)) is not None:
            remote.seen_s = time.monotonic()
            remote.advertised.set()
        name, uuids, manufacturer = advertised(advertisement.data)
        rssi = self._rssi_of(mac)
        if not any(passes(wanted, uuids, rssi) for wanted in self._sessions.values()):
            return
        if remote is None:
            self._remotes[path] = Remote(path, advertisement.address, time.monotonic())
            self._tree.add(path, {DEVICE: device_properties(self._adapter_path, mac, name, uuids, rssi, manufacturer)})
        else:
            news = {"RSSI": Variant("n", rssi)}
            if manufacturer != self._tree[path][DEVICE].get("ManufacturerData"):
                news["ManufacturerData"] = manufacturer
            self._tree.change(path, DEVICE, **news)

    async def _remove_device(self, message: Message) -> Message:
        remote = self._remotes.get(message.body[0])
        if remote is None:
            raise BluezError("DoesNotExist", "Does Not Exist")
        await self._drop(remote)
        self._remove_remote(remote)
        return Message.new_method_return(message)

    def _remove_remote(self, remote: Remote) -> None:
        self._remotes.pop(remote.path, None)
        self._tree.remove(remote.path)

    async def _forget_unseen(self) -> None:
        while True:
            await asyncio.sleep(1.0)
            horizon_s = time.monotonic() - self._device_timeout_s
            for remote in list(self._remotes.values()):
                if remote.connection is None and remote.attempt is None and remote.seen_s < horizon_s:
                    self._remove_remote(remote)

    # --- links -----------------------------------------------------------------------------------------------------

    def _require_power(self) -> None:
        if not self.powered:
            raise BluezError("NotReady", "Resource Not Ready")

    def _remote(self, message: Message) -> Remote:
        """The device that the call is about, by the first part of its path."""
        path = "/".join((message.path or "").split("/")[:5])
        remote = self._remotes.get(path)
        if remote is None:
            raise UnknownObject(message.path)
        return remote

    async def _connect(self, message: Message) -> Message:
        remote = self._remote(message)
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
            async with self._listening():
                await remote.advertised.wait()
            async with self._connecting:
                try:
                    connection = await self._central.connect(remote.address, timeout=LINK_SETUP_TIMEOUT_S)
                except (BaseBumbleError, TimeoutError) as error:
                    log.info("link to %s not set up: %r", remote.address, error)
                    continue
                except asyncio.CancelledError:
                    await self._central.cancel_connection()
                    # the link may have come up in the same moment
                    if (late := self._central.find_connection_by_bd_addr(remote.address)) is not None:
                        await end_link(late)
                    raise
            self._on_link_up(remote, connection)
        mac = mac_of(remote.address)
        if self.aborts.get(mac, 0) > 0:
            self.aborts[mac] -= 1
            await self._end(remote)
            return
        self._spawn(self._resolve(remote, remote.connection))

    def _on_link_up(self, remote: Remote, connection: Connection) -> None:
        remote.connection = connection
        connection.on("disconnection", lambda reason: self._on_link_lost(remote, connection, reason))
        self._tree.change(remote.path, DEVICE, Connected=Variant("b", True))

    @contextlib.asynccontextmanager
    async def _listening(self) -> AsyncIterator[None]:
        await self._scan(+1)
        try:
            yield
        finally:
            await self._scan(-1)

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
        remote = self._remote(message)
        if remote.connection is None and remote.attempt is None:
            raise BluezError("NotConnected", "Not Connected")
        await self._drop(remote)
        return Message.new_method_return(message)

    async def _drop(self, remote: Remote) -> None:
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

    def _on_client_gone(self, sender: str) -> None:
        self._filters.pop(sender, None)
        if sender in self._sessions:
            self._spawn(self._end_session(sender))
        for remote in self._remotes.values():
            self._gatt.on_client_gone(remote, sender)
            if sender in remote.users:
                remote.users.discard(sender)
                if not remote.users:
                    self._spawn(self._drop(remote))


async def end_link(connection: Connection) -> None:
    """Disconnect; bumble never answers where the other side did so in the same moment, hence the limit."""
    with contextlib.suppress(BaseBumbleError, TimeoutError):
        await asyncio.wait_for(connection.disconnect(), LINK_END_TIMEOUT_S)


# --- helpers without state -----------------------------------------------------------------------------------------
