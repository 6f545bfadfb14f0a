"""The questions that show that what a rule or a dashboard asks for is there."""

import re

import asked
import pytest


@pytest.mark.parametrize(
    ("alert", "parts"),
    [
        ("a > 1", ["a > bool 1"]),
        ("abs(a) >= 1 and on (x) b != 0", ["abs(a) >= bool 1 and on (x) b != bool 0"]),
        ("a == 3 or (b == 1 and on (x) c > 0)", ["a == bool 3", "(b == bool 1 and on (x) c > bool 0)"]),
        ('up{job!="a or (b"} == 0', ['up{job!="a or (b"} == bool 0']),
        ('a{x=~"b{2}|\\"}>"}[2m] < 1', ['a{x=~"b{2}|\\"}>"}[2m] < bool 1']),
        ("max(a) > (b or 0 * a)", ["max(a) > bool (b or 0 * a)"]),
        ("a >bool 1 or b >= bool 1", ["a >bool 1", "b >= bool 1"]),
        ("priority * on (x) group_left (y) floor", ["priority * on (x) group_left (y) floor"]),
    ],
)
def test_an_alert_is_asked_in_parts_whether_it_is_true_or_not(alert, parts):
    """What is compared is shown either way; each side of an `or`, but in brackets, is asked by itself."""
    assert asked.parts(alert) == parts


def test_every_comparison_of_every_alert_is_asked_either_way():
    """Else a study in which nothing is wrong would answer nothing."""
    for query in asked.of_rules():
        bare = re.sub(r'"[^"]*"|\{[^}]*\}', "", query)
        assert re.findall(r"[<>=!]=?(?! bool)(?!=)", bare) == [], query


def test_a_choice_is_asked_as_grafana_does():
    """The values of a label, of the series that are chosen already."""
    chosen = "/api/v1/label/sensor_type/values?match%5B%5D=sense4hri_stream_state%7Bsensor_id%3D%22h10_2%22%7D"
    assert asked.of_choices("h10_2") == [
        "/api/v1/label/sensor_id/values?match%5B%5D=sense4hri_stream_state",
        chosen,
    ]
