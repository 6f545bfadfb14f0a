"""Parameters of a service, written once: a frozen dataclass with their defaults, ranges, units and sentences.

    @dataclass(frozen=True)
    class Config(Schema):
        window_s: float = parameter(10.0, help="span of rate and quality", unit="s", low=2, high=600)

The same rules are checked, in the same words, where a Config is made in Python and where ROS parameters are loaded;
they are in the parameters' descriptors, in `config/default.yaml` and in the README's table. Imports no ROS.
"""

import importlib
import math
import re
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

KINDS: dict[type, str] = {str: "a string", bool: "true or false", int: "a whole number", float: "a number"}


@dataclass(frozen=True)
class Rule:
    """What is known of one parameter beside its name, type and default.

    help: what it is, as half a sentence. low, high: smallest and largest value, in `unit`. choices: the only values.
    matches, form: a regular expression of the whole text, and what it demands in words. Of a list they hold for each
    entry. settable: may be set at run time. nan: NaN is taken, for `not
    known`. example: written to default.yaml where the default alone cannot work.
    notes: further lines for default.yaml.
    """

    help: str = ""
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[Any, ...] = ()
    matches: str = ""
    form: str = ""
    settable: bool = False
    nan: bool = False
    example: Any = None
    notes: str = ""

    @property
    def allowed(self) -> str:
        """What a value must be, as in `2 to 600 s`; empty where anything of the type will do."""
        if self.choices:
            return f"one of {', '.join(str(choice) for choice in self.choices)}"
        return self.form or self._range

    @property
    def _range(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if self.low is not None and self.high is not None:
            return f"{self.low:g} to {self.high:g}{unit}"
        if self.low is not None:
            return f"at least {self.low:g}{unit}"
        return "" if self.high is None else f"at most {self.high:g}{unit}"

    def holds(self, value: Any) -> bool:
        """True for a value of the right type that keeps the rule."""
        if self.choices:
            return value in self.choices
        if isinstance(value, str):
            return not self.matches or re.fullmatch(self.matches, value) is not None
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


def parameter(
    default: Any = MISSING,
    *,
    help: str,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[Any, ...] = (),
    matches: str = "",
    form: str = "",
    settable: bool = False,
    example: Any = None,
    notes: str = "",
) -> Any:
    """Return a dataclass field with its `Rule`; one without default is required."""
    rule = Rule(help, unit, low, high, choices, matches, form, settable, False, example, notes)
    return field(default=default, metadata={"rule": rule})


class Parameter(NamedTuple):
    """One parameter of a schema; kind is str, bool, int, float or a tuple of these, default MISSING if required."""

    name: str
    kind: Any
    default: Any
    rule: Rule


class Schema:
    """Base of a service's Config: whoever makes one gets ValueError for the first value that breaks its rule.

    What concerns several parameters at once is checked in the subclass's `__post_init__`, after this one.
    """

    def __post_init__(self) -> None:
        for entry in parameters_of(type(self)):
            check(entry.name, entry.kind, entry.rule, getattr(self, entry.name))


def schema_of(package: str) -> type[Schema]:
    """Return the one Schema that a package's module `config` defines; ValueError where there is none, or several."""
    module = importlib.import_module(f"{package}.config")
    own = [each for each in vars(module).values() if isinstance(each, type) and each.__module__ == module.__name__]
    schemas = [each for each in own if issubclass(each, Schema) and is_dataclass(each)]
    if len(schemas) != 1:
        raise ValueError(f"{package}.config defines {len(schemas)} dataclasses that inherit from Schema, must be 1")
    return schemas[0]


def parameters_of(schema: type) -> Iterator[Parameter]:
    """Yield the parameters of a dataclass, in order."""
    hints = get_type_hints(schema)
    for entry in fields(schema):
        yield Parameter(entry.name, hints[entry.name], _default(entry), rule_of(entry))


def rule_of(entry: "Field[Any]") -> Rule:
    """Return the rule of a dataclass's field; one without says nothing."""
    rule: Rule = entry.metadata.get("rule", Rule())
    return rule


def find(schema: type, name: str) -> Parameter:
    """Return one parameter of a dataclass; KeyError where it has none of this name."""
    return {entry.name: entry for entry in parameters_of(schema)}[name]


def item_of(kind: Any) -> tuple[type, bool]:
    """Return the type of a value, or of a list's entries, and whether it is a list."""
    return (get_args(kind)[0], True) if get_origin(kind) is tuple else (kind, False)


def check(name: str, kind: Any, rule: Rule, value: Any) -> Any:
    """Return the value as its type: a whole number as float, a list as tuple. ValueError names the parameter."""
    item, many = item_of(kind)
    if not many:
        return _one(f"parameter {name!r} is {value!r}, must be", item, rule, value)
    if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
        raise ValueError(f"parameter {name!r} is {value!r}, must be a list")
    return tuple(_one(f"parameter {name!r} holds {entry!r}, each must be", item, rule, entry) for entry in value)


def _one(complaint: str, item: type, rule: Rule, value: Any) -> Any:
    if item is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, item) or (isinstance(value, bool) and item is not bool):
        raise ValueError(f"{complaint} {KINDS[item]}")
    if rule.nan and isinstance(value, float) and math.isnan(value):
        return value
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{complaint} {rule.allowed or 'a finite number'}")
    if not rule.holds(value):
        raise ValueError(f"{complaint} {rule.allowed}")
    return value


def _default(entry: "Field[Any]") -> Any:
    return entry.default_factory() if entry.default_factory is not MISSING else entry.default
