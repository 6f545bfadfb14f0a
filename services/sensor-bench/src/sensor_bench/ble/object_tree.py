"""The objects that a D-Bus service exports: a tree of properties that announces every change."""

from collections.abc import Callable, Iterator
from typing import Any

from dbus_fast import Message, MessageType, Variant

from sensor_bench.ble.names import OBJECT_MANAGER, PROPERTIES, Properties


class ObjectTree:
    """Path -> interface -> properties; changes go out through `send` as ObjectManager and Properties signals."""

    def __init__(self, send: Callable[[Message], None]) -> None:
        self._send = send
        self._objects: dict[str, dict[str, Properties]] = {}

    def __contains__(self, path: object) -> bool:
        return path in self._objects

    def __iter__(self) -> Iterator[str]:
        return iter(self._objects)

    def __getitem__(self, path: str) -> dict[str, Properties]:
        return self._objects[path]

    def all(self) -> dict[str, dict[str, Properties]]:
        """Everything, as GetManagedObjects returns it."""
        return self._objects

    def add(self, path: str, interfaces: dict[str, Properties]) -> None:
        self._objects[path] = interfaces
        self._signal("/", OBJECT_MANAGER, "InterfacesAdded", "oa{sa{sv}}", [path, interfaces])

    def remove(self, path: str) -> None:
        if (interfaces := self._objects.pop(path, None)) is not None:
            self._signal("/", OBJECT_MANAGER, "InterfacesRemoved", "oas", [path, list(interfaces)])

    def remove_below(self, path: str) -> None:
        """Remove all children, the deepest first."""
        for child in sorted((known for known in self._objects if known.startswith(path + "/")), reverse=True):
            self.remove(child)

    def change(self, path: str, interface: str, **values: Variant) -> None:
        if path in self._objects:
            self._objects[path][interface].update(values)
            self._signal(path, PROPERTIES, "PropertiesChanged", "sa{sv}as", [interface, values, []])

    def invalidate(self, path: str, interface: str, name: str) -> None:
        """Take a property away."""
        if path in self._objects and self._objects[path][interface].pop(name, None) is not None:
            self._signal(path, PROPERTIES, "PropertiesChanged", "sa{sv}as", [interface, {}, [name]])

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
