"""What a report says of a whole session: its verdict, its folders, its hosts, its events, and of damaged files."""

from __future__ import annotations

import contextlib
import json
import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sense4hri_session
from mcap.reader import make_reader
from mcap.writer import Writer
from sense4hri_report import make_report
from sense4hri_report.__main__ import main
from sense4hri_session import SessionError

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
EPOCH_NS = 599_616_000 * SECOND
ECG, EDA = "p1/ecg/h10_1", "p2/eda/shimmer_1"
ECG_TOPIC, EDA_TOPIC = (f"/humans/physiological/{key}/raw" for key in (ECG, EDA))
LENGTH_S = 30.0
ALONE: dict[str, Any] = {"continues": None, "continued_in": [], "pause_s": None, "pause_after_s": None}
"""`parts` of a report beside the names of its folders."""


def at(seconds: float) -> int:
    """ROS time so long after the session's start."""
    return START_NS + round(seconds * SECOND)


def stamp(ns: int) -> dict[str, int]:
    return {"sec": ns // SECOND, "nanosec": ns % SECOND}


def stream(study: Any, key: str, from_s: float = -2.0, to_s: float = LENGTH_S + 2, without: Any = ()) -> None:
    """130 Hz in messages of 13 samples, those with the numbers in `without` left out."""
    noise = np.random.default_rng(1)
    for i in range(round((to_s - from_s) * 10)):
        if i not in without:
            end_s = from_s + (i + 1) * 0.1
            device_ns = EPOCH_NS + round((end_s + 100) * SECOND)
            study.raw(key, at(end_s + 0.02), device_ns, {"c": noise.normal(0, 100, 13)})


def told(**more: Any) -> dict[str, Any]:
    """The session in recorder.json."""
    about = {"session_id": "s1", "study": "Test", "task": "rest", "human_ids": ["p1", "p2"], "metadata": {}}
    times = {"start_at_ns": at(0), "stop_at_ns": at(LENGTH_S)}
    return about | times | {"required_streams": [ECG_TOPIC, "/humans/physiological/p2/*/*/raw"]} | more


def finish(study: Any, folder: str = "s1_rest_20261121T093000Z", lost: Any = (), **more: Any) -> Path:
    """Write the recording, and what the recorder would tell of it. lost: (topic, more of its account)."""
    path = study.write().rename(study.parent / folder)
    notes = json.loads((path / "recorder.json").read_text()) | more
    for topic, account in lost:
        next(item for item in notes["topics"] if item["topic"] == topic).update(account)
    (path / "recorder.json").write_text(json.dumps(notes))
    study.messages.clear()
    return path


def health(study: Any, key: str, second: float, offset_ns: int, **more: Any) -> None:
    about = {"header": {"stamp": stamp(at(second)), "frame_id": "h10_1"}, "state": 2, "host": "lab"}
    about |= {"realtime_minus_monotonic_ns": offset_ns, "nominal_rate_hz": 130.0}
    study.add(f"/humans/physiological/{key}/health", "StreamHealth", at(second), **about | more)


def entry(summary: dict[str, Any], key: str) -> dict[str, Any]:
    return next(item for item in summary["streams"] if item["stream"] == key)


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


def test_half_of_the_samples_is_the_border_of_use(study):
    """A stream with 60 % of its samples has gaps, one with 40 % is broken; both shares are exact."""
    stream(study, ECG, without=range(100, 220))
    stream(study, EDA, without=range(100, 280))
    summary = make_report(finish(study, session=told()))
    assert entry(summary, ECG)["coverage"] == pytest.approx(0.6, abs=1e-4)
    assert entry(summary, EDA)["coverage"] == pytest.approx(0.4, abs=1e-4)
    assert [entry(summary, key)["verdict"] for key in (ECG, EDA)] == ["usable with gaps", "broken"]


def test_what_is_missing_outside_of_the_session_is_not_held_against_it(study):
    """A gap before the start and a message lost after the stop leave the session complete, and are remarked."""
    stream(study, ECG, -10.0, without=range(10, 20))
    stream(study, EDA)
    loss = {"after_ns": at(31), "before_ns": at(31.1), "count": 1, "cause": "queue"}
    summary = make_report(finish(study, session=told(), lost=[(EDA_TOPIC, {"lost": 1, "losses": [loss]})]))
    assert (summary["verdict"], summary["problems"]) == ("complete", [])
    assert "1 gap outside of the session" in entry(summary, ECG)["remarks"]
    assert any("outside of the session" in remark for remark in entry(summary, EDA)["remarks"])


def test_a_hole_is_laid_to_the_one_who_made_it(study):
    """Of three holes one lies where the recorder's disk lost messages, one where the link was lost, one before both."""
    stream(study, ECG, without={50, *range(100, 140), 250})
    for second in range(30):
        lost = 8 <= second < 12
        health(study, ECG, second, 5, state=3 if lost else 2, reasons=["no packet for 2 s"] if lost else [])
    loss = {"after_ns": at(3.0), "before_ns": at(3.2), "count": 1, "cause": "disk"}
    summary = make_report(finish(study, session=told(), lost=[(ECG_TOPIC, {"lost": 1, "losses": [loss]})]))
    assert [(gap["lost_samples"], gap["cause"]) for gap in entry(summary, ECG)["gaps"]] == [
        (13, "recorder: disk"),
        (520, "link: LOST: no packet for 2 s"),
        (13, "before the recorder: sensor, radio or driver"),
    ]


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
    ("later", "verdict", "said", "channels"),
    [
        (("b", "c"), "usable with gaps", "its channels changed 1 time: a, c came for a part of the time", "abc"),
        (("b", "a"), "complete", "its channels changed 1 time, in their order", "ab"),
    ],
)
def test_a_stream_that_changes_its_channels_is_named_with_them(study, later, verdict, said, channels):
    """A channel that came for a part of the time is a gap, another order is none; the event says from what to what."""
    for i in range(320):
        names = ("a", "b") if i < 170 else later
        samples = {name: np.full(13, 100.0 * ord(name) + i) for name in names}
        study.raw(ECG, at(i * 0.1 - 1.0), EPOCH_NS + i * SECOND // 10, samples)
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    found = entry(summary, ECG)
    assert (found["verdict"], found["channels"]) == (verdict, list(channels))
    assert said in found["problems"] + found["remarks"]
    assert (found["messages"], found["samples"], found["lost_samples"]) == (320, 320 * 13, 0)
    assert [(e["kind"], e["what"]) for e in found["events"]] == [
        ("channels", f"channels changed from a, b to {', '.join(later)}")
    ]


def test_an_empty_session_is_broken(study):
    """A session in which not one message came has a report, and it says that nothing is there."""
    study.add("/study/session", "SessionState", at(0), session_id="s1", phase=2, header={"stamp": stamp(at(0))})
    summary = make_report(finish(study, session=told()))
    assert summary["verdict"] == "broken"
    assert [item["kind"] for item in summary["streams"]] == ["absent", "absent"]


def rewritten(folder: Path, split_at_ns: int = 0, **options: Any) -> None:
    """The recording as `ros2 bag record` writes it, without recorder.json; in two files where split_at_ns is given."""
    (old,) = folder.glob("*.mcap")
    parts = [(0, split_at_ns or 2**63), (split_at_ns, 2**63)][: 2 if split_at_ns else 1]
    for number, (begin, end) in enumerate(parts):
        with old.open("rb") as source, (folder / f"bag_{number}.mcap").open("wb") as target:
            writer, channels = Writer(target, **options), {}
            writer.start("ros2")
            for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
                if channel.topic not in channels:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", kind)
                head = channel.topic == "/study/session"
                if begin <= message.log_time < end or head:
                    log_ns = max(message.log_time, begin)
                    writer.add_message(channels[channel.topic], log_ns, message.data, message.publish_time)
            writer.finish()
    for path in (old, folder / "recorder.json", folder / "metadata.yaml"):
        path.unlink()


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


@pytest.fixture(scope="module")
def whole(new_study):
    """A folder to copy and damage."""
    stream(new_study, ECG, without=range(100, 110))
    for second in range(30):
        health(new_study, ECG, second, 5)
    return finish(new_study, session=told(required_streams=[ECG_TOPIC]))


def copied(whole: Path, target: Path) -> tuple[Path, Path, bytes]:
    folder = shutil.copytree(whole, target / whole.name)
    (file,) = folder.glob("*.mcap")
    return folder, file, file.read_bytes()


@pytest.mark.parametrize("share", [0.001, 0.3, 0.5, 0.7, 0.9999])
def test_a_file_that_was_cut_off_has_a_report_of_what_is_there(whole, tmp_path, share):
    """The report names the file that was cut off, and whether that cost messages."""
    folder, file, content = copied(whole, tmp_path)
    file.write_bytes(content[: int(len(content) * share)])
    summary = make_report(folder)
    found = sum(item.get("samples", 0) for item in summary["streams"])
    assert found == 330 * 13 if share > 0.99 else found < 300 * 13
    assert any(file.name in said for said in summary["problems" if share < 0.99 else "remarks"])
    assert (found < 150 * 13) == (summary["verdict"] == "broken")


def test_a_file_without_content_is_an_error_that_names_it(whole, tmp_path):
    """Where no file of a folder is a recording there is no report, and the error says which file is none."""
    folder, file, _ = copied(whole, tmp_path)
    file.write_bytes(b"")
    with pytest.raises(SessionError, match=f"{file.name} is no MCAP file"):
        make_report(folder)


def test_flipped_bits_never_end_in_a_traceback_or_a_lie(whole, tmp_path):
    """80 files with eight changed bytes: a sentence or a report, and a report without trouble counts what is true."""
    folder, file, content = copied(whole, tmp_path)
    truth = entry(make_report(folder), ECG)
    dice, reports = random.Random(6), 0
    for _ in range(80):
        damaged = bytearray(content)
        for _ in range(8):
            damaged[dice.randrange(len(damaged))] ^= 1 << dice.randrange(8)
        file.write_bytes(damaged)
        try:
            summary = make_report(folder)
        except SessionError:
            continue
        reports += 1
        if not summary["recording"]["trouble"] and summary["verdict"] != "broken":
            found = entry(summary, ECG)
            assert [found[key] for key in ("samples", "gaps", "duplicates")] == [
                truth[key] for key in ("samples", "gaps", "duplicates")
            ]
    assert reports > 40


def test_a_damaged_message_or_definition_never_ends_in_a_traceback(whole, tmp_path):
    """30 files without chunks, and so without checksums, with 40 changed bytes: a sentence or a report of the rest."""
    folder, _, _ = copied(whole, tmp_path)
    rewritten(folder, use_chunking=False, enable_crcs=False)
    file, dice, reports = folder / "bag_0.mcap", random.Random(7), 0
    content = file.read_bytes()
    begin = content.index(b"StreamHealth") - 100
    for number in range(30):
        damaged = bytearray(content)
        for _ in range(40):
            damaged[dice.randrange(begin, begin + 8000 if number % 2 else len(damaged))] = dice.randrange(256)
        file.write_bytes(damaged)
        with contextlib.suppress(SessionError):
            reports += make_report(folder)["format"]
    assert reports > 15


@pytest.mark.parametrize("content", ["", "{", "[]", '{"topics": 3, "session": [], "nodes": [1], "events": {}}'])
def test_a_damaged_recorder_json_costs_only_what_it_told(whole, tmp_path, content):
    """The samples are judged, and the report says what is not known."""
    folder, _, _ = copied(whole, tmp_path)
    (folder / "recorder.json").write_text(content)
    summary = make_report(folder)
    assert entry(summary, ECG)["gaps_total"] == 1
    assert any("recorder.json" in remark for remark in summary["remarks"])


def test_the_command_says_what_it_cannot_report_on_and_goes_on(whole, tmp_path, capsys):
    """Of three folders, one is none and one cannot be written to: two sentences, one report, exit status 1."""
    folder, file, _ = copied(whole, tmp_path)
    blocked, _, _ = copied(whole, tmp_path / "b")
    (blocked / "report.html").mkdir()
    assert main([str(tmp_path / "none"), str(blocked), str(folder)]) == 1
    said = capsys.readouterr()
    assert "there is no such file or directory" in said.err
    assert f"{blocked / 'report.html'} cannot be written" in said.err
    assert said.out.startswith(f"{folder / 'report.html'}: usable with gaps: ")
    assert sorted(path.name for path in blocked.glob(".report*")) == []
    assert main([str(file)]) == 1
    assert "is a file" in capsys.readouterr().err


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


@pytest.mark.parametrize("days", [-1, 1, 365 * 3])
def test_one_receipt_stamp_that_is_days_off_changes_no_verdict(study, days):
    """A stream with device time is complete, lies where it did, and the odd stamp is remarked."""
    stream(study, ECG)
    log_ns, number, topic, kind, values = study.messages[200]
    header = {"stamp": stamp(log_ns + days * 86_400 * SECOND), "frame_id": ""}
    study.messages[200] = (log_ns, number, topic, kind, values | {"header": header})
    summary = make_report(finish(study, session=told(required_streams=[ECG_TOPIC])))
    own = entry(summary, ECG)
    assert (summary["verdict"], own["coverage"], own["gaps_total"]) == ("complete", 1.0, 0)
    assert abs(own["last"]["since_start_s"] - (LENGTH_S + 2)) < 0.1
    assert any("1 receipt stamp more than an hour off" in remark for remark in own["remarks"])


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


OUTSIDE: dict[str, Any] = {"session": None}
STREAMING, STOPPING = 2, 4


@pytest.mark.parametrize(
    ("health_to_s", "counts_on", "last_state", "said"),
    [
        (29, True, STREAMING, "before the recording's end; meanwhile its driver sent about 1"),
        (20, True, STREAMING, "before the recording's end; the last that its driver said is that it streams"),
        (29, False, STOPPING, ""),
        (20, True, STOPPING, ""),
    ],
)
def test_outside_a_session_a_lost_tail_is_missed(study, health_to_s, counts_on, last_state, said):
    """A stream that ends 10 s early is complete only where its driver stopped, not where it sent or streamed on."""
    stream(study, ECG, 0.0, 20.0)
    stream(study, EDA, 0.0, 30.0)
    for second in range(health_to_s + 1):
        state = last_state if second == health_to_s else STREAMING if second <= 20 or counts_on else last_state
        total = 130 * (second if counts_on else min(second, 20))
        health(study, ECG, float(second), 0, samples_total=total, state=state)
    study.messages.sort()
    summary = make_report(finish(study, "20261121T093000Z", **OUTSIDE))
    own = entry(summary, ECG)
    assert own["verdict"] == summary["verdict"] == ("usable with gaps" if said else "complete")
    assert not said or (said in own["why"] and own["why"].startswith("ends 10.0 s"))
    assert entry(summary, EDA)["verdict"] == "complete"


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


@pytest.mark.parametrize("without", [(200,), (0,), (50, 51, 52)])
def test_a_message_without_a_time_among_others_is_no_reset_and_no_loss(study, without):
    """A device stamp of exactly 0 is an unknown time: the samples count, nothing is lost, and a remark says so."""
    stream(study, ECG)
    for i in without:
        log_ns, number, topic, kind, values = study.messages[i]
        study.messages[i] = (log_ns, number, topic, kind, values | {"device_timestamp": stamp(0)})
    own = entry(make_report(finish(study, session=told(required_streams=[ECG_TOPIC]))), ECG)
    assert (own["gaps_total"], own["resets"], own["device_time"]) == (0, 0, True)
    if without[0]:
        assert (own["verdict"], own["samples"]) == ("complete", own["messages"] * 13)
        assert f"{len(without)} message" in own["remarks"][0]


@pytest.mark.parametrize("lost", [0, 1, 3])
@pytest.mark.parametrize("jitter_samples", [0.0, 0.4])
def test_a_hole_inside_a_message_is_counted_where_the_stamps_are_exact(study, lost, jitter_samples):
    """Of one or three of 73 samples that a message lacks the report tells; where the stamps jitter, nobody can."""
    dice, taken = random.Random(1), 0
    for i in range(60):
        taken += 73 + (lost if i == 40 else 0)
        device_ns = EPOCH_NS + round((taken + dice.uniform(-1, 1) * jitter_samples) / 130 * SECOND)
        study.raw(ECG, at(taken / 130 - 2), device_ns, {"c": np.arange(73.0)})
    own = entry(make_report(finish(study, session=None)), ECG)
    told = lost if not jitter_samples else 0
    assert (own["lost_within_messages"], own["lost_samples"], own["resets"]) == (told, 0, 0)
    assert own["verdict"] == ("usable with gaps" if told else "complete")


def test_a_chunk_that_the_disk_refused_is_no_outage_of_all(study):
    """Messages of one topic lost to the disk, somewhere in a file that has all others, are that topic's loss alone."""
    for key in (ECG, EDA):
        stream(study, key, without=range(100, 110) if key == ECG else ())
    loss = {"after_ns": at(-2), "before_ns": at(LENGTH_S), "count": 10, "cause": "disk"}
    summary = make_report(finish(study, lost=[(ECG_TOPIC, {"lost": 10, "losses": [loss]})], session=told()))
    assert summary["verdict"] == entry(summary, ECG)["verdict"] == "usable with gaps"
    assert entry(summary, EDA)["verdict"] == "complete"
    assert not any("nothing was recorded" in text for text in (*summary["problems"], *summary["remarks"]))


def test_numbers_that_nothing_has_are_left_out(study, recwarn):
    """Impossible clock models, rates, levels and nested parameters cost themselves alone: the report is made."""
    stream(study, ECG)
    base = f"/humans/physiological/{ECG}"
    for second, value in enumerate((float("nan"), float("inf"), 1e307, -1e307, -1.0)):
        about = {"header": {"stamp": stamp(at(second)), "frame_id": ""}, "device_reference": stamp(EPOCH_NS)}
        offset_ns = (1 << 63) - 1 if second % 2 else 0
        study.add(f"{base}/clock", "ClockModel", at(second), **about, skew_ppm=value, offset_ns=offset_ns)
        health(study, ECG, float(second), 0, nominal_rate_hz=value, battery_percent=value, latency_s=value)
    sensor = {"sensor_id": "h10_1", "sensor_type": "ecg", "sampling_frequency_hz": -1.0, "node": "driver"}
    deep = '{"a":' * 5000 + "1" + "}" * 5000
    study.add("/study/sensors", "SensorInfoArray", at(0), sensors=[sensor | {"parameters_json": deep}])
    folder = finish(study, session=told(required_streams=[ECG_TOPIC]))
    summary = make_report(folder)
    assert entry(summary, ECG)["coverage"] == 1.0
    assert "4 clock models that no clock has: left out" in entry(summary, ECG)["remarks"]
    assert sense4hri_session.open(folder)[ECG].sampling_frequency_hz == pytest.approx(130, abs=0.1)
    assert not [str(warning.message) for warning in recwarn if "overflow" in str(warning.message)]
