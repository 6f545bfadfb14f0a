"""What in a recording belongs to a pseudonym, and a message without it.

Two kinds of names. The pseudonym itself is looked for as a whole word in every text. Persons, faces, bodies and voices
(ROS4HRI) that the recording ties to it, and to nobody else, are looked for as whole texts, alone or as a frame
(`face_<id>`); in markers and in a session's metadata as a frame only: a condition may be called `1` as a face is. What
the recording does not tie is left and said: nothing is guessed.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Iterable
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from sense4hri.names import ROOT, UNASSIGNED
from sense4hri.patterns import Patterns
from sense4hri.pseudonym import GONE, Pseudonym, json_texts

KINDS = {1: "persons", 2: "faces", 3: "bodies", 4: "voices"}  # as in hri_msgs/IdsMatch
_FRAMES = {"persons": "person", "faces": "face", "bodies": "body", "voices": "voice"}
_PART = re.compile(r"/humans/(persons|faces|bodies|voices)/([^/]+)/(\w+)")
_ASKED = re.compile(r"/humans/(persons|faces|bodies|voices)/(\w+)/\*\*")
_STATE = re.compile(rf"{ROOT}/([^/]+)/state")
_TIES = {"face_id": "faces", "body_id": "bodies", "voice_id": "voices", "alias": "persons"}
_LEAST_MATCH = 0.5  # hri_person_manager's own threshold
_FREE_TEXT = frozenset({"detail", "value", "name", "message"})
_NAMES = frozenset({"session_id", "study", "task"})
_JSON = frozenset({"metadata_json", "parameters_json"})
_MARKER = "sense4hri_msgs/msg/Marker"
_OURS = ("sense4hri_msgs/", "diagnostic_msgs/")
_DROP = object()

Node = tuple[str, str]  # (kind, id); kind "human" for a pseudonym


@dataclass
class Evidence:
    """Which pseudonyms, persons, faces, bodies and voices the recording ties together."""

    edges: dict[Node, set[Node]] = field(default_factory=dict)
    worn: dict[str, set[str]] = field(default_factory=dict)
    """sensor_ids by pseudonym."""

    @staticmethod
    def wanted(topic: str) -> bool:
        """True for a topic that `add` learns from."""
        part = _PART.fullmatch(topic)
        own = topic in ("/study/assignments", "/study/sensors", "/humans/candidate_matches")
        return own or bool(_STATE.fullmatch(topic)) or bool(part and part[1] == "persons" and part[3] in _TIES)

    def add(self, topic: str, message: Any) -> None:
        """Learn from one message."""
        part, state = _PART.fullmatch(topic), _STATE.fullmatch(topic)
        if topic == "/study/assignments":
            for item in message.assignments:
                self.worn.setdefault(item.human_id, set()).add(item.sensor_id)
                self._tie(("human", item.human_id), ("persons", item.person_id))
        elif topic == "/study/sensors":
            for item in message.sensors:
                self.worn.setdefault(item.human_id, set()).add(item.sensor_id)
        elif topic == "/humans/candidate_matches":
            one = (KINDS.get(message.id1_type, ""), message.id1)
            other = (KINDS.get(message.id2_type, ""), message.id2)
            if message.confidence > _LEAST_MATCH:
                self._tie(one, other)
        elif state:
            self._tie(("human", state[1]), ("persons", message.person_id))
            self._tie(("human", state[1]), ("faces", message.face_id))
        elif part:
            self._tie(("persons", part[2]), (_TIES[part[3]], message.data))

    def ids_of(self, human_id: str, humans: Iterable[str], persons: Iterable[str]) -> tuple[set[Node], set[Node]]:
        """Ids tied to a pseudonym alone, and those tied to it and to another one as well."""
        for name in set(persons) & {human_id, *humans}:
            if not any(kind == "persons" for kind, _ in self.edges.get(("human", name), ())):
                self._tie(("human", name), ("persons", name))
        others = {name for kind, name in self.edges if kind == "human"} - {human_id, UNASSIGNED}
        own = self._reach(human_id)
        shared = own & set().union(*(self._reach(other) for other in others))
        return own - shared, shared

    def tied(self) -> set[Node]:
        """Every id that belongs to some pseudonym."""
        return set().union(*(self._reach(name) for kind, name in self.edges if kind == "human"))

    def _tie(self, one: Node, other: Node) -> None:
        if not all(isinstance(text, str) for text in (*one, *other)):
            raise TypeError("names are texts")
        if all((*one, *other)):
            self.edges.setdefault(one, set()).add(other)
            self.edges.setdefault(other, set()).add(one)

    def _reach(self, human_id: str) -> set[Node]:
        """What hangs on a pseudonym: its persons and what hangs on them; a face does not lead to further persons."""
        found: set[Node] = set()
        waiting = [("human", human_id)]
        while waiting:
            at = waiting.pop()
            for node in self.edges.get(at, set()) - found:
                if node[0] != "human" and (node[0] != "persons" or at[0] in ("human", "persons")):
                    found.add(node)
                    waiting.append(node)
        return found


class Traces(Pseudonym):
    """The traces of one pseudonym. others: further pseudonyms of the recording. also: globs of topics to remove too."""

    def __init__(self, human_id: str, ids: set[Node], others: Collection[str] = (), also: tuple[str, ...] = ()) -> None:
        super().__init__(human_id, others)
        asked = {(found[1], found[2]) for glob in also if (found := _ASKED.fullmatch(glob))}
        self.ids = {(kind, name) for kind, name in ids | asked if kind in _FRAMES}
        self._also = Patterns(also)
        self._alone = {name for _, name in self.ids}
        self._frames = {f"{frame}_{name}" for kind, name in self.ids for frame in (_FRAMES[kind], "gaze", "head")}
        anywhere = [self._part.pattern, *(re.escape(name) for _, name in self.ids)]
        self._bytes = re.compile("|".join(anywhere).encode())
        self._needles = [name.encode() for name in {*self._names, *(name for _, name in self.ids)}]

    @cached_property
    def typed(self) -> Traces:
        """The same for what somebody typed, in which no id alone is a trace."""
        traces = copy(self)
        traces._alone = set()
        return traces

    def may_be_in(self, data: bytes) -> bool:
        """False for bytes without which no message has a trace. Looks for the bare names first: faster."""
        return any(needle in data for needle in self._needles) and bool(self._bytes.search(data))

    def owns_topic(self, topic: str) -> bool:
        """True where everything on a topic is the pseudonym's."""
        if topic.startswith(f"{ROOT}/{self.human_id}/"):
            return True
        parts = topic.split("/")
        owned = len(parts) > 4 and parts[1] == "humans" and (parts[2], parts[3]) in self.ids
        return owned or self._also.match(topic)

    def mentions(self, text: str) -> bool:
        """True where a text names the pseudonym as a word, one of its topics, or is the name of one of its ids."""
        named = super().mentions(text) or text in self._alone or text in self._frames
        return named or (text[:1] == "/" and self.owns_topic(text))

    def is_in(self, value: Any, type_name: str = "") -> bool:
        """True where any text within a value (message of this type, list, JSON) mentions the pseudonym."""
        traces = self.typed if type_name == _MARKER else self
        return any(traces.mentions(text) for text in texts(value))

    def without(self, message: Any, type_name: str) -> Any:
        """The message itself where it has no trace, a copy without, or None where nothing of it may stay."""
        traces = self.typed if type_name == _MARKER else self
        edited = traces._edit(message, "", type_name.startswith(_OURS))
        return None if edited is _DROP else edited

    def _edit(self, value: Any, name: str, ours: bool) -> Any:
        if isinstance(value, str):
            return self._edit_text(value, name, ours)
        if isinstance(value, list):
            items = [self._edit(item, "", ours) for item in value]
            kept = [item for item in items if item is not _DROP]
            return value if len(kept) == len(value) and all(a is b for a, b in zip(kept, value, strict=True)) else kept
        if not dataclasses.is_dataclass(value) or isinstance(value, type):
            return value
        if getattr(value, "human_id", None) == self.human_id:
            return _DROP
        changed = {}
        for spec in dataclasses.fields(value):
            if spec.name == "__msgtype__":
                continue
            before = getattr(value, spec.name)
            after = self._edit(before, spec.name, ours)
            if after is _DROP:
                return _DROP
            if after is not before:
                changed[spec.name] = after
        return dataclasses.replace(value, **changed) if changed else value

    def _edit_text(self, text: str, name: str, ours: bool) -> Any:
        if ours and name == "directory":
            return self.path_without(text)
        if ours and name in _NAMES:
            return self.name_without(text)
        if ours and name in _JSON:
            return (self.typed if name == "metadata_json" else self).json_without(text)
        if not self.mentions(text):
            return text
        return f"({GONE})" if ours and name in _FREE_TEXT else _DROP


def texts(value: Any) -> Iterable[str]:
    """Every text within a message, a list or JSON, the keys among them."""
    if isinstance(value, list | tuple):
        for item in value:
            yield from texts(item)
    elif dataclasses.is_dataclass(value):
        for spec in dataclasses.fields(value):
            if spec.name != "__msgtype__":
                yield from texts(getattr(value, spec.name))
    else:
        yield from json_texts(value)
