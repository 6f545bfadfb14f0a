"""The paper's figure as real processes: virtual sensors, drivers, interpreters, fusion, recorded, by `make demo`."""

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import metrics_table
import pytest
import study_file
from driver_check import DriverCheck
from processes import DEADLINE_S, DOCKER_STOP_S, ended_within, poll
from rosbags.highlevel import AnyReader
from sense4hri.names import StreamName

ROOT = Path(__file__).resolve().parents[2]
CONFORMANCE = ROOT.parent / "shared" / "check" / "conformance.py"
STUDY = study_file.read(study_file.find("demo"))
STRANGER = ROOT / "tests" / "graph" / "strangers_study" / "study.yaml"
INTERPRETED = ("ecg", "ppg")


@pytest.mark.timeout(1200)
def test_the_demo_runs_the_whole_chain_and_says_what_it_saw(demo, tmp_path):
    """A session of 45 s: nothing in the chain is silent, the contract is kept, the recording holds what flowed."""
    run = demo("--duration", "45")
    run.until("the page:", 120)
    shows_what_the_page_of_metrics_says(run.logs)
    checks = [DriverCheck(sensor.sensor_id, 15) for sensor in STUDY.sensors]
    run.until("records, into", 120)
    if CONFORMANCE.exists():
        check = [sys.executable, str(CONFORMANCE), "20"]
        result = subprocess.run(check, capture_output=True, text=True, timeout=90, env=os.environ.copy())
        assert result.returncode == 0, result.stdout + result.stderr
    assert [line for check in checks for line in check.departures()] == []
    status = run.wait(120)
    output = "\n".join(run.lines)
    assert status == 0, output
    streams = [StreamName.parse(topic)[0] for topic in STUDY.required_streams]
    for _, sensor_type, sensor in (name for name in streams if name.sensor_type in INTERPRETED):
        row = re.search(rf"{sensor_type}/{sensor}\s+(\d+)\s+0\s+0\s+(\d+)", output)
        assert row is not None, output
        assert int(row[1]) > 30 * 50
        assert int(row[2]) >= 25
    for human_id in STUDY.participants:
        assert re.search(rf"^states of {human_id}: .*; at the end \w+: \w", output, re.MULTILINE), output
    folder = recorded_into(output)
    assert tmp_path / "recordings" in folder.parents
    assert re.search(rf"^report: +(none|{re.escape(str(folder))}/report.html)", output, re.MULTILINE), output
    with AnyReader([folder]) as reader:
        recorded = {connection.topic: connection.msgcount for connection in reader.connections}
    for human_id in STUDY.participants:
        assert recorded[f"/humans/physiological/{human_id}/state"] > 20
    assert sum(topic.endswith("/raw") for topic in recorded) == len(STUDY.required_streams)
    assert recorded["/study/markers"] >= 2


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_eight_participants_are_recorded(demo):
    """The session begins, and its report knows all of the sixteen streams, none of them broken."""
    required = study_file.read(study_file.find("eight-participants")).required_streams
    assert len(required) == 16
    run = demo("--study", "eight-participants", "--duration", "10")
    assert run.wait(600) == 0, "\n".join(run.lines)
    file = recorded_into("\n".join(run.lines)) / "report.json"
    poll(file.exists, f"{file}")
    report = json.loads(file.read_text())
    assert report["verdict"] != "broken", report["why"]
    of = {stream["topic"]: stream for stream in report["streams"]}
    assert [topic for topic in required if of[topic]["samples"] < 8.0 * of[topic]["declared_hz"]] == []


def recorded_into(output: str) -> Path:
    """The folder of the recording of which a demo tells."""
    into = re.search(r"session s\d+T\d+: records, into (\S+)", output)
    assert into is not None, output
    return Path(into[1])


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_study_that_replays_plays_a_recorded_session_to_its_end(demo, monkeypatch):
    """With features of every stream that has an interpreter, within the recorded session."""
    recorded = demo("--duration", "45")
    assert recorded.wait(240) == 0, "\n".join(recorded.lines)
    monkeypatch.setenv("BAG", str(recorded_into("\n".join(recorded.lines))))
    monkeypatch.setenv("RATE", "20.0")
    run = demo("--study", "replay")
    assert run.wait(240) == 0, "\n".join(run.lines)
    output = "\n".join(run.lines)
    assert "the recording has been played" in output
    for _, sensor_type, sensor in (StreamName.parse(topic)[0] for topic in STUDY.required_streams):
        row = re.search(rf"{sensor_type}/{sensor}\s+(\d+)\s+0\s+0\s+(\d+)", output)
        assert row is not None, output
        assert int(row[1]) > 30 * 50
        assert (int(row[2]) >= 25) == (sensor_type in INTERPRETED), output


def shows_what_the_page_of_metrics_says(logs: Path) -> None:
    """All that is exported stands in docs/metrics.md, and all that stands there is exported once all streams."""
    page = metrics_table.written()
    wanted = [row for row in page if in_demo(row)]
    poll(lambda: not metrics_table.lacking(wanted, metrics_table.scraped(logs)), "every metric of the page is exported")
    assert metrics_table.lacking(metrics_table.scraped(logs), page) == []


def in_demo(row: metrics_table.Row) -> bool:
    """True where a service of a row runs in the demo study, and it is about nothing that happens only sometimes."""
    absent = {folder.name.replace("-", "_") for folder in (ROOT / "services").iterdir()} - STUDY.packages
    return not absent.issuperset(row.services) and "field" not in row.labels


def test_ctrl_c_ends_the_demo_within_ten_seconds(demo):
    """SIGINT ends a session that prepares and every process within 10 s, with a summary and no child left behind."""
    run = demo()
    run.until("preparing", 120)
    children = children_of(run.process.pid)
    assert len(children) == len(STUDY.processes)
    run.process.send_signal(signal.SIGINT)
    assert ended_within(run.process, DOCKER_STOP_S, *children) is not None
    run.wait(DEADLINE_S)
    assert any("stopped before it had begun" in line for line in run.lines), "\n".join(run.lines)
    assert any(line.startswith("stream ") for line in run.lines)
    assert [pid for pid in children if Path(f"/proc/{pid}").exists()] == []


def test_a_terminal_that_is_closed_ends_the_demo_and_leaves_no_child_behind(ros_domain, tmp_path):
    """SIGHUP ends a session as SIGTERM does, though nobody reads any more what is said."""
    study = conducted(tmp_path)
    terminal, its_end = pty.openpty()
    command = [sys.executable, str(ROOT / "compose" / "demo.py"), "--study", str(study), "--recordings", str(tmp_path)]
    run = subprocess.Popen(command, stdin=its_end, stdout=its_end, stderr=its_end, preexec_fn=heeds_hangups)
    os.close(its_end)
    os.set_blocking(terminal, False)
    said = bytearray()

    def prepares() -> bool:
        with contextlib.suppress(BlockingIOError):
            said.extend(os.read(terminal, 4096))
        return b"preparing" in said

    poll(prepares, lambda: f"preparing in:\n{said.decode()}")
    children = children_of(run.pid)
    os.close(terminal)
    run.send_signal(signal.SIGHUP)
    assert run.wait(DEADLINE_S) == 0
    assert len(children) == 1
    assert [pid for pid in children if Path(f"/proc/{pid}").exists()] == []


def heeds_hangups() -> None:
    """Also where the tests run under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def conducted(folder: Path, more: str = "") -> Path:
    """A study with nothing but a session-coordinator, and these services."""
    coordinator = f"a: {{extends: {{file: {ROOT}/compose/compose.yaml, service: session-coordinator}}}}"
    study = folder / "alone.yaml"
    study.write_text(f"name: t\nx-study: {{name: t}}\nservices: {{{coordinator}{more}}}\nvolumes: {{session: }}\n")
    return study


def test_a_program_of_somebody_elses_is_not_waited_for(demo, tmp_path):
    """It need not be a driver, and may have no HTTP to say that it is ready."""
    run = demo("--study", str(conducted(tmp_path, ", b: {command: sleep 600}")))
    run.until("preparing", 60)


@pytest.mark.parametrize(("name", "reason"), [("none.csv", "No such file"), (".", "Is a directory")])
def test_a_recording_that_cannot_be_opened_is_named_before_anything_starts(demo, tmp_path, name, reason):
    """Status 78 and one line with the file and the reason."""
    run = demo("--input", str(tmp_path / name))
    assert run.wait(DEADLINE_S) == 78
    assert len(run.lines) == 1
    assert re.fullmatch(rf"INPUT={re.escape(str(tmp_path / name))} cannot be played: {reason}.*", run.lines[0])


def test_a_study_of_somebody_elses_driver_is_one_file(demo, tmp_path):
    """A driver the repository does not know is started, required, recorded and summed up by its study."""
    stranger = study_file.read(STRANGER)
    run = demo("--study", str(STRANGER), "--duration", "4")
    assert run.wait(120) == 0, "\n".join(run.lines)
    output = "\n".join(run.lines)
    row = re.search(r"^p9/respiration/belt_1 +(\d+) +(?:\d+|–) ", output, re.MULTILINE)
    assert row is not None, output
    assert int(row[1]) >= 4 * 25
    assert re.search(rf"records, into {re.escape(str(tmp_path))}/recordings/breathing/p9/\S+", output), output
    (bag,) = (path.parent for path in (tmp_path / "recordings").rglob("metadata.yaml"))
    with AnyReader([bag]) as reader:
        recorded = {connection.topic: connection.msgcount for connection in reader.connections}
    assert recorded[stranger.required_streams[0]] >= 4 * 5


def test_a_wrong_study_is_named_before_anything_starts(demo, tmp_path):
    """Status 78 and a line with file, line and key, as `make check` says; so it is with a program that is not there."""
    wrong = tmp_path / "wrong.yaml"
    for text, said in (
        ("services: {}", "x-study: must have a name"),
        ("x-study: {name: t}\nservices: {}", "services: session-coordinator is missing"),
        (
            "x-study: {name: t}\nservices: {a: {command: python -m session_coordinator}, b: {command: no_such}}",
            "services.b.command: no_such is not a program of this machine",
        ),
    ):
        wrong.write_text(text)
        run = demo("--study", str(wrong))
        assert run.wait(60) == 78
        assert any(re.match(rf"{re.escape(str(wrong))}:\d+: error: .*{re.escape(said)}", line) for line in run.lines)
        assert not any("logs in" in line for line in run.lines), run.lines


def children_of(pid: int) -> list[int]:
    """Return the ids of a process's children."""
    listed = subprocess.run(["ps", "--ppid", str(pid), "-o", "pid="], capture_output=True, text=True, check=False)
    return [int(child) for child in listed.stdout.split()]
