"""YAML to dataclasses, strictly: every unknown, missing or mistyped key is named with its place."""

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from sensor_bench.signals.recordings import Playback

T = TypeVar("T")


def build(kind: type[T], given: Any, where: str) -> T:
    """A dataclass from a mapping. Raises ValueError that begins with the place."""
    if not isinstance(given, dict):
        raise ValueError(f"{where}: expected keys and values, got {given!r}")
    known = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    if unknown := sorted(set(map(str, given)) - set(known)):
        raise ValueError(f"{where}: unknown key {unknown[0]!r}; known are {', '.join(known)}")
    for name, f in known.items():
        if name not in given and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
            raise ValueError(f"{where}: {name} is missing")
    hints = get_type_hints(kind)
    return kind(**{name: _value(hints[name], value, f"{where}.{name}") for name, value in given.items()})


def _value(expected: Any, given: Any, where: str) -> Any:
    """One value: a scalar, `tuple[X, ...]` from a list, a dataclass or a `Mapping[str, X]` from keys and values."""
    origin, within = get_origin(expected), get_args(expected)
    if expected is Playback and isinstance(given, str):
        return Playback(given)
    if dataclasses.is_dataclass(expected):
        return build(expected, given, where)  # type: ignore[arg-type]
    if origin is Mapping:
        items = _checked(dict, "keys and values", given, where).items()
        return {str(name): _value(within[1], item, f"{where}.{name}") for name, item in items}
    if origin is tuple:
        items = enumerate(_checked(list, "a list", given, where))
        return tuple(_value(within[0], item, f"{where}[{i}]") for i, item in items)
    if expected is float and type(given) is int:
        return float(given)
    return given if expected is Any else _checked(expected, expected.__name__, given, where)


def _checked(expected: type, words: str, given: Any, where: str) -> Any:
    if type(given) is not expected:
        raise ValueError(f"{where}: expected {words}, got {given!r}")
    return given
