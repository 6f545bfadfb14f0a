"""An `org.bluez` stand-in: the part of BlueZ's D-Bus interface that GATT clients use, in front of a bumble central.

Object paths, properties, signals and errors are those of bluetoothd 5.66 as far as clients such as bleak or SimpleBLE
can tell; the README lists what is left out. The one deliberate addition: a device whose last user vanishes from the
bus is disconnected, so that a killed driver does not leave its strap held.
"""

import asyncio
import contextlib
import logging
import os
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bumble.att import ATT_Error
from bumble.core import AdvertisingData, BaseBumbleError
from bumble.device import Advertisement, Connection, Device, Peer
from bumble.gatt_client import CharacteristicProxy, DescriptorProxy
from bumble.hci import HCI_CONNECTION_TERMINATED_BY_LOCAL_HOST_ERROR, Address
from dbus_fast import BusType, Message, MessageType, Variant
from dbus_fast.aio import MessageBus

log = logging.getLogger(__name__)

SERVICE = "org.bluez"
ROOT = "/org/bluez"
OBJECT_MANAGER = "org.freedesktop.DBus.ObjectManager"
PROPERTIES = "org.freedesktop.DBus.Properties"
INTROSPECTABLE = "org.freedesktop.DBus.Introspectable"
ADAPTER = f"{SERVICE}.Adapter1"
DEVICE = f"{SERVICE}.Device1"
GATT_SERVICE = f"{SERVICE}.GattService1"
CHARACTERISTIC = f"{SERVICE}.GattCharacteristic1"
DESCRIPTOR = f"{SERVICE}.GattDescriptor1"
AGENT_MANAGER = f"{SERVICE}.AgentManager1"

BASE_UUID = "-0000-1000-8000-00805f9b34fb"
HIDDEN_SERVICES = {f"0000{short}{BASE_UUID}" for short in ("1800", "1801")}
"""Generic Access and Generic Attribute: bluetoothd keeps them to itself."""
FLAGS = {
    0x01: "broadcast",
    0x02: "read",
    0x04: "write-without-response",
    0x08: "write",
    0x10: "notify",
    0x20: "indicate",
}
FILTER_KEYS = {"UUIDs", "RSSI", "Pathloss", "Transport", "DuplicateData", "Discoverable", "Pattern"}
CONNECT_TIMEOUT_S = 20.0
"""The kernel's limit for an LE connection attempt."""
DEVICE_TIMEOUT_S = 30.0
"""bluetoothd forgets an unpaired device that long after it was last seen."""
LINK_SETUP_TIMEOUT_S = 5.0
LINK_END_TIMEOUT_S = 1.0
CLIENT_MTU = 517
ABORTED = "le-connection-abort-by-local"

Properties = dict[str, Variant]


class BluezError(Exception):
    """A call is refused; becomes the D-Bus error `org.bluez.Error.<name>`."""

    def __init__(self, name: str, text: str) -> None:
        super().__init__(f"{name}: {text}")
        self.name, self.text = name, text


class UnknownObject(KeyError):
    """The object path does not exist (any more)."""


class NotifyPipe(NamedTuple):
    """The two ends of an AcquireNotify socket: ours, and the sender it was given to."""

    ours: socket.socket
    sender: str


@dataclass
class Characteristic:
    """A remote characteristic, who listens to it, and which operations are under way."""

    remote: CharacteristicProxy
    flags: list[str]
    listeners: set[str] = field(default_factory=set)
    pipe: NotifyPipe | None = None
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
        self._objects: dict[str, dict[str, Properties]] = {ROOT: {AGENT_MANAGER: {}}}
        self._remotes: dict[str, Remote] = {}
        self._sessions: dict[str, dict[str, Any]] = {}
        self._filters: dict[str, dict[str, Any]] = {}
        self._connecting = asyncio.Lock()
        self._scanners = 0
        self._scan_lock = asyncio.Lock()
        self._tasks: set[asyncio.Task[Any]] = set()
        self.aborts: dict[str, int] = {}
        """Address -> how many of the next Connect calls are cut off with le-connection-abort-by-local."""
        self._calls: dict[tuple[str, str], Callable[[Message], Awaitable[Message]]] = {
            (ADAPTER, "SetDiscoveryFilter"): self._set_discovery_filter,
            (ADAPTER, "GetDiscoveryFilters"): self._get_discovery_filters,
            (ADAPTER, "StartDiscovery"): self._start_discovery,
            (ADAPTER, "StopDiscovery"): self._stop_discovery,
            (ADAPTER, "RemoveDevice"): self._remove_device,
            (DEVICE, "Connect"): self._connect,
            (DEVICE, "Disconnect"): self._disconnect,
            (DEVICE, "Pair"): self._pair,
            (CHARACTERISTIC, "ReadValue"): self._read_value,
            (CHARACTERISTIC, "WriteValue"): self._write_value,
            (CHARACTERISTIC, "StartNotify"): self._start_notify,
            (CHARACTERISTIC, "StopNotify"): self._stop_notify,
            (CHARACTERISTIC, "AcquireNotify"): self._acquire_notify,
            (DESCRIPTOR, "ReadValue"): self._read_descriptor,
            (PROPERTIES, "Get"): self._get_property,
            (PROPERTIES, "GetAll"): self._get_properties,
            (PROPERTIES, "Set"): self._set_property,
            (INTROSPECTABLE, "Introspect"): self._introspect,
            (AGENT_MANAGER, "RegisterAgent"): self._accept,
            (AGENT_MANAGER, "UnregisterAgent"): self._accept,
            (AGENT_MANAGER, "RequestDefaultAgent"): self._accept,
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
        return self._adapter_path in self._objects

    @property
    def powered(self) -> bool:
        return self.present and bool(self._objects[self._adapter_path][ADAPTER]["Powered"].value)

    async def set_present(self, present: bool) -> None:
        """Plug the adapter in or pull it out; when it goes, its devices go with it."""
        if present and not self.present:
            self._add_adapter(powered=True)
        elif not present and self.present:
            await self._stop_everything()
            for remote in list(self._remotes.values()):
                self._remove_remote(remote)
            self._remove_object(self._adapter_path)

    async def set_powered(self, powered: bool) -> None:
        """Bluetooth on or off; off ends all links and discovery."""
        if not self.present or powered == self.powered:
            return
        if not powered:
            await self._stop_everything()
        self._change(self._adapter_path, ADAPTER, Powered=Variant("b", powered))

    async def _stop_everything(self) -> None:
        for sender in list(self._sessions):
            await self._end_session(sender)
        await asyncio.gather(*(self._drop(remote) for remote in list(self._remotes.values())))

    def _add_adapter(self, powered: bool) -> None:
        self._add_object(
            self._adapter_path,
            {
                ADAPTER: {
                    "Address": Variant("s", _mac(self._central.random_address)),
                    "AddressType": Variant("s", "public"),
                    "Name": Variant("s", "sensor-bench"),
                    "Alias": Variant("s", "sensor-bench"),
                    "Class": Variant("u", 0),
                    "Powered": Variant("b", powered),
                    "Discoverable": Variant("b", False),
                    "DiscoverableTimeout": Variant("u", 180),
                    "Pairable": Variant("b", True),
                    "PairableTimeout": Variant("u", 0),
                    "Discovering": Variant("b", False),
                    "UUIDs": Variant("as", []),
                    "Roles": Variant("as", ["central"]),
                }
            },
        )

    # --- objects and signals ---------------------------------------------------------------------------------------

    def _send(self, message: Message) -> None:
        if self._bus is not None and self._bus.connected:
            self._bus.send(message)

    def _signal(self, path: str, interface: str, member: str, signature: str, body: list[Any]) -> None:
        self._send(
            Message(
                message_type=MessageType.SIGNAL,
                path=path,
                interface=interface,
                member=member,
                signature=signature,
                body=body,
            )
        )

    def _add_object(self, path: str, interfaces: dict[str, Properties]) -> None:
        self._objects[path] = interfaces
        self._signal("/", OBJECT_MANAGER, "InterfacesAdded", "oa{sa{sv}}", [path, interfaces])

    def _remove_object(self, path: str) -> None:
        if (interfaces := self._objects.pop(path, None)) is not None:
            self._signal("/", OBJECT_MANAGER, "InterfacesRemoved", "oas", [path, list(interfaces)])

    def _change(self, path: str, interface: str, **values: Variant) -> None:
        if path in self._objects:
            self._objects[path][interface].update(values)
            self._signal(path, PROPERTIES, "PropertiesChanged", "sa{sv}as", [interface, values, []])

    def _invalidate(self, path: str, interface: str, name: str) -> None:
        if path in self._objects and self._objects[path][interface].pop(name, None) is not None:
            self._signal(path, PROPERTIES, "PropertiesChanged", "sa{sv}as", [interface, {}, [name]])

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
            return Message.new_method_return(message, "a{oa{sa{sv}}}", [self._objects])
        if path != "/" and path != "/org" and not path.startswith(ROOT):
            return None
        self._spawn(self._answer(message))
        return True

    async def _answer(self, message: Message) -> None:
        call = self._calls.get((message.interface or "", message.member or ""))
        try:
            if message.interface not in (PROPERTIES, INTROSPECTABLE) and (
                message.path not in self._objects or message.interface not in self._objects[message.path]
            ):
                raise UnknownObject(message.path)
            if call is None:
                reply = Message.new_error(
                    message, "org.freedesktop.DBus.Error.UnknownMethod", f"{message.interface}.{message.member}"
                )
            else:
                reply = await call(message)
        except BluezError as error:
            reply = Message.new_error(message, f"{SERVICE}.Error.{error.name}", error.text)
        except ATT_Error as error:
            name, text = _att_error(int(error.error_code))
            reply = Message.new_error(message, f"{SERVICE}.Error.{name}", text)
        except (BaseBumbleError, asyncio.CancelledError) as error:
            reply = Message.new_error(message, f"{SERVICE}.Error.Failed", str(error) or "Not connected")
        except UnknownObject as error:
            reply = Message.new_error(
                message, "org.freedesktop.DBus.Error.UnknownObject", f"no such object: {error.args[0]}"
            )
        self._send(reply)

    async def _accept(self, message: Message) -> Message:
        return Message.new_method_return(message)

    async def _introspect(self, message: Message) -> Message:
        prefix = (message.path or "").rstrip("/") + "/"
        children = {path[len(prefix) :].split("/")[0] for path in self._objects if path.startswith(prefix)}
        nodes = "".join(f'<node name="{name}"/>' for name in sorted(children))
        interfaces = "".join(f'<interface name="{name}"/>' for name in self._objects.get(message.path or "", {}))
        return Message.new_method_return(message, "s", [f"<node>{interfaces}{nodes}</node>"])

    def _properties(self, message: Message) -> Properties:
        try:
            return self._objects[message.path or ""][message.body[0]]
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
            self._change(message.path or "", interface, **{name: value})
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
            self._change(self._adapter_path, ADAPTER, Discovering=Variant("b", True))
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
            self._change(self._adapter_path, ADAPTER, Discovering=Variant("b", False))
            for path in self._remotes:
                self._invalidate(path, DEVICE, "RSSI")

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
        mac = _mac(advertisement.address)
        path = f"{self._adapter_path}/dev_{mac.replace(':', '_')}"
        if (remote := self._remotes.get(path)) is not None:
            remote.seen_s = time.monotonic()
            remote.advertised.set()
        name, uuids, manufacturer = _advertised(advertisement.data)
        rssi = self._rssi_of(mac)
        if not any(_passes(wanted, uuids, rssi) for wanted in self._sessions.values()):
            return
        if remote is None:
            self._remotes[path] = Remote(path, advertisement.address, time.monotonic())
            self._add_object(path, {DEVICE: _device(self._adapter_path, mac, name, uuids, rssi, manufacturer)})
        else:
            news = {"RSSI": Variant("n", rssi)}
            if manufacturer != self._objects[path][DEVICE].get("ManufacturerData"):
                news["ManufacturerData"] = manufacturer
            self._change(path, DEVICE, **news)

    async def _remove_device(self, message: Message) -> Message:
        remote = self._remotes.get(message.body[0])
        if remote is None:
            raise BluezError("DoesNotExist", "Does Not Exist")
        await self._drop(remote)
        self._remove_remote(remote)
        return Message.new_method_return(message)

    def _remove_remote(self, remote: Remote) -> None:
        self._remotes.pop(remote.path, None)
        self._remove_object(remote.path)

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
        mac = _mac(remote.address)
        if self.aborts.get(mac, 0) > 0:
            self.aborts[mac] -= 1
            await self._end(remote)
            return
        self._spawn(self._resolve(remote, remote.connection))

    def _on_link_up(self, remote: Remote, connection: Connection) -> None:
        remote.connection = connection
        connection.on("disconnection", lambda reason: self._on_link_lost(remote, connection, reason))
        self._change(remote.path, DEVICE, Connected=Variant("b", True))

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
            if (uuid := _uuid128(service.uuid)) not in HIDDEN_SERVICES:
                path = f"{remote.path}/service{service.handle:04x}"
                properties = {
                    "UUID": Variant("s", uuid),
                    "Device": Variant("o", remote.path),
                    "Primary": Variant("b", True),
                    "Includes": Variant("ao", []),
                }
                self._add_object(path, {GATT_SERVICE: properties})
                for characteristic in service.characteristics:
                    self._add_characteristic(remote, path, characteristic, mtu)
        uuids = sorted(_uuid128(service.uuid) for service in peer.services)
        self._change(remote.path, DEVICE, UUIDs=Variant("as", uuids))
        self._change(remote.path, DEVICE, ServicesResolved=Variant("b", True))

    @staticmethod
    async def _discover(peer: Peer) -> int:
        mtu = await peer.request_mtu(CLIENT_MTU)
        await peer.discover_services()
        await peer.discover_characteristics()
        for service in peer.services:
            for characteristic in service.characteristics:
                await peer.discover_descriptors(characteristic)
        return int(mtu)

    def _add_characteristic(self, remote: Remote, service: str, found: CharacteristicProxy, mtu: int) -> None:
        path = f"{service}/char{found.handle - 1:04x}"
        flags = [name for bit, name in FLAGS.items() if int(found.properties) & bit]
        remote.characteristics[path] = Characteristic(found, flags)
        properties = {
            "UUID": Variant("s", _uuid128(found.uuid)),
            "Service": Variant("o", service),
            "Value": Variant("ay", b""),
            "Flags": Variant("as", flags),
            "MTU": Variant("q", mtu),
        }
        if {"notify", "indicate"} & set(flags):
            properties["Notifying"] = Variant("b", False)
            properties["NotifyAcquired"] = Variant("b", False)
        self._add_object(path, {CHARACTERISTIC: properties})
        for descriptor in found.descriptors:
            at = f"{path}/desc{descriptor.handle:04x}"
            remote.descriptors[at] = descriptor
            values = {
                "UUID": Variant("s", _uuid128(descriptor.type)),
                "Characteristic": Variant("o", path),
                "Value": Variant("ay", b""),
            }
            self._add_object(at, {DESCRIPTOR: values})

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
                characteristic.pipe.ours.close()
        remote.characteristics.clear()
        remote.descriptors.clear()
        self._change(remote.path, DEVICE, ServicesResolved=Variant("b", False), Connected=Variant("b", False))
        for path in sorted((path for path in self._objects if path.startswith(remote.path + "/")), reverse=True):
            self._remove_object(path)

    async def _pair(self, message: Message) -> Message:
        raise BluezError("AuthenticationFailed", "Authentication Failed")

    def _on_client_gone(self, sender: str) -> None:
        self._filters.pop(sender, None)
        if sender in self._sessions:
            self._spawn(self._end_session(sender))
        for remote in self._remotes.values():
            for path, characteristic in remote.characteristics.items():
                if sender in characteristic.listeners:
                    self._spawn(self._remove_listener(path, characteristic, sender))
            if sender in remote.users:
                remote.users.discard(sender)
                if not remote.users:
                    self._spawn(self._drop(remote))

    # --- characteristics -------------------------------------------------------------------------------------------

    def _characteristic(self, message: Message) -> Characteristic:
        remote = self._remote(message)
        characteristic = remote.characteristics.get(message.path or "")
        if characteristic is None:
            raise BluezError("Failed", "Not connected")
        remote.users.add(message.sender or "")
        return characteristic

    async def _on_remote(self, message: Message, operation: Awaitable[Any]) -> Any:
        """Await an ATT operation, but no longer than the link lasts."""
        connection = self._remote(message).connection
        if connection is None:
            raise BluezError("Failed", "Not connected")
        try:
            return await connection.cancel_on_disconnection(operation)
        except asyncio.CancelledError:
            raise BluezError("Failed", "Not connected") from None

    async def _read_value(self, message: Message) -> Message:
        characteristic = self._characteristic(message)
        if "read" not in characteristic.flags:
            raise BluezError("NotPermitted", "Read not permitted")
        with characteristic.exclusive("read"):
            value = bytes(await self._on_remote(message, characteristic.remote.read_value()))
        value = value[_offset(message.body[0]) :]
        # bluetoothd announces a read value as a change; clients that are notified see it as a notification
        self._change(message.path or "", CHARACTERISTIC, Value=Variant("ay", value))
        return Message.new_method_return(message, "ay", [value])

    async def _read_descriptor(self, message: Message) -> Message:
        descriptor = self._remote(message).descriptors.get(message.path or "")
        if descriptor is None:
            raise BluezError("Failed", "Not connected")
        value = bytes(await self._on_remote(message, descriptor.read_value()))
        self._change(message.path or "", DESCRIPTOR, Value=Variant("ay", value))
        return Message.new_method_return(message, "ay", [value])

    async def _write_value(self, message: Message) -> Message:
        characteristic = self._characteristic(message)
        value, options = bytes(message.body[0]), message.body[1]
        kind = options["type"].value if "type" in options else None
        if kind not in (None, "command", "request", "reliable"):
            raise BluezError("InvalidArguments", f"Invalid arguments in method call: type {kind}")
        with_response = kind != "command" and (kind is not None or "write" in characteristic.flags)
        if ("write" if with_response else "write-without-response") not in characteristic.flags:
            raise BluezError("NotSupported", "Operation is not supported")
        if not with_response:
            await characteristic.remote.write_value(value, with_response=False)
            return Message.new_method_return(message)
        with characteristic.exclusive("write"):
            await self._on_remote(message, characteristic.remote.write_value(value, with_response=True))
        return Message.new_method_return(message)

    async def _start_notify(self, message: Message) -> Message:
        characteristic, path, sender = self._characteristic(message), message.path or "", message.sender or ""
        if not {"notify", "indicate"} & set(characteristic.flags):
            raise BluezError("NotSupported", "Operation is not supported")
        if characteristic.pipe is not None:
            raise BluezError("NotPermitted", "Notify acquired")
        if sender in characteristic.listeners:
            return Message.new_method_return(message)
        with characteristic.exclusive("notify"):
            if not characteristic.listeners:
                await self._subscribe(
                    message,
                    characteristic,
                    lambda value: self._change(path, CHARACTERISTIC, Value=Variant("ay", bytes(value))),
                )
                self._change(path, CHARACTERISTIC, Notifying=Variant("b", True))
            characteristic.listeners.add(sender)
        return Message.new_method_return(message)

    async def _subscribe(
        self, message: Message, characteristic: Characteristic, on_value: Callable[[bytes], None]
    ) -> None:
        characteristic.on_value = on_value
        prefer_notify = "notify" in characteristic.flags
        await self._on_remote(message, characteristic.remote.subscribe(on_value, prefer_notify=prefer_notify))

    async def _stop_notify(self, message: Message) -> Message:
        characteristic = self._characteristic(message)
        if (message.sender or "") not in characteristic.listeners:
            raise BluezError("Failed", "No notify session started")
        await self._remove_listener(message.path or "", characteristic, message.sender or "")
        return Message.new_method_return(message)

    async def _remove_listener(self, path: str, characteristic: Characteristic, sender: str) -> None:
        characteristic.listeners.discard(sender)
        if characteristic.listeners:
            return
        with contextlib.suppress(BaseBumbleError, asyncio.CancelledError):
            await characteristic.remote.unsubscribe(characteristic.on_value)
        self._change(path, CHARACTERISTIC, Notifying=Variant("b", False))

    async def _acquire_notify(self, message: Message) -> Message:
        """Notifications as datagrams through a socket; ends when the client closes its end or the link is lost."""
        characteristic, path = self._characteristic(message), message.path or ""
        if "notify" not in characteristic.flags:
            raise BluezError("NotSupported", "Operation is not supported")
        if characteristic.listeners or characteristic.pipe is not None:
            raise BluezError("NotPermitted", "Notify acquired")
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        characteristic.pipe = NotifyPipe(ours, message.sender or "")

        def forward(value: bytes) -> None:
            with contextlib.suppress(OSError):
                ours.send(bytes(value))

        await self._subscribe(message, characteristic, forward)
        self._change(path, CHARACTERISTIC, NotifyAcquired=Variant("b", True))
        self._spawn(self._release_when_closed(path, characteristic, ours))
        mtu = self._objects[path][CHARACTERISTIC]["MTU"].value
        reply = Message.new_method_return(message, "hq", [0, mtu], unix_fds=[os.dup(theirs.fileno())])
        theirs.close()
        return reply

    async def _release_when_closed(self, path: str, characteristic: Characteristic, ours: socket.socket) -> None:
        with contextlib.suppress(OSError):
            await asyncio.get_running_loop().sock_recv(ours, 1)
        ours.close()
        characteristic.pipe = None
        with contextlib.suppress(BaseBumbleError, asyncio.CancelledError):
            await characteristic.remote.unsubscribe(characteristic.on_value)
        self._change(path, CHARACTERISTIC, NotifyAcquired=Variant("b", False))


async def end_link(connection: Connection) -> None:
    """Disconnect; bumble never answers where the other side did so in the same moment, hence the limit."""
    with contextlib.suppress(BaseBumbleError, TimeoutError):
        await asyncio.wait_for(connection.disconnect(), LINK_END_TIMEOUT_S)


# --- helpers without state -----------------------------------------------------------------------------------------


def _mac(address: Address) -> str:
    return address.to_string(with_type_qualifier=False)


def _uuid128(uuid: Any) -> str:
    raw = uuid.to_bytes()[::-1].hex()
    if len(raw) == 4:
        return f"0000{raw}{BASE_UUID}"
    return f"{raw[:8]}-{raw[8:12]}-{raw[12:16]}-{raw[16:20]}-{raw[20:]}"


def _offset(options: dict[str, Variant]) -> int:
    return int(options["offset"].value) if "offset" in options else 0


def _att_error(code: int) -> tuple[str, str]:
    """BlueZ's error name and text for an ATT error code."""
    known = {
        0x02: ("NotPermitted", "Read not permitted"),
        0x03: ("NotPermitted", "Write not permitted"),
        0x05: ("NotPermitted", "Not paired"),
        0x06: ("NotSupported", "Operation is not supported"),
        0x07: ("InvalidOffset", "Invalid offset"),
        0x0D: ("InvalidValueLength", "Invalid Length"),
        0x0F: ("NotPermitted", "Not paired"),
    }
    return known.get(code, ("Failed", f"Operation failed with ATT error: 0x{code:02x}"))


def _advertised(data: AdvertisingData) -> tuple[str, list[str], Variant]:
    """Name, 128-bit service UUIDs and manufacturer data of an advertisement."""
    name = data.get(AdvertisingData.Type.COMPLETE_LOCAL_NAME) or ""
    uuids = data.get(AdvertisingData.Type.COMPLETE_LIST_OF_16_BIT_SERVICE_CLASS_UUIDS) or []
    manufacturer = data.get(AdvertisingData.Type.MANUFACTURER_SPECIFIC_DATA)
    by_company = {int(manufacturer[0]): Variant("ay", bytes(manufacturer[1]))} if manufacturer else {}
    return str(name), [_uuid128(uuid) for uuid in uuids], Variant("a{qv}", by_company)


def _passes(wanted: dict[str, Any], uuids: list[str], rssi: int) -> bool:
    """Whether a session with this discovery filter wants to know about the device."""
    if wanted.get("Transport") == "bredr":
        return False
    if rssi < wanted.get("RSSI", -128):
        return False
    asked = {uuid.lower() for uuid in wanted.get("UUIDs", [])}
    return not asked or bool(asked & set(uuids))


def _device(adapter: str, mac: str, name: str, uuids: list[str], rssi: int, manufacturer: Variant) -> Properties:
    properties = {
        "Address": Variant("s", mac),
        "AddressType": Variant("s", "random"),
        "Alias": Variant("s", name or mac.replace(":", "-")),
        "Paired": Variant("b", False),
        "Bonded": Variant("b", False),
        "Trusted": Variant("b", False),
        "Blocked": Variant("b", False),
        "LegacyPairing": Variant("b", False),
        "Connected": Variant("b", False),
        "ServicesResolved": Variant("b", False),
        "UUIDs": Variant("as", uuids),
        "Adapter": Variant("o", adapter),
        "RSSI": Variant("n", rssi),
    }
    if name:
        properties["Name"] = Variant("s", name)
    if manufacturer.value:
        properties["ManufacturerData"] = manufacturer
    return properties
