"""Sessions with real processes: coordinator, recorder, clock-sync, an interpreter, a toy driver, toy members."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from ears import Ears
from processes import DEADLINE_S, Process, Processes, withheld_s
from rclpy.qos import QoSProfile
from rosbags.highlevel import AnyReader
from sense4hri import qos
from sense4hri.beats import TWINS
from sense4hri.crowd import MOST, TOO_MANY
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import ECG, ClockModel, Marker, SessionAck, SessionState
from sense4hri_msgs.srv import AssignSensor, ListSensors, StartSession, StopSession

TESTS = Path(__file__).resolve().parents[1]
KIT, FLOOD = TESTS / "kit", str(TESTS / "bench" / "flood_publisher.py")
RAW = "/humans/physiological/p1/ecg/toy_1/raw"
FEATURES = "/humans/physiological/p1/ecg/toy_1/features"
STOPPED_S = 16.0
LEAD_S = 5.0
"""On a busy machine a start must be announced well ahead: an interpreter that hears of it too late begins late."""


class Study(Ears):
    """Processes on a domain of the test's own, and a node that hears everything about the session."""

    def __init__(self, folder: Path) -> None:
        super().__init__("_watch")
        self._folder, self._processes = folder, Processes(folder, KIT)
        self.run = self._processes.start
        self.states: list[SessionState] = self.listen(SessionState, "/study/session", qos.SESSION)
        self.acks: list[SessionAck] = self.listen(SessionAck, "/study/ack", qos.ACK)
        self.markers: list[Marker] = self.listen(Marker, "/study/markers", qos.MARKERS)

    def listen(self, kind: type, topic: str, profile: QoSProfile) -> list[Any]:
        """Hear all of it, however late it is taken in."""
        return self.hear(kind, topic, qos.deep(profile, 500))

    def coordinator(self, **parameters: object) -> Process:
        """Start one that gives services the time that a busy machine may cost them."""
        given = {"state_file": self._folder / "session.json", "answer_timeout_s": 60.0, "flush_timeout_s": 60.0}
        process = self.run("session_coordinator", **given | parameters)
        process.port()
        self.until(lambda: self.node.count_publishers("/study/session") > 0, "the coordinator publishes")
        self.until(lambda: "/markers" in process.get("/openapi.json")[1], "the coordinator has all of its paths")
        return process

    def cli(self, *arguments: str) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", "session_coordinator.cli", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)

    def until(self, condition: Callable[[], Any], what: str | Callable[[], str], seconds: float = DEADLINE_S) -> Any:
        """As ever; what did not happen is told with the states and the logs."""

        def told() -> str:
            logs = "\n".join(f"--- {each.log_file.name}\n{each.log()[-1500:]}" for each in self._processes.running)
            return f"{what if isinstance(what, str) else what()}\n{self.states[-2:]}\n{logs}"

        return super().until(condition, told, seconds)

    def phase(self, phase: int) -> SessionState:
        return self.until(lambda: next((s for s in self.states[-1:] if s.phase == phase), None), f"phase {phase}")

    def hear_nodes(self, coordinator: Process, *names: str) -> None:
        """Wait until the coordinator knows exactly these nodes."""
        self.until(
            lambda: coordinator.ask("/session")[1].get("present_services") == sorted(names), f"{names} take part"
        )

    def withheld_s(self) -> float:
        """How long everybody here has been kept waiting for a core."""
        living = [each.child.pid for each in self._processes.running if each.child.poll() is None]
        return withheld_s(os.getpid(), *living)

    def notes(self) -> list[str]:
        return [m.value for m in self.markers if m.name == "note" and m.source == "session-coordinator"]

    def close(self) -> None:
        self._processes.close()
        super().close()


@pytest.fixture
def study(opened: Callable[[Study], Study], tmp_path: Path) -> Study:
    return opened(Study(tmp_path))


@pytest.mark.timeout(1200)
def test_a_session_with_a_missing_sensor_from_start_to_file(study, tmp_path):
    """The missing stream is named; once it is there everybody begins at one instant; the file holds it all."""
    coordinator = study.coordinator(lead_s=LEAD_S)
    recorder = study.run("recorder", directory=tmp_path / "recordings")
    study.run("interpreter_ecg")
    study.run("clock_sync")
    study.hear_nodes(coordinator, "recorder", "interpreter_ecg", "clock_sync")
    updates = study.listen(ECG, FEATURES, qos.FEATURES)
    wish = StartSession.Request(
        study="Prüfung 1/b", human_ids=["p1"], required_streams=["/humans/physiological/p1/*/*/raw"], allow_warmup=True
    )
    answer = study.ask(StartSession, "/study/start_session", wish)
    assert answer.success, answer.message
    assert answer.message.endswith("no sensor has been seen of p1")
    missing = study.until(
        lambda: any(e == "/humans/physiological/p1/*/*/raw: absent" for s in study.states for e in s.waiting_for),
        "the missing stream is named",
    )
    assert missing
    study.run("toy_driver.py", human_id="p1", sensor_id="toy_1")
    recording = study.phase(SessionState.RECORDING)
    start_ns = to_ns(recording.start_at)
    assert 0 < start_ns - to_ns(recording.header.stamp) <= LEAD_S * 1e9
    assert "driver_toy_toy_1" in recording.expected_services
    study.until(lambda: len([u for u in updates if to_ns(u.header.stamp) > start_ns]) >= 3, "three updates of it")
    status, told = coordinator.ask("/markers", {"name": "stimulus", "value": "blue", "human_id": "p1", "age_ms": 500})
    assert status == 200
    marker = study.until(lambda: [m for m in study.markers if m.name == "stimulus"], "the marker")[0]
    assert (to_ns(marker.header.stamp), marker.session_id) == (told["stamp_ns"], recording.session_id)
    assert study.cli("mark", "baseline_end").returncode == 0
    stopped = study.cli("stop")
    assert stopped.returncode == 0, stopped.stdout + stopped.stderr
    over = study.phase(SessionState.IDLE)
    assert over.detail == f"session '{recording.session_id}': complete"
    done: dict[str, int] = {}

    def everybody_has_finished() -> bool:
        for ack in study.acks:
            if ack.phase == SessionState.STOPPING and ack.ok:
                done[ack.service] = min(to_ns(ack.header.stamp), done.get(ack.service, 2**63))
        return len(done) == 4

    study.until(everybody_has_finished, "four have finished")
    assert max(done, key=done.get) == "recorder"
    # cut at one instant: the first update of the session comes one interval after its first sample
    first = next(u for u in updates if to_ns(u.header.stamp) >= start_ns)
    assert to_ns(first.header.stamp) - start_ns >= 900_000_000
    other = RAW.replace("/p1/", "/p2/").replace("toy_1", "toy_2")
    models = study.listen(ClockModel, other.replace("/raw", "/clock"), qos.CLOCK)
    study.run("toy_driver.py", human_id="p2", sensor_id="toy_2")
    study.until(lambda: models, "the first model of a clock, 20 s at least before it is locked")
    wish = StartSession.Request(study="s", human_ids=["p2"], required_streams=[other])
    assert study.ask(StartSession, "/study/start_session", wish).success
    study.until(
        lambda: any(entry.startswith("clock_sync: clock of ") for entry in study.states[-1].waiting_for),
        "a clock that is not locked is waited for where warm-up was not accepted",
    )
    assert study.ask(StopSession, "/study/stop_session", StopSession.Request()).success
    assert study.phase(SessionState.IDLE).detail.endswith("stopped before it had begun")
    assert recorder.stop() == 0
    with AnyReader([Path(over.directory)]) as reader:
        topics = {connection.topic for connection, _, _ in reader.messages()}
    assert {RAW, FEATURES, "/study/session", "/study/ack", "/study/markers"} <= topics


def test_who_does_not_answer_is_named_and_the_next_session_works(study):
    """A deaf service fails the session by name; without it the next one records. A second start is refused."""
    coordinator = study.coordinator(answer_timeout_s=8.0)
    deaf = study.run("toy_members.py", "7", "1", env={"TOY_MEMBERS": "deaf"})
    study.run("toy_members.py", "0", "2")
    study.hear_nodes(coordinator, "toy_member_7", "toy_member_0", "toy_member_1")
    wish = StartSession.Request(study="s")
    assert study.ask(StartSession, "/study/start_session", wish).success
    second = study.ask(StartSession, "/study/start_session", StartSession.Request(study="other"))
    assert not second.success
    assert "PREPARING; stop it first" in second.message
    assert "did not answer within 8 s: toy_member_7" in study.phase(SessionState.FAILED).detail
    deaf.stop()
    study.hear_nodes(coordinator, "toy_member_0", "toy_member_1")
    assert study.ask(StartSession, "/study/start_session", wish).success
    study.phase(SessionState.RECORDING)
    refused = study.ask(StopSession, "/study/stop_session", StopSession.Request(session_id="other"))
    assert (refused.success, "is not running" in refused.message) == (False, True)
    assert study.ask(StopSession, "/study/stop_session", StopSession.Request()).success
    study.phase(SessionState.IDLE)


def recorded(study: Study, tmp_path: Path, **parameters: object) -> Process:
    """A session of a toy driver that is being recorded; returns the recorder."""
    coordinator = study.coordinator()
    study.run("toy_driver.py", human_id="p1", sensor_id="toy_1")
    recorder = study.run("recorder", **{"directory": tmp_path / "recordings", **parameters})
    study.hear_nodes(coordinator, "driver_toy_toy_1", "recorder")
    wish = StartSession.Request(study="s", human_ids=["p1"], required_streams=[RAW])
    assert study.ask(StartSession, "/study/start_session", wish).success
    study.phase(SessionState.RECORDING)
    study.until(lambda: not study.states[-1].waiting_for, "everybody has acknowledged")
    return recorder


def stopped(study: Study) -> str:
    """What is said of the session that is stopped now."""
    assert study.ask(StopSession, "/study/stop_session", StopSession.Request()).success
    over = study.until(lambda: [s for s in study.states[-1:] if s.phase in (0, 4)], "the session is over")[0]
    assert over.phase == SessionState.IDLE, over.detail
    return over.detail


def waits(study: Study, words: str) -> float:
    """Wait until this stands in waiting_for; return after how many seconds, without those the machine withheld."""
    begun_s, withheld = time.monotonic(), study.withheld_s()
    study.until(lambda: any(words in entry for entry in study.states[-1].waiting_for), words)
    return time.monotonic() - begun_s - (study.withheld_s() - withheld)


def test_a_recorder_that_is_killed_is_missed_within_seconds_and_its_gap_is_told(study, tmp_path):
    """Killed and started again: its missing heartbeat is a sentence within 5 s, the end says from when to when."""
    recorder, begun_s = recorded(study, tmp_path), time.time()
    study.until(lambda: on_disk(recorder) > begun_s, "something of the session is on the disk")
    recorder.kill()
    assert waits(study, "recorder: no heartbeat for more than 3.5 s") < 5.0
    again = study.run("recorder", directory=tmp_path / "recordings")
    study.until(lambda: not study.states[-1].waiting_for, "it records again")
    study.until(lambda: "messages saved" in again.log(), "it has read how far the part before goes")
    said = stopped(study)
    assert re.search(r"incomplete: recorder: nobody recorded from [\d:]+ to [\d:]+ UTC \(\d+\.\d s\)", said), said
    assert "recorder: records again" in study.notes()


def test_a_coordinator_that_stood_still_waits_as_long_as_it_would_have_waited_for_all(study):
    """Stopped for longer than a service may take to answer: the service that answers after that takes part."""
    coordinator = study.coordinator(required_services=["toy_member_7"], answer_timeout_s=STOPPED_S - 1.0)
    assert coordinator.ask("/start", {"study": "s", "human_ids": ["p1"]})[0] == 200
    study.phase(SessionState.PREPARING)
    coordinator.send(signal.SIGSTOP)
    begun_s = time.monotonic()
    study.until(lambda: time.monotonic() - begun_s > STOPPED_S, "it has stood still")
    coordinator.send(signal.SIGCONT)
    study.until(lambda: "stood still" in coordinator.log(), "it knows that it stood still")
    study.run("toy_members.py", "7", "1")
    study.until(lambda: study.states[-1].phase != SessionState.PREPARING, "it goes on")
    assert study.states[-1].phase == SessionState.RECORDING, study.states[-1].detail


def test_a_recorder_that_is_stopped_and_goes_on_with_everything_is_complete(study, tmp_path):
    """Stopped for some seconds: told within 5 s and taken back; at the end all that was sent is in the file."""
    recorder = recorded(study, tmp_path)
    recorder.send(signal.SIGSTOP)
    assert waits(study, "recorder: no heartbeat for more than 3.5 s") < 5.0
    recorder.send(signal.SIGCONT)
    study.until(lambda: not study.states[-1].waiting_for, "it records again")
    directory = study.states[-1].directory
    assert stopped(study).endswith(": complete")
    about = json.loads((Path(directory) / "recorder.json").read_text())
    assert {topic["topic"]: topic["lost"] for topic in about["topics"]}[RAW] == 0


OF_BOTH_ENOUGH = pytest.mark.slow(reason="each floor and each end is in one of the other two")


@pytest.mark.parametrize(
    ("ends_full", "floor_mb"),
    [(False, 0), (True, 20), *(pytest.param(*both, marks=OF_BOTH_ENOUGH) for both in ((False, 20), (True, 0)))],
)
def test_a_disk_that_is_full_and_free_again_costs_what_came_meanwhile(study, tmp_path, floor_mb, ends_full):
    """Said with its time and that what is there is safe; gone on with by itself; the stop ends cleanly and says it."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=40m", "none", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("no right to mount a small file system")
    try:
        recorder = recorded(study, tmp_path, directory=disk, free_floor_mb=floor_mb)
        begun_s = time.time()
        study.until(lambda: on_disk(recorder) > begun_s + 1.0, "a second of the session is on the disk")
        fill(disk / "others")
        waits(study, "recorder: NOT RECORDING: since ")
        assert any("what was written before is safe" in entry for entry in study.states[-1].waiting_for)
        assert recorder.get("/readyz")[0] == 503
        lost = recorder.ask("/recording")[1]["lost"]
        study.until(lambda: recorder.ask("/recording")[1]["lost"] > lost + 20, "what comes is counted, samples too")
        if not ends_full:
            (disk / "others").unlink()
            study.until(lambda: not study.states[-1].waiting_for, "it records again")
            assert recorder.get("/readyz")[0] == 200
        directory = Path(study.states[-1].directory)
        said = stopped(study)
        assert re.search(r"incomplete: recorder: \d+ messages lost \(\d+ at the disk\)$", said), said
        (disk / "others").unlink(missing_ok=True)
        about = json.loads((directory / "recorder.json").read_text())
        assert "what was written before is safe" in about["events"][0]["what"]
        topic = next(topic for topic in about["topics"] if topic["topic"] == RAW)
        assert sum(loss["count"] for loss in topic["losses"]) == topic["lost"] > 0
        assert recorder.stop() == 0
        with AnyReader([directory]) as reader:
            assert sum(c.topic == RAW for c, _, _ in reader.messages()) == topic["messages"] > 0
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)


def on_disk(recorder: Process) -> float:
    """When all that the recorder had written had last reached the disk; Unix time in s."""
    synced = re.search(r"^sense4hri_recorder_last_sync_timestamp_seconds\S* (\S+)", recorder.get("/metrics")[1], re.M)
    return float(synced[1]) if synced else 0.0


def fill(path: Path) -> None:
    """Leave not a byte of a disk free."""
    with path.open("wb", buffering=0) as file:
        for size in (1 << 20, 1 << 12, 1):
            with suppress(OSError):
                while True:
                    file.write(bytes(size))


def test_services_that_come_and_go_are_recorded_events(study):
    """A driver killed and started afresh, a member that leaves, one that appears: each is a note of the session."""
    coordinator = study.coordinator()
    driver = study.run("toy_driver.py", human_id="p1", sensor_id="toy_1")
    leaving = study.run("toy_members.py", "0", "1")
    study.hear_nodes(coordinator, "driver_toy_toy_1", "toy_member_0")
    assert study.ask(StartSession, "/study/start_session", StartSession.Request(study="s")).success
    study.phase(SessionState.RECORDING)
    driver.kill()
    study.run("toy_driver.py", human_id="p1", sensor_id="toy_1")
    study.until(lambda: "service started afresh: driver_toy_toy_1" in study.notes(), "the driver's new life is noted")
    leaving.stop()
    study.until(lambda: "service gone: toy_member_0" in study.notes(), "the one that left is noted")
    study.run("toy_members.py", "1", "1")
    study.until(lambda: "service appeared: toy_member_1" in study.notes(), "the new one is noted")
    session_id = study.states[-1].session_id
    assert {m.session_id for m in study.markers} == {session_id}
    study.until(lambda: not study.states[-1].waiting_for, "everybody has acknowledged")
    assert study.ask(StopSession, "/study/stop_session", StopSession.Request()).success
    assert "gone before the end: toy_member_0" in study.phase(SessionState.IDLE).detail


def test_two_nodes_of_one_name_are_waited_for_until_one_has_left(study):
    """Both acknowledge under the one name, so that only their heartbeats tell; each is heard after the other."""
    coordinator = study.coordinator()
    first, _ = (study.run("toy_driver.py", human_id="p1", sensor_id="toy_1") for _ in range(2))
    study.hear_nodes(coordinator, "driver_toy_toy_1")
    wish = StartSession.Request(study="s", required_streams=["/camera"])
    assert study.ask(StartSession, "/study/start_session", wish).success
    waits(study, f"driver_toy_toy_1: {TWINS}")
    first.stop()
    study.until(lambda: list(study.states[-1].waiting_for) == ["/camera: absent"], "one is left")


def test_a_killed_coordinator_goes_on_with_the_session(study):
    """Killed while recording and started again, it says the same session, gets its answers again, and can stop it."""
    first = study.coordinator()
    study.run("toy_members.py", "0", "3")
    study.hear_nodes(first, "toy_member_0", "toy_member_1", "toy_member_2")
    assert first.ask("/start", {"study": "s", "session_id": "mine", "human_ids": ["p1"]})[0] == 200
    before = study.phase(SessionState.RECORDING)
    first.kill()
    study.states.clear()
    second = study.coordinator()
    after = study.phase(SessionState.RECORDING)
    assert (after.session_id, after.start_at) == ("mine", before.start_at)
    study.until(lambda: any("session_coordinator was away" in note for note in study.notes()), "the absence is noted")
    study.until(lambda: not study.states[-1].waiting_for, "everybody has acknowledged again")
    assert second.ask("/start", {"study": "t"})[0] == 409
    assert second.ask("/stop", {})[0] == 200
    assert study.phase(SessionState.IDLE).detail == "session 'mine': not recorded: no recorder took part"


@pytest.mark.timeout(300)
def test_a_second_coordinator_ends_no_session(study, tmp_path):
    """It keeps to itself that it conducts none for as long as another one is there, and refuses a stop with the reason.

    The recorder would take that for the end of the session and close its file.
    """
    first = study.coordinator()
    study.run("recorder", directory=tmp_path / "recordings", record_when="session")
    study.hear_nodes(first, "recorder")
    assert first.ask("/start", {"study": "s", "session_id": "mine"})[0] == 200
    study.phase(SessionState.RECORDING)
    study.states.clear()
    second = study.run("session_coordinator", state_file=tmp_path / "second.json")
    second.port()
    study.until(lambda: "recorder" in second.ask("/session")[1].get("present_services", ()), "the second one looks on")
    study.until(lambda: "another session-coordinator" in str(second.ask("/stop", {})), "it knows of the first one")
    assert first.ask("/stop", {})[0] == 200
    over = study.phase(SessionState.IDLE)
    assert over.detail.startswith("session 'mine'")
    assert {state.session_id for state in study.states[:-1]} == {"mine"}
    assert len([*(tmp_path / "recordings").glob("*/*/*/recorder.json")]) == 1
    first.stop()
    study.until(lambda: study.states[-1].detail == "", "the second one says that there is no session")


def test_a_session_file_that_was_removed_is_written_again(study, tmp_path):
    """So that a coordinator started afresh goes on with the session all the same."""
    first = study.coordinator()
    assert first.ask("/start", {"study": "s", "session_id": "mine"})[0] == 200
    study.phase(SessionState.RECORDING)
    (tmp_path / "session.json").unlink()
    study.until(lambda: (tmp_path / "session.json").is_file(), "it is there again")
    first.kill()
    study.coordinator()
    study.until(lambda: any("session_coordinator was away" in note for note in study.notes()), "it goes on")
    assert study.phase(SessionState.RECORDING).session_id == "mine"


def test_what_cannot_be_is_refused_with_a_sentence(study):
    """Names that break the rules, unknown fields, a stop of nothing: an error over ROS and HTTP, and nothing begins."""
    coordinator = study.coordinator()
    wish = StartSession.Request(study="s", session_id="a/b")
    answer = study.ask(StartSession, "/study/start_session", wish)
    assert (answer.success, "session_id is 'a/b'" in answer.message) == (False, True)
    for path, fields, words in [
        ("/start", {"study": "s", "human_ids": ["Müller"]}, "'Müller'"),
        ("/start", {"study": "s", "colour": 1}, "'colour' is not a field"),
        ("/markers", {"value": "x"}, "name is empty"),
        ("/stop", {"session_id": 4}, "session_id"),
    ]:
        status, told = coordinator.ask(path, fields)
        assert (status, words in told["error"]) == (400, True), told
    status, told = coordinator.ask("/stop", {})
    assert (status, told["error"]) == (409, "no session is running")
    assert coordinator.ask("/session")[1]["phase"] == "IDLE"
    refused = study.cli("start", "--study", "s", "--session", "größe")
    assert (refused.returncode, "größe" in refused.stderr) == (1, True)


def test_what_was_refused_is_not_kept_and_a_damaged_file_is_set_aside(study, tmp_path):
    """Neither hostile metadata, nor a glob that would never be done, nor a broken state file stops the coordinator."""
    kept = tmp_path / "session.json"
    kept.write_text('{"session": {"phase": 2, "study": "s", "detail": "\\ud800"}, "used": []}')
    coordinator = study.coordinator()
    assert coordinator.log().count("session.json.damaged-") == 1
    assert len(list(tmp_path.glob("session.json.damaged-*"))) == 1
    for metadata in (r'{"room": "\ud800"}', "[" * 60_000, '{"n": 1' + "0" * 400 + "}"):
        status, told = coordinator.ask("/start", {"study": "s", "metadata_json": metadata})
        assert (status, told["field"]) == (400, "metadata_json"), told
        wish = StartSession.Request(study="s", metadata_json=metadata)
        answer = study.ask(StartSession, "/study/start_session", wish)
        assert not answer.success
        assert answer.message.startswith("metadata_json cannot be taken: ")
        assert coordinator.ask("/session")[1]["phase"] == "IDLE"
        assert "PREPARING" not in coordinator.log()
        assert not kept.exists() or '"phase": 1' not in kept.read_text()
    hostile = "/*/" + "*" * 200 + "X/**"
    study.run("toy_driver.py", human_id="p1", sensor_id="toy_1")
    study.hear_nodes(coordinator, "driver_toy_toy_1")
    started = study.ask(
        StartSession, "/study/start_session", StartSession.Request(study="s", required_streams=[hostile])
    )
    assert started.success, started.message
    study.until(lambda: study.states and f"{hostile}: absent" in study.states[-1].waiting_for, "nothing matches it")
    coordinator.kill()
    coordinator = study.coordinator()
    study.until(lambda: coordinator.ask("/session")[1].get("phase") == "PREPARING", "it goes on with the session")
    study.until(lambda: study.states[-1].waiting_for == [f"{hostile}: absent"], "everybody but the glob is ready")
    assert coordinator.ask("/stop", {})[0] == 200
    study.phase(SessionState.IDLE)


def test_a_required_stream_that_nobody_reads_is_waited_for_with_the_reason(study):
    """A process has more topics than are read of one: those beyond stand in the way by name, or of a glob of theirs."""
    study.run(FLOOD, str(MOST + 5), "0", "100", "3600").until("there")
    coordinator = study.coordinator(lead_s=LEAD_S)
    topics = [f"/humans/physiological/x/ecg/flood_{i}/raw" for i in range(MOST + 5)]
    wish = StartSession.Request(study="flood", required_streams=topics, allow_warmup=True)
    assert study.ask(StartSession, "/study/start_session", wish).success

    def beyond() -> list[str]:
        waiting = study.states[-1].waiting_for if study.states else []
        return [entry.removesuffix(f": {TOO_MANY}") for entry in waiting if entry.endswith(TOO_MANY)]

    study.until(lambda: len(beyond()) == 5, lambda: f"five are not read: {beyond()}")
    assert set(beyond()) < set(topics)
    assert len(coordinator.ask("/session")[1]["waiting_for"]) == MOST + 5  # the others are silent


def test_random_requests_end_neither_coordinator_nor_registry(study, tmp_path):
    """Of hundreds of requests and acknowledgements that nobody can mean each request is answered, and both go on."""
    coordinator = study.coordinator()
    registry = study.run("metadata_registry", database=tmp_path / "registry.sqlite")
    dice = random.Random(3)
    acks = study.node.create_publisher(SessionAck, "/study/ack", qos.ACK)
    clients = {
        kind: study.node.create_client(kind, name)
        for kind, name in {
            StartSession: "/study/start_session",
            StopSession: "/study/stop_session",
            AssignSensor: "/study/assign_sensor",
            ListSensors: "/study/list_sensors",
        }.items()
    }
    study.until(lambda: all(client.service_is_ready() for client in clients.values()), "all are served")
    for _ in range(20):
        asked = []
        for _ in range(20):
            kind = dice.choice(list(clients))
            asked.append(clients[kind].call_async(scrambled(kind.Request(), dice)))
            acks.publish(scrambled(SessionAck(), dice))
        study.until(lambda asked=asked: all(one.done() for one in asked), "each request is answered")
    assert coordinator.ask("/session")[0] == registry.ask("/sensors")[0] == 200
    assert "Traceback" not in coordinator.log() + registry.log()


def scrambled(message: Any, dice: random.Random) -> Any:
    """Fill the texts, lists and numbers of a message with what nobody can mean."""
    texts = [
        "",
        "s",
        "p1",
        "h10_1",
        "\x01",
        "ü" * 300,
        "x" * 100_000,
        "[" * 50_000,
        r'{"a": "\ud800"}',
        "/*/" + "*" * 200,
    ]
    for name, kind in message.get_fields_and_field_types().items():
        if kind == "string":
            setattr(message, name, dice.choice(texts))
        elif kind == "sequence<string>":
            setattr(message, name, dice.choice([[], ["p1"], ["/**"], texts, ["a"] * 2000]))
        elif kind == "uint8":
            setattr(message, name, dice.randint(0, 255))
    return message
