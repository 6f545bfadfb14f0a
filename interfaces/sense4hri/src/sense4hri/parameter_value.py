"""A parameter's value as it comes off the graph: read in one place, whoever sent it."""

from typing import Any

from rcl_interfaces.msg import ParameterType, ParameterValue
from rclpy.parameter import parameter_value_to_python

from sense4hri.errors import Refused
from sense4hri.intake import LONGEST_TEXT, MOST_ITEMS


def plain_value(value: ParameterValue) -> Any:
    """Return a parameter's value as plain Python: bool, int, float, str or a list of these; None where it is not set.

    Raises Refused for a type that does not exist and for what is longer than a message may be (`intake`).
    """
    if value.type > ParameterType.PARAMETER_STRING_ARRAY:
        raise Refused(f"is of type {value.type}, which does not exist")
    found = parameter_value_to_python(value)
    entries = found if isinstance(found, list) else [found]
    if len(entries) > MOST_ITEMS or any(isinstance(entry, str) and len(entry) > LONGEST_TEXT for entry in entries):
        raise Refused(f"is longer than {MOST_ITEMS} entries or {LONGEST_TEXT} characters")
    if not isinstance(found, list):
        return found
    return [entry[0] if isinstance(entry, bytes) else entry for entry in found]
