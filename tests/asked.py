"""What the rules and the dashboards ask Prometheus, as questions that find something as long as nothing is wrong."""

from __future__ import annotations

import json
import re
import urllib.parse
from collections.abc import Callable, Iterable
from pathlib import Path

import make_dashboards
import yaml

RULES = Path(__file__).resolve().parents[1] / "compose" / "prometheus" / "rules.yml"
OF_SEVERAL_HOSTS = "sense4hri_host_clock_"
"""In the name of every metric that is there only with a second host."""
QUOTED = r'"(?:\\.|[^"\\])*"'
TOKEN = re.compile(rf"{QUOTED}|\{{(?:{QUOTED}|[^}}\"])*\}}|[()]|\bor\b|(?P<compared>==|!=|>=|<=|>|<)(?!=|\s*bool\b)")


def parts(alert: str) -> list[str]:
    """Return what an alert's expression compares: the sides of each `or` that is in no bracket, true or not.

    A comparison with `bool` leaves out only what has no partner, so that an answer shows that both sides match.
    """
    found, depth, begun = [""], 0, 0
    for token in TOKEN.finditer(alert):
        depth += {"(": 1, ")": -1}.get(token[0], 0)
        found[-1] += alert[begun : token.start()]
        begun = token.end()
        if token[0] == "or" and not depth:
            found.append("")
        else:
            found[-1] += f"{token[0]} bool" if token["compared"] else token[0]
    found[-1] += alert[begun:]
    return [part.strip() for part in found]


def of_rules() -> list[str]:
    """Return the name of what each rule records, and the parts of each alert."""
    rules = [rule for group in yaml.safe_load(RULES.read_text())["groups"] for rule in group["rules"]]
    return [asked for rule in rules for asked in ([rule["record"]] if "record" in rule else parts(rule["expr"]))]


def of_panels(sensor_id: str, sensor_type: str) -> list[str]:
    """Return the query of every panel, for a chosen stream."""
    return [_chosen(query, sensor_id, sensor_type) for query in make_dashboards.queries()]


def everything(sensor_id: str, sensor_type: str) -> list[str]:
    """Return what all rules and panels ask."""
    return [*of_rules(), *of_panels(sensor_id, sensor_type)]


def of_choices(sensor_id: str) -> list[str]:
    """Return the paths that Grafana asks for what can be chosen at the top of a dashboard."""
    boards = [json.loads(text) for text in make_dashboards.files().values()]
    asked = [variable["query"] for board in boards for variable in board["templating"].get("list", [])]
    found = [re.fullmatch(r"label_values\((.+), (\w+)\)", _chosen(each, sensor_id)) for each in asked]
    assert found
    assert all(found), asked
    return [f"/api/v1/label/{one[2]}/values?{urllib.parse.urlencode({'match[]': one[1]})}" for one in found if one]


def _chosen(query: str, sensor_id: str, sensor_type: str = "") -> str:
    return query.replace("$sensor_id", sensor_id).replace("$sensor_type", sensor_type)


def unanswered(queries: Iterable[str], answer: Callable[[str], object]) -> list[str]:
    """Return those queries to which the answer is nothing."""
    return [query for query in queries if not answer(query)]
