"""What may be asked for: the checks of a start and of a marker. No ROS, no clock."""

import json
import math
import re
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sense4hri.errors import Refusal
from sense4hri.names import HUMAN_ID_FORM, is_human_id, meaning
from sense4hri.patterns import checked
from sense4hri.schema import Rule, parameter
from sense4hri.strict_json import parse

_SESSION_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,62}")
_GLOB = re.compile(r"(/[A-Za-z0-9_*?]+)+")
LONGEST_NAME, LONGEST_VALUE, LONGEST_METADATA = 100, 1000, 65536
MOST_PEOPLE = 100
OLDEST_PRESS_MS = 3_600_000.0


@dataclass(frozen=True)
class StartWish:
    """A session as asked for: the fields of StartSession, and `metadata` as an object in place of metadata_json."""

    study: str = parameter("", help="name of the study; any text")
    session_id: str = parameter("", help="letters, digits, '_' and '-'; empty: generated")
    task: str = parameter("", help="any text")
    metadata_json: str = parameter("", help="a JSON object as text")
    metadata: dict[str, Any] = field(default_factory=dict, metadata={"rule": Rule("the same, as an object")})
    human_ids: tuple[str, ...] = parameter((), help="who takes part; empty: everybody")
    required_streams: tuple[str, ...] = parameter((), help="full topic names or globs")
    allow_warmup: bool = parameter(False, help="begin before every clock is locked")


@dataclass(frozen=True)
class StopWish:
    """The end of a session."""

    session_id: str = parameter("", help="empty: whichever runs")


@dataclass(frozen=True)
class MarkerWish:
    """A marker as asked for."""

    name: str = parameter("", help="a name of the contract or of the study")
    value: str = parameter("", help="any text")
    human_id: str = parameter("", help="whom it concerns; empty: everybody")
    age_ms: float = parameter(0.0, help="how long ago the event was", unit="ms", low=0, high=OLDEST_PRESS_MS)
    uncertainty_ms: float = parameter(math.nan, help="half width of that, unless unknown", unit="ms", low=0)
    source: str = parameter("", help="who says so; empty: http")


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


def request(wish: StartWish) -> Request:
    """Return the session that somebody wishes for. Raises Refusal that names the field."""
    study = _text("study", wish.study, LONGEST_NAME)
    if not study:
        raise Refusal("study is empty: name the study", "study")
    session_id = _text("session_id", wish.session_id, LONGEST_NAME)
    if session_id and not _SESSION_ID.fullmatch(session_id):
        raise Refusal(
            f"session_id {session_id!r}: letters, digits, '_' and '-', a letter or digit first, at most 63; "
            "study and task may be free text",
            "session_id",
        )
    task = _text("task", wish.task, LONGEST_NAME)
    return Request(study, session_id, task, _metadata(wish), _human_ids(wish), _streams(wish))


def ended(wish: StopWish) -> str:
    """Return which session somebody wants to end, empty: whichever runs. Raises Refusal that names the field."""
    return _text("session_id", wish.session_id, LONGEST_NAME)


def press(wish: MarkerWish) -> Press:
    """Return the marker that somebody wishes for. Raises Refusal that names the field."""
    name, human_id = _text("name", wish.name, LONGEST_NAME), _text("human_id", wish.human_id, LONGEST_NAME)
    if not name:
        raise Refusal("name is empty: name the marker", "name")
    if human_id and not is_human_id(human_id):
        raise Refusal(f"human_id {human_id!r}: {HUMAN_ID_FORM}", "human_id")
    value, source = _text("value", wish.value, LONGEST_VALUE), _text("source", wish.source, LONGEST_NAME)
    return Press(name, value, human_id, wish.age_ms / 1000, wish.uncertainty_ms / 1000, source)


def _human_ids(wish: StartWish) -> tuple[str, ...]:
    if len(wish.human_ids) > MOST_PEOPLE:
        raise Refusal(f"human_ids names {len(wish.human_ids)} people, at most {MOST_PEOPLE} are allowed", "human_ids")
    for human_id in wish.human_ids:
        if means := meaning(human_id):
            raise Refusal(f"human_ids: {human_id!r} is no participant: it means {means}", "human_ids")
        if not is_human_id(human_id):
            raise Refusal(f"human_ids: {human_id!r} is no participant: {HUMAN_ID_FORM}", "human_ids")
        if wish.human_ids.count(human_id) > 1:
            raise Refusal(f"human_ids: {human_id!r} is named twice", "human_ids")
    return wish.human_ids


def _streams(wish: StartWish) -> tuple[str, ...]:
    for stream in checked(wish.required_streams, "required_streams"):
        if not _GLOB.fullmatch(stream):
            raise Refusal(
                f"required_streams: {stream!r} is no full topic name or glob, such as /humans/**/raw",
                "required_streams",
            )
    return wish.required_streams


def _metadata(wish: StartWish) -> str:
    """Return metadata_json, with `allow_warmup` in it where that is asked for."""
    try:
        found = parse(wish.metadata_json, "it", LONGEST_METADATA) if wish.metadata_json else wish.metadata
    except Refusal as err:
        raise Refusal(f"metadata_json cannot be taken: {err}", "metadata_json") from err
    if not isinstance(found, dict):
        raise Refusal("metadata_json must be a JSON object", "metadata_json")
    if not isinstance(found.get("allow_warmup", False), bool):
        raise Refusal("allow_warmup must be true or false", "metadata_json")
    if wish.allow_warmup:
        found = {**found, "allow_warmup": True}
    text = json.dumps(found, ensure_ascii=False, allow_nan=False) if found else ""
    return _text("metadata_json", text, LONGEST_METADATA, lines=True)


def _text(name: str, text: str, longest: int, lines: bool = False) -> str:
    if len(text) > longest:
        raise Refusal(f"{name} has {len(text)} characters, at most {longest} are allowed", name)
    if not lines and not text.isprintable():
        raise Refusal(f"{name} {text!r} holds a character that cannot be printed", name)
    return text
