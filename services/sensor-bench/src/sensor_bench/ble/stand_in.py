"""An `org.bluez` stand-in: the part of BlueZ's D-Bus interface that GATT clients use, in front of a bumble central.

Object paths, properties, signals and errors are those of bluetoothd 5.66 as far as clients such as bleak or SimpleBLE
can tell; the README lists what is left out. The one deliberate addition: a device whose last user vanishes from the
bus is disconnected, so that a killed driver does not leave its strap held.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from bumble.att import ATT_Error
from bumble.core import BaseBumbleError
from bumble.device import Device
from dbus_fast import Message, MessageType
from dbus_fast.aio import MessageBus

from sensor_bench.ble import patient_bus
from sensor_bench.ble.adapter import DEVICE_TIMEOUT_S, Adapter
from sensor_bench.ble.gatt_calls import GattCalls
from sensor_bench.ble.links import Links
from sensor_bench.ble.listening import Listening
from sensor_bench.ble.names import (
    ADAPTER,
    AGENT_MANAGER,
    DEVICE,
    INTROSPECTABLE,
    OBJECT_MANAGER,
    PROPERTIES,
    ROOT,
    SERVICE,
    SIGNATURES,
    BluezError,
    Properties,
    UnknownObject,
    att_error,
)
from sensor_bench.ble.object_tree import ObjectTree
from sensor_bench.ble.remotes import Call, Remotes

log = logging.getLogger(__name__)


class BluezStandIn:
    """Owns the name `org.bluez` on the bus that `DBUS_SYSTEM_BUS_ADDRESS` (or `bus_address`) names.

    adapter and links are its two halves, with the knobs of the bench.
    """

    def __init__(
        self,
        central: Device,
        bus_address: str,
        rssi_of: Callable[[str], int],
        adapter: str = "hci0",
        device_timeout_s: float = DEVICE_TIMEOUT_S,
    ) -> None:
        self._bus_address = bus_address
        self._bus: MessageBus | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self._tree = ObjectTree(self._send)
        self._tree.add(ROOT, {AGENT_MANAGER: {}})
        self._remotes, listening = Remotes(), Listening(central)
        gatt = GattCalls(self._tree, self._remotes, self._spawn)
        self.links = Links(
            central, self._tree, self._remotes, gatt, listening, lambda: self.adapter.require_power(), self._spawn
        )
        path = f"{ROOT}/{adapter}"
        self.adapter = Adapter(
            path, central, self._tree, self._remotes, listening, self.links.drop, rssi_of, device_timeout_s
        )
        self._calls: dict[tuple[str, str], Call] = {
            (PROPERTIES, "Get"): self._get_property,
            (PROPERTIES, "GetAll"): self._get_properties,
            (PROPERTIES, "Set"): self._set_property,
            (INTROSPECTABLE, "Introspect"): self._introspect,
            (AGENT_MANAGER, "RegisterAgent"): self._accept,
            (AGENT_MANAGER, "UnregisterAgent"): self._accept,
            (AGENT_MANAGER, "RequestDefaultAgent"): self._accept,
            **self.adapter.calls(),
            **self.links.calls(),
            **gatt.calls(),
        }

    async def start(self) -> None:
        self.adapter.plug_in()
        await self._connect()
        self._spawn(self.adapter.forget_unseen())

    async def disconnected(self) -> None:
        """Wait until the connection to the bus has ended, as it does with the bus."""
        if self._bus is None:
            return
        try:
            await asyncio.shield(self._bus.wait_for_disconnect())  # `stop` waits for the same
        except patient_bus.LOST as err:
            log.error("the connection to the private bus is lost (%r); it is made again", err)

    async def reconnect(self) -> None:
        """Be on the bus again as another one: clients of before are gone, or see that `org.bluez` was. Raises LOST."""
        await self.adapter.forget_clients()
        await self._connect()

    async def _connect(self) -> None:
        self._bus = await patient_bus.connect(self._bus_address)
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

    async def stop(self) -> None:
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.gather(*(self.links.drop(remote) for remote in list(self._remotes.values())))
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

    def _send(self, message: Message) -> None:
        if self._bus is not None and self._bus.connected:
            self._bus.send(message)

    def _on_client_gone(self, sender: str) -> None:
        self._spawn(self.adapter.on_client_gone(sender))
        self.links.on_client_gone(sender)

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
            await self.adapter.set_powered(bool(value.value))
        elif (interface, name) in {(DEVICE, "Trusted"), (DEVICE, "Alias"), (ADAPTER, "Alias"), (DEVICE, "Blocked")}:
            self._tree.change(message.path or "", interface, **{name: value})
        else:
            return Message.new_error(message, "org.freedesktop.DBus.Error.PropertyReadOnly", name)
        return Message.new_method_return(message)
