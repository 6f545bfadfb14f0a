"""What a report says of sensors that change their wearer."""

from __future__ import annotations

from typing import Any

import pytest
from reported_session import ECG, ECG_TOPIC, LENGTH_S, at, entry, finish, stamp, stream, told
from sense4hri_report import make_report

MOVED = "p2/ecg/h10_1"


def assigned(study: Any, since_s: float, human_id: str, sensor_id: str = "h10_1") -> None:
    """The registry's word, so long after the start."""
    item = {"sensor_id": sensor_id, "human_id": human_id, "since": stamp(at(since_s)), "source": "operator"}
    study.add("/study/assignments", "SensorAssignmentArray", at(since_s), assignments=[item])


@pytest.mark.parametrize("registry", [True, False])
def test_a_change_of_wearer_is_an_event_and_each_is_judged_over_their_own_stretch(study, registry):
    """A sensor that goes to p2 after 12 s and back after 20 s leaves both complete, and the report says when."""
    stream(study, ECG, -2.0, 12.0)
    stream(study, MOVED, 12.0, 20.0)
    stream(study, ECG, 20.0, LENGTH_S + 2)
    for since_s, human_id in ((-3.0, "p1"), (11.5, "p2"), (19.5, "p1")) if registry else ():
        assigned(study, since_s, human_id)
    study.messages.sort()
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    assert (summary["verdict"], summary["problems"]) == ("complete", [])
    one, two = entry(summary, ECG), entry(summary, MOVED)
    assert one["coverage"] == two["coverage"] == 1.0
    worn = [[round(s[edge]["since_start_s"]) for s in e["worn"] for edge in ("from", "to")] for e in (one, two)]
    assert worn == [[0, 12, 20, 30], [12, 20]]
    said = [(round(e["since_start_s"]), e["what"]) for e in summary["events"] if e["source"] == "wearer"]
    assert said == [(12, "h10_1 went from p1 to p2"), (20, "h10_1 went from p2 to p1")]


def test_what_is_missing_in_a_persons_own_stretch_is_theirs(study):
    """p2's stream that begins 4 s after p1's ended has a gap of 4 s; what was nobody's before the start is no fault."""
    stream(study, ECG, -2.0, 12.0)
    stream(study, MOVED, 16.0, LENGTH_S + 2)
    stream(study, "unassigned/eda/e4_1", -2.0, -1.0)
    stream(study, "p2/eda/e4_1", -1.0, LENGTH_S + 2)
    assigned(study, 12.0, "p2")
    study.messages.sort()
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    assert entry(summary, ECG)["verdict"] == "complete"
    assert entry(summary, MOVED)["why"] == "begins 4.01 s after it changed hands"
    assert entry(summary, "unassigned/eda/e4_1")["verdict"] == "complete"
    assert entry(summary, "p2/eda/e4_1")["coverage"] == 1.0


def test_an_assignment_that_the_data_did_not_follow_is_told(study):
    """The registry gave the sensor to p2 after 10 s, its samples stayed with p1: told with span; 3 s of lag is not."""
    stream(study, ECG)
    stream(study, "p1/eda/e4_1", -2.0, 13.0)
    stream(study, "p2/eda/e4_1", 13.0, LENGTH_S + 2)
    for sensor_id in ("h10_1", "e4_1"):
        assigned(study, -3.0, "p1", sensor_id)
        assigned(study, 10.0, "p2", sensor_id)
    study.messages.sort()
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    assert "for 22.0 s, from 10.0 s after the session's start, the registry named p2" in entry(summary, ECG)["why"]
    assert entry(summary, ECG)["verdict"] == summary["verdict"] == "usable with gaps"
    assert {entry(summary, key)["verdict"] for key in ("p1/eda/e4_1", "p2/eda/e4_1")} == {"complete"}


def test_what_is_derived_from_a_sensor_that_changed_hands_names_the_same_persons_stream(study):
    """Breathing found in p2's ECG is derived from p2's, not from that of whoever wore the strap before."""
    stream(study, ECG, -2.0, 12.0)
    stream(study, MOVED, 12.0, LENGTH_S + 2)
    for human in ("p1", "p2"):
        about = {"header": {"stamp": stamp(at(14)), "frame_id": "h10_1_ecg"}}
        study.add(f"/humans/physiological/{human}/respiration/h10_1_ecg/features", "Respiration", at(14), **about)
    study.messages.sort()
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    derived = {human: entry(summary, f"{human}/respiration/h10_1_ecg")["derived_from"] for human in ("p1", "p2")}
    assert derived == {"p1": ECG, "p2": MOVED}
