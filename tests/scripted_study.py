"""A study to which everything happens that can happen to one, and what its report and its export must say afterwards.

The same story is played with processes (tests/graph) and with containers (tests/containers); `Lab` is what both offer.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import mne
import pandas as pd
import pyxdf
import study_file
from processes import poll
from wall_clock import WallClock

SECOND_NS = 1_000_000_000
STRAP, BAND, LATE = "h10_1", "verity_1", "h10_2"
"""p1's strap, whose driver is killed; p1's arm band, whose link is cut; p2's strap, which is switched on late."""
STUDY = study_file.read(study_file.find("demo"))
STREAMS = {
    sensor: next(topic for topic in STUDY.required_streams if f"/{sensor}/" in topic) for sensor in (STRAP, BAND, LATE)
}
STEP_S = 2.0
CUT_S = 4.0
FLOWS_S = 90.0
NO_RECORDER = "no recorder ran"
SLACK_NS = 50_000_000
"""A command is entered a little before the process that runs it can look at the clock."""


class Lab(Protocol):
    """A study that runs, all but p2's strap. clock: the wall clock of everything in it."""

    clock: WallClock

    def session(self, *arguments: str) -> subprocess.Popen[str]:
        """Start `sense4hri-session` with these arguments; its output is piped."""

    def start(self, sensor: str) -> None:
        """Start a sensor's driver."""

    def kill(self, service: str) -> None:
        """SIGKILL a driver or the recorder, and start it again."""

    def knobs(self, sensor: str, **values: Any) -> None:
        """Turn knobs of sensor-bench."""

    def samples(self, topic: str) -> int:
        """Return how many messages came on a raw topic so far."""

    def parts(self) -> int:
        """Return how many folders the session's recording has so far."""


class Story(NamedTuple):
    """What was done, in ns of the host's clock at that time."""

    session_id: str
    killed_ns: int
    driver_back_ns: int
    cut_ns: int
    joined_ns: int
    recorder_killed_ns: int
    stepped_ns: int
    marks: dict[str, tuple[int, int]]
    """Marker -> before and after it was entered."""


def told(process: subprocess.Popen[str], what: str) -> None:
    """Read what a command prints up to a line with `what`; AssertionError where it ends without one."""
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if what in line:
            return
    raise AssertionError(f"never said {what!r}: {lines}")


def finish(process: subprocess.Popen[str], seconds: float = 120.0) -> None:
    """AssertionError, with what it printed, where a command fails."""
    output, _ = process.communicate(timeout=seconds)
    assert process.returncode == 0, output


def play(lab: Lab) -> Story:
    """Do everything, as a researcher and a bad day would."""
    marks: dict[str, tuple[int, int]] = {}

    def mark(name: str, value: str) -> None:
        before_ns = lab.clock.now_ns()
        finish(lab.session("mark", name, value))
        marks[f"{name} {value}"] = before_ns, lab.clock.now_ns()

    def flow(*sensors: str, messages: int = 3) -> None:
        counts = {sensor: lab.samples(STREAMS[sensor]) for sensor in sensors}
        for sensor, count in counts.items():
            poll(lambda s=sensor, c=count: lab.samples(STREAMS[s]) >= c + messages, f"{sensor} flows", FLOWS_S)

    flow(STRAP, BAND)
    required = [word for topic in STREAMS.values() for word in ("--require", topic)]
    names = ["--study", "Prüfung 1/b", "--session", "bad_day"]
    humans = ["--human", "p1", "--human", "p2"]
    starting = lab.session("start", *names, "--allow-warmup", *humans, *required)
    told(starting, f"{STREAMS[LATE]}: absent")
    lab.start(LATE)
    finish(starting)
    flow(*STREAMS)
    mark("condition_start", "driver")
    killed_ns = lab.clock.now_ns()
    lab.kill(STRAP)
    flow(STRAP)
    driver_back_ns = lab.clock.now_ns()
    mark("stimulus", "link")
    cut_ns = lab.clock.now_ns()
    lab.knobs(BAND, down=True)
    poll(lambda: lab.clock.now_ns() > cut_ns + CUT_S * SECOND_NS, "the link was cut for a while")
    lab.knobs(BAND, down=False)
    flow(BAND)
    joined_ns = lab.clock.now_ns()
    recorder_killed_ns = lab.clock.now_ns()
    lab.kill("recorder")
    poll(lambda: lab.parts() == 2, "the recorder goes on in a second folder", FLOWS_S)
    flow(*STREAMS, messages=6)
    stepped_ns = lab.clock.now_ns()
    lab.clock.step(STEP_S)
    flow(*STREAMS, messages=6)
    mark("condition_end", "step")
    finish(lab.session("stop"))
    return Story("bad_day", killed_ns, driver_back_ns, cut_ns, joined_ns, recorder_killed_ns, stepped_ns, marks)


def check(recordings: Path, story: Story, work: Path) -> None:
    """AssertionError unless the session's report says what was done, nothing else, and its export holds the marks."""
    first, second = folders(recordings)
    report = _report(first)
    assert report == _report(second)
    _check_report(report, story, [first.name, second.name])
    _check_steps(report, story)
    _check_export(second, story.marks, work / second.name)


def folders(recordings: Path) -> list[Path]:
    """Return the session's folders, the first one first."""
    found = [path.parent for path in recordings.rglob("recorder.json")]
    sessions = [folder for folder in found if json.loads((folder / "recorder.json").read_text())["session"]]
    return sorted(sessions, key=lambda folder: (len(folder.name), folder.name))


def _report(folder: Path) -> dict[str, Any]:
    assert (folder / "report.html").stat().st_size > 10_000
    return dict(json.loads((folder / "report.json").read_text()))


def _holes(report: dict[str, Any]) -> dict[str, list[tuple[int, int]]]:
    """Sensor -> holes of its streams within the session, those while no recorder ran apart."""
    holes: dict[str, list[tuple[int, int]]] = {}
    for stream in report["streams"]:
        assert stream["kind"] == "raw", stream
        assert (stream["resets"], stream["duplicates"], stream["backwards"], stream["reordered"]) == (0, 0, 0, 0), (
            stream
        )
        found = holes.setdefault(stream["stream"].rpartition("/")[2], [])
        gaps = [gap for gap in stream["gaps"] if gap["in_session"] and NO_RECORDER not in gap["cause"]]
        found += [(gap["from"]["ros_ns"], gap["to"]["ros_ns"]) for gap in gaps]
    return holes


def _check_report(report: dict[str, Any], story: Story, names: list[str]) -> None:
    assert report["session"]["session_id"] == story.session_id
    assert report["session"]["stop_at_ns"] is not None
    assert report["verdict"] == "usable with gaps", report["why"]
    assert report["recording"]["state"] == "complete"
    assert report["parts"]["folders"] == names, report["parts"]
    assert any(f"{NO_RECORDER}, between {' and '.join(names)}" in problem for problem in report["problems"])
    holes = _holes(report)
    assert set(holes) == {STRAP, BAND, LATE}
    assert holes[LATE] == []
    slack_ns = 2 * SECOND_NS
    for sensor, from_ns, to_ns in (
        (STRAP, story.killed_ns, story.driver_back_ns),
        (BAND, story.cut_ns, story.joined_ns),
    ):
        streams = sum(stream["stream"].endswith(f"/{sensor}") for stream in report["streams"])
        assert len(holes[sensor]) == streams, (sensor, holes[sensor])
        assert all(from_ns - slack_ns < begin < end < to_ns + slack_ns for begin, end in holes[sensor]), sensor
    assert all(end - begin > CUT_S / 2 * SECOND_NS for begin, end in holes[BAND]), holes[BAND]
    happened = " ".join(event["what"] for event in report["events"])
    assert "driver_polar_h10_1" in happened, happened


def _check_steps(report: dict[str, Any], story: Story) -> None:
    steps = report["host_clock_steps"]
    assert len({step["host"] for step in steps}) == len(steps) > 0, steps  # every container is a host by its name
    for step in steps:
        assert abs(step["step_s"] - STEP_S) < 0.05
        assert abs(step["ros_ns"] - story.stepped_ns) < 4 * SECOND_NS


def _check_export(folder: Path, marks: dict[str, tuple[int, int]], out: Path) -> None:
    command = [sys.executable, "-m", "sense4hri_session", str(folder), "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    table = pd.read_parquet(out / "parquet" / "markers.parquet")
    _assert_marked("parquet", dict(zip(table["name"] + " " + table["value"], table["time_ns"], strict=True)), marks)
    streams, _ = pyxdf.load_xdf(str(out / "session.xdf"), dejitter_timestamps=False)
    named = {stream["info"]["name"][0]: stream for stream in streams}
    signal, texts = named[f"p2/ecg/{LATE}"], named["markers"]
    begun_ns = int(signal["info"]["desc"][0]["session_start_ns"][0])
    stamps_ns = [begun_ns + round(at * SECOND_NS) for at in texts["time_stamps"]]
    found = dict(zip([row[0] for row in texts["time_series"]], stamps_ns, strict=True))
    _assert_marked("xdf", found, marks)
    raw = mne.io.read_raw_edf(out / "edf" / f"p2_ecg_{LATE}.edf", verbose="error")
    begun_ns = round(raw.info["meas_date"].timestamp() * SECOND_NS)
    _assert_marked("edf", {a["description"]: begun_ns + round(a["onset"] * SECOND_NS) for a in raw.annotations}, marks)


def _assert_marked(what: str, found: dict[str, int], marks: dict[str, tuple[int, int]]) -> None:
    """Every mark is there, at the time of its press: before the command's end and after its beginning."""
    for name, (from_ns, to_ns) in marks.items():
        times = [at_ns for text, at_ns in found.items() if all(word in text for word in name.split())]
        assert len(times) == 1, (what, name, found)
        assert from_ns - SLACK_NS <= times[0] <= to_ns, (what, name, times[0] - from_ns)
