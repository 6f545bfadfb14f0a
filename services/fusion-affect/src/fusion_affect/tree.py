"""The decision tree: its file, checked, and its evaluation; pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from sense4hri.errors import ConfigError

VERSION = 1
UNKNOWN = "unknown"
STATES = ("calm_relaxed", "alert_active", "stressed_anxious")


@dataclass(frozen=True)
class Limits:
    """When an input may be used at all; see `tree.yaml`."""

    heart_rate_max_age_s: float
    expression_max_age_s: float
    faces_max_age_s: float
    stream_live_s: float
    min_signal_quality: float
    min_expression_confidence: float
    max_disagreement_bpm: float


class Line(NamedTuple):
    """One line of a group: the state of a heart rate below its limits; NaN = no such limit."""

    state: str
    below_bpm: float
    below_percent: float


@dataclass(frozen=True)
class Tree:
    """A checked decision tree."""

    name: str
    limits: Limits
    group_of: Mapping[str, str]
    """Expression -> group."""
    lines: Mapping[str, tuple[Line, ...]]
    """Group -> lines; only the last is without limit."""
    without_expression: str | None


class Verdict(NamedTuple):
    """What the tree says, and the path that led there (never empty)."""

    state: str
    path: tuple[str, ...]


def load(file: str = "") -> Tree:
    """Read and check a tree, the shipped one by default. Raises ConfigError that names file and place."""
    where = f"tree_file {file}" if file else "tree.yaml"
    try:
        text = Path(file).read_text() if file else resources.files(__package__).joinpath("tree.yaml").read_text()
        return parse(yaml.safe_load(text))
    except OSError as err:
        raise ConfigError(f"{where}: {err.strerror}") from err
    except UnicodeDecodeError as err:
        raise ConfigError(f"{where}: not a text file") from err
    except yaml.YAMLError as err:
        raise ConfigError(f"{where}: not YAML: {' '.join(str(err).split())}") from err
    except ValueError as err:
        raise ConfigError(f"{where}: {err}") from err


def parse(content: Any) -> Tree:
    """Check what a tree's file holds. Raises ValueError that names the place and what is expected there."""
    top = _table(
        content, "the file", {"version", "name", "inputs", "expressions", "heart_rate"}, {"without_expression"}
    )
    if top["version"] != VERSION:
        raise ValueError(f"version is {top['version']!r}, must be {VERSION}")
    if not isinstance(top["name"], str):
        raise ValueError(f"name is {top['name']!r}, must be a text")
    group_of = _groups(_table(top["expressions"], "expressions"))
    groups = list(_table(top["expressions"], "expressions"))
    lines = {
        group: _lines(rows, f"heart_rate.{group}")
        for group, rows in _table(top["heart_rate"], "heart_rate", set(groups)).items()
    }
    without = top.get("without_expression")
    if without is not None and without not in groups:
        raise ValueError(f"without_expression is {without!r}, must be null or one of {', '.join(groups)}")
    return Tree(top["name"], _limits(top["inputs"]), group_of, lines, without)


def decide(tree: Tree, expression: str, heart_rate_bpm: float, baseline_bpm: float) -> Verdict:
    """Walk the tree. `expression` is empty where there is none; a rate or baseline in 1/min is NaN where there is none.

    >>> decide(load(), "neutral", 70.0, float("nan")).state
    'calm_relaxed'
    """
    if expression:
        group = tree.group_of.get(expression)
        if group is None:
            return Verdict(UNKNOWN, (f"expression '{expression}' is in no group of the tree",))
        path: tuple[str, ...] = (f"expression '{expression}' is {group}",)
    elif tree.without_expression is None:
        return Verdict(UNKNOWN, ("the tree needs an expression",))
    else:
        group = tree.without_expression
        path = (f"no expression: taken as {group}",)
    if math.isnan(heart_rate_bpm):
        return Verdict(UNKNOWN, (*path, "the tree needs a heart rate"))
    for line in tree.lines[group]:
        limit_bpm, told = _limit(line, baseline_bpm)
        if limit_bpm is None:
            return Verdict(UNKNOWN, (*path, f"{told}, and the resting baseline is not known"))
        if heart_rate_bpm < limit_bpm:
            return Verdict(line.state, (*path, f"heart rate {heart_rate_bpm:.1f} bpm is {told}: {line.state}"))
    raise AssertionError("a checked tree ends in a line without limit")


def _limit(line: Line, baseline_bpm: float) -> tuple[float | None, str]:
    """A line's limit in 1/min, None where it needs a baseline that is not there; and how it is told."""
    if not math.isnan(line.below_percent):
        if not math.isnan(baseline_bpm):
            limit_bpm = line.below_percent / 100 * baseline_bpm
            told = f"{line.below_percent:g} % of the baseline {baseline_bpm:.1f} bpm"
            return limit_bpm, f"below {limit_bpm:.1f} bpm ({told})"
        if math.isnan(line.below_bpm):
            return None, f"{line.state} is below {line.below_percent:g} % of the baseline"
    if math.isnan(line.below_bpm):
        return math.inf, "above every limit"
    return line.below_bpm, f"below {line.below_bpm:g} bpm"


def _limits(content: Any) -> Limits:
    names = {field.name for field in fields(Limits)}
    return Limits(
        **{name: _number(value, f"inputs.{name}") for name, value in _table(content, "inputs", names).items()}
    )


def _groups(content: Mapping[str, Any]) -> dict[str, str]:
    group_of: dict[str, str] = {}
    for group, words in content.items():
        if not isinstance(words, list) or not all(isinstance(word, str) and word for word in words):
            raise ValueError(f"expressions.{group} is {words!r}, must be a list of words")
        for word in words:
            if word in group_of:
                raise ValueError(f"expressions.{group}: '{word}' is in {group_of[word]} already")
            group_of[word] = group
    return group_of


def _lines(content: Any, where: str) -> tuple[Line, ...]:
    if not isinstance(content, list) or not content:
        raise ValueError(f"{where} is {content!r}, must be a list of lines")
    lines = [_line(row, f"{where}[{number}]") for number, row in enumerate(content)]
    for number, line in enumerate(lines):
        unlimited = math.isnan(line.below_bpm) and math.isnan(line.below_percent)
        if unlimited != (number == len(lines) - 1):
            raise ValueError(f"{where}[{number}]: the last line, and only the last, is without a limit")
    for name in ("below_bpm", "below_percent"):
        given = [getattr(line, name) for line in lines if not math.isnan(getattr(line, name))]
        if given != sorted(set(given)):
            raise ValueError(f"{where}: limits must rise from line to line, are {given}")
    return tuple(lines)


def _line(content: Any, where: str) -> Line:
    row = _table(content, where, {"state"}, {"below_bpm", "below_percent_of_baseline"})
    if row["state"] not in STATES:
        raise ValueError(f"{where}.state is {row['state']!r}, must be one of {', '.join(STATES)}")
    below = {
        name: _number(row[name], f"{where}.{name}") if name in row else math.nan
        for name in ("below_bpm", "below_percent_of_baseline")
    }
    return Line(row["state"], below["below_bpm"], below["below_percent_of_baseline"])


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise ValueError(f"{where} is {value!r}, must be a number of 0 or more")
    return float(value)


def _table(
    content: Any, where: str, needed: set[str] | None = None, optional: set[str] | None = None
) -> dict[str, Any]:
    """A table with exactly these names; without `needed`, any names, at least one."""
    if not isinstance(content, dict) or not content or not all(isinstance(name, str) for name in content):
        raise ValueError(f"{where} is {content!r}, must be a table of names and values")
    if needed is not None:
        for name in sorted(needed - content.keys()):
            raise ValueError(f"{where} lacks '{name}'")
        for name in sorted(content.keys() - needed - (optional or set())):
            raise ValueError(
                f"{where} has '{name}', which is not known; known are {', '.join(sorted(needed | (optional or set())))}"
            )
    return content
