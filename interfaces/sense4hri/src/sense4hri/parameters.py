"""A schema's values as ROS parameters: declared with their descriptors, checked, and loaded."""

import sys
from collections.abc import Mapping
from dataclasses import MISSING
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from sense4hri.errors import ConfigError
from sense4hri.schema import KINDS, Rule, check, item_of, parameters_of

Config = TypeVar("Config")
Kind = Parameter.Type
_SINGLE = {str: Kind.STRING, bool: Kind.BOOL, int: Kind.INTEGER, float: Kind.DOUBLE}
_ARRAYS = {str: Kind.STRING_ARRAY, bool: Kind.BOOL_ARRAY, int: Kind.INTEGER_ARRAY, float: Kind.DOUBLE_ARRAY}
_LARGEST_INTEGER = 2**63 - 1


def load(node: Node, schema: type[Config]) -> Config:
    """Declare every field of schema (see `sense4hri.schema`) as a parameter and return the values.

    Field types: str, bool, int, float and tuples of these (`tuple[str, ...]`). A whole number is accepted where a
    float is meant. Raises ConfigError that names the parameter.
    """
    values = {entry.name: declare(node, *entry) for entry in parameters_of(schema)}
    try:
        return schema(**values)
    except ValueError as err:
        raise ConfigError(str(err)) from err


def declare(node: Node, name: str, kind: Any, default: Any = MISSING, rule: Rule | None = None) -> Any:
    """Declare one parameter and return its value; see `load`."""
    rule = rule or Rule()
    item, many = item_of(kind)
    given = node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True)).value
    node.undeclare_parameter(name)
    if given is None and default is MISSING:
        raise ConfigError(f"parameter {name!r} is required: {rule.help or KINDS[item]}")
    try:
        value = check(name, kind, rule, default if given is None else given)
    except ValueError as err:
        raise ConfigError(str(err)) from err
    typed = Parameter(name, _ARRAYS[item] if many else _SINGLE[item], list(value) if many else value)
    node.declare_parameter(name, typed.value, _descriptor(name, kind, rule), ignore_override=True)
    return value


def as_parameters(values: Mapping[str, Any]) -> list[Parameter]:
    """Return names and values as parameters, with tuples as arrays."""
    return [Parameter(name, value=list(value) if isinstance(value, tuple) else value) for name, value in values.items()]


def _descriptor(name: str, kind: Any, rule: Rule) -> ParameterDescriptor:
    """Say of a parameter to ROS tools what its rule says."""
    descriptor = ParameterDescriptor(
        name=name,
        description=f"{rule.help} [{rule.unit}]" if rule.unit else rule.help,
        additional_constraints=rule.allowed,
        read_only=not rule.settable,
    )
    if rule.choices or (rule.low is None and rule.high is None):
        return descriptor
    if kind is float:
        largest = sys.float_info.max
        low, high = (-largest if rule.low is None else rule.low), (largest if rule.high is None else rule.high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
    if kind is int:
        low = -_LARGEST_INTEGER if rule.low is None else rule.low
        high = _LARGEST_INTEGER if rule.high is None else rule.high
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return descriptor
