"""The recorder in a session: what it tells, and what is left when it is killed in the middle of one."""

import json
import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from processes import poll, withheld_s
from rosbags.highlevel import AnyReader
from sense4hri import qos
from sense4hri.stamps import set_time
from sense4hri_msgs.msg import Marker, SessionAck, SessionState


class Study:
    """Plays the coordinator; markers numbered from 0 are the data."""

    def __init__(self, ears) -> None:
        self.ears = ears
        self._states = ears.node.create_publisher(SessionState, "/study/session", qos.SESSION)
        self._markers = ears.node.create_publisher(Marker, "/study/markers", 1000)
        self.acks: list[SessionAck] = ears.hear(SessionAck, "/study/ack", qos.ACK)
        self.told: list[DiagnosticArray] = ears.hear(DiagnosticArray, "/diagnostics", qos.deep(qos.HEALTH))
        self.state = SessionState(session_id="s1", study="Prüfung 1/b", task="n-back", human_ids=["p2", "p1"])
        self.state.metadata_json = r'{"note": "\ud800"}'  # half of a surrogate pair, which no file can hold
        self.sent_s: list[float] = []
        """When each marker was sent, on the monotonic clock."""

    @property
    def sent(self) -> int:
        return len(self.sent_s)

    def phase(self, phase: int) -> SessionAck:
        """Say this phase; return the recorder's acknowledgement that it is ready or done."""
        self.state.phase, self.state.waiting_for = phase, ["recorder"]
        now_ns = time.time_ns()
        for stamp in [self.state.header.stamp] + [self.state.start_at] * (phase == SessionState.RECORDING):
            set_time(stamp, now_ns)
        if phase == SessionState.STOPPING:
            set_time(self.state.stop_at, now_ns)
        self.acks.clear()
        self._states.publish(self.state)
        found = self.ears.until(lambda: [a for a in self.acks if a.phase == phase and a.ok], f"phase {phase} is agreed")
        return found[0]

    def mark(self, seconds: float) -> None:
        """Publish markers for so long, 100 a second."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            marker = Marker(name="note", value=str(self.sent), source="test", session_id="s1")
            set_time(marker.header.stamp, time.time_ns())
            self._markers.publish(marker)
            self.sent_s.append(time.monotonic())
            self.ears.spin(0.01)

    def values(self) -> dict[str, str]:
        """What /diagnostics said last."""
        told = [status for message in self.told for status in message.status if status.name == "recorder: recording"]
        if not told:
            return {}
        status = told[-1]
        return {entry.key: entry.value for entry in status.values} | {"text": status.message}


def markers(folder: Path) -> list[int]:
    with AnyReader([folder]) as reader:
        found = [c for c in reader.connections if c.topic == "/study/markers"]
        return [int(reader.deserialize(raw, c.msgtype).value) for c, _, raw in reader.messages(found)]


def read(path: Path) -> dict:
    return json.loads(path.read_text())


def parts(folder: Path) -> dict:
    """What a report says of the session's other folders; nothing where there is no report."""
    path = folder / "report.json"
    return read(path)["parts"] if path.exists() else {}


def test_a_disk_that_is_full_before_a_session_is_told(start, ears, tmp_path):
    """Within seconds, while nobody records; it is forgotten once there is room."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=40m", "none", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("no right to mount a small file system")
    try:
        start("recorder", directory=disk, record_when="session", free_floor_mb=20)
        study = Study(ears)
        said = lambda: study.values().get("text")  # noqa: E731
        ears.until(lambda: said() == "waits for a session", "nothing is wrong")
        (disk / "others").write_bytes(bytes(35_000_000))
        full = re.compile(r"no session can be recorded: \d+ MB free, free_floor_mb is 20")
        ears.until(lambda: full.fullmatch(said()), said)
        (disk / "others").unlink()
        ears.until(lambda: said() == "waits for a session", said)
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_a_session_survives_the_recorder(start, ears, tmp_path):
    """Killed and started again mid-session, it repairs the one part and writes the other; one report is of both.

    What is lost is what was sent within 0.5 s before the kill and until the new recorder heard; nothing is there twice.
    """
    parameters = {"directory": tmp_path / "recordings", "record_when": "session"}
    recorder = start("recorder", **parameters)
    study = Study(ears)
    ears.until(study.values, "the state is told")
    assert (study.values()["recording"], study.values()["text"]) == ("false", "waits for a session")
    first = Path(study.phase(SessionState.PREPARING).directory)
    assert first.parent == tmp_path / "recordings" / "Prufung_1_b" / "p1-p2"
    study.phase(SessionState.RECORDING)
    study.mark(1.5)
    # where this process or the recorder had to wait for a core, more is lost
    waited_s = max(np.diff(study.sent_s)) + withheld_s(recorder.child.pid)
    killed_s = time.monotonic()
    recorder.kill()
    second = start("recorder", **parameters)
    study.acks.clear()
    ears.until(lambda: study.mark(0.05) or [a for a in study.acks if a.directory.endswith("_1")], "it goes on")
    further = first.with_name(f"{first.name}_1")
    study.mark(0.5)
    assert Path(study.phase(SessionState.STOPPING).directory) == further
    told = ears.until(lambda: study.values().get("report") and study.values(), "the report is made")
    assert told["report"] == str(further / "report.html")
    assert told["recording"] == "false"
    poll(lambda: len(parts(first).get("folders", [])) == 2, "the report is in the first part too")
    assert second.stop() == 0
    assert parts(first)["folders"] == parts(further)["folders"] == [first.name, further.name]
    problems = read(further / "report.json")["problems"]
    assert any(f"no recorder ran, between {first.name} and {further.name}" in problem for problem in problems)
    before, after = markers(first), markers(further)
    assert before == list(range(len(before)))
    assert len(before) >= sum(at_s < killed_s - 0.5 - waited_s for at_s in study.sent_s)
    assert after == list(range(after[0], study.sent))
    assert after[0] > before[-1]
    about = read(first / "recorder.json")
    counted = {topic["topic"]: topic["messages"] for topic in about["topics"]}
    assert (about["state"], counted["/study/markers"]) == ("interrupted", len(before))
    about = read(further / "recorder.json")
    assert (about["state"], about["session"]["session_id"]) == ("complete", "s1")
    assert "started while the session was running" in about["events"][0]["what"]
    nodes = {node["node"]: node["parameters"] for node in about["nodes"]}
    assert nodes["/recorder"]["record_when"] == "session"
    assert nodes["/recorder"]["software_version"] == about["software"]["recorder"] != ""
    assert [*(further.parent).glob("*Z_1/*.mcap")] == [further / f"{further.name}_0.mcap"]


def test_looking_for_what_was_left_behind_keeps_nothing_from_being_recorded(start, ears, tmp_path):
    """A lab has thousands of recordings: a session is recorded meanwhile, and what is found is recovered after that."""
    left = tmp_path / "recordings" / "20261120T093000Z"
    left.mkdir(parents=True)
    (left / "recorder.json").write_text('{"format": 1, "state": "recording", "session": null}')
    env = {"FOUND_AT": str(tmp_path / "found")}
    recorder = start("slow_search.py", env=env, directory=tmp_path / "recordings", record_when="session")
    study = Study(ears)
    study.phase(SessionState.PREPARING)
    study.phase(SessionState.RECORDING)
    study.mark(0.5)
    folder = Path(study.phase(SessionState.STOPPING).directory)
    assert markers(folder) == list(range(study.sent))
    (tmp_path / "found").touch()
    poll(lambda: read(left / "recorder.json")["state"] == "interrupted", "what was left behind is closed")
    assert recorder.stop() == 0
    assert read(folder / "recorder.json")["state"] == "complete"
