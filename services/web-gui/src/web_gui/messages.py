"""What a page sends, checked. Pure."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from sense4hri import strict_json
from sense4hri.intake import LONGEST_NAME
from sense4hri.names import HUMAN_ID_FORM, SENSOR_ID_FORM, UNASSIGNED, StreamName, is_human_id, is_sensor_id, meaning
from sense4hri.stamps import SECOND_NS

from web_gui.view import MOST_CHANNELS, LaneRequest, Request

MOST_COLUMNS, MOST_LANES = 8192, 512
SHORTEST_S, LONGEST_S = 0.5, 120.0
LONGEST_TEXT, LONGEST_METADATA, MOST_NAMES = 1000, 32_768, 1000
LAST_NUMBER = 2**32 - 1
LAST_MS = 9e12
ORDERS = ("start", "stop", "assign", "marker")


class Ack(NamedTuple):
    """A page has taken the frame of this number."""

    number: int


class Ping(NamedTuple):
    """A page asks what time it is here."""

    number: int


class Start(NamedTuple):
    """A reader wants a session; the fields are those of StartSession."""

    number: int
    study: str
    session_id: str
    task: str
    metadata_json: str
    human_ids: tuple[str, ...]
    required_streams: tuple[str, ...]
    allow_warmup: bool


class Stop(NamedTuple):
    """A reader wants the session to end; session_id empty: whichever runs."""

    number: int
    session_id: str


class Assign(NamedTuple):
    """A reader says who wears a sensor from now on; both are free text until `fault` is empty."""

    number: int
    sensor_id: str
    human_id: str

    @property
    def fault(self) -> str:
        """Which of the two is no such id, and what one looks like; empty where both are."""
        if not is_sensor_id(self.sensor_id):
            return f"{self.sensor_id!r} is no sensor_id: {SENSOR_ID_FORM}"
        if self.human_id != UNASSIGNED and (means := meaning(self.human_id)):
            return f"{self.human_id!r} is no participant: it means {means}"
        return "" if is_human_id(self.human_id) else f"{self.human_id!r} is no pseudonym: {HUMAN_ID_FORM}"


class Press(NamedTuple):
    """A marker. at_ns: the press on the host's wall clock; uncertainty_s: half width of that."""

    number: int
    name: str
    value: str
    human_id: str
    at_ns: int
    uncertainty_s: float


class Unfit(ValueError):
    """What is wrong with an order whose number is known, so that it can be answered."""

    def __init__(self, why: str, number: int) -> None:
        super().__init__(why)
        self.number = number


Message = Request | Ack | Ping | Start | Stop | Assign | Press


def parse(text: str) -> Message:
    """Return what a page says. Raises ValueError that names what is wrong, Unfit where it is an order."""
    message = strict_json.parse(text.encode(errors="replace"))
    if not isinstance(message, dict):
        raise ValueError("the message must be a JSON object")
    kind = message.get("type")
    if not isinstance(kind, str) or kind not in _READERS:
        raise ValueError(f"type is {kind!r}, must be one of {', '.join(_READERS)}")
    if kind not in ORDERS:
        return _READERS[kind](message)
    number = _number(message)
    try:
        return _READERS[kind](message)
    except ValueError as err:
        raise Unfit(str(err), number) from err


def _view(message: dict[str, Any]) -> Request:
    window_s = _real(message, "window_s", SHORTEST_S, LONGEST_S)
    end_ms = None if message.get("end_ms") is None else _real(message, "end_ms", 0, LAST_MS)
    lanes = message.get("lanes")
    if not isinstance(lanes, list) or len(lanes) > MOST_LANES:
        raise ValueError(f"lanes must be a list of at most {MOST_LANES}")
    return Request(
        _number(message, "view"),
        _whole(message, "columns", 1, MOST_COLUMNS),
        round(window_s * SECOND_NS),
        None if end_ms is None else round(end_ms * 1e6),
        tuple(_lane(lane) for lane in lanes),
    )


def _lane(lane: Any) -> LaneRequest:
    if not isinstance(lane, dict) or not isinstance(lane.get("stream"), str):
        raise ValueError("a lane must be an object with the string `stream`")
    parts = lane["stream"].split("/")
    if len(parts) != 3:
        raise ValueError(f"stream is {lane['stream'][:200]!r}, must be 'human_id/sensor_type/sensor_id'")
    channels = lane.get("channels")
    if channels is None:
        return LaneRequest(StreamName(*parts).checked(), None)
    if not isinstance(channels, list) or len(channels) > MOST_CHANNELS:
        raise ValueError(f"channels must be a list of at most {MOST_CHANNELS} whole numbers")
    if not all(type(channel) is int and 0 <= channel < 2**16 for channel in channels):
        raise ValueError("channels must be whole numbers from 0")
    return LaneRequest(StreamName(*parts).checked(), tuple(channels))


def _ack(message: dict[str, Any]) -> Ack:
    return Ack(_number(message))


def _ping(message: dict[str, Any]) -> Ping:
    return Ping(_number(message))


def _start(message: dict[str, Any]) -> Start:
    allow_warmup = message.get("allow_warmup", False)
    if not isinstance(allow_warmup, bool):
        raise ValueError("allow_warmup must be true or false")
    return Start(
        _number(message),
        _text(message, "study"),
        _text(message, "session_id"),
        _text(message, "task"),
        _text(message, "metadata_json", LONGEST_METADATA),
        _texts(message, "human_ids"),
        _texts(message, "required_streams"),
        allow_warmup,
    )


def _stop(message: dict[str, Any]) -> Stop:
    return Stop(_number(message), _text(message, "session_id"))


def _assign(message: dict[str, Any]) -> Assign:
    return Assign(_number(message), _text(message, "sensor_id"), _text(message, "human_id"))


def _press(message: dict[str, Any]) -> Press:
    name, human_id = _text(message, "name", LONGEST_NAME), _text(message, "human_id")
    if not name:
        raise ValueError("name is empty: name the marker")
    if human_id and not is_human_id(human_id):
        raise ValueError(f"human_id {human_id!r}: {HUMAN_ID_FORM}")
    at_ns = round(_real(message, "at_ms", 0, LAST_MS) * 1e6)
    uncertainty_s = _real(message, "uncertainty_ms", 0, 60_000) / 1000
    return Press(_number(message), name, _text(message, "value"), human_id, at_ns, uncertainty_s)


def _number(message: dict[str, Any], key: str = "number") -> int:
    return _whole(message, key, 0, LAST_NUMBER)


def _whole(message: dict[str, Any], key: str, low: int, high: int) -> int:
    value = message.get(key)
    if type(value) is not int or not low <= value <= high:
        raise ValueError(f"{key} must be a whole number from {low} to {high}")
    return value


def _real(message: dict[str, Any], key: str, low: float, high: float) -> float:
    value = message.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{key} must be a number")
    if not low <= value <= high:
        raise ValueError(f"{key} must be a number from {low:g} to {high:g}")
    return float(value)


def _text(message: dict[str, Any], key: str, longest: int = LONGEST_TEXT) -> str:
    value = message.get(key, "")
    if not isinstance(value, str) or len(value) > longest:
        raise ValueError(f"{key} must be a text of at most {longest} characters")
    return value


def _texts(message: dict[str, Any], key: str) -> tuple[str, ...]:
    values = message.get(key, [])
    if not isinstance(values, list) or len(values) > MOST_NAMES or not all(isinstance(v, str) for v in values):
        raise ValueError(f"{key} must be a list of at most {MOST_NAMES} texts")
    return tuple(_text({key: value}, key) for value in values)


_READERS: dict[str, Callable[[dict[str, Any]], Message]] = {
    "view": _view,
    "ack": _ack,
    "ping": _ping,
    "start": _start,
    "stop": _stop,
    "assign": _assign,
    "marker": _press,
}
