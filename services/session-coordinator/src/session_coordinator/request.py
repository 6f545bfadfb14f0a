"""What may be asked for: the checks of a start and of a marker. No ROS, no clock."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from sense4hri.names import UNASSIGNED, is_human_id

_SESSION_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,62}")
_GLOB = re.compile(r"(/[A-Za-z0-9_*?]+)+")
LONGEST_NAME, LONGEST_VALUE, LONGEST_METADATA = 100, 1000, 65536
OLDEST_PRESS_MS = 3_600_000.0


class Request(NamedTuple):
    """A session as asked for, checked."""

    study: str
    session_id: str = ""
    task: str = ""
    metadata_json: str = ""
    human_ids: tuple[str, ...] = ()
    required_streams: tuple[str, ...] = ()


class Press(NamedTuple):
    """A marker as asked for, checked; uncertainty_s is NaN where nobody knows it."""

    name: str
    value: str
    human_id: str
    age_s: float
    uncertainty_s: float
    source: str


def request(fields: Mapping[str, Any]) -> Request:
    """Return the session that the fields of a StartSession ask for. Raises ValueError that names the field."""
    _only(fields, {*Request._fields, "allow_warmup", "metadata"})
    study = _text(fields, "study", LONGEST_NAME)
    if not study:
        raise ValueError("study is empty: name the study")
    session_id = _text(fields, "session_id", LONGEST_NAME)
    if session_id and not _SESSION_ID.fullmatch(session_id):
        raise ValueError(
            f"session_id {session_id!r}: letters, digits, '_' and '-', a letter or digit first, at most 63; "
            "study and task may be free text"
        )
    human_ids = _texts(fields, "human_ids")
    for human_id in human_ids:
        if not is_human_id(human_id) or human_id == UNASSIGNED:
            raise ValueError(
                f"human_ids: {human_id!r} is no participant: letters, digits and single '_', a letter first, at most 63"
            )
        if human_ids.count(human_id) > 1:
            raise ValueError(f"human_ids: {human_id!r} is named twice")
    streams = _texts(fields, "required_streams")
    for stream in streams:
        if not _GLOB.fullmatch(stream):
            raise ValueError(f"required_streams: {stream!r} is no full topic name or glob, such as /humans/**/raw")
    return Request(study, session_id, _text(fields, "task", LONGEST_NAME), _metadata(fields), human_ids, streams)


def press(fields: Mapping[str, Any]) -> Press:
    """Return the marker that a request asks for. Raises ValueError that names the field."""
    _only(fields, {"name", "value", "human_id", "age_ms", "uncertainty_ms", "source"})
    name, human_id = _text(fields, "name", LONGEST_NAME), _text(fields, "human_id", LONGEST_NAME)
    if not name:
        raise ValueError("name is empty: name the marker")
    if human_id and not is_human_id(human_id):
        raise ValueError(f"human_id {human_id!r}: letters, digits and single '_', a letter first, at most 63")
    age_ms = _number(fields, "age_ms", 0.0)
    if not 0 <= age_ms <= OLDEST_PRESS_MS:
        raise ValueError(f"age_ms is {age_ms:g}, must be 0 to {OLDEST_PRESS_MS:g}")
    uncertainty_ms = _number(fields, "uncertainty_ms", math.nan)
    if uncertainty_ms < 0:
        raise ValueError(f"uncertainty_ms is {uncertainty_ms:g}, must not be negative")
    value, source = _text(fields, "value", LONGEST_VALUE), _text(fields, "source", LONGEST_NAME)
    return Press(name, value, human_id, age_ms / 1000, uncertainty_ms / 1000, source)


def _metadata(fields: Mapping[str, Any]) -> str:
    """Return metadata_json, with `allow_warmup` in it where that is asked for."""
    text = _text(fields, "metadata_json", LONGEST_METADATA, lines=True)
    try:
        found = json.loads(text) if text else fields.get("metadata", {})
    except ValueError as err:
        raise ValueError(f"metadata_json is not JSON: {err}") from err
    if not isinstance(found, dict):
        raise ValueError("metadata_json must be a JSON object")
    allowed = fields.get("allow_warmup", False)
    if not isinstance(allowed, bool) or not isinstance(found.get("allow_warmup", False), bool):
        raise ValueError("allow_warmup must be true or false")
    if allowed:
        found = {**found, "allow_warmup": True}
    return json.dumps(found, ensure_ascii=False, allow_nan=False) if found else ""


def _only(fields: Mapping[str, Any], known: set[str]) -> None:
    for name in sorted(fields.keys() - known):
        raise ValueError(f"{name!r} is not a field; fields are {', '.join(sorted(known))}")


def _text(fields: Mapping[str, Any], name: str, longest: int, lines: bool = False) -> str:
    text = fields.get(name, "")
    if not isinstance(text, str):
        raise ValueError(f"{name} is {text!r}, must be a string")
    if len(text) > longest:
        raise ValueError(f"{name} has {len(text)} characters, at most {longest} are allowed")
    if not lines and not text.isprintable():
        raise ValueError(f"{name} {text!r} holds a character that cannot be printed")
    return text


def _texts(fields: Mapping[str, Any], name: str) -> tuple[str, ...]:
    texts = fields.get(name, ())
    if not isinstance(texts, list | tuple) or not all(isinstance(text, str) for text in texts):
        raise ValueError(f"{name} must be a list of strings")
    return tuple(texts)


def _number(fields: Mapping[str, Any], name: str, default: float) -> float:
    value = fields.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{name} is {value!r}, must be a number")
    return float(value)
