"""A frozen dataclass is the parameter schema; ROS parameters are its values."""

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from sense4hri.errors import ConfigError

Schema = TypeVar("Schema")
Kind = Parameter.Type
_NAMES = {str: "a string", bool: "true or false", int: "a whole number", float: "a number"}
_KINDS = {str: Kind.STRING, bool: Kind.BOOL, int: Kind.INTEGER, float: Kind.DOUBLE}
_ARRAYS = {str: Kind.STRING_ARRAY, bool: Kind.BOOL_ARRAY, int: Kind.INTEGER_ARRAY, float: Kind.DOUBLE_ARRAY}


def load(node: Node, schema: type[Schema]) -> Schema:
    """Declare every field of schema as a parameter and return the values.

    Field types: str, bool, int, float and tuples of these (`tuple[str, ...]`). A whole number is accepted where a
    float is meant. A field without default is required; one with `metadata={"settable": True}` may be
    set at run time. Raises ConfigError that names the parameter.
    """
    hints = get_type_hints(schema)
    values = {
        field.name: declare(
            node,
            field.name,
            hints[field.name],
            _default(field),
            str(field.metadata.get("help", "")),
            read_only=not field.metadata.get("settable", False),
        )
        for field in fields(schema)  # type: ignore[arg-type]
    }
    try:
        return schema(**values)
    except ValueError as err:
        raise ConfigError(str(err)) from err


def declare(
    node: Node, name: str, kind: Any, default: Any = MISSING, description: str = "", read_only: bool = True
) -> Any:
    """Declare one parameter and return its value; see `load`."""
    item, many = (get_args(kind)[0], True) if get_origin(kind) is tuple else (kind, False)
    given = node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True)).value
    node.undeclare_parameter(name)
    if given is None and default is MISSING:
        raise ConfigError(f"parameter {name!r} is required: {description or _NAMES[item]}")
    value = _checked(name, item, many, default if given is None else given)
    typed = Parameter(name, _ARRAYS[item] if many else _KINDS[item], list(value) if many else value)
    descriptor = ParameterDescriptor(description=description, read_only=read_only)
    node.declare_parameter(name, typed.value, descriptor, ignore_override=True)
    return value


def as_parameters(values: Mapping[str, Any]) -> list[Parameter]:
    """Return names and values as parameters, with tuples as arrays."""
    return [Parameter(name, value=list(value) if isinstance(value, tuple) else value) for name, value in values.items()]


def _checked(name: str, item: type, many: bool, value: Any) -> Any:
    if not many:
        return _one(name, item, value)
    if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
        raise ConfigError(f"parameter {name!r} is {value!r}, must be a list")
    return tuple(_one(name, item, entry) for entry in value)


def _one(name: str, item: type, value: Any) -> Any:
    if item is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not item:
        raise ConfigError(f"parameter {name!r} is {value!r}, must be {_NAMES[item]}")
    return value


def _default(field: Field[Any]) -> Any:
    return field.default_factory() if field.default_factory is not MISSING else field.default
