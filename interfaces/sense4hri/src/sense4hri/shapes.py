"""JSON <-> dataclasses: one check of what comes in, one form of what goes out, one schema of both. Pure.

A shape is a dataclass, `bool`, `int`, `float`, `str`, `tuple[X, ...]`, `list[X]`, `dict[str, X]`, `Any` (any JSON), or
several of them with `|`. What `sense4hri.schema.parameter` says of a dataclass's field, its sentence, range and
choices, goes into the check and into the schema.
"""

import dataclasses
import json
import math
import types
from collections.abc import Mapping
from enum import Enum
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from sense4hri.errors import Refusal
from sense4hri.schema import KINDS, Rule, rule_of

LONGEST_SHOWN = 80
_WORDS: dict[type, str] = KINDS | {tuple: "a list", dict: "an object"}
_KINDS = {bool: "boolean", int: "integer", float: "number", str: "string", type(None): "null"}
Shape = TypeVar("Shape")


def read(shape: Any, value: Any, field: str = "") -> Any:
    """Return JSON as this shape. field: its name as far as known. Raises Refusal that names the field."""
    if shape is Any:
        return value
    if dataclasses.is_dataclass(shape):
        return _read_dataclass(shape, value, field)
    origin = get_origin(shape)
    if origin in (Union, types.UnionType):
        return _read_union(shape, value, field)
    if origin in (tuple, list):
        items = _checked(isinstance(value, list), shape, value, field)
        return origin(read(get_args(shape)[0], item, field) for item in items)
    if origin is dict:
        items = _checked(isinstance(value, dict), shape, value, field)
        return {name: read(get_args(shape)[1], item, _below(field, name)) for name, item in items.items()}
    if shape is float and type(value) is int:
        return float(value)
    return _checked(type(value) is shape, shape, value, field)


def plain(value: Any) -> Any:
    """Return a value as JSON can carry it: dataclasses and NamedTuples as objects, NaN and infinity as null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {one.name: plain(getattr(value, one.name)) for one in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    return value


def schema(shape: Any, known: dict[str, Any], *, answers: bool = False) -> dict[str, Any]:
    """Return the JSON schema of a shape; dataclasses are put into `known` and referred to by name.

    answers: the shape is an answer, in which every field is there and any number may be null.
    """
    if dataclasses.is_dataclass(shape):
        name = str(getattr(shape, "__name__", ""))
        if name not in known:
            known[name] = {}
            known[name] = _dataclass_schema(shape, known, answers)
        return {"$ref": f"#/components/schemas/{name}"}
    origin, within = get_origin(shape), get_args(shape)
    if origin in (Union, types.UnionType):
        return {"anyOf": [schema(one, known, answers=answers) for one in within]}
    if origin in (tuple, list):
        return {"type": "array", "items": schema(within[0], known, answers=answers)}
    if origin is dict:
        return {"type": "object", "additionalProperties": schema(within[1], known, answers=answers)}
    if shape is float and answers:
        return {"type": ["number", "null"]}
    return {"type": _KINDS[shape]} if shape in _KINDS else {}


def _read_dataclass(shape: Any, value: Any, field: str) -> Any:
    if not isinstance(value, dict):
        where = field or "the body"
        raise Refusal(f"{where} must be a JSON object, got {_shown(value)}", field)
    hints = get_type_hints(shape)
    known = {one.name: one for one in dataclasses.fields(shape)}
    for name in value.keys() - known.keys():
        fields = ", ".join(known) or "none"
        within = f" of {field}" if field else ""
        raise Refusal(f"{_shown(name)} is not a field{within}; fields are {fields}", _below(field, name))
    for name, one in known.items():
        if name not in value and one.default is dataclasses.MISSING and one.default_factory is dataclasses.MISSING:
            raise Refusal(f"{_below(field, name)} is missing", _below(field, name))
    given = {name: read(hints[name], item, _below(field, name)) for name, item in value.items()}
    for name, item in given.items():
        _ruled(rule_of(known[name]), item, _below(field, name))
    return shape(**given)


def _ruled(rule: Rule, value: Any, field: str) -> None:
    """Refuse what breaks the rule of its field; None is `not given`, and within an object its own rules hold."""
    for item in value if isinstance(value, tuple | list) else (value,):
        if isinstance(item, bool | int | float | str) and not rule.holds(item):
            raise Refusal(f"{field} is {_shown(item)}, must be {rule.allowed}", field)


def _read_union(shape: Any, value: Any, field: str) -> Any:
    """Return the value as the first of several shapes that takes it; what is wrong inside an object is said as such."""
    inner: Refusal | None = None
    for one in get_args(shape):
        try:
            return read(one, value, field)
        except Refusal as err:
            inner = err if dataclasses.is_dataclass(one) and isinstance(value, dict) else inner
    if inner is not None:
        raise inner
    return _checked(False, shape, value, field)


def _checked(fits: bool, shape: Any, value: Any, field: str) -> Any:
    if not fits:
        raise Refusal(f"{field or 'the body'} is {_shown(value)}, must be {_words(shape)}", field)
    return value


def _words(shape: Any) -> str:
    origin, within = get_origin(shape), get_args(shape)
    if origin in (Union, types.UnionType):
        return " or ".join(_words(one) for one in within if one is not type(None))
    if origin in (tuple, list):
        plural = {str: "strings", float: "numbers", int: "whole numbers"}.get(within[0], "objects")
        return f"a list of {plural}"
    return _WORDS.get(origin or shape, "an object")


def _dataclass_schema(shape: Any, known: dict[str, Any], answers: bool) -> dict[str, Any]:
    hints, properties, required = get_type_hints(shape), {}, []
    for one in dataclasses.fields(shape):
        rule = rule_of(one)
        properties[one.name] = _bound(schema(hints[one.name], known, answers=answers), _limits(rule)) | _about(rule)
        if answers or (one.default is dataclasses.MISSING and one.default_factory is dataclasses.MISSING):
            required.append(one.name)
    told = {"description": " ".join(shape.__doc__.split())} if shape.__doc__ else {}
    return {"type": "object", **told, "properties": properties, "required": required, "additionalProperties": answers}


def _about(rule: Rule) -> dict[str, Any]:
    text = f"{rule.help}, in {rule.unit}" if rule.unit else rule.help
    return {"description": text} if text else {}


def _limits(rule: Rule) -> dict[str, Any]:
    pattern = f"^(?:{rule.matches})$" if rule.matches else None
    told = {"minimum": rule.low, "maximum": rule.high, "pattern": pattern, "enum": list(rule.choices) or None}
    return {key: value for key, value in told.items() if value is not None}


def _bound(told: dict[str, Any], limits: dict[str, Any]) -> dict[str, Any]:
    """Return a field's schema with the limits of its rule: for each entry of a list, and not for null (`_ruled`)."""
    if "anyOf" in told:
        return {"anyOf": [_bound(one, limits) for one in told["anyOf"]]}
    if told.get("type") == "array":
        return told | {"items": _bound(told["items"], limits)}
    return told | limits if told.get("type") not in (None, "null", "object") else told


def _below(field: str, name: str) -> str:
    return f"{field}.{name}" if field else name


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=True) if isinstance(value, dict | list) else repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
