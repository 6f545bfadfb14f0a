"""What a report says of a whole session: its verdict, its hosts, its events."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import sense4hri_session
from reported_session import (
    ECG,
    ECG_TOPIC,
    EDA,
    EDA_TOPIC,
    EPOCH_NS,
    LENGTH_S,
    SECOND,
    at,
    entry,
    finish,
    health,
    rewritten,
    stamp,
    stream,
    told,
)
from sense4hri_report import make_report


@pytest.mark.parametrize(
    ("rate_hz", "state", "verdict"), [(0.0, 2, "complete"), (0.0, 3, "broken"), (130.0, 2, "broken")]
)
def test_a_stream_of_events_that_had_none_is_not_broken(study, rate_hz, state, verdict):
    """Declared with 0 Hz, its driver streaming, no sample: nothing came, and nothing is wrong; else it is broken."""
    stream(study, ECG)
    for second in range(-2, 32):
        health(study, EDA, second, 0, nominal_rate_hz=rate_hz, state=state)
    silent = entry(make_report(finish(study, session=told(required_streams=[ECG_TOPIC]))), EDA)
    assert (silent["kind"], silent["samples"], silent["verdict"]) == ("no samples", 0, verdict)
    assert verdict == "broken" or silent["remarks"][0].startswith("nothing came")


def test_a_session_without_a_fault_is_complete(study):
    """Two required streams from before the start to after the stop are complete, and both files say the same."""
    stream(study, ECG)
    stream(study, EDA)
    folder = finish(study, session=told())
    summary = make_report(folder)
    assert (summary["verdict"], summary["problems"]) == ("complete", [])
    assert summary["why"].startswith("nothing is missing: 2 streams from the session's start to its stop")
    assert {item["coverage"] for item in summary["streams"]} == {1.0}
    assert all(item["required"] for item in summary["streams"])
    assert json.loads((folder / "report.json").read_text()) == summary
    assert "Nothing is missing: 2 streams" in (folder / "report.html").read_text()


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({}, "it was required and never came"),
        (
            {"refused": [{"topic": EDA_TOPIC, "type": "x_msgs/msg/X", "why": "type not installed"}]},
            "type not installed",
        ),
        ({"withheld": [EDA_TOPIC]}, "withheld, because it identifies people"),
    ],
)
def test_a_required_stream_that_is_not_there_breaks_the_session(study, more, why):
    """The session is broken, and the report names the stream and why it is not there, as far as anybody knows."""
    stream(study, ECG)
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC, EDA_TOPIC]), **more))
    assert summary["verdict"] == "broken"
    assert EDA_TOPIC in summary["why"]
    assert why in summary["why"]
    assert entry(summary, ECG)["verdict"] == "complete"


def test_a_stream_nobody_required_cannot_break_a_session(study):
    """A stream that ends before the start is broken; the session, whose required stream is there, has gaps."""
    stream(study, ECG)
    stream(study, EDA, -10.0, -5.0)
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    assert entry(summary, EDA)["verdict"] == "broken"
    assert summary["verdict"] == "usable with gaps"


def test_a_step_of_the_hosts_clock_is_found_once_and_a_slew_is_none(study):
    """+3 s at the 12th second is reported once, with size and time; a slew of 500 ppm and one odd account are not."""
    stream(study, ECG)
    for second in range(30):
        offset = 10**15 + second * 500_000 + (3 * SECOND if second >= 12 else 0) + (SECOND if second == 20 else 0)
        health(study, ECG, second, offset)
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    (step,) = summary["host_clock_steps"]
    assert (step["host"], step["since_start_s"]) == ("lab", 12.0)
    assert step["step_s"] == pytest.approx(3.0, abs=0.01)
    assert summary["verdict"] == "usable with gaps"
    assert "the clock of lab was set by +3.0" in summary["why"]


@pytest.mark.parametrize(("lost_s", "missing"), [(0, 0), (2, 260)])
def test_a_clock_set_ahead_costs_a_device_without_clock_no_sample(study, lost_s, missing):
    """+10 s at the 15th second are no silence and no gap; what is truly missing there is counted without them."""
    for i in range(320):
        second = i * 0.1
        ahead_s = 10 if second >= 15 else 0
        if not 15 <= second < 15 + lost_s:
            study.raw(EDA, at(second + 0.1 + ahead_s), 0, {"c": np.arange(13.0) + i})
        if i % 10 == 0:
            for key in (ECG, EDA):
                health(study, key, second + ahead_s, 10**15 + ahead_s * SECOND)
        study.add("/study/markers", "Marker", at(second + ahead_s), header={"stamp": stamp(at(second + ahead_s))})
    about = told(required_streams=[EDA_TOPIC, "/study/markers"], stop_at_ns=at(LENGTH_S + 10))
    summary = make_report(finish(study, session=about, host="lab"))
    eda = entry(summary, EDA)
    assert (eda["lost_samples_estimated"], eda["missing_in_session"]) == (pytest.approx(missing, abs=2),) * 2
    assert len(eda["gaps"]) == bool(lost_s)
    assert entry(summary, "/study/markers")["verdict"] == "complete"
    assert any("the clock of lab was set by +10.000 s" in problem for problem in summary["problems"])
    assert not any("nothing was recorded" in told for told in summary["problems"] + summary["remarks"])


@pytest.mark.parametrize(("back_s", "true_s"), [(3600, LENGTH_S), (20, LENGTH_S - 20)])
def test_a_clock_set_back_in_the_session_breaks_no_stream(study, back_s, true_s):
    """Back by an hour or by 20 s at the 15th second, also past the start: what is there is judged, the step is told."""
    for i in range(320):
        second = i * 0.1 - 1
        by_stamp = second - (back_s if second >= 15 else 0)
        device_ns = EPOCH_NS + round(second * SECOND)
        study.raw(ECG, at(by_stamp + 0.1), device_ns, {"c": np.arange(13.0) + i})
        if i % 10 == 0:
            health(study, ECG, by_stamp, 10**15 - (back_s * SECOND if second >= 15 else 0))
    folder = study.write(ordered=list(study.messages))
    notes = json.loads((folder / "recorder.json").read_text())
    notes["session"] = told(required_streams=[ECG_TOPIC], stop_at_ns=at(LENGTH_S - back_s))
    (folder / "recorder.json").write_text(json.dumps(notes))
    summary = make_report(folder)
    assert (entry(summary, ECG)["verdict"], summary["verdict"]) == ("complete", "usable with gaps")
    assert f"the clock of lab was set by {-back_s:+.3f} s" in " ".join(summary["problems"])
    assert summary["window"]["seconds"] == pytest.approx(true_s, abs=0.2)


def test_a_host_that_was_started_anew_set_no_clock(study):
    """Its monotonic clock begins again after 2.5 h, its wall clock went on: no step; one of +3 s afterwards is told."""
    stream(study, ECG)
    for second in (*range(10), *range(15, 30)):
        begun_ns = at(-9000) if second < 15 else at(14)
        stepped_ns = 3 * SECOND if second >= 20 else 0
        health(study, ECG, second + stepped_ns // SECOND, begun_ns + stepped_ns)
    study.messages.sort()
    (step,) = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))["host_clock_steps"]
    assert (step["since_start_s"], step["step_s"]) == (23.0, pytest.approx(3.0))


def test_a_marker_and_a_phase_without_a_stamp_lie_at_their_receipt(study):
    """`ros2 topic pub` leaves the stamp zero: report and export have them when the recorder received them."""
    stream(study, ECG)
    study.add("/study/markers", "Marker", at(5), name="note", value="by hand", source="me")
    study.add("/study/session", "SessionState", at(6), session_id="s1", phase=2)
    study.messages.sort()
    folder = finish(study, session=told(required_streams=[ECG_TOPIC]))
    summary = make_report(folder)
    assert [marker["since_start_s"] for marker in summary["markers"]] == [5.0]
    assert [event["since_start_s"] for event in summary["events"] if event["source"] in ("me", "session")] == [5.0, 6.0]
    assert sense4hri_session.open(folder).markers["time_ns"].tolist() == [at(5)]


def test_what_happened_is_told_in_order_and_by_whom(study):
    """Phases, services that died and appeared, notes and the recorder's events are in one list, in order of time."""
    stream(study, ECG)
    for second, phase in ((-1.5, 1), (-1.0, 2), (30.0, 3)):
        about = {"session_id": "s1", "phase": phase, "header": {"stamp": stamp(at(second))}}
        study.add("/study/session", "SessionState", at(second), **about)
    for second, what in ((5.0, "service died: interpreter_ecg"), (9.0, "service appeared: interpreter_ecg")):
        about = {"name": "note", "value": what, "source": "session-coordinator", "header": {"stamp": stamp(at(second))}}
        study.add("/study/markers", "Marker", at(second), **about)
    events = [{"at_ns": at(7), "what": "the disk has 900 MB left"}]
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC]), events=events))
    assert [(event["since_start_s"], event["source"], event["what"]) for event in summary["events"]] == [
        (-1.5, "session", "PREPARING"),
        (-1.0, "session", "RECORDING"),
        (5.0, "session-coordinator", "service died: interpreter_ecg"),
        (7.0, "recorder", "the disk has 900 MB left"),
        (9.0, "session-coordinator", "service appeared: interpreter_ecg"),
        (30.0, "session", "STOPPING"),
    ]


def test_doubts_are_remarks_and_change_no_verdict(study):
    """Off the skin, an empty battery, a reconnect and withheld topics are said; the session stays complete."""
    stream(study, ECG)
    for second in range(30):
        worn = 0.0 if second < 6 else 1.0
        more = {"battery_percent": 9.0, "contact": worn, "reconnects_total": int(second > 20)}
        health(study, ECG, second, 5, **more)
    faces = "/humans/faces/a/crop"
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC]), withheld=[faces]))
    assert summary["verdict"] == "complete"
    said = " ".join(entry(summary, ECG)["remarks"])
    assert "off the skin for 20% of the time" in said
    assert "battery at 9 % at the end" in said
    assert "the link was lost and came back 1 time" in said
    assert summary["withheld"] == [faces]


@pytest.mark.parametrize(
    ("session", "more", "said"),
    [
        (told(stop_at_ns=None), {}, "the session never stopped"),
        (told(), {"state": "interrupted", "why": "disk full"}, "the recording was interrupted: disk full"),
        (told(), {"state": "recording"}, "the recorder has not closed it"),
    ],
)
def test_a_session_that_did_not_end_well_says_so(study, session, more, said):
    """What is there can be used; how it ended is a problem of the session, not of its streams."""
    stream(study, ECG)
    stream(study, EDA)
    summary = make_report(finish(study, session=session, **more))
    assert summary["verdict"] == "usable with gaps"
    assert said in summary["why"]
    assert {item["verdict"] for item in summary["streams"]} == {"complete"}


@pytest.mark.parametrize(
    ("detail", "said"),
    [
        ("stopped before it had begun", "the session-coordinator said at the stop: stopped before it had begun"),
        ("", "by its stamps it stopped before it started: the host's clock was set back meanwhile"),
    ],
)
def test_a_session_stopped_before_its_announced_start_is_no_clock_set_back(study, detail, said):
    """The coordinator knows the difference, by a clock that nobody sets, and has said it at the stop."""
    stream(study, ECG)
    about = {"header": {"stamp": stamp(at(-0.4))}, "session_id": "s1", "phase": 3, "detail": detail}
    study.add("/study/session", "SessionState", at(-0.4), **about)
    summary = make_report(finish(study, session=told(stop_at_ns=at(-0.4), required_streams=[ECG_TOPIC])))
    assert summary["problems"] == [said]


@pytest.mark.parametrize(("topic", "kind", "verdict"), [
    ("/study/markers", "Marker", "usable with gaps"),
    (f"/humans/physiological/{ECG}/features", "ECG", "usable with gaps"),
    ("/humans/physiological/p1/state", "UserState", "usable with gaps"),
    (f"/humans/physiological/{ECG}/clock", "ClockModel", "complete"),
    ("/humans/faces/face_a/expression", "hri_msgs/msg/Expression", "complete"),
])  # fmt: skip
@pytest.mark.parametrize("second", [2, -2])
def test_lost_markers_features_and_states_are_missed(study, topic, kind, verdict, second):
    """5 messages that the disk did not take in the session are a problem; before it, or superseded, they are none."""
    for key in (ECG, EDA):
        stream(study, key)
    for number in (-2, -1, 1, 3):
        study.add(topic, kind, at(number), header={"stamp": stamp(at(number))})
    loss = {"after_ns": at(second), "before_ns": at(second + 0.5), "count": 5, "cause": "disk"}
    summary = make_report(finish(study, session=told(), lost=[(topic, {"lost": 5, "losses": [loss]})]))
    assert summary["verdict"] == (verdict if second > 0 else "complete")
    if summary["verdict"] != "complete":
        assert summary["problems"] == [f"{topic}: 5 messages sent and not recorded (5 by the disk)"]
    elif topic.startswith("/humans/faces"):
        assert any(topic in remark for remark in summary["remarks"]) == (second > 0)


def test_markers_that_cannot_be_decoded_are_missed(study):
    """A marker of other bytes is in no table: the session says so."""
    for key in (ECG, EDA):
        stream(study, key)
    study.add_bytes("/study/markers", "Marker", at(1), b"\0\1\0\0xx")
    summary = make_report(finish(study, session=told()))
    assert summary["problems"] == ["/study/markers: 1 message cannot be decoded"]


def test_an_empty_session_is_broken(study):
    """A session in which not one message came has a report, and it says that nothing is there."""
    study.add("/study/session", "SessionState", at(0), session_id="s1", phase=2, header={"stamp": stamp(at(0))})
    summary = make_report(finish(study, session=told()))
    assert summary["verdict"] == "broken"
    assert [item["kind"] for item in summary["streams"]] == ["absent", "absent"]


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"chunk_size": 4096}])
def test_a_recording_of_ros2_bag_has_a_report(study, options):
    """Without recorder.json, with and without chunks, in two files: the session's own word is enough."""
    stream(study, ECG, without=range(100, 110))
    about = {"session_id": "s1", "study": "Test", "start_at": stamp(at(0)), "stop_at": stamp(at(LENGTH_S))}
    about |= {"phase": 3, "required_streams": [ECG_TOPIC], "header": {"stamp": stamp(at(-2))}}
    study.add("/study/session", "SessionState", at(-2), **about)
    folder = study.write()
    rewritten(folder, at(15.05), **options)
    summary = make_report(folder)
    assert summary["recording"]["files"] == ["bag_0.mcap", "bag_1.mcap"]
    assert summary["session"]["session_id"] == "s1"
    assert entry(summary, ECG)["problems"] == ["1 gap, 130 samples missing (3.33%), the longest 1.00 s"]
    assert (entry(summary, ECG)["duplicates"], entry(summary, ECG)["gaps_total"]) == (0, 1)
    assert [phase["phase"] for phase in summary["session"]["phases"]] == ["STOPPING"]
    assert any("there is no recorder.json" in remark for remark in summary["remarks"])
    assert {topic["lost"] for topic in summary["topics"]} == {None}


SHIMMER = "p1/ecg/Shimmer_1"
TWIST = "/humans/physiological/p2/eda/e4_1/raw"


def test_nothing_that_was_recorded_under_the_streams_names_is_invisible(study):
    """A stream of a wrong name is judged and named, one of another type and a topic of no stream have their row."""
    stream(study, ECG)
    stream(study, SHIMMER)
    for i in range(40):
        study.add(TWIST, "std_msgs/msg/Float64", at(i), data=1.0)
        study.add("/humans/physiological/p3/emg", "std_msgs/msg/String", at(i), data="x")
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    shimmer, twist, emg = (entry(summary, key) for key in (SHIMMER, TWIST, "/humans/physiological/p3/emg"))
    assert (shimmer["coverage"], shimmer["verdict"]) == (1.0, "usable with gaps")
    assert "sensor_id 'Shimmer_1': small letters" in shimmer["why"]
    assert twist["verdict"] == "broken"
    assert "std_msgs/msg/Float64, a stream's raw is sense4hri_msgs/msg/PhysioRaw" in twist["why"]
    assert emg["verdict"] == "usable with gaps"
    assert "no topic of a stream" in emg["why"]
    assert summary["verdict"] == "usable with gaps"
    assert entry(summary, ECG)["verdict"] == "complete"


@pytest.mark.parametrize(
    ("numbers", "epochs", "begin_s"),
    [("121", "ABB", [0, 10]), ("11", "AB", [0, 15]), ("11", "AA", [0]), ("112", "ABC", [0, 10, 20])],
    ids=["started anew after", "while", "nothing happened", "numbers that rise late"],
)
def test_segments_of_a_clock_sync_that_was_started_anew_are_told_apart(study, numbers, epochs, begin_s):
    """It counts from 1 again: a segment is an epoch of the device's clock, and no line is drawn through two."""
    stream(study, ECG)
    base = f"/humans/physiological/{ECG}"
    for second in range(30):
        part = second * len(numbers) // 30
        device_ns = EPOCH_NS + second * SECOND - "ABC".index(epochs[part]) * 3600 * SECOND
        about = {"header": {"stamp": stamp(at(second)), "frame_id": ""}, "device_reference": stamp(device_ns)}
        about |= {"offset_ns": at(second) - device_ns, "segment": int(numbers[part]), "state": 1}
        study.add(f"{base}/clock", "ClockModel", at(second), **about, skew_ppm=0.0, uncertainty_s=0.001, latency_s=0.0)
    folder = finish(study, session=told(required_streams=[ECG_TOPIC]))
    told_of = entry(make_report(folder), ECG)["clock"]["segments"]
    assert [round(segment["since_start_s"]) for segment in told_of] == begin_s
    page = (folder / "report.html").read_text()
    assert re.search(r"clock offset less drift</text>.*?>\+([^ ]*) ms<", page, re.DOTALL)[1] == "0.05"


@pytest.mark.parametrize("rate_hz", [-1.0, 1e-308])
def test_numbers_that_nothing_has_are_left_out(study, recwarn, rate_hz):
    """Impossible clock models, rates, levels and nested parameters cost themselves alone: the report is made."""
    stream(study, ECG)
    study.raw(ECG, at(LENGTH_S + 2.1), 0, {"c": np.zeros(13)})  # without a time: placed by the rate
    base = f"/humans/physiological/{ECG}"
    for second, value in enumerate((float("nan"), float("inf"), 1e307, -1e307, -1.0)):
        about = {"header": {"stamp": stamp(at(second)), "frame_id": ""}, "device_reference": stamp(EPOCH_NS)}
        offset_ns = (1 << 63) - 1 if second % 2 else 0
        study.add(f"{base}/clock", "ClockModel", at(second), **about, skew_ppm=value, offset_ns=offset_ns)
        health(study, ECG, float(second), 0, nominal_rate_hz=value, battery_percent=value, latency_s=value)
    sensor = {"sensor_id": "h10_1", "sensor_type": "ecg", "sampling_frequency_hz": rate_hz, "node": "driver"}
    deep = '{"a":' * 5000 + "1" + "}" * 5000
    study.add("/study/sensors", "SensorInfoArray", at(0), sensors=[sensor | {"parameters_json": deep}])
    folder = finish(study, session=told(required_streams=[ECG_TOPIC]))
    summary = make_report(folder)
    assert entry(summary, ECG)["coverage"] == 1.0
    assert "4 clock models that no clock has: left out" in entry(summary, ECG)["remarks"]
    assert sense4hri_session.open(folder)[ECG].sampling_frequency_hz == pytest.approx(130, abs=0.1)
    assert not [str(warning.message) for warning in recwarn if "overflow" in str(warning.message)]
