"""ROS parameters of a schema: the same sentence as in Python, and descriptors that say what the rules say."""

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
import rclpy
from command_words import parameters_of
from compose_yaml import StudyError
from rcl_interfaces.msg import ParameterDescriptor
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.node import Node
from sense4hri import parameters
from sense4hri.errors import ConfigError
from sense4hri.schema import Schema, parameter

TEXTS = [
    *("y", "N", "Yes", "off", "TrUe", "7", "08", "017", "-0x1F", "0X1F", "0b11", "0o7", "1e3", "12E45678", "-.5", "1."),
    *("09.5", ".inf", "nan", "1_000", "11:22:33:44:55:06", "11:22", "2026-01-02", "null", "~", "'y'", "'08'"),
    *("[y,n]", "['y',b]", "[1e3]", "[1,2]", "[p1,null]"),
]


@dataclass(frozen=True)
class Config(Schema):
    window_s: float = parameter(10.0, help="span", unit="s", low=2, high=600)
    delay_s: float = parameter(0.0, help="delay", unit="s", low=0, settable=True)
    count: int = parameter(3, help="how many", low=1, high=8)
    mode: str = parameter("auto", help="how", choices=("auto", "off"))
    topics: tuple[str, ...] = parameter((), help="which", matches="/.*", form="a topic, with '/' in front")


@pytest.fixture
def node_with() -> Iterator[Callable[..., Node]]:
    """Make a node with these parameters on its command line."""
    context = Context()

    def make(**values: object) -> Node:
        given = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        rclpy.init(args=["--ros-args", *given], context=context)
        return rclpy.create_node("asked", context=context, start_parameter_services=False, enable_rosout=False)

    yield make
    rclpy.try_shutdown(context=context)


@pytest.mark.parametrize(
    ("name", "value"), [("window_s", 1.0), ("window_s", float("nan")), ("count", 9), ("mode", "up"), ("topics", ("a",))]
)
def test_ros_and_python_refuse_in_the_same_words(node_with, name, value):
    """What a YAML file gets wrong is told as it is told to who makes a Config in Python."""
    with pytest.raises(ValueError, match=name) as in_python:
        Config(**{name: value})
    written = {"nan": ".nan", "('a',)": "[a]"}.get(str(value), value)
    with pytest.raises(ConfigError) as in_ros:
        parameters.load(node_with(**{name: written}), Config)
    assert str(in_ros.value) == str(in_python.value)


def test_whole_numbers_and_lists_are_loaded_as_their_types(node_with):
    """`window_s: 20` is 20.0, and a list of the file is a tuple."""
    config = parameters.load(node_with(window_s=20, topics="[/a, /b]"), Config)
    assert (config.window_s, config.topics, type(config.window_s)) == (20.0, ("/a", "/b"), float)


def test_descriptors_say_what_the_rules_say(node_with):
    """`ros2 param describe` shows sentence, unit, range and choices; only settable parameters can be set."""
    node = node_with()
    parameters.load(node, Config)
    window, delay, count, mode = (node.describe_parameter(name) for name in ("window_s", "delay_s", "count", "mode"))
    assert (window.description, window.read_only, delay.read_only) == ("span [s]", True, False)
    assert [(each.from_value, each.to_value) for each in window.floating_point_range] == [(2.0, 600.0)]
    assert [(each.from_value, each.to_value) for each in count.integer_range] == [(1, 8)]
    assert delay.floating_point_range[0].from_value == 0.0
    assert mode.additional_constraints == "one of auto, off"


@pytest.mark.parametrize("text", TEXTS)
def test_a_study_file_is_read_as_ros_reads_it(node_with, text):
    """What `make check` takes for a number, a text or a truth value is what the node gets."""
    read = parameters_of("study.command", ["--ros-args", "-p", f"asked:={text}"])["asked"]
    node = node_with(asked=text)
    given = node.declare_parameter("asked", descriptor=ParameterDescriptor(dynamic_typing=True)).value
    assert repr(read) == repr(list(given) if isinstance(given, array) else given)


@pytest.mark.parametrize("text", ["[1, 2.5]", "[a, 1]", "[a, y]", "[y, 'b']"])
def test_a_list_that_ros_does_not_read_is_refused(node_with, text):
    """ROS has lists of one type alone; a node would end with a traceback."""
    with pytest.raises(StudyError, match=r"study.command: asked: .* values of one type"):
        parameters_of("study.command", ["--ros-args", "-p", f"asked:={text}"])
    with pytest.raises(RCLError, match="should be of same type"):
        node_with(asked=text)
