"""A pseudonym taken out of recordings: all of it, nothing else, and whole at any moment."""

import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import sense4hri_session
import yaml
import zstandard
from mcap.reader import SeekingReader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from sense4hri_recording import lock
from sense4hri_recording.layout import LOCK
from sense4hri_session import SessionError, export, rewrite
from sense4hri_session.__main__ import main as export_main
from sense4hri_session.journal import JOURNAL, Journal
from sense4hri_session.rewrite import write_anew
from sense4hri_session.traces import Traces
from sense4hri_session.withdraw import find_folders, main, withdraw

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
NAME = "visit-p1_rest_20231114T221320Z"
COUNT = 60
ODD = b"\0\0\0p1\0\0\0"  # of a number, and the bytes of a name by chance
WORD = re.compile(rb"(?<![A-Za-z0-9_])p1(?![A-Za-z0-9_])")


def stamp(ns):
    return {"sec": ns // SECOND, "nanosec": ns % SECOND}


def fill(study, me="p1"):
    """me and p2 with an ECG each, faces, persons, frames, and my name in every place where it may stand."""
    at = START_NS
    header = {"stamp": stamp(at), "frame_id": ""}
    for i in range(COUNT):
        at = START_NS + i * SECOND // 10
        for human in (me, "p2", f"{me}_b"):
            study.raw(
                f"{human}/ecg/{human.replace('_', '')}_x", at, SECOND + i * SECOND // 10, {"ecg": np.arange(13.0) + i}
            )
        study.add("/humans/physiological/p2/ecg/p2_x/features", "ECG", at, heart_rate_bpm=float(i))
        expression = {"expression": "happy"}
        for face in ("fa", "fb", "fc", "fd"):
            study.add(f"/humans/faces/{face}/expression", "hri_msgs/msg/Expression", at, **expression)
        study.add("/humans/faces/tracked", "hri_msgs/msg/IdsList", at, ids=["fa", "fb"])
        frames = [{"header": header, "child_frame_id": name} for name in ("face_fa", "face_fb", "base_link")]
        study.add("/tf", "tf2_msgs/msg/TFMessage", at, transforms=frames)
    study.raw(f"unassigned/ecg/{me}_x", START_NS, SECOND, {"ecg": np.zeros(13)})
    odd = np.frombuffer(ODD, "<f8")
    study.raw("p2/eda/odd_1", at, SECOND, {"eda": odd})
    study.add(
        "/study/assignments",
        "SensorAssignmentArray",
        START_NS + 5,
        assignments=[
            {"sensor_id": f"{me}_x", "human_id": me, "person_id": "person_a", "since": stamp(at)},
            {"sensor_id": "p2_x", "human_id": "p2", "person_id": "person_b", "since": stamp(at)},
        ],
    )
    for person, face in (("person_a", "fa"), ("person_b", "fb"), ("person_a", "fd"), ("person_b", "fd")):
        study.add(f"/humans/persons/{person}/face_id", "std_msgs/msg/String", START_NS + 6, data=face)
    sensors = [
        study.sensor(f"{me}/ecg/{me}_x", 130.0, "uV", ["ecg"], 14),
        study.sensor("p2/ecg/p2_x", 130.0, "uV", ["ecg"], 14, parameters_json=json.dumps({"seen": me, "rate": 130})),
    ]
    study.add("/study/sensors", "SensorInfoArray", START_NS + 7, sensors=sensors)
    for name, human, value in (
        ("note", me, "x"),
        ("note", "", f"{me} coughs"),
        ("stimulus", "p2", "a"),
        ("sync", "", ""),
    ):
        study.add(
            "/study/markers",
            "Marker",
            at,
            header=header,
            name=name,
            human_id=human,
            value=value,
            session_id=f"visit-{me}",
        )
    study.add(
        "/study/session",
        "SessionState",
        START_NS + 8,
        session_id=f"visit-{me}",
        study="Trust",
        task="rest",
        human_ids=[me, "p2"],
        required_streams=[f"/humans/physiological/{me}/ecg/{me}_x/raw", "/humans/physiological/p2/**"],
        waiting_for=[f"{me}: no signal", "p2: no signal"],
        detail=f"waits for {me}",
        directory=f"/r/Trust/{me}-p2/{NAME.replace('p1', me)}",
        metadata_json=json.dumps({"room": 3, me: {"age": 30}, "who": [me, "p2"]}),
        phase=2,
    )
    study.add(
        "/study/ack", "SessionAck", START_NS + 9, session_id=f"visit-{me}", service="recorder", detail=f"{me} is here"
    )
    study.add("/rosout", "rcl_interfaces/msg/Log", at, name="fusion", msg=f"{me}: no face")
    study.add("/rosout", "rcl_interfaces/msg/Log", at, name="fusion", msg="p2: no face")
    study.add("/robot/say", "std_msgs/msg/String", at, data=f"hello {me}")
    study.add("/robot/say", "std_msgs/msg/String", at, data="hello")


def place(folder, root, me="p1"):
    """Lay a recording where a session lies, with everything that may stand beside its files."""
    target = root / "Trust" / f"{me}-p2" / NAME.replace("p1", me)
    target.parent.mkdir(parents=True, exist_ok=True)
    folder.rename(target)
    (file,) = target.glob("*.mcap")
    file.rename(target / f"{target.name}_0.mcap")
    about = yaml.safe_load((target / "metadata.yaml").read_text())
    about["rosbag2_bagfile_information"]["relative_file_paths"] = [f"{target.name}_0.mcap"]
    (target / "metadata.yaml").write_text(yaml.safe_dump(about))
    session = {"session_id": f"visit-{me}", "study": "Trust", "task": "rest", "human_ids": [me, "p2"]}
    session |= {"required_streams": [f"/humans/physiological/{me}/**"], "metadata": {me: 3, "room": 3}}
    nodes = [
        {"node": f"/driver_ecg_{me}_x", "seen_ns": 1, "parameters": {"human_id": me, "serial_number": "7"}},
        {"node": "/driver_ecg_p2_x", "seen_ns": 1, "parameters": {"human_id": "p2", "serial_number": "8"}},
    ]
    topics = [{"topic": f"/humans/physiological/{human}/ecg/x/raw", "messages": 3} for human in (me, "p2")]
    facts = {"format": 1, "state": "complete", "why": "", "session": session, "nodes": nodes, "topics": topics}
    facts["events"] = [{"at_ns": 1, "what": f"{me} lost"}, {"at_ns": 2, "what": "disk slow"}]
    (target / "recorder.json").write_text(json.dumps(facts))
    for name in ("report.json", "report.html", "metadata.yaml.damaged", ".recorder.json", "notes.txt"):
        (target / name).write_text(f"{me} was here")
    return target


@pytest.fixture(scope="module")
def original(new_study):
    fill(new_study)
    return new_study.write()


@pytest.fixture
def session(original, tmp_path):
    """A session's folder to withdraw from."""
    return place(shutil.copytree(original, tmp_path / "copy"), tmp_path / "recordings")


def messages(folder):
    found = []
    for file in sorted(folder.glob("*.mcap")):
        with file.open("rb") as source:
            found += [
                (c.topic, m.log_time, m.data) for _, c, m in SeekingReader(source, validate_crcs=True).iter_messages()
            ]
    return found


def state(root):
    return {path.relative_to(root): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_nothing_of_it_is_left_and_the_rest_is_as_it_was(session):
    """No text of a message, file or name holds the pseudonym any more; every other message is there byte for byte."""
    before = messages(session)
    found = withdraw(session, "p1")
    after = messages(found.now)
    own = ("/humans/physiological/p1/", "/humans/faces/fa/", "/humans/persons/person_a/")
    kept = [m for m in before if not m[0].startswith(own)]
    touched = {"/humans/faces/tracked", "/tf", "/rosout", "/robot/say"}
    assert [m for m in after if not m[0].startswith("/study/") and m[0] not in touched] == [
        m for m in kept if not m[0].startswith("/study/") and m[0] not in touched
    ]
    with_name = [m for m in after if WORD.search(m[2])]
    assert {m[0] for m in with_name} == {"/humans/physiological/p2/eda/odd_1/raw"}, "only a number looks like it"
    assert not any(m[0].startswith(own) for m in after)
    assert found.removed["/humans/physiological/p1/ecg/p1_x/raw"] == COUNT
    for path in found.now.iterdir():
        if path.suffix in (".json", ".yaml"):
            assert not WORD.search(path.read_bytes()), path
    assert not any(
        re.search(r"(?<![A-Za-z0-9])p1(?![A-Za-z0-9_])", str(p.relative_to(session.parents[2])))
        for p in session.parents[2].rglob("*")
    )


def every_byte(root):
    """What is on the disk below root, names among it, and of MCAP files also what their chunks unpack to."""
    for path in root.rglob("*"):
        yield path, str(path.relative_to(root)).encode()
        if path.is_file():
            yield path, path.read_bytes()
        if path.suffix == ".mcap":
            with path.open("rb") as source:
                for record in StreamReader(source, emit_chunks=True).records:
                    if isinstance(record, Chunk):
                        packed = record.compression == "zstd"
                        yield path, zstandard.decompress(record.data) if packed else record.data


def test_no_byte_of_it_is_left(study, tmp_path):
    """A grep of every byte on the disk, packed and unpacked, finds the pseudonym before and nothing of it after."""
    me = "zqkow77"
    fill(study, me)
    place(study.write(), tmp_path / "recordings", me)
    assert sum(me.encode() in data for _, data in every_byte(tmp_path)) > 8
    also = (f"/humans/physiological/unassigned/ecg/{me}_x/**", f"/humans/physiological/{me}_b/**")
    found = withdraw(find_folders([tmp_path])[0], me, also)
    (found.now / "notes.txt").unlink()
    assert (found.now / "report.html").is_file()
    assert [path for path, data in every_byte(tmp_path) if me.encode() in data] == []
    assert {"p2/ecg/p2_x", "p2/eda/odd_1"} == set(sense4hri_session.open(found.now).streams)


def test_the_study_goes_on_without_it(session):
    """Lists lose the pseudonym's entries only, texts are blanked, what concerns others says what it said."""
    folder = withdraw(session, "p1").now
    opened = sense4hri_session.open(folder)
    assert opened.humans == ["p1_b", "p2", "unassigned"]
    row = opened.table("/study/session").iloc[0]
    assert (row["human_ids"], row["waiting_for"]) == (["p2"], ["p2: no signal"])
    assert row["required_streams"] == ["/humans/physiological/p2/**"]
    assert json.loads(row["metadata_json"]) == {"room": 3, "who": ["p2"]}
    assert (row["detail"], row["session_id"]) == ("(withdrawn)", "visit-withdrawn")
    assert row["directory"] == "/r/Trust/p2/visit-withdrawn_rest_20231114T221320Z" == f"/r/Trust/p2/{folder.name}"
    assert opened.markers[["human_id", "name", "value"]].to_numpy().tolist() == [
        ["", "note", "(withdrawn)"],
        ["p2", "stimulus", "a"],
        ["", "sync", ""],
    ]
    assert set(opened.markers["session_id"]) == {row["session_id"]}
    assert [s["human_id"] for s in opened.table("/study/sensors").iloc[0]["sensors"]] == ["p2"]
    assert json.loads(opened.sensors["p2_x", "ecg"]["parameters_json"]) == {"rate": 130}
    assert opened.table("/rosout")["msg"].tolist() == ["p2: no face"]
    assert opened.table("/robot/say")["data"].tolist() == ["hello"]
    assert all(ids == ["fb"] for ids in opened.table("/humans/faces/tracked")["ids"])
    frames = [t["child_frame_id"] for t in opened.table("/tf").iloc[0]["transforms"]]
    assert frames == ["face_fb", "base_link"]
    about = opened.recorders[0]
    assert [n["node"] for n in about.nodes] == ["/driver_ecg_p2_x"]
    assert about.session["human_ids"] == ["p2"]
    assert [t["topic"] for t in about.topics] == ["/humans/physiological/p2/ecg/x/raw"]
    assert about.events[0]["what"] == "disk slow"
    with AnyReader([folder]) as reader:
        assert sum(1 for _ in reader.messages()) == len(messages(folder))
    counts = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert counts["message_count"] == len(messages(folder))


def test_it_says_what_it_did_and_what_it_could_not_decide(session, capsys):
    """The account names topics, files, the new name, and what stays because nothing tells whose it is."""
    assert main([str(session.parents[2]), "--human", "p1", "--yes"]) == 0
    said = capsys.readouterr().out
    assert f"removed  {COUNT} messages of /humans/physiological/p1/ecg/p1_x/raw" in said
    for name in ("report.html", "metadata.yaml.damaged", "recorder.json"):
        assert re.search(rf"(deleted|changed|anew) .*{name}", said)
    assert "renamed  to" in said
    assert re.search(r"left     1 messages of p1_x while nobody wore it; --also .*unassigned", said)
    assert re.search(r"left     /humans/faces/fd is tied to another pseudonym as well", said)
    assert re.search(rf"left     {COUNT} messages of /humans/faces/fc/\*\*: nobody's", said)
    assert re.search(r"left     notes.txt: not a file of the recording", said)


def test_what_was_left_can_be_removed_too(session):
    """--also removes the topics that were named as undecided."""
    also = ("/humans/physiological/unassigned/*/p1_x/**", "/humans/faces/fd/**")
    folder = withdraw(session, "p1", also).now
    topics = {m[0] for m in messages(folder)}
    assert not any("unassigned" in topic or "/fd/" in topic for topic in topics)
    assert "/humans/faces/fb/expression" in topics


def test_a_dry_run_changes_nothing_and_says_the_same(session, capsys):
    """--dry-run lists what would be removed and leaves every byte."""
    before = state(session.parents[2])
    assert main([str(session), "--human", "p1", "--dry-run"]) == 0
    dry = capsys.readouterr().out
    assert state(session.parents[2]) == before
    assert main([str(session), "--human", "p1", "--yes"]) == 0
    assert capsys.readouterr().out.splitlines()[:-1] == dry.splitlines()[:-1]


def test_it_asks_first(session, capsys, monkeypatch):
    """Without --yes and without a terminal nothing is done and the exit status is 2."""
    before = state(session)
    assert main([str(session), "--human", "p1"]) == 2
    assert state(session) == before


class Typed:
    """A terminal at which this is typed; None is Ctrl-C."""

    def __init__(self, answer: str | None) -> None:
        self.answer = answer

    def isatty(self) -> bool:
        return True

    def readline(self) -> str:
        if self.answer is None:
            raise KeyboardInterrupt
        return self.answer


@pytest.mark.parametrize("answer", ["p2\n", "", None])
def test_another_answer_than_the_pseudonym_does_nothing_and_says_so(session, monkeypatch, capsys, answer):
    """A wrong word, Ctrl-D and Ctrl-C."""
    before = state(session)
    monkeypatch.setattr(sys, "stdin", Typed(answer))
    assert main([str(session), "--human", "p1"]) == 2
    assert "nothing was done: that is not p1" in capsys.readouterr().err
    assert state(session) == before


def test_the_second_time_there_is_nothing_left(session, capsys):
    """Withdrawing again finds nothing and changes no byte."""
    folder = withdraw(session, "p1").now
    (folder / "notes.txt").unlink()
    before = state(folder)
    assert not withdraw(folder, "p1")
    assert state(folder) == before


def test_a_pseudonym_that_begins_alike_is_another_one(session):
    """Withdrawing p1_b leaves p1, and a pseudonym that is not there changes nothing."""
    folder = withdraw(session, "p1_b").now
    assert "/humans/physiological/p1/ecg/p1_x/raw" in {m[0] for m in messages(folder)}
    before = state(folder)
    assert not withdraw(folder, "p9")
    assert state(folder) == before


def test_what_is_called_as_a_face_says_what_it_said(study):
    """The face `1` of p1 goes; the condition `1` is the study's, and p2's answer is p2's. A frame is the face's."""
    metadata = {"condition": "1", "shown": "face_1"}
    told = {"session_id": "s1", "metadata_json": json.dumps(metadata), "phase": 2}
    study.add("/study/session", "SessionState", START_NS, **told)
    study.raw("p1/ecg/p1_x", START_NS, SECOND, {"ecg": np.zeros(13)})
    study.add("/humans/physiological/p1/state", "UserState", START_NS, human_id="p1", face_id="1", person_id="7")
    study.add("/humans/faces/tracked", "hri_msgs/msg/IdsList", START_NS + 1, ids=["1", "2"])
    header = {"stamp": stamp(START_NS), "frame_id": ""}
    for human, name, value in (("", "condition_start", "1"), ("p2", "response", "7"), ("", "note", "face_1")):
        study.add("/study/markers", "Marker", START_NS, header=header, name=name, value=value, human_id=human)
    folder = study.write()
    session = {"session_id": "s1", "metadata": metadata}
    (folder / "recorder.json").write_text(json.dumps({"format": 1, "state": "complete", "session": session}))
    opened = sense4hri_session.open(withdraw(folder, "p1").now)
    assert opened.table("/humans/faces/tracked")["ids"].tolist() == [["2"]]
    assert json.loads(opened.table("/study/session")["metadata_json"][0]) == {"condition": "1"}
    assert opened.recorders[0].session["metadata"] == {"condition": "1"}
    assert opened.markers["value"].tolist() == ["1", "7", "(withdrawn)"]


def test_exports_in_or_beside_the_folder_are_deleted(session):
    """An export made of the recording goes with it."""
    opened = sense4hri_session.open(session)
    export.export(opened, session / "out", ("csv",))
    export.export(opened, session.with_name(f"{NAME}_export"), ("csv",))
    found = withdraw(session, "p1")
    assert not (found.now / "out").exists()
    assert not session.with_name(f"{NAME}_export").exists()
    assert sum("an export" in line for line in found.files) == 2


def test_a_folder_being_recorded_is_refused(session, capsys):
    """While somebody holds the lock nothing is touched; the exit status is 1."""
    with (session / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        before = state(session)
        assert main([str(session), "--human", "p1", "--yes"]) == 1
        assert "is being recorded" in capsys.readouterr().err
        assert state(session) == before


def test_a_damaged_recording_is_refused(session, capsys):
    """A file that was cut off is named with the way to repair it, and stays."""
    (file,) = session.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-3000])
    before = state(session)
    assert main([str(session), "--human", "p1", "--yes"]) == 1
    assert "sense4hri-repair" in capsys.readouterr().err
    assert state(session) == before


def test_what_cannot_be_read_back_is_not_put_in_place(session, monkeypatch):
    """Where the new file differs from what it should hold, the old one stays and an error says so."""
    (file,) = session.glob("*.mcap")
    before = file.read_bytes()

    def lossy(source, target, summary, library, named, data):
        seen = iter(range(10**9))
        write_anew(source, target, summary, library, named, lambda c, m: None if next(seen) == 77 else data(c, m))

    monkeypatch.setattr(rewrite, "write_anew", lossy)
    with pytest.raises(SessionError, match="reading back"):
        withdraw(session, "p1")
    assert file.read_bytes() == before


PROBE = """
import os, sys
from sense4hri_session import withdraw
STEPS = ("withdrawal.py", "leftovers.py", "journal.py", "rewrite.py", "rosbag2.py", "files.py", "recorder_json.py")
done, kill_at = 0, int(sys.argv[1])
def trace(frame, event, arg):
    global done
    if event == "call" and frame.f_code.co_filename.endswith(STEPS):
        done += 1
        if done == kill_at: os.kill(os.getpid(), 9)
change, withdraw._report = withdraw.Withdrawal.change, lambda found: None
def traced(self, *given):
    sys.setprofile(trace)
    change(self, *given)
    sys.setprofile(None)
    print(done, file=sys.stderr)
withdraw.Withdrawal.change = traced
sys.exit(withdraw.main([sys.argv[2], "--human", "p1", "--yes", "--quiet"]))
"""


@pytest.mark.slow
def test_killed_anywhere_it_leaves_whole_files_and_finishes_the_next_time(original, tmp_path):
    """SIGKILL at 5 moments: every MCAP file reads to its end, and the same command again leaves nothing."""

    def run(kill_at, root):
        place(shutil.copytree(original, tmp_path / "copy"), root)
        command = [sys.executable, "-c", PROBE, str(kill_at), str(root)]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=400)

    steps = int(run(0, tmp_path / "truth").stderr)
    (folder,) = find_folders([tmp_path / "truth"])
    truth = messages(folder)
    for kill_at in (steps // 3, steps - 14, steps - 8, steps - 4, steps - 1):
        root = tmp_path / str(kill_at)
        assert run(kill_at, root).returncode == -signal.SIGKILL
        for folder in find_folders([root]):
            assert messages(folder)
        for folder in find_folders([root]):
            withdraw(folder, "p1")
        (folder,) = find_folders([root])
        assert messages(folder) == truth
        assert not (folder / JOURNAL).exists()
        assert not list(root.rglob("*.new"))


def test_a_renaming_that_was_cut_short_is_finished(original, tmp_path):
    """A file with both names, an empty folder of the pseudonym: the same command leaves neither."""
    folder = place(shutil.copytree(original, tmp_path / "copy"), tmp_path / "root")
    withdraw(folder, "p1")
    (done,) = find_folders([tmp_path / "root"])
    (file,) = done.glob("*.mcap")
    (done / f"{NAME}_0.mcap").hardlink_to(file)
    (tmp_path / "root" / "Trust" / "p1").mkdir()
    Journal("p1").write(done)
    withdraw(done, "p1")
    assert [path.name for path in (tmp_path / "root").rglob("*") if re.search(r"\bp1\b", path.name)] == []
    assert messages(done)


def test_messages_that_cannot_be_read_do_not_keep_anybody_from_withdrawing(study, capsys):
    """A byte on somebody's state, a text in place of a person's name: told, and everything else is removed."""
    fill(study)
    study.add_bytes("/humans/physiological/zz/state", "UserState", START_NS + 9, b"\0")
    study.add("/humans/persons/person_x/alias", "std_msgs/msg/Float64", START_NS + 9, data=1.0)
    root = study.parent / "root"
    place(study.write(), root)
    assert main([str(root), "--human", "p1", "--yes", "--quiet"]) == 0
    told = capsys.readouterr().out
    assert "/humans/physiological/zz/state would tell whose" in told
    assert "/humans/persons/person_x/alias would tell whose" in told
    (left,) = find_folders([root])
    topics = {topic for topic, _, _ in messages(left)}
    assert "/humans/physiological/p2/ecg/p2_x/raw" in topics
    assert not any(topic.startswith("/humans/physiological/p1/") for topic in topics)


def test_the_export_of_a_folder_with_a_dot_in_its_name_is_deleted(session):
    """`pilot.1` is exported to `pilot.1_export`, not to what would be `pilot.2`'s as well, and that goes with it."""
    folder = session.rename(session.with_name("pilot.1"))
    assert export_main([str(folder), "--formats", "csv", "--quiet"]) == 0
    assert (folder.with_name("pilot.1_export") / "csv").is_dir()
    withdraw(folder, "p1")
    assert list(folder.parent.parent.rglob("*.csv")) == []


KILLED = """
import os, sys
from sense4hri_session import __main__, export
getattr(export, sys.argv[1]).write = lambda *given: os.kill(os.getpid(), 9)
__main__.main([*sys.argv[2:], "--quiet"])
"""


@pytest.mark.parametrize("during", ["xdf", "bids"])
def test_an_export_that_was_killed_is_deleted_too(session, during):
    """It lies beside the recording under a hidden name, with the tables of who withdraws in it, and nobody ends it."""
    command = [sys.executable, "-c", KILLED, during, str(session)]
    assert subprocess.run(command, check=False, timeout=400).returncode == -signal.SIGKILL
    (half,) = session.parent.glob(f".{NAME}_export.*")
    assert list(half.glob("csv/p1_*"))
    other = half.with_name(".other_export.x")
    shutil.copytree(half, other)
    (other / "session.json").write_text(json.dumps({"parts": [{"folder": "other"}]}))
    found = withdraw(session, "p1")
    assert not half.exists()
    assert f"deleted  {half.name}: an export" in found.files
    assert list(other.glob("csv/p1_*"))


@pytest.fixture(scope="module")
def half_shared(original, tmp_path_factory):
    """The folder of all recordings, where a copy to be shared was killed while it was made."""
    folder = tmp_path_factory.mktemp("killed")
    session = place(shutil.copytree(original, folder / "copy"), folder / "recordings")
    command = [sys.executable, "-c", KILLED, "bids", str(session), "--share"]
    assert subprocess.run(command, check=False, timeout=400).returncode == -signal.SIGKILL
    return folder / "recordings"


@pytest.mark.parametrize("named", ["the recording", "all"])
def test_a_copy_to_be_shared_that_was_killed_is_deleted_too(half_shared, tmp_path, capsys, named):
    """What was copied so far lies beside the recording under a hidden name; nobody knows of it, so it goes as well."""
    (session,) = shutil.copytree(half_shared, tmp_path / "recordings").glob(f"*/*/{NAME}")
    study = session.parents[1]
    assert list(session.parent.glob(f".{NAME}_shared.*/*/*.mcap"))
    assert main([str(session if named == "the recording" else study), "--human", "p1", "--yes", "--quiet"]) == 0
    (left,) = study.rglob("*.mcap")
    assert [*study.iterdir(), *left.parents[1].iterdir()] == [left.parents[1], left.parent]


def test_a_copy_to_be_shared_keeps_no_tables_of_who_withdrew(original, tmp_path, capsys):
    """`--share`, then a withdrawal from all: the copy's recording is cleaned, and its tables are gone."""
    folder = place(shutil.copytree(original, tmp_path / "copy"), tmp_path / "root")
    assert export_main([str(folder), "--share", "--formats", "csv", "--quiet"]) == 0
    shared = Path(capsys.readouterr().out.strip().splitlines()[-1])
    assert list(shared.glob("csv/p1_*"))
    assert main([str(tmp_path / "root"), "--human", "p1", "--yes", "--quiet"]) == 0
    assert list((tmp_path / "root").rglob("*.csv")) == []
    assert list((tmp_path / "root").rglob("recording/*/*.mcap"))


def test_where_the_command_runs_makes_no_difference_to_what_goes(original, tmp_path, capsys, monkeypatch):
    """Called beside a copy's recording, whose folder is then named without the one above, its tables go as well."""
    folder = place(shutil.copytree(original, tmp_path / "copy"), tmp_path / "root")
    assert export_main([str(folder), "--share", "--formats", "csv", "--quiet"]) == 0
    shared = Path(capsys.readouterr().out.strip().splitlines()[-1])
    monkeypatch.chdir(shared / "recording")
    assert main([NAME, "--human", "p1", "--yes", "--quiet"]) == 0
    assert list(shared.rglob("*.csv")) == []


@pytest.fixture
def precious(tmp_path):
    """A file that is none of the recording's."""
    path = tmp_path / "precious.txt"
    path.write_text("p1 is precious")
    return path


@pytest.mark.parametrize(
    "name", [".recorder.json", ".metadata.yaml", ".withdrawal.json", f".{NAME}_0.mcap.new", "notes"]
)
def test_links_in_a_recording_are_refused_and_nothing_is_written_through_them(session, precious, capsys, name):
    """A link in the place of a temporary file, or of any other, is named; where it leads nothing changes."""
    (session / name).unlink(missing_ok=True)
    (session / name).symlink_to(precious)
    before = state(session)
    assert main([str(session), "--human", "p1", "--yes"]) == 1
    assert re.search(rf"{re.escape(name)} is a link", capsys.readouterr().err)
    assert precious.read_text() == "p1 is precious"
    assert state(session) == before


@pytest.mark.parametrize("name", [".recorder.json", ".metadata.yaml", ".withdrawal.json", f".{NAME}_0.mcap.new"])
def test_folders_in_the_place_of_files_are_named_before_anything_is_changed(session, capsys, name):
    """A folder where a file or its half is to be written ends no withdrawal halfway."""
    (session / name).unlink(missing_ok=True)
    (session / name).mkdir()
    before = state(session)
    assert main([str(session), "--human", "p1", "--yes"]) == 1
    assert re.search(rf"{re.escape(name)} is a folder", capsys.readouterr().err)
    assert state(session) == before


def test_a_recording_that_lies_elsewhere_is_not_said_to_be_withdrawn(session, tmp_path, capsys):
    """Where the recording's file is a link, what it leads to would stay: refused."""
    (file,) = session.glob("*.mcap")
    elsewhere = file.rename(tmp_path / "elsewhere.mcap")
    file.symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    assert main([str(session), "--human", "p1", "--yes"]) == 1
    assert "is a link" in capsys.readouterr().err
    assert file.is_symlink()
    assert elsewhere.read_bytes() == before


def test_no_journal_moves_a_recording(session, tmp_path):
    """What a file in the folder says of where it belongs is not believed."""
    journal = {"human_id": "p1", "ids": [], "also": [], "report": False, "target": str(tmp_path / "stolen" / "away")}
    (session / JOURNAL).write_text(json.dumps(journal))
    (tmp_path / "stolen").mkdir()
    assert withdraw(session, "p1").now.parent.parent == session.parent.parent
    assert list((tmp_path / "stolen").iterdir()) == []


def opened_below(path):
    """Files at or below a path that this process has open; Windows would neither rename nor delete it."""
    found = [os.readlink(each) for each in Path("/proc/self/fd").iterdir() if each.is_symlink()]
    return [name for name in found if Path(name).is_relative_to(path.resolve())]


@pytest.mark.parametrize("bars", [True, False])
def test_no_file_is_open_where_windows_would_refuse(session, monkeypatch, bars):
    """No file of a folder is open when that is renamed, nor what is deleted or replaced; elsewhere the lock is held."""
    found = defaultdict(list)
    for name in ("rename", "replace", "unlink"):
        real = getattr(Path, name)

        def looked(path, *more, real=real, **words):
            found[path.name] += opened_below(path)
            return real(path, *more, **words)

        monkeypatch.setattr(Path, name, looked)
    monkeypatch.setattr(lock, "OPEN_FILES_BAR_RENAMES", bars)
    assert withdraw(session, "p1").now.is_dir()
    held = found.pop(session.name)
    assert [Path(name).name for name in held] == ([] if bars else [LOCK])
    assert len(found) > 5
    assert not any(found.values()), found


def test_a_linked_participant_folder_takes_no_recording_away(session, tmp_path, capsys):
    """The folder in which the recording belongs afterwards is a link: it is not moved there."""
    (tmp_path / "away").mkdir()
    target = withdraw(session, "p1", dry_run=True).now
    target.parent.symlink_to(tmp_path / "away")
    assert main([str(session), "--human", "p1", "--yes"]) == 1
    assert "is a link" in capsys.readouterr().err
    assert list((tmp_path / "away").iterdir()) == []


def test_globs_do_not_swallow_the_folder(session, capsys):
    """`--also GLOB FOLDER` is one glob and the folder, and may be said again."""
    also = ["--also", "/humans/faces/fd/**", "--also", "/humans/physiological/unassigned/**"]
    assert main(["--human", "p1", "--dry-run", *also, str(session)]) == 0
    assert "removed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ('{"who": "p1", "n": 1}', '{"n": 1}'),
        ('{"who": "p1", "who": "p2"}', "{}"),
        ('{"face": "fa", "n": NaN}', "{}"),
        ('{"n": 1, "n": 2}', '{"n": 1, "n": 2}'),
    ],
)
def test_json_that_could_hide_a_pseudonym_is_emptied(text, left):
    """A name given twice shows its last value only; such JSON is kept where the pseudonym is nowhere in it."""
    assert Traces("p1", {("faces", "fa")}).json_without(text) == left
