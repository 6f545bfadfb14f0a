"""Messages decoded, and encoded again, by the definitions that the recording itself carries."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Protocol

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from sense4hri_recording import definitions
from sense4hri_recording.errors import DAMAGE

LARGEST_DEFINITION, LARGEST_DEFINITIONS = 128 << 10, 1 << 20  # characters, of one type and of all
MOST_KEPT = 64  # types, beside those of open recordings

UNDECODABLE = (TypesysError, SerdeError, *DAMAGE)
"""What bytes or definitions that make no sense raise."""


class Typed(Protocol):
    """A topic's type. definition: text of it and every nested one (`ros2msg`)."""

    @property
    def type_name(self) -> str: ...

    @property
    def definition(self) -> str: ...


class Types:
    """Message types as they become known, each by the definition that the recording carries (`definitions`)."""

    def __init__(self) -> None:
        self._known: dict[str, Typestore] = {}
        self._refused: dict[str, str] = {}
        self._read_bytes = 0

    def decode(self, topic: Typed, data: bytes) -> Any:
        """A message with its fields as attributes. Raises one of UNDECODABLE."""
        if topic.type_name not in self._known:
            self._learn(topic)
        return self._known[topic.type_name].deserialize_cdr(data, topic.type_name)

    def encode(self, topic: Typed, message: Any) -> bytes:
        """A message of a type that was decoded before, as bytes again."""
        return bytes(self._known[topic.type_name].serialize_cdr(message, topic.type_name))

    def _learn(self, topic: Typed) -> None:
        """Take a type in, or remember why not: a definition is looked at once."""
        if topic.type_name in self._refused:
            raise ValueError(self._refused[topic.type_name])
        try:
            self._check_size(topic)
            self._known[topic.type_name] = _typestore(topic.type_name, topic.definition)
        except UNDECODABLE as err:
            self._refused[topic.type_name] = str(err) or type(err).__name__
            raise

    def _check_size(self, topic: Typed) -> None:
        self._read_bytes += len(topic.definition)
        if len(topic.definition) > LARGEST_DEFINITION or self._read_bytes > LARGEST_DEFINITIONS:
            raise ValueError(f"the definition of {topic.type_name[:100]} has {len(topic.definition)} characters")


@lru_cache(maxsize=MOST_KEPT)
def _typestore(name: str, definition: str) -> Typestore:
    """What reads and writes messages of a type; making it takes 50 ms, and most recordings carry the same types."""
    found = get_types_from_msg(definition, name)
    definitions.check(found, name)
    store = get_typestore(Stores.EMPTY)
    store.register(found)
    return store
