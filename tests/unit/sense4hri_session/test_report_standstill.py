"""What a report says of a recorder that stood still, and of a disk that took nothing."""

from __future__ import annotations

from typing import Any

import pytest
from reported_session import ECG, ECG_TOPIC, EDA, EDA_TOPIC, LENGTH_S, at, entry, finish, health, stream, told
from sense4hri_report import make_report


def stand_still(study: Any, lost: bool) -> None:
    """From the 10th to the 20th second the recorder takes nothing; what came then is lost, or written afterwards."""
    frozen = [m for m in study.messages if at(10) < m[0] < at(20)]
    kept = [m for m in study.messages if m not in frozen]
    late = [] if lost else [(at(20) + i, *m[1:]) for i, m in enumerate(sorted(frozen, key=lambda m: m[:2]))]
    study.messages[:] = sorted([*kept, *late], key=lambda m: m[:2])


def test_an_outage_that_cost_a_stream_nothing_is_not_taken_off_its_time(study):
    """14 of 30 s missing is less than half, whatever was written late in other 10 s."""
    stream(study, ECG)
    stream(study, EDA, without=[*range(25, 115), *range(230, 280)])
    for second in range(-2, 32):
        health(study, ECG, float(second), 0)
    stand_still(study, lost=False)
    summary = make_report(finish(study, session=told()))
    assert any("nothing was recorded for 10.0 s" in remark for remark in summary["remarks"])
    assert entry(summary, EDA)["coverage"] == pytest.approx(16 / 30, abs=0.01)
    assert entry(summary, EDA)["verdict"] == summary["verdict"] == "usable with gaps"


@pytest.mark.parametrize("lost", [True, False])
def test_a_recorder_that_stood_still_is_told_with_its_span(study, lost):
    """10 s in which nothing reached the recorder make the session incomplete where samples are missing, else not."""
    missing = range(120, 220) if lost else ()
    for key in (ECG, EDA):
        stream(study, key, without=missing)
    for second in range(-2, 32):
        health(study, ECG, float(second), 0)
    stand_still(study, lost)
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    sentence = "nothing was recorded for 10.0 s, from 10.0 s after the session's start: nothing reached the recorder"
    assert any(sentence in text for text in summary["problems" if lost else "remarks"])
    assert summary["verdict"] == ("usable with gaps" if lost else "complete")
    assert any(event["source"] == "recorder" and "10.0 s" in event["what"] for event in summary["events"])


def test_what_a_full_disk_left_whole_can_be_used(study):
    """The disk is full after 8 of 30 s: all streams have gaps, none is broken, and the report says from when."""
    for key in (ECG, EDA):
        stream(study, key, -2.0, 8.0)
    loss = {"after_ns": at(8), "before_ns": at(30), "count": 220, "cause": "disk"}
    lost = [(topic, {"lost": 220, "losses": [loss]}) for topic in (ECG_TOPIC, EDA_TOPIC)]
    summary = make_report(finish(study, lost=lost, session=told()))
    assert summary["verdict"] == "usable with gaps"
    assert {item["verdict"] for item in summary["streams"]} == {"usable with gaps"}
    assert {round(item["coverage"], 2) for item in summary["streams"]} == {0.27}
    sentence = "nothing was recorded for 22.0 s, from 8.02 s after the session's start: the disk took nothing"
    assert sentence in summary["problems"]


def test_a_chunk_that_the_disk_refused_is_no_outage_of_all(study):
    """Messages of one topic lost to the disk, somewhere in a file that has all others, are that topic's loss alone."""
    for key in (ECG, EDA):
        stream(study, key, without=range(100, 110) if key == ECG else ())
    loss = {"after_ns": at(-2), "before_ns": at(LENGTH_S), "count": 10, "cause": "disk"}
    summary = make_report(finish(study, lost=[(ECG_TOPIC, {"lost": 10, "losses": [loss]})], session=told()))
    assert summary["verdict"] == entry(summary, ECG)["verdict"] == "usable with gaps"
    assert entry(summary, EDA)["verdict"] == "complete"
    assert not any("nothing was recorded" in text for text in (*summary["problems"], *summary["remarks"]))
