"""A message filled from a NamedTuple by the names of its fields; what nobody filled says so.

Field of the update -> field of the message: numbers and text as they are; int ns -> Time, tuple of them -> Time[]; a
nested NamedTuple -> the nested message, a tuple of them -> an array of it. Needs message classes, but no ROS node.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any, get_args, get_origin, get_type_hints

from sense4hri import stamps
from sense4hri.wire import doubles

STAMPS = ("device_ns", "received_ns")  # of an update: they become the message's two stamps
OF_THE_KIT = ("header", "device_timestamp")  # of a message
UNKNOWN: dict[str, Any] = {"double": float("nan"), "float": float("nan"), "int32": -1, "int64": -1}
NUMBERS: dict[str, type] = {"double": float, "float": float, "boolean": bool, "string": str}
TIME = "builtin_interfaces/Time"


def check(update: type, message: type) -> None:
    """Raise TypeError, with a sentence, where a field of the update has no place in the message."""
    hints = get_type_hints(update)
    missing = [name for name in STAMPS if name not in hints]
    if missing:
        raise TypeError(
            f"{update.__name__} has no field {missing[0]}: an update carries both stamps of its last sample"
        )
    taken = [name for name in OF_THE_KIT if name in hints]
    if taken:
        raise TypeError(f"{update.__name__}.{taken[0]}: the kit fills this field of {message.__name__}")
    _check_fields(update, {name: hint for name, hint in hints.items() if name not in STAMPS}, message)


def _check_fields(update: type, hints: dict[str, Any], message: Any) -> None:
    kinds = message.get_fields_and_field_types()
    for name, hint in hints.items():
        if name not in kinds:
            raise TypeError(f"{update.__name__}.{name}: {message.__name__} has no field of this name")
        kind, is_array = _element(kinds[name])
        inner = get_args(hint)[0] if get_origin(hint) is tuple else hint
        if is_array != (get_origin(hint) is tuple):
            raise TypeError(f"{update.__name__}.{name}: {message.__name__} has {kinds[name]} here")
        if _is_nested(kind) != hasattr(inner, "_fields"):
            raise TypeError(f"{update.__name__}.{name}: {message.__name__} has {kinds[name]} here")
        if _is_nested(kind):
            _check_fields(inner, get_type_hints(inner), _class(kind))


def blank(message: Callable[[], Any]) -> Any:
    """Return a new message in which every number is unknown: NaN, -1 for a count; nested ones too."""
    made = message()
    for name, kind in made.get_fields_and_field_types().items():
        if kind in UNKNOWN:
            setattr(made, name, UNKNOWN[kind])
        elif _is_nested(kind):
            setattr(made, name, blank(_class(kind)))
    return made


def fill(message: Any, update: Any) -> Any:
    """Write every field of a NamedTuple, but the two stamps, into the message; return it."""
    kinds = message.get_fields_and_field_types()
    for name, value in update._asdict().items():
        if name not in STAMPS:
            kind, is_array = _element(kinds[name])
            setattr(message, name, _array(kind, value) if is_array else _converter(kind)(value))
    return message


def _array(kind: str, values: Any) -> Any:
    return doubles(values) if kind == "double" else [_converter(kind)(value) for value in values]


def _converter(kind: str) -> Callable[[Any], Any]:
    if kind == TIME:
        return stamps.from_ns
    if _is_nested(kind):
        return partial(_nested, _class(kind))
    return NUMBERS.get(kind, int)


def _nested(message: Callable[[], Any], value: Any) -> Any:
    return fill(blank(message), value)


def _element(kind: str) -> tuple[str, bool]:
    """Return the kind of one element and whether it is an array: `sequence<double>` is (double, True)."""
    return (kind[9:-1], True) if kind.startswith("sequence<") else (kind, False)


def _is_nested(kind: str) -> bool:
    """True for one message inside another, Time and Header left out."""
    return "/" in kind and "<" not in kind and kind not in (TIME, "std_msgs/Header")


def _class(kind: str) -> Any:
    """Return the class of `sense4hri_msgs/HRV`."""
    package, _, name = kind.partition("/")
    return getattr(import_module(f"{package}.msg"), name)
