"""The GATT part of the stand-in: characteristics and descriptors of connected devices, read, written, listened to."""

import asyncio
import contextlib
import os
import socket
from collections.abc import Awaitable, Callable
from typing import Any

from bumble.core import BaseBumbleError
from bumble.gatt_client import CharacteristicProxy
from dbus_fast import Message, Variant

from sensor_bench.ble.names import CHARACTERISTIC, DESCRIPTOR, FLAGS, BluezError, offset, uuid128
from sensor_bench.ble.object_tree import ObjectTree
from sensor_bench.ble.remotes import Call, Characteristic, Remote, Remotes


class GattCalls:
    """Answers the calls to GattCharacteristic1 and GattDescriptor1."""

    def __init__(
        self,
        tree: ObjectTree,
        remotes: Remotes,
        spawn: Callable[[Awaitable[None]], object],
    ) -> None:
        self._tree, self._remotes, self._spawn = tree, remotes, spawn

    def calls(self) -> dict[tuple[str, str], Call]:
        """(interface, member) -> handler."""
        return {
            (CHARACTERISTIC, "ReadValue"): self._read_value,
            (CHARACTERISTIC, "WriteValue"): self._write_value,
            (CHARACTERISTIC, "StartNotify"): self._start_notify,
            (CHARACTERISTIC, "StopNotify"): self._stop_notify,
            (CHARACTERISTIC, "AcquireNotify"): self._acquire_notify,
            (DESCRIPTOR, "ReadValue"): self._read_descriptor,
        }

    def add(self, remote: Remote, service: str, found: CharacteristicProxy, mtu: int) -> None:
        """Export a discovered characteristic and its descriptors below the service's path."""
        path = f"{service}/char{found.handle - 1:04x}"
        flags = [name for bit, name in FLAGS.items() if int(found.properties) & bit]
        remote.characteristics[path] = Characteristic(found, flags)
        properties = {
            "UUID": Variant("s", uuid128(found.uuid)),
            "Service": Variant("o", service),
            "Value": Variant("ay", b""),
            "Flags": Variant("as", flags),
            "MTU": Variant("q", mtu),
        }
        if {"notify", "indicate"} & set(flags):
            properties["Notifying"] = Variant("b", False)
            properties["NotifyAcquired"] = Variant("b", False)
        self._tree.add(path, {CHARACTERISTIC: properties})
        for descriptor in found.descriptors:
            at = f"{path}/desc{descriptor.handle:04x}"
            remote.descriptors[at] = descriptor
            values = {
                "UUID": Variant("s", uuid128(descriptor.type)),
                "Characteristic": Variant("o", path),
                "Value": Variant("ay", b""),
            }
            self._tree.add(at, {DESCRIPTOR: values})

    def on_client_gone(self, remote: Remote, sender: str) -> None:
        """End the notifications of a client that vanished."""
        for path, characteristic in remote.characteristics.items():
            if sender in characteristic.listeners:
                self._spawn(self._remove_listener(path, characteristic, sender))

    def _characteristic(self, message: Message) -> Characteristic:
        remote = self._remotes.of(message)
        characteristic = remote.characteristics.get(message.path or "")
        if characteristic is None:
            raise BluezError("Failed", "Not connected")
        remote.users.add(message.sender or "")
        return characteristic

    async def _on_remote(self, message: Message, operation: Awaitable[Any]) -> Any:
        """Await an ATT operation, but no longer than the link lasts."""
        connection = self._remotes.of(message).connection
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
        value = value[offset(message.body[0]) :]
        # bluetoothd announces a read value as a change; clients that are notified see it as a notification
        self._tree.change(message.path or "", CHARACTERISTIC, Value=Variant("ay", value))
        return Message.new_method_return(message, "ay", [value])

    async def _read_descriptor(self, message: Message) -> Message:
        descriptor = self._remotes.of(message).descriptors.get(message.path or "")
        if descriptor is None:
            raise BluezError("Failed", "Not connected")
        value = bytes(await self._on_remote(message, descriptor.read_value()))
        self._tree.change(message.path or "", DESCRIPTOR, Value=Variant("ay", value))
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
                    lambda value: self._tree.change(path, CHARACTERISTIC, Value=Variant("ay", bytes(value))),
                )
                self._tree.change(path, CHARACTERISTIC, Notifying=Variant("b", True))
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
        self._tree.change(path, CHARACTERISTIC, Notifying=Variant("b", False))

    async def _acquire_notify(self, message: Message) -> Message:
        """Notifications as datagrams through a socket; ends when the client closes its end or the link is lost."""
        characteristic, path = self._characteristic(message), message.path or ""
        if "notify" not in characteristic.flags:
            raise BluezError("NotSupported", "Operation is not supported")
        if characteristic.listeners or characteristic.pipe is not None:
            raise BluezError("NotPermitted", "Notify acquired")
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        characteristic.pipe = ours

        def forward(value: bytes) -> None:
            with contextlib.suppress(OSError):
                ours.send(bytes(value))

        await self._subscribe(message, characteristic, forward)
        self._tree.change(path, CHARACTERISTIC, NotifyAcquired=Variant("b", True))
        self._spawn(self._release_when_closed(path, characteristic, ours))
        mtu = self._tree[path][CHARACTERISTIC]["MTU"].value
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
        self._tree.change(path, CHARACTERISTIC, NotifyAcquired=Variant("b", False))
