"""Dashboards are what their lists say, and ask only for what services export."""

import json
import re

import make_dashboards
import metrics_table
import pytest
import yaml
from grafana_foundation_sdk.models import dashboard

RULES = make_dashboards.FOLDER.parents[1] / "prometheus" / "rules.yml"


@pytest.mark.parametrize("path", make_dashboards.files(), ids=lambda path: path.stem)
def test_the_file_is_what_its_list_makes(path):
    """compose/grafana/make_dashboards.py writes it again."""
    assert path.read_text() == make_dashboards.files()[path]


@pytest.mark.parametrize("path", make_dashboards.files(), ids=lambda path: path.stem)
def test_grafanas_own_model_reads_it(path):
    """Nothing in it is unknown to Grafana's model of a dashboard, and no two panels have one place."""
    board = dashboard.Dashboard.from_json(json.loads(path.read_text()))
    assert board.uid == f"sense4hri-{path.stem}"
    places = [(panel.grid_pos.x, panel.grid_pos.y) for panel in board.panels]
    assert len({*places}) == len(places)
    assert all(panel.grid_pos.x + panel.grid_pos.w <= make_dashboards.WIDTH for panel in board.panels)


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
