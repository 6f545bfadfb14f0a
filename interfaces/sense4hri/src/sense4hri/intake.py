"""What may come in off the graph: checked once, where it enters, before a service sees it. Pure.

Refused is only what somebody behind would stumble over: stamps and numbers that no clock and no sensor has, texts and
lists without end, ids that are none. NaN stays ("cannot be computed"), except in the numbers that clock arithmetic
rests on. What a field may hold follows from its type and, where that says too little, from its name.
"""

import re
import struct
from array import array
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from sense4hri.errors import Refused
from sense4hri.stamps import SECOND_NS

MOST_BYTES = 4 << 20
LARGEST = 1e30
"""No unit of the contract has larger numbers, and their fourth powers are still finite."""
LARGEST_DIFFERENCE_NS = 1 << 61  # of two stamps, each within 0 .. 2^31 s
LARGEST_TOTAL = 1 << 53
LARGEST_PPM = 1e6
LONGEST_TEXT, LONGEST_JSON, LONGEST_NAME = 1 << 16, 1 << 20, 256
MOST_ITEMS = 10_000
MOST_NUMBERS = MOST_BYTES // 8

_PEOPLE = frozenset({"human_id", "person_id"})
_IDS = frozenset({"human_id", "sensor_id", "sensor_type", "person_id", "face_id", "session_id"})
_NAMES = frozenset({"name", "unit", "channel_name", "frame_id", "service", "source", "from_host", "to_host", "host"})
_ID = re.compile(r"[A-Za-z0-9_-]{0,255}")
_ID_FORM = "letters, digits, '_' and '-' alone"
_HIGHEST = {
    ("StreamHealth", "state"): 4,
    ("ClockModel", "state"): 2,
    ("HostClock", "state"): 2,
    ("SessionState", "phase"): 4,
    ("SessionAck", "phase"): 4,
}
_FINITE = frozenset({("ClockModel", "uncertainty_s"), ("ClockMeasurement", "uncertainty_s")})

Test = Callable[[Any], str]
"""test(value): what is wrong with it, empty where nothing is."""


def check(message: Any) -> None:
    """Raise Refused, with a sentence that names the field, where a message or request is none that can be used."""
    why = _wrong(message)
    if why:
        raise Refused(why)


def check_bytes(cdr: bytes) -> None:
    """Raise Refused where a serialised message is too long to be looked at, or has no plain encapsulation."""
    if len(cdr) > MOST_BYTES:
        raise Refused(f"it has {len(cdr)} bytes, more than {MOST_BYTES}")
    if len(cdr) < 4 or cdr[0] != 0:
        raise Refused(f"its {len(cdr)} bytes are no serialised message")


@lru_cache(maxsize=1000)
def has_both_stamps(kind: type) -> bool:
    """True for a message class that begins `Header header; Time device_timestamp`."""
    fields: dict[str, str] = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    return list(fields)[:2] == ["header", "device_timestamp"]


def check_stamps(cdr: bytes) -> None:
    """Raise Refused where the stamps of a serialised `Header header; Time device_timestamp; ...` cannot be read."""
    order = "<" if cdr[1] & 1 else ">"
    try:
        received, (length,) = struct.unpack_from(order + "iI", cdr, 4), struct.unpack_from(order + "I", cdr, 12)
        device = struct.unpack_from(order + "iI", cdr, 16 + (length + 3) // 4 * 4)
    except struct.error:
        raise Refused("it is cut short") from None
    for field, (seconds, nanoseconds) in (("header.stamp", received), ("device_timestamp", device)):
        why = _no_time(seconds, nanoseconds)
        if why:
            raise Refused(f"{field} {why}")


def _wrong(message: Any) -> str:
    kind: Any = type(message)
    for field, test in _tests(kind):
        why = test(getattr(message, field))
        if why:
            return _at(field, why)
    return ""


def _at(place: str, why: str) -> str:
    """Put the place before what is wrong there, which may begin with a place within it."""
    return f"{place}{why}" if why[0] in ".[" else f"{place} {why}"


def _within_message(message: Any) -> str:
    why = _wrong(message)
    return f".{why}" if why else ""


@lru_cache(maxsize=1000)
def _tests(kind: type) -> tuple[tuple[str, Test], ...]:
    """Return the fields of a message class that can be wrong, each with its test."""
    fields: dict[str, str] = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    found = ((field, _test(kind.__name__, field, type_name)) for field, type_name in fields.items())
    return tuple((field, test) for field, test in found if test is not None)


def _test(kind: str, field: str, type_name: str) -> Test | None:
    item = type_name.removeprefix("sequence<").partition(",")[0].rstrip(">").partition("[")[0]
    many = item != type_name and not type_name.startswith(("string<", "wstring<"))
    if item.startswith(("string", "wstring")):
        one = _text_test(field)
        return _each(one) if many else one
    if "/" in item:
        one = _time if item == "builtin_interfaces/Time" else _within_message
        return _each(one) if many else one
    if item in ("double", "float"):
        return _numbers if many else _number_test(kind, field)
    return _count if many else _integer_test(kind, field, item)


def _number_test(kind: str, field: str) -> Test:
    if field == "skew_ppm":
        return lambda value: "" if abs(value) <= LARGEST_PPM else f"is {value:g}, which no clock has"
    if (kind, field) in _FINITE:
        return lambda value: "" if 0 <= value <= LARGEST else f"is {value:g}, must be a finite number from 0 on"
    return lambda value: f"is {value:g}, must be a number up to {LARGEST:g}" if abs(value) > LARGEST else ""


def _integer_test(kind: str, field: str, type_name: str) -> Test | None:
    if (kind, field) in _HIGHEST:
        return _within(0, _HIGHEST[kind, field])
    if type_name == "int64" and field.endswith("_ns"):
        return _within(-LARGEST_DIFFERENCE_NS, LARGEST_DIFFERENCE_NS)
    return _within(-1, LARGEST_TOTAL) if field.endswith("_total") else None


def _within(low: int, high: int) -> Test:
    return lambda value: "" if low <= value <= high else f"is {value}, must be within {low} .. {high}"


def _text_test(field: str) -> Test:
    if field in _PEOPLE:  # what was typed there may be a name, and this sentence ends up in logs and recordings
        return lambda value: "" if _ID.fullmatch(value) else "is no id; it is not repeated here, for it may be a name"
    if field in _IDS:
        return lambda value: "" if _ID.fullmatch(value) else f"is {value[:40]!r}, which is no id: {_ID_FORM}"
    longest = LONGEST_JSON if field.endswith("_json") else LONGEST_NAME if field in _NAMES else LONGEST_TEXT
    return lambda value: f"has {len(value)} characters, at most {longest} can be" if len(value) > longest else ""


def _each(one: Test) -> Test:
    def test(values: Any) -> str:
        if len(values) > MOST_ITEMS:
            return f"has {len(values)} entries, at most {MOST_ITEMS} can be"
        for number, value in enumerate(values):
            why = one(value)
            if why:
                return _at(f"[{number}]", why)
        return ""

    return test


def _numbers(values: Any) -> str:
    if len(values) > MOST_NUMBERS:
        return f"has {len(values)} numbers, at most {MOST_NUMBERS} can be"
    if len(values) == 0:
        return ""
    numbers = np.frombuffer(values, values.typecode) if isinstance(values, array) else np.asarray(values)
    return f"holds a number beyond {LARGEST:g}" if np.any(np.abs(numbers) > LARGEST) else ""


def _count(values: Any) -> str:
    return f"has {len(values)} entries, at most {MOST_BYTES} can be" if len(values) > MOST_BYTES else ""


def _time(value: Any) -> str:
    return _no_time(value.sec, value.nanosec)


def _no_time(seconds: int, nanoseconds: int) -> str:
    if seconds < 0 or nanoseconds >= SECOND_NS:
        return f"is {seconds} s and {nanoseconds} ns, which is no time"
    return ""
