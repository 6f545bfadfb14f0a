"""The adapter of the stand-in: plugged in and powered or not, discovery per client, devices seen and forgotten."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from bumble.device import Advertisement, Device
from dbus_fast import Message, Variant

from sensor_bench.ble.listening import Listening
from sensor_bench.ble.names import (
    ADAPTER,
    DEVICE,
    BluezError,
    adapter_properties,
    advertised,
    device_properties,
    mac_of,
    passes,
)
from sensor_bench.ble.object_tree import ObjectTree
from sensor_bench.ble.remotes import Call, Remote, Remotes

FILTER_KEYS = {"UUIDs", "RSSI", "Pathloss", "Transport", "DuplicateData", "Discoverable", "Pattern"}
DEVICE_TIMEOUT_S = 30.0
"""bluetoothd forgets an unpaired device that long after it was last seen."""


class Adapter:
    """Answers the calls to Adapter1. drop(remote) ends a device's link; rssi_of(mac) says how strong it is heard."""

    def __init__(
        self,
        path: str,
        central: Device,
        tree: ObjectTree,
        remotes: Remotes,
        listening: Listening,
        drop: Callable[[Remote], Awaitable[None]],
        rssi_of: Callable[[str], int],
        device_timeout_s: float = DEVICE_TIMEOUT_S,
    ) -> None:
        self._path, self._central, self._tree, self._remotes = path, central, tree, remotes
        self._listening, self._drop, self._rssi_of = listening, drop, rssi_of
        self._device_timeout_s = device_timeout_s
        self._sessions: dict[str, dict[str, Any]] = {}
        self._filters: dict[str, dict[str, Any]] = {}

    def calls(self) -> dict[tuple[str, str], Call]:
        """(interface, member) -> handler."""
        return {
            (ADAPTER, "SetDiscoveryFilter"): self._set_discovery_filter,
            (ADAPTER, "GetDiscoveryFilters"): self._get_discovery_filters,
            (ADAPTER, "StartDiscovery"): self._start_discovery,
            (ADAPTER, "StopDiscovery"): self._stop_discovery,
            (ADAPTER, "RemoveDevice"): self._remove_device,
        }

    def plug_in(self) -> None:
        """The adapter appears, powered, and hears what is advertised."""
        self._central.on("advertisement", self._on_advertisement)
        self._add_adapter(powered=True)

    @property
    def present(self) -> bool:
        return self._path in self._tree

    @property
    def powered(self) -> bool:
        return self.present and bool(self._tree[self._path][ADAPTER]["Powered"].value)

    async def set_present(self, present: bool) -> None:
        """Plug the adapter in or pull it out; when it goes, its devices go with it."""
        if present and not self.present:
            self._add_adapter(powered=True)
        elif not present and self.present:
            await self._stop_everything()
            for remote in list(self._remotes.values()):
                self._remove_remote(remote)
            self._tree.remove(self._path)

    async def set_powered(self, powered: bool) -> None:
        """Bluetooth on or off; off ends all links and discovery."""
        if not self.present or powered == self.powered:
            return
        if not powered:
            await self._stop_everything()
        self._tree.change(self._path, ADAPTER, Powered=Variant("b", powered))

    async def _stop_everything(self) -> None:
        for sender in list(self._sessions):
            await self._end_session(sender)
        await asyncio.gather(*(self._drop(remote) for remote in list(self._remotes.values())))

    def _add_adapter(self, powered: bool) -> None:
        properties = adapter_properties(mac_of(self._central.random_address), powered)
        self._tree.add(self._path, {ADAPTER: properties})

    def require_power(self) -> None:
        """Raise what bluetoothd answers while Bluetooth is off."""
        if not self.powered:
            raise BluezError("NotReady", "Resource Not Ready")

    async def on_client_gone(self, sender: str) -> None:
        """Forget a client that left the bus."""
        self._filters.pop(sender, None)
        await self._end_session(sender)

    async def forget_clients(self) -> None:
        """Forget all clients, end their discovery and their links: the bus is gone."""
        self._filters.clear()
        await self._stop_everything()

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
        self.require_power()
        sender = message.sender or ""
        if sender in self._sessions:
            raise BluezError("InProgress", "Operation already in progress")
        self._sessions[sender] = self._filters.get(sender, {})
        await self._listening.need(+1)
        if len(self._sessions) == 1:
            self._tree.change(self._path, ADAPTER, Discovering=Variant("b", True))
        return Message.new_method_return(message)

    async def _stop_discovery(self, message: Message) -> Message:
        self.require_power()
        if (message.sender or "") not in self._sessions:
            raise BluezError("Failed", "No discovery started")
        await self._end_session(message.sender or "")
        return Message.new_method_return(message)

    async def _end_session(self, sender: str) -> None:
        if self._sessions.pop(sender, None) is None:
            return
        await self._listening.need(-1)
        if not self._sessions:
            self._tree.change(self._path, ADAPTER, Discovering=Variant("b", False))
            for path in self._remotes:
                self._tree.invalidate(path, DEVICE, "RSSI")

    def _on_advertisement(self, advertisement: Advertisement) -> None:
        if not self.powered:
            return
        mac = mac_of(advertisement.address)
        path = f"{self._path}/dev_{mac.replace(':', '_')}"
        if (remote := self._remotes.get(path)) is not None:
            remote.seen_s = time.monotonic()
            remote.advertised.set()
        name, uuids, manufacturer = advertised(advertisement.data)
        rssi = self._rssi_of(mac)
        if not any(passes(wanted, uuids, rssi) for wanted in self._sessions.values()):
            return
        if remote is None:
            self._remotes[path] = Remote(path, advertisement.address, time.monotonic())
            self._tree.add(path, {DEVICE: device_properties(self._path, mac, name, uuids, rssi, manufacturer)})
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

    async def forget_unseen(self) -> None:
        """For ever, look for devices that have not been seen for too long."""
        while True:
            await asyncio.sleep(1.0)
            horizon_s = time.monotonic() - self._device_timeout_s
            for remote in list(self._remotes.values()):
                if remote.connection is None and remote.attempt is None and remote.seen_s < horizon_s:
                    self._remove_remote(remote)
