"""What the recorder makes of recordings that were left behind unfinished, and what it says of itself."""

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from recorder.about import away_before
from recorder.bag import Bag
from recorder.heads import Heads
from recorder.recover import left_behind, main, recover
from recorder.split import Entry
from recorder.status import Status
from recorder.told import About, Limits
from rosbags.highlevel import AnyReader
from sense4hri.recorder_status import RecorderStatus
from sense4hri_recording.lock import Lock
from sense4hri_recording.parts import closed_parts, earlier_part
from string_messages import START_NS, cdr_string, string_channel


def killed(parent: Path, name: str = "s1_20261121T093000Z", numbers: int = 20) -> Path:
    """What is on the disk of a recording of several files when its recorder is killed."""
    source = parent / "running" / name
    source.mkdir(parents=True)
    heads, latched, plain = Heads(), string_channel("/study/sensors"), string_channel()
    latched.state = True
    bag = Bag(source, Limits("none", split_bytes=2_000), about=About({"session_id": "s1"}), heads=heads)
    for i in range(numbers):
        for entry in [
            *([Entry(latched, cdr_string("holds"), START_NS, START_NS, 1)] if i == 0 else []),
            Entry(plain, cdr_string(str(i) + " " * 200), START_NS + i, START_NS + i, i + 1),
        ]:
            heads.keep(entry)
            bag.add(entry)
        bag.flush()
    left = parent / name
    shutil.copytree(source, left)
    bag.close()
    shutil.rmtree(source.parent)
    return left


def sidecar(folder: Path) -> dict:
    return json.loads((folder / "recorder.json").read_text())


def test_a_recording_left_behind_is_whole_again_and_says_so(tmp_path, capsys):
    """Its damaged file stays, the repaired one is in metadata.yaml; counts are without the heads; done once only."""
    folder = killed(tmp_path)
    before = {path.name: path.read_bytes() for path in folder.glob("*.mcap")}
    assert len(before) > 2
    assert sidecar(folder)["state"] == "recording"
    assert list(left_behind(tmp_path)) == [folder]
    assert main([str(folder)]) == 0
    assert "messages saved" in capsys.readouterr().out
    assert list(left_behind(tmp_path)) == []
    about = sidecar(folder)
    assert (about["state"], about["closed_ns"]) == ("interrupted", None)
    assert about["last_written_ns"] >= START_NS + 19
    assert {topic["topic"]: topic["messages"] for topic in about["topics"]} == {"/study/sensors": 1, "/study/x": 20}
    assert "was killed" in about["why"]
    assert any("_repaired.mcap: " in event["what"] for event in about["events"])
    with AnyReader([folder]) as reader:
        found = [reader.deserialize(raw, c.msgtype).data for c, _, raw in reader.messages() if c.topic == "/study/x"]
    assert [int(text) for text in found] == list(range(20))
    assert {name: (folder / name).read_bytes() for name in before} == before


@pytest.mark.parametrize("recovered", [False, True])
def test_for_how_long_nobody_recorded_is_known_before_the_part_before_is_recovered(tmp_path, recovered):
    """A recorder that is back says since when the one before wrote nothing, by its files, not by its last word."""
    before = killed(tmp_path)
    told = sidecar(before)
    ended_ns = told["opened_ns"] - 60_000_000_000
    session = {"session_id": "s1", "start_at_ns": ended_ns - 890_000_000_000}
    told |= {"session": session, "opened_ns": ended_ns - 900_000_000_000, "last_written_ns": ended_ns - 899_000_000_000}
    if recovered:
        told |= {"state": "interrupted", "last_written_ns": ended_ns}
    (before / "recorder.json").write_text(json.dumps(told))
    for file in before.glob("*.mcap"):
        os.utime(file, ns=(ended_ns, ended_ns))
    (before / "x_0_repaired.mcap").touch()
    after = tmp_path / "s1_20261121T094500Z"
    after.mkdir()
    bag = Bag(after, Limits("none"), about=About(session))
    away_s = (sidecar(after)["opened_ns"] - ended_ns) / 1e9
    bag.close()
    assert re.fullmatch(rf"nobody recorded from \S+ to \S+ UTC \({away_s:.1f} s\)", away_before(after))


def test_what_is_being_written_is_left_alone(tmp_path):
    """A folder that another recorder holds is neither listed nor touched; its files stay as they are."""
    folder = killed(tmp_path)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    lock = Lock(folder)
    assert list(left_behind(tmp_path)) == []
    with pytest.raises(BlockingIOError):
        recover(folder)
    lock.release()
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_recording_that_was_closed_in_order_is_never_called_interrupted(tmp_path, capsys):
    """Whoever names it, by hand or because its recorder closed it just then: it is told, and stays as it is."""
    Bag(tmp_path, Limits("none")).close()
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert main([str(tmp_path)]) == 1
    assert "was closed in order" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_recording_without_a_message_is_closed_with_what_is_wrong(tmp_path):
    """Cut off in its first bytes, it is marked as interrupted all the same, and the reason is an event."""
    folder = killed(tmp_path, numbers=1)
    (file,) = folder.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:30])
    recover(folder)
    assert sidecar(folder)["state"] == "interrupted"
    assert any("not repaired" in event["what"] for event in sidecar(folder)["events"])


@pytest.mark.parametrize("text", ["", "[]", '{"topics": 3}'])
def test_a_damaged_sidecar_stops_nothing(tmp_path, text):
    """A recorder.json that makes no sense is passed over or refused by name; the other folders are recovered."""
    broken, whole = killed(tmp_path, "s1_20261121T093000Z"), killed(tmp_path, "s1_20261121T103000Z")
    (broken / "recorder.json").write_text(text)
    assert whole in set(left_behind(tmp_path))
    assert main([str(broken), str(whole)]) == 1
    assert sidecar(whole)["state"] == "interrupted"


def test_the_parts_of_a_session_know_each_other(tmp_path):
    """A further part is named after the earlier one; an open part is not among the others, other sessions never."""
    first = killed(tmp_path)
    killed(tmp_path, "s2_20261121T093000Z")
    second = killed(tmp_path, f"{first.name}_1")
    assert earlier_part(tmp_path, "s1").startswith(first.name[:3])
    assert closed_parts(second) == [second]
    recover(first)
    assert closed_parts(second) == [first, second]


RECORDS = RecorderStatus(recording=True)


@pytest.mark.parametrize(
    ("status", "level", "text"),
    [
        (Status(RecorderStatus()), DiagnosticStatus.OK, "waits for a session"),
        (Status(RECORDS), DiagnosticStatus.OK, "records"),
        (Status(replace(RECORDS, session_id="s1")), DiagnosticStatus.OK, "records session s1"),
        (Status(replace(RECORDS, lost=3)), DiagnosticStatus.WARN, "3 messages lost"),
        (
            Status(replace(RECORDS, lost=3), lost_of="2 of /a, 1 of /b"),
            DiagnosticStatus.WARN,
            "3 messages lost (2 of /a, 1 of /b)",
        ),
        (
            Status(replace(RECORDS, minutes_left=12.3), warn_minutes=30.0),
            DiagnosticStatus.WARN,
            "the disk lasts 12 more minutes",
        ),
        (Status(RecorderStatus(minutes_left=12.3), warn_minutes=30.0), DiagnosticStatus.OK, "waits for a session"),
        (
            Status(RecorderStatus(lost=3), problem="x: No space left on device"),
            DiagnosticStatus.ERROR,
            "NOT RECORDING: x: No",
        ),
        (Status(RECORDS, doubts=("no report",)), DiagnosticStatus.WARN, "no report"),
    ],
)
def test_the_state_is_one_sentence_with_its_level(status, level, text):
    """What is published says how bad it is, and carries every value of the agreement as text."""
    (told,) = status.message().status
    assert RecorderStatus.parse(told) == status.judged()
    values = {entry.key: entry.value for entry in told.values}
    assert (told.level, told.name) == (level, "recorder: recording")
    assert told.message.startswith(text)
    assert values.keys() == {
        *("recording", "directory", "session_id", "messages", "lost"),
        *("written_bytes", "free_bytes", "minutes_left", "report", "behind_s", "host"),
    }
    assert values["minutes_left"] in ("", "12.3")
