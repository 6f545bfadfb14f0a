"""Dashboards are what their lists say, and ask only for what services export."""

import functools
import json
import operator
import re
from importlib import metadata

import grafana_schema
import make_dashboards
import metrics_table
import pytest
import yaml

RULES = make_dashboards.FOLDER.parents[1] / "prometheus" / "rules.yml"


@pytest.mark.parametrize("path", make_dashboards.files(), ids=lambda path: path.stem)
def test_the_file_is_what_its_list_makes(path):
    """compose/grafana/make_dashboards.py writes it again."""
    assert path.read_text() == make_dashboards.files()[path]


@pytest.mark.parametrize("path", make_dashboards.files(), ids=lambda path: path.stem)
def test_it_is_as_grafanas_types_have_it(path):
    """Every key is known, none that must be there lacks, every value is of its type; no two panels have one place."""
    board = json.loads(path.read_text())
    assert grafana_schema.faults(board) == []
    assert board["uid"] == f"sense4hri-{path.stem}"
    places = [panel["gridPos"] for panel in board["panels"]]
    assert len({(place["x"], place["y"]) for place in places}) == len(places)
    assert all(place["x"] + place["w"] <= make_dashboards.WIDTH for place in places)


FIELDS = "panels.0.fieldConfig"
OVERRIDE = f"{FIELDS}.overrides.0.properties"


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        ("title", 42, "$.title: 42 is not of type 'string'"),
        ("titel", "study", "$: Additional properties are not allowed ('titel' was unexpected)"),
        ("panels.0.gridPos.h", "tall", "$.panels[0].gridPos.h: 'tall' is not of type 'integer'"),
        ("panels.1.type", "timesreies", "$.panels[1].type: 'timesreies' is not one of "),
        ("panels.0.targets.0", {"refId": "A"}, "$.panels[0].targets[0]: 'expr' is a required property"),
        ("panels.0.options", {"perPage": 20}, "$.panels[0].options: Additional properties are not allowed ('perPage'"),
        (f"{FIELDS}.defaults.custom", {"width": "all"}, "$.panels[0].fieldConfig.defaults.custom.width: 'all' is not"),
        (f"{OVERRIDE}.0.id", "unti", "$.panels[0].fieldConfig.overrides[0].properties[0].id: 'unti' is not one of "),
        (f"{OVERRIDE}.0.value", 3, "$.panels[0].fieldConfig.overrides[0].properties[0].value: 3 is not of type "),
    ],
)
def test_a_planted_fault_is_told_with_its_place(place, value, told):
    """Grafana's own model would take each of them: its `from_json` checks nothing."""
    board = json.loads((make_dashboards.FOLDER / "study.json").read_text())
    *way, last = [int(word) if word.isdecimal() else word for word in place.split(".")]
    functools.reduce(operator.getitem, way, board)[last] = value
    assert told in "\n".join(grafana_schema.faults(board))


def test_the_types_are_of_the_grafana_that_is_started():
    """Another version has other keys."""
    compose = yaml.safe_load((make_dashboards.FOLDER.parents[1] / "compose.yaml").read_text())
    _, _, version = metadata.version("grafana-foundation-sdk").partition("!")
    assert compose["services"]["grafana"]["image"] == f"grafana/grafana:{version}"


def test_every_query_asks_for_what_is_exported():
    """A panel of a metric that nobody exports would stay empty for ever."""
    rules = [rule for group in yaml.safe_load(RULES.read_text())["groups"] for rule in group["rules"]]
    known = {row.name for row in metrics_table.written()} | {rule["record"] for rule in rules if "record" in rule}
    known |= {f"{row.name}_{part}" for row in metrics_table.written() for part in ("sum", "count", "bucket")}
    for query in make_dashboards.queries():
        asked = set(re.findall(r"\bsense4hri[:_][a-z0-9_:]+|\bALERTS\b", query))
        assert asked, query
        assert asked <= known | {"ALERTS"}, query


def test_every_stream_is_one_row():
    """The columns of the table of streams keep the same two labels, so that they become one row."""
    for column in make_dashboards.STREAMS:
        assert column.expression.startswith(f"max by ({make_dashboards.STREAM})"), column.title


def test_hosts_are_shown():
    """Every metric of the clocks of hosts is on the dashboard of clocks, by pair; what they run, on that of hosts."""
    curves = [curve for curve in make_dashboards.CURVES["clocks"] if curve.title.startswith("hosts: ")]
    metrics = {row.name for row in metrics_table.written() if row.name.startswith("sense4hri_host_clock_")}
    assert {re.search(r"sense4hri_host_clock_\w+", curve.expression)[0] for curve in curves} == metrics
    assert all(curve.legend.startswith("{{host}} − {{field}}") for curve in curves)
    services = [curve for curve in make_dashboards.CURVES["services"] if " by (host) " in curve.expression]
    assert len(services) > 2
    assert {curve.legend for curve in services} == {"{{host}}"}
