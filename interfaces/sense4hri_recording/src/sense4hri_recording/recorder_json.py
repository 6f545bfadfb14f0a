"""`recorder.json`: what only the recorder knows of a recording. The one form of it, its one reader and its one writer.

A file that is absent, damaged or of another version costs what it would have told, never the recording.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from sense4hri.files import open_file, replace_file

from sense4hri_recording.errors import LATEST_NS

NAME = "recorder.json"
DEPTH = 3
FORMAT = 1
LARGEST_BYTES, DEEPEST = 16 << 20, 32  # a damaged disk may say anything
RECORDING, COMPLETE, INTERRUPTED = "recording", "complete", "interrupted"
UNKNOWN = "what was lost on the way, and the nodes' parameters, are not known"


@dataclass
class RecorderJson:
    """The content. Times are ROS time in ns, None where not known.

    session: `session_id study task human_ids required_streams metadata start_at_ns stop_at_ns`; None outside of
    sessions. topics: one object per topic with its counts and losses. more: what another version wrote besides.
    """

    state: str = ""
    why: str = ""
    session: dict[str, Any] | None = None
    host: str = ""
    opened_ns: int | None = None
    closed_ns: int | None = None
    last_written_ns: int | None = None
    software: dict[str, str] = field(default_factory=dict)
    topics: list[dict[str, Any]] = field(default_factory=list)
    refused: list[dict[str, Any]] = field(default_factory=list)
    withheld: list[str] = field(default_factory=list)
    nodes: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    format: int = FORMAT
    more: dict[str, Any] = field(default_factory=dict)
    trouble: str = ""
    """One sentence where the file is absent, damaged or of another version; never written."""
    says_session: bool = False
    """The file says whether this is a session: `session` None then means that it is none. Never written."""

    @property
    def session_id(self) -> str:
        """Empty outside of sessions."""
        found = (self.session or {}).get("session_id")
        return found if isinstance(found, str) else ""

    @property
    def start_at_ns(self) -> int | None:
        """The session's announced beginning; None where the recorder had not heard of it yet."""
        return number((self.session or {}).get("start_at_ns"))

    @property
    def by_topic(self) -> dict[str, dict[str, Any]]:
        """The topics' objects by their names."""
        return {topic["topic"]: topic for topic in self.topics if isinstance(topic.get("topic"), str)}

    def doubts(self, folder: Path) -> Iterator[str]:
        """What whoever uses this recording should read, in sentences; nothing of a file that is absent."""
        if self.trouble and (folder / NAME).is_file():
            yield f"{folder}: {self.trouble}"
        if self.state == RECORDING:
            yield f"{folder} is still being recorded, or its recorder was killed and has not been started since"
        if self.state == INTERRUPTED:
            yield f"{folder} was interrupted: {self.why or 'the recorder ended without closing it'}"

    def as_json(self) -> dict[str, Any]:
        """Return the content of the file."""
        return {"format": self.format, **{name: getattr(self, name) for name in _KEYS}, **self.more}


_LARGEST = (1 << 63) - 1
_KEYS = tuple(f.name for f in fields(RecorderJson) if f.name not in ("format", "more", "trouble", "says_session"))


def read(folder: Path) -> RecorderJson:
    """Read a folder's recorder.json; what is not as agreed is left out, and `trouble` says why little is known."""
    path = folder / NAME
    try:
        with open_file(path, LARGEST_BYTES) as file:
            content = plain(json.loads(file.read().decode()))
    except FileNotFoundError:
        return RecorderJson(trouble=f"there is no {NAME}: {UNKNOWN}")
    except (OSError, ValueError, RecursionError) as err:
        return RecorderJson(trouble=f"{NAME} cannot be read ({err}): {UNKNOWN}")
    if not isinstance(content, dict):
        return RecorderJson(trouble=f"{NAME} is damaged, it is not an object: {UNKNOWN}")
    return from_json(content)


def from_json(content: dict[str, Any]) -> RecorderJson:
    """The content of a file; every value that is not of the kind agreed on is as if it were not there."""
    return RecorderJson(
        state=_text(content.get("state")),
        why=_text(content.get("why")),
        session=_session(content.get("session")),
        host=_text(content.get("host")),
        opened_ns=number(content.get("opened_ns")),
        closed_ns=number(content.get("closed_ns")),
        last_written_ns=number(content.get("last_written_ns")),
        software={str(key): _text(value) for key, value in _object(content.get("software")).items()},
        topics=[_topic(item) for item in _objects(content.get("topics"))],
        refused=_objects(content.get("refused")),
        withheld=[str(topic) for topic in _list(content.get("withheld"))],
        nodes=_objects(content.get("nodes")),
        events=_objects(content.get("events")),
        format=number(content.get("format")) or 0,
        more={key: value for key, value in content.items() if key not in (*_KEYS, "format")},
        trouble=_of_another_version(content.get("format")),
        says_session="session" in content,
    )


def write(folder: Path, content: RecorderJson) -> None:
    """Replace a folder's recorder.json, whole or not at all. Raises OSError.

    What would make it longer than `read` takes is left out, the nodes first, then where messages were lost; an event
    says so. The counts stay.
    """
    text = _text_of(content)
    for what, less in (("nodes", _without_nodes), ("losses", _without_losses)):
        if len(text.encode()) > LARGEST_BYTES:
            said = f"{what} are left out: {NAME} would be longer than {LARGEST_BYTES} bytes"
            event = {"at_ns": content.last_written_ns, "what": said}
            content = replace(less(content), events=[*content.events, event])
            text = _text_of(content)
    replace_file(folder / NAME, text)


def _text_of(content: RecorderJson) -> str:
    return json.dumps(plain(content.as_json()), indent=1, ensure_ascii=False, allow_nan=False)


def _without_nodes(content: RecorderJson) -> RecorderJson:
    return replace(content, nodes=[])


def _without_losses(content: RecorderJson) -> RecorderJson:
    return replace(content, topics=[topic | {"losses": []} for topic in content.topics])


def recordings(root: Path) -> Iterator[tuple[Path, RecorderJson]]:
    """Every folder of a recording at root or below, and what its recorder.json says, in the order of names.

    A recording lies at most DEPTH folders below (`<study>/<participants>/<recording>`), so that nobody who names `/`
    waits for a whole disk.
    """
    found = [path for depth in range(DEPTH + 1) for path in root.glob("*/" * depth + NAME)]
    for path in sorted(found):
        yield path.parent, read(path.parent)


def number(value: object) -> int | None:
    """A whole number above zero, and no later than any clock shows where it is a time; else None."""
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 < value <= LATEST_NS else None


def count(value: object) -> int:
    """Return a count that was read; 0 where it is none."""
    return number(value) or 0


def _of_another_version(found: object) -> str:
    if found == FORMAT:
        return ""
    if number(found) is None:
        return f"{NAME} has no format number: what is not as in format {FORMAT} is not looked at"
    return (
        f"{NAME} is of format {found}, newer than {FORMAT}, the newest this program knows: what is new in it is not "
        "looked at"
    )


def _topic(value: dict[str, Any]) -> dict[str, Any]:
    """The account of a topic with losses, where it has any, that are a list of objects."""
    return value | {"losses": _objects(value["losses"])} if "losses" in value else value


def _session(value: object) -> dict[str, Any] | None:
    """A session with what is agreed on in it of the kind agreed on; what is there besides stays."""
    if not isinstance(value, dict):
        return None
    kinds: dict[str, Any] = {**dict.fromkeys(("session_id", "study", "task"), str), "metadata": dict}
    found = {key: item for key, item in value.items() if isinstance(item, kinds.get(key, object))}
    for key in {"human_ids", "required_streams"} & set(found):
        found[key] = [item for item in _list(found[key]) if isinstance(item, str)]
    for key in {"start_at_ns", "stop_at_ns"} & set(found):
        found[key] = number(found[key])
    return found


def plain(value: Any, deepest: int = DEEPEST) -> Any:
    """JSON that every program can write again: null for what is no finite number of 64 bits, whole characters only.

    Raises ValueError where it is nested too deeply.
    """
    if deepest < 0:
        raise ValueError(f"it is nested deeper than {DEEPEST} levels")
    if isinstance(value, dict):
        return {plain(str(key)): plain(item, deepest - 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, deepest - 1) for item in value]
    if isinstance(value, str):
        return value if value.isascii() else value.encode("utf-8", "replace").decode()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return None if isinstance(value, int) and abs(value) > _LARGEST else value


def _text(value: object) -> str:
    return "" if value is None else str(value)


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _objects(value: object) -> list[dict[str, Any]]:
    return [item for item in _list(value) if isinstance(item, dict)]


def _object(value: object) -> dict[Any, Any]:
    return value if isinstance(value, dict) else {}
