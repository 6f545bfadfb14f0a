"""Messages decoded, and encoded again, by the definitions that the recording itself carries."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from sense4hri_recording.errors import DAMAGE

UNDECODABLE = (TypesysError, SerdeError, *DAMAGE)
"""What bytes or definitions that make no sense raise."""


class Typed(Protocol):
    """A topic's type. definition: text of it and every nested one (`ros2msg`)."""

    @property
    def type_name(self) -> str: ...

    @property
    def definition(self) -> str: ...


class Types:
    """Message types as they become known. check: called with the definitions of every new one, may raise ValueError."""

    def __init__(self, check: Callable[[Typesdict], None] | None = None) -> None:
        self._store = get_typestore(Stores.EMPTY)
        self._known: set[str] = set()
        self._check = check

    def decode(self, topic: Typed, data: bytes) -> Any:
        """A message with its fields as attributes. Raises one of UNDECODABLE."""
        if topic.type_name not in self._known:
            self._learn(topic)
        return self._store.deserialize_cdr(data, topic.type_name)

    def encode(self, topic: Typed, message: Any) -> bytes:
        """A message of a type that was decoded before, as bytes again."""
        return bytes(self._store.serialize_cdr(message, topic.type_name))

    def _learn(self, topic: Typed) -> None:
        found = get_types_from_msg(topic.definition, topic.type_name)
        if self._check is not None:
            self._check(found)
        self._store.register({name: kind for name, kind in found.items() if name not in self._store.types})
        self._known.add(topic.type_name)
