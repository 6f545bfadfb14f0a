"""Parameters written once: what is refused, in which words, and what README and default.yaml say of it."""

import subprocess
import sys
from dataclasses import dataclass

import pytest
from sense4hri.schema import Rule, Schema, check, parameter, parameters_of

NAN, INF = float("nan"), float("inf")


@dataclass(frozen=True)
class Config(Schema):
    window_s: float = parameter(10.0, help="span", unit="s", low=2, high=600)
    delay_s: float = parameter(0.0, help="delay", unit="s", low=0)
    gain: float = parameter(1.0, help="gain")
    count: int = parameter(3, help="how many", low=1, high=8)
    mode: str = parameter("auto", help="how", choices=("auto", "off"))
    bits: int = parameter(8, help="how fine", choices=(8, 16))
    name: str = parameter("x1", help="who", matches=r"[a-z]\d", form="a letter and a digit")
    topics: tuple[str, ...] = parameter(("/a",), help="which", matches="/.*", form="a topic, with '/' in front")
    on: bool = parameter(True, help="whether")


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("window_s", 1.0, "parameter 'window_s' is 1.0, must be 2 to 600 s"),
        ("window_s", NAN, "parameter 'window_s' is nan, must be 2 to 600 s"),
        ("delay_s", -0.5, "parameter 'delay_s' is -0.5, must be at least 0 s"),
        ("delay_s", INF, "parameter 'delay_s' is inf, must be at least 0 s"),
        ("gain", INF, "parameter 'gain' is inf, must be a finite number"),
        ("gain", "much", "parameter 'gain' is 'much', must be a number"),
        ("gain", True, "parameter 'gain' is True, must be a number"),
        ("count", 0, "parameter 'count' is 0, must be 1 to 8"),
        ("count", 2.0, "parameter 'count' is 2.0, must be a whole number"),
        ("count", True, "parameter 'count' is True, must be a whole number"),
        ("mode", "on", "parameter 'mode' is 'on', must be one of auto, off"),
        ("bits", 9, "parameter 'bits' is 9, must be one of 8, 16"),
        ("name", "x12", "parameter 'name' is 'x12', must be a letter and a digit"),
        ("name", "x1\n", "parameter 'name' is 'x1\\n', must be a letter and a digit"),
        ("topics", "/a", "parameter 'topics' is '/a', must be a list"),
        ("topics", ("/a", "b"), "parameter 'topics' holds 'b', each must be a topic, with '/' in front"),
        ("topics", (1,), "parameter 'topics' holds 1, each must be a string"),
        ("on", 1, "parameter 'on' is 1, must be true or false"),
    ],
)
def test_what_breaks_its_rule_is_refused_in_one_wording(name, value, sentence):
    """The sentence names the parameter, what was given and what is allowed."""
    with pytest.raises(ValueError, match="parameter") as caught:
        Config(**{name: value})
    assert str(caught.value) == sentence


@pytest.mark.parametrize(("name", "value"), [("window_s", 2), ("window_s", 600.0), ("count", 8), ("topics", ())])
def test_the_ends_of_a_range_belong_to_it(name, value):
    """A range includes both ends; a whole number is taken where a float is meant; a list may be empty."""
    assert getattr(Config(**{name: value}), name) == value


def test_values_come_as_their_type():
    """What is loaded is a float and a tuple, whatever was written."""
    assert type(check("x", float, Rule(), 2)) is float
    assert check("x", tuple[float, ...], Rule(), [1, 2.5]) == (1.0, 2.5)


def test_a_schema_needs_no_ros():
    """Who only makes a Config does not load rclpy."""
    loads = "import sys, sense4hri.schema, sense4hri.device; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", loads], check=False).returncode == 0


def test_a_dataclass_without_rules_is_a_schema_too():
    """A plain field is a parameter of which only the type is known."""

    @dataclass(frozen=True)
    class Plain:
        size: int
        word: str = "w"

    assert [(each.name, each.kind, each.rule) for each in parameters_of(Plain)] == [
        ("size", int, Rule()),
        ("word", str, Rule()),
    ]
