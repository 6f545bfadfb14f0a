"""What a report says of a session that lies in several folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from reported_session import ECG, ECG_TOPIC, EDA, EDA_TOPIC, LENGTH_S, at, entry, finish, stamp, stream, told
from sense4hri_report import make_report

ALONE: dict[str, Any] = {"continues": None, "continued_in": [], "pause_s": None, "pause_after_s": None}
"""`parts` of a report beside the names of its folders."""


def two_parts(study: Any) -> tuple[Path, Path]:
    """A session whose recorder was killed at the 10th second and recorded on from the 16th on, 6.1 s later."""
    stream(study, ECG, -2.0, 10.0)
    stream(study, EDA, -2.0, 10.0)
    first = finish(study, session=told(stop_at_ns=None), state="interrupted", why="the recorder was killed")
    stream(study, ECG, 16.0)
    stream(study, EDA, 17.5)
    before = [(topic, {"missed_at_start": 160}) for topic in (ECG_TOPIC, EDA_TOPIC)]
    second = finish(study, f"{first.name}_1", session=told(), lost=before)
    return first, second


def test_a_report_is_of_all_parts_and_names_what_is_missing_between_them(study):
    """Made of either folder it is in both; each stream has one hole, laid to the recorder; nothing else is wrong."""
    first, second = two_parts(study)
    summary = make_report(second)
    for folder in (first, second):
        assert json.loads((folder / "report.json").read_text()) == summary
        assert "no recorder ran, between" in (folder / "report.html").read_text()
    assert summary["parts"] == {"folders": [first.name, second.name], **ALONE}
    assert summary["verdict"] == "usable with gaps"
    pause, *streams = summary["problems"][::-1]
    assert pause == (
        "nothing was recorded for 6.10 s, from 10.0 s after the session's start: "
        f"no recorder ran, between {first.name} and {second.name}"
    )
    assert [problem.partition(":")[0] for problem in streams] == [EDA, ECG]
    for key, missing in ((ECG, 6.0), (EDA, 7.5)):
        own = entry(summary, key)
        assert (own["problems"], own["messages"]) == ([own["why"]], round((LENGTH_S + 4 - missing) * 10))
        ((gap),) = own["gaps"]
        assert (gap["lost_samples"], gap["cause"]) == (missing * 130, f"recorder: {pause.partition('start: ')[2]}")
        assert own["missed_at_start"] == 0
    assert (summary["window"]["start_known"], summary["window"]["stop_known"]) == (True, True)
    assert summary["recording"]["messages"] == sum(entry(summary, key)["messages"] for key in (ECG, EDA))
    assert {topic["messages_by_recorder"] == topic["messages"] for topic in summary["topics"]} == {True}


def test_what_came_while_no_recorder_ran_is_missed_without_a_stream_too(study):
    """Of a session with markers alone, none lost as far as anybody knows, the report tells the time all the same."""
    for name, seconds in (("s1_1970", (0, 1, 2)), ("s1_1970_1", (5, 6, 7))):
        for second in seconds:
            study.add("/study/markers", "Marker", at(second), name="note", header={"stamp": stamp(at(second))})
        folder = finish(study, name, session=told(required_streams=[]))
    problems = make_report(folder)["problems"]
    assert any("nothing was recorded for 3.00 s" in problem for problem in problems), problems


def test_a_part_that_cannot_be_read_costs_itself_alone(study):
    """The report of the other part names it, and what of the session is missing."""
    first, second = two_parts(study)
    (file,) = second.glob("*.mcap")
    file.write_bytes(b"")
    summary = make_report(first)
    assert any(file.name in problem for problem in summary["problems"])
    assert entry(summary, ECG)["messages"] == 120
    assert summary["parts"]["continued_in"] == [second.name]


def test_a_part_that_is_being_recorded_is_named_and_not_read(study):
    """While the further folder is open the report is of the first alone."""
    first, second = two_parts(study)
    notes = json.loads((second / "recorder.json").read_text())
    (second / "recorder.json").write_text(json.dumps(notes | {"state": "recording"}))
    summary = make_report(first)
    assert (summary["parts"]["folders"], summary["parts"]["continued_in"]) == ([first.name], [second.name])
    assert not (second / "report.json").exists()


def test_a_later_folder_of_a_session_begins_no_stream_late(study):
    """Alone, each folder names the other; no stream is late, ends early or missed messages."""
    first, second = two_parts(study)
    early, late = (make_report(folder, only_this_part=True) for folder in (first, second))
    assert early["parts"] == ALONE | {"folders": [first.name], "continued_in": [second.name], "pause_after_s": 6.1}
    assert late["parts"] == ALONE | {"folders": [second.name], "continues": first.name, "pause_s": 6.1}
    for summary in (early, late):
        assert summary["verdict"] == "usable with gaps"
        assert [(item["verdict"], item["problems"]) for item in summary["streams"]] == [("complete", [])] * 2
    assert late["problems"] == [f"it continues the session in {first.name}, 6.10 s after the last message there"]
    assert len(early["problems"]) == 2  # interrupted, and goes on
    assert (late["window"]["start_known"], late["window"]["stop_known"]) == (False, True)


def test_another_session_of_that_name_is_no_part(study):
    """A folder `.._1` of a session with another id is not taken for a part."""
    stream(study, ECG)
    first = finish(study, session=told(required_streams=[ECG_TOPIC]))
    stream(study, ECG)
    finish(study, f"{first.name}_1", session=told(session_id="s2"))
    parts = make_report(first)["parts"]
    assert parts == ALONE | {"folders": [first.name]}
