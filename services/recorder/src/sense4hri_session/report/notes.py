"""recorder.json: what only the recorder knows. Where it is absent or damaged, nothing of it is known."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

NAME = "recorder.json"
FORMAT = 1


@dataclass
class RecorderNotes:
    """The content, whatever of it is well-formed; trouble: why there is none, empty where there is."""

    trouble: str = ""
    state: str = ""
    why: str = ""
    session: dict[str, Any] | None = None
    has_session: bool = False
    """The recorder says whether this is a session; `session` None then means that it is none."""
    host: str = ""
    opened_ns: int | None = None
    closed_ns: int | None = None
    last_written_ns: int | None = None
    software: dict[str, str] = field(default_factory=dict)
    topics: dict[str, dict[str, Any]] = field(default_factory=dict)
    refused: list[dict[str, Any]] = field(default_factory=list)
    withheld: list[str] = field(default_factory=list)
    nodes: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)


def read_notes(folder: Path) -> RecorderNotes:
    """Read a folder's recorder.json; what is not as agreed is left out."""
    path = folder / NAME
    try:
        content = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        return RecorderNotes(f"there is no {NAME}: what was lost on the way, and the nodes' parameters, are not known")
    except (OSError, ValueError, RecursionError) as err:
        return RecorderNotes(f"{NAME} cannot be read ({err}): what was lost on the way is not known")
    if not isinstance(content, dict):
        return RecorderNotes(f"{NAME} is not an object: what was lost on the way is not known")
    session = content.get("session")
    trouble = "" if content.get("format") == FORMAT else f"{NAME} has format {content.get('format')!r}, not {FORMAT}"
    return RecorderNotes(
        trouble,
        _text(content.get("state")),
        _text(content.get("why")),
        session if isinstance(session, dict) else None,
        "session" in content,
        _text(content.get("host")),
        number(content.get("opened_ns")),
        number(content.get("closed_ns")),
        number(content.get("last_written_ns")),
        {str(key): _text(value) for key, value in _dict(content.get("software")).items()},
        {item["topic"]: item for item in _dicts(content.get("topics")) if isinstance(item.get("topic"), str)},
        _dicts(content.get("refused")),
        [str(topic) for topic in _list(content.get("withheld"))],
        _dicts(content.get("nodes")),
        _dicts(content.get("events")),
    )


def number(value: object) -> int | None:
    """A whole number above zero, else None."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else None


def count(value: object) -> int:
    """A count; 0 where it is none."""
    return number(value) or 0


def _text(value: object) -> str:
    return "" if value is None else str(value)


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _dicts(value: object) -> list[dict[str, Any]]:
    return [item for item in _list(value) if isinstance(item, dict)]


def _dict(value: object) -> dict[Any, Any]:
    return value if isinstance(value, dict) else {}
