"""Alerts ask only for what services export, and each has its test."""

import re
from pathlib import Path

import metrics_table
import yaml

FOLDER = Path(__file__).resolve().parents[3] / "compose" / "prometheus"
RULES = [rule for group in yaml.safe_load((FOLDER / "rules.yml").read_text())["groups"] for rule in group["rules"]]
TESTS = yaml.safe_load((FOLDER / "rules_test.yml").read_text())["tests"]


def test_every_metric_of_a_rule_is_in_the_table():
    """A name that no service exports would never raise an alert, and nobody would see."""
    rows = metrics_table.written()
    known = {row.name for row in rows} | {f"{row.name}_bucket" for row in rows if row.kind == "histogram"}
    known |= {rule["record"] for rule in RULES if "record" in rule}
    asked = {name for rule in RULES for name in re.findall(r"\bsense4hri[:_][a-z0-9_:]+", rule["expr"])}
    assert asked
    assert asked <= known


def test_every_alert_is_raised_and_ended_in_a_test():
    """promtool runs them, with the images."""
    alerts = {rule["alert"] for rule in RULES if "alert" in rule}
    raised = {case["alertname"] for test in TESTS for case in test["alert_rule_test"] if case.get("exp_alerts")}
    ended = {
        test["alert_rule_test"][-1]["alertname"] for test in TESTS if not test["alert_rule_test"][-1].get("exp_alerts")
    }
    assert alerts == raised == ended


def test_every_alert_says_how_bad_it_is_in_a_sentence():
    """An operator reads the summary and nothing else."""
    for rule in (rule for rule in RULES if "alert" in rule):
        assert rule["labels"]["severity"] in ("warning", "critical"), rule["alert"]
        assert len(rule["annotations"]["summary"]) > 20, rule["alert"]
