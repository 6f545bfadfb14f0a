"""Recordings of several files, folders that belong together, and what the recorder knew of them."""

import json
import shutil

import pytest
import sense4hri_session
import yaml
from mcap.reader import SeekingReader
from mcap.writer import Writer
from sense4hri_recording.layout import find_files

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
LATCHED = ("/study/sensors", "/study/assignments", "/study/session")
TABLES = ("markers", "states", "expressions", "assignments")


def split(folder, parts=3, repeat=True):
    """Cut a recording of one file into several, the current messages of latched topics at the head of each."""
    (file,) = folder.glob("*.mcap")
    with file.open("rb") as source:
        records = list(SeekingReader(source).iter_messages())
    names, current = [], {}
    size = len(records) // parts + 1
    for number in range(parts):
        own = records[number * size : (number + 1) * size]
        at_ns = own[0][2].log_time
        head = [(*found[:2], found[2], at_ns) for found in current.values()] if repeat else []
        names.append(f"{folder.name}_split_{number}.mcap")
        with (folder / names[-1]).open("wb") as sink:
            writer = Writer(sink)
            writer.start(profile="ros2", library="test")
            schemas, channels = {}, {}
            for schema, channel, message, log_ns in [*head, *((*found, found[2].log_time) for found in own)]:
                if schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                if channel.id not in channels:
                    text = channel.metadata["offered_qos_profiles"]
                    if channel.topic in LATCHED:
                        text = text.replace("volatile", "transient_local")
                    channels[channel.id] = writer.register_channel(
                        channel.topic, "cdr", schemas[schema.id], {**channel.metadata, "offered_qos_profiles": text}
                    )
                writer.add_message(channels[channel.id], log_ns, message.data, message.publish_time, message.sequence)
            writer.finish()
        current |= {
            channel.id: (schema, channel, message) for schema, channel, message in own if channel.topic in LATCHED
        }
    file.unlink()
    about = yaml.safe_load((folder / "metadata.yaml").read_text())
    about["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (folder / "metadata.yaml").write_text(yaml.safe_dump(about))
    return names


def facts(state="complete", session_id="s1", **more):
    session = {"session_id": session_id, "study": "Trust", "task": "walk", "human_ids": ["p1", "p2"]}
    session |= {"required_streams": [], "metadata": {"room": 4}}
    session |= {"start_at_ns": START_NS + 20 * SECOND, "stop_at_ns": START_NS + 80 * SECOND}
    return {"format": 1, "state": state, "why": "", "session": session | more}


@pytest.fixture
def copy(recording, tmp_path):
    """A copy to change."""
    return shutil.copytree(recording, tmp_path / recording.name)


def test_several_splits_are_one_recording(copy, recording):
    """Three splits give the samples, tables and messages of the one file; what is repeated at a head is not doubled."""
    whole = sense4hri_session.open(recording)
    assert len(split(copy)) == 3
    parts = sense4hri_session.open(copy)
    for key, stream in whole.streams.items():
        assert parts[key].frame().equals(stream.frame())
    for name in TABLES:
        assert getattr(parts, name).equals(getattr(whole, name)), name
    for topic in LATCHED:
        assert len(parts.table(topic)) == len(whole.table(topic)), topic
    assert (parts.start_ns, parts.end_ns) == (whole.start_ns, whole.end_ns)


def test_the_order_is_that_of_receipt_when_the_hosts_clock_is_set_back(study):
    """With the host's clock set back an hour amid a recording no sample is taken for a repetition, none is shuffled."""
    for i in range(400):
        back = 3600 * SECOND if i >= 200 else 0
        log_ns = START_NS + i * SECOND // 10 - back
        study.raw("p1/ecg/x_1", log_ns, SECOND + i * SECOND // 10, {"ecg": [float(i)] * 13})
    ordered = study.messages
    folder = study.write(ordered)
    frame = sense4hri_session.open(folder)["p1/ecg/x_1"].frame()
    assert frame["ecg"].tolist() == [float(i) for i in range(400) for _ in range(13)]


def test_what_the_recorder_knew_comes_first(copy):
    """Study, task and the session's begin and end are those of recorder.json; both are events of the timeline."""
    (copy / "recorder.json").write_text(json.dumps(facts()))
    session = sense4hri_session.open(copy)
    assert (session.info["study"], session.info["task"]) == ("Trust", "walk")
    timeline = session.timeline
    edges = timeline[timeline["source"] == "session"]
    assert edges["name"].tolist() == ["session_start", "session_stop"]
    assert ((edges["time_ns"] - START_NS) / SECOND).tolist() == [20.0, 80.0]
    assert timeline["time_ns"].is_monotonic_increasing
    assert len(timeline) == len(session.markers) + 2
    assert session.notes == []


def test_an_interrupted_recording_says_so(copy):
    """What was interrupted opens, and a note says why."""
    (copy / "recorder.json").write_text(json.dumps(facts("interrupted") | {"why": "killed"}))
    assert any("interrupted: killed" in note for note in sense4hri_session.open(copy).notes)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"\xff\xfe", b'{"session": 7}', b'{"session": {"session_id": [1]}}', b"[" * 100_000]
)
def test_a_damaged_recorder_json_costs_no_data(copy, content):
    """Whatever recorder.json holds, the recording opens with all its streams."""
    (copy / "recorder.json").write_bytes(content)
    assert len(sense4hri_session.open(copy).streams) == 4


def test_splits_without_metadata_are_read_in_the_order_of_their_numbers(tmp_path):
    """Where metadata.yaml is lost, the tenth split comes after the second, and a repaired file in its own place."""
    for name in ("s_0", "s_1", "s_2", "s_2_repaired", "s_10"):
        (tmp_path / f"{name}.mcap").touch()
    assert [file.stem for file in find_files(tmp_path)] == ["s_0", "s_1", "s_2_repaired", "s_10"]
