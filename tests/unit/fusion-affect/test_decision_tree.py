"""The decision tree: what its file may hold, and every path through the shipped one."""

import copy
import math
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import yaml
from fusion_affect.tree import STATES, UNKNOWN, decide, load, parse
from hypothesis import given
from hypothesis import strategies as st
from sense4hri.errors import ConfigError

NAN = math.nan
ROS4HRI = [
    "neutral",
    "angry",
    "sad",
    "happy",
    "surprised",
    "disgusted",
    "scared",
    "pleading",
    "vulnerable",
    "despaired",
    "guilty",
    "disappointed",
    "embarrassed",
    "horrified",
    "skeptical",
    "annoyed",
    "furious",
    "suspicious",
    "rejected",
    "bored",
    "tired",
    "asleep",
    "confused",
    "amazed",
    "excited",
]


def shipped() -> Any:
    return yaml.safe_load(resources.files("fusion_affect").joinpath("tree.yaml").read_text())


@pytest.mark.parametrize(
    ("expression", "bpm", "state"),
    [
        ("neutral", 70.0, "calm_relaxed"),
        ("neutral", 84.9, "calm_relaxed"),
        ("neutral", 85.0, "alert_active"),
        ("neutral", 105.0, "stressed_anxious"),
        ("happy", 70.0, "calm_relaxed"),
        ("happy", 150.0, "alert_active"),
        ("surprised", 70.0, "alert_active"),
        ("surprised", 120.0, "stressed_anxious"),
        ("angry", 70.0, "alert_active"),
        ("scared", 95.0, "stressed_anxious"),
    ],
)
def test_first_expression_then_heart_rate(expression: str, bpm: float, state: str) -> None:
    """The shipped tree asks for the expression first and for the heart rate second, and tells both steps."""
    verdict = decide(load(), expression, bpm, NAN)
    assert verdict.state == state
    assert len(verdict.path) == 2
    assert expression in verdict.path[0]
    assert f"{bpm:.1f} bpm" in verdict.path[1]
    assert state in verdict.path[1]


def test_a_baseline_moves_the_limits() -> None:
    """At 90 bpm a person who rests at 80 is calm, one who rests at 55 is not, and the path shows the baseline."""
    assert decide(load(), "neutral", 90.0, 80.0).state == "calm_relaxed"
    verdict = decide(load(), "neutral", 90.0, 55.0)
    assert verdict.state == "stressed_anxious"
    assert "calm_relaxed" not in " ".join(verdict.path)
    assert "120 % of the baseline 80.0 bpm" in decide(load(), "neutral", 90.0, 80.0).path[-1]


@pytest.mark.parametrize("expression", ROS4HRI)
def test_every_expression_of_ros4hri_has_a_place(expression: str) -> None:
    """No expression hri_msgs names is left out of the shipped tree."""
    assert decide(load(), expression, 70.0, NAN).state in STATES


@pytest.mark.parametrize(
    ("expression", "bpm", "why"),
    [("", 70.0, "needs an expression"), ("neutral", NAN, "needs a heart rate"), ("smirking", 70.0, "'smirking'")],
)
def test_unknown_says_why(expression: str, bpm: float, why: str) -> None:
    """What the tree cannot decide is unknown, and the reason names what is missing."""
    verdict = decide(load(), expression, bpm, NAN)
    assert verdict.state == UNKNOWN
    assert why in verdict.path[-1]


def test_without_a_camera() -> None:
    """A study without a camera can name the group to be taken where there is no expression."""
    tree = parse({**shipped(), "without_expression": "composed"})
    verdict = decide(tree, "", 70.0, NAN)
    assert verdict.state == "calm_relaxed"
    assert verdict.path[0] == "no expression: taken as composed"


def test_percentages_alone_need_a_baseline() -> None:
    """A tree of percentages alone is unknown until the baseline is known."""
    content = shipped()
    content["heart_rate"]["composed"] = [
        {"below_percent_of_baseline": 120, "state": "calm_relaxed"},
        {"state": "alert_active"},
    ]
    tree = parse(content)
    verdict = decide(tree, "neutral", 70.0, NAN)
    assert verdict.state == UNKNOWN
    assert "baseline is not known" in verdict.path[-1]
    assert decide(tree, "neutral", 70.0, 65.0).state == "calm_relaxed"


@given(
    st.sampled_from([*ROS4HRI, "", "nonsense"]),
    st.one_of(st.just(NAN), st.floats(0, 400)),
    st.one_of(st.just(NAN), st.floats(30, 200)),
)
def test_always_an_answer_with_a_path(expression: str, bpm: float, baseline: float) -> None:
    """Whatever comes in, a state of the contract comes out, and a path that is not empty."""
    verdict = decide(TREE, expression, bpm, baseline)
    assert verdict.state in (*STATES, UNKNOWN)
    assert all(verdict.path)
    assert verdict.path


TREE = load()


def _changed(path: str, value: Any) -> Any:
    content = copy.deepcopy(shipped())
    *way, last = path.split(".")
    place: Any = content
    for name in way:
        place = place[int(name)] if name.isdigit() else place[name]
    if value is None:
        del place[int(last) if last.isdigit() else last]
    else:
        place[int(last) if last.isdigit() else last] = value
    return content


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("version", 2, "version is 2"),
        ("name", None, "lacks 'name'"),
        ("name", 5, "name is 5"),
        ("colour", "red", "'colour', which is not known"),
        ("inputs.min_signal_quality", None, "inputs lacks 'min_signal_quality'"),
        ("inputs.min_signal_quality", "good", "inputs.min_signal_quality is 'good'"),
        ("inputs.min_signal_quality", True, "inputs.min_signal_quality is True"),
        ("inputs.min_signal_quality", -0.1, "inputs.min_signal_quality is -0.1"),
        ("inputs.min_signal_quality", math.inf, "inputs.min_signal_quality is inf"),
        ("expressions.composed", "neutral", "expressions.composed is 'neutral'"),
        ("expressions.pleasant", ["neutral"], "'neutral' is in composed already"),
        ("expressions", [], "expressions is []"),
        ("heart_rate.pleasant", None, "heart_rate lacks 'pleasant'"),
        ("heart_rate.angry", [], "heart_rate has 'angry'"),
        ("heart_rate.composed", [], "heart_rate.composed is []"),
        ("heart_rate.composed.0", 85, "heart_rate.composed[0] is 85"),
        ("heart_rate.composed.0.state", "relaxed", "heart_rate.composed[0].state is 'relaxed'"),
        ("heart_rate.composed.0.state", None, "heart_rate.composed[0] lacks 'state'"),
        ("heart_rate.composed.0.below_bpm", "85", "heart_rate.composed[0].below_bpm is '85'"),
        ("heart_rate.composed.0.below", 85, "heart_rate.composed[0] has 'below'"),
        ("heart_rate.composed.0.below_bpm", 120, "limits must rise"),
        ("heart_rate.composed.2", None, "the last line, and only the last, is without a limit"),
        ("heart_rate.composed.0", {"state": "calm_relaxed"}, "heart_rate.composed[0]: the last line"),
        ("without_expression", "angry", "without_expression is 'angry'"),
    ],
)
def test_a_wrong_file_is_named(tmp_path: Path, path: str, value: Any, named: str) -> None:
    """Every mistake in a tree's file is a configuration error that names the file and the place."""
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(_changed(path, value)))
    with pytest.raises(ConfigError) as caught:
        load(str(file))
    assert str(file) in str(caught.value)
    assert named in str(caught.value)


@pytest.mark.parametrize(
    ("content", "named"), [(b"a: [", "not YAML"), (b"\xff\xfe\xff", "text"), (b"", "the file is None")]
)
def test_no_tree_at_all(tmp_path: Path, content: bytes, named: str) -> None:
    """A file that is absent, a folder, no text or no YAML is a configuration error too."""
    file = tmp_path / "mine.yaml"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=named):
        load(str(file))
    with pytest.raises(ConfigError, match="No such file"):
        load(str(tmp_path / "absent.yaml"))
    with pytest.raises(ConfigError, match="directory"):
        load(str(tmp_path))
