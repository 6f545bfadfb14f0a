"""The recorder as a process: what is in the file when things go wrong."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import rclpy
from lifecycle_msgs.msg import State
from mcap.reader import make_reader
from processes import DEADLINE_S
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from sense4hri_recording.reader import Reader
from sense4hri_recording.repair import main as repair
from sensor_msgs.msg import Image
from std_msgs.msg import Header, String
from wall_clock import WallClock

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


def wait_for(condition, what: str, seconds: float = 20.0) -> Any:
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.02)
    return result


class Recorder:
    """One recorder process."""

    def __init__(self, folder: Path, *arguments: str, **environment: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.directory, self.log = folder / "recordings", folder / "log"
        command = [sys.executable, "-m", "recorder", "--ros-args", "-p", f"directory:={self.directory}"]
        command += ["-p", "reports:=false"]
        for argument in arguments:
            command += ["-p", argument]
        with self.log.open("w") as log:
            self.process = subprocess.Popen(command, stderr=log, env=os.environ | environment)

    def __enter__(self) -> "Recorder":
        wait_for(lambda: "recording to" in self.text(), "recording")
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait(10)

    def text(self) -> str:
        assert self.process.poll() is None, self.log.read_text()
        return self.log.read_text()

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(10)

    @property
    def folder(self) -> Path:
        return self.directory / (self.directory / "recording").read_text().strip()

    def get(self, path: str) -> tuple[int, str]:
        port = re.search(r"metrics on port (\d+)", self.text())
        assert port is not None
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port[1]}{path}", timeout=5) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as err:
            with err:
                return err.code, err.read().decode()

    def status(self) -> dict[str, Any]:
        return json.loads(self.get("/recording")[1])


@pytest.fixture
def node(ros_domain: int) -> Iterator[Any]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("recorder_test", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def matched(publisher: Any) -> None:
    wait_for(lambda: publisher.get_subscription_count() > 0, f"{publisher.topic_name} is recorded")


def texts(recording: Path) -> dict[str, list[str]]:
    """The `data` of every String message, by topic, as rosbags reads them."""
    found: dict[str, list[str]] = {}
    with AnyReader([recording]) as reader:
        for connection, _, raw in reader.messages(c for c in reader.connections if c.msgtype == "std_msgs/msg/String"):
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype).data)
    return found


def test_terminated_it_has_lost_nothing(node, tmp_path):
    """After SIGTERM every message published before it is in the file, of late topics and best-effort ones too."""
    with Recorder(tmp_path) as recorder:
        first = node.create_publisher(String, "/study/first", 200)
        unreliable = node.create_publisher(String, "/study/unreliable", BEST_EFFORT)
        matched(first)
        matched(unreliable)
        for i in range(300):
            first.publish(String(data=str(i)))
            time.sleep(0.002)  # a burst that overflows a starved socket is repeated only seconds later
        late = node.create_publisher(String, "/humans/physiological/p1/late", 200)
        latched = node.create_publisher(String, "/tf_static", LATCHED)
        latched.publish(String(data="for ever"))
        matched(late)
        for i in range(300):
            late.publish(String(data=str(i)))
            unreliable.publish(String(data=str(i)))
            time.sleep(0.002)
        matched(latched)
        assert recorder.stop() == 0
        found = texts(recorder.folder)
    numbers = [str(i) for i in range(300)]
    assert found["/study/first"] == numbers
    assert found["/humans/physiological/p1/late"] == numbers
    assert found["/study/unreliable"] == numbers
    assert found["/tf_static"] == ["for ever"]


def test_the_receipt_is_the_log_time_and_the_header_the_publish_time(node, tmp_path):
    """A type that begins with a Header keeps its stamp as publish time; rosbags sees the receipt."""
    with Recorder(tmp_path) as recorder:
        publisher = node.create_publisher(Header, "/study/header", 10)
        image = node.create_publisher(Image, "/study/image", 10)
        matched(publisher)
        matched(image)
        before = time.time_ns()
        message = Image(height=1)
        message.header.stamp.sec = 42
        image.publish(message)
        wait_for(lambda: recorder.status()["messages"] >= 1, "recorded")
        after = time.time_ns()
        assert recorder.stop() == 0
        with next(recorder.folder.glob("*.mcap")).open("rb") as file:
            stamps = [(m.log_time, m.publish_time) for _, _, m in make_reader(file).iter_messages(["/study/image"])]
    assert len(stamps) == 1
    assert before <= stamps[0][0] <= after
    assert stamps[0][1] == 42_000_000_000


def test_a_weaker_publisher_that_joins_is_recorded_too(node, tmp_path):
    """When a best-effort publisher joins a reliable one the recorder asks for less, and hears both."""
    with Recorder(tmp_path) as recorder:
        first = node.create_publisher(String, "/study/x", 50)
        matched(first)
        first.publish(String(data="first"))
        wait_for(lambda: recorder.status()["messages"] >= 1, "recorded")
        second = node.create_publisher(String, "/study/x", BEST_EFFORT)
        matched(second)
        matched(first)
        second.publish(String(data="second"))
        first.publish(String(data="third"))
        wait_for(
            lambda: sum(t["messages"] for t in recorder.status()["topics"] if t["topic"] == "/study/x") == 3, "all"
        )
        assert recorder.stop() == 0
        assert sorted(texts(recorder.folder)["/study/x"]) == ["first", "second", "third"]


def test_killed_it_leaves_a_prefix(node, tmp_path):
    """After kill -9 the repaired folder holds a gap-free beginning that misses at most half a second."""
    with Recorder(tmp_path) as recorder:
        publisher = node.create_publisher(String, "/study/x", 200)
        matched(publisher)
        for i in range(200):
            publisher.publish(String(data=str(i)))
            time.sleep(0.01)
        recorder.process.send_signal(signal.SIGKILL)
        recorder.process.wait(10)
        assert repair([str(recorder.folder)]) == 0
        found = texts(recorder.folder)["/study/x"]
    assert found == [str(i) for i in range(len(found))]
    assert len(found) >= 150


def test_a_type_that_is_not_installed_is_said_once(node, tmp_path):
    """A topic of an unknown type is named in the log once, in the status and in the metrics; the rest is recorded."""
    hidden = tmp_path / "path" / "lifecycle_msgs"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").touch()
    with Recorder(tmp_path, PYTHONPATH=str(hidden.parent)) as recorder:
        unknown = node.create_publisher(State, "/study/unknown", 10)
        known = node.create_publisher(String, "/study/known", 10)
        matched(known)
        wait_for(lambda: "NOT RECORDED: /study/unknown" in recorder.text(), "the unknown type is reported")
        known.publish(String(data="x"))
        unknown.publish(State())
        wait_for(lambda: "recorder_refused_topics{" in recorder.get("/metrics")[1], "metrics")
        wait_for(lambda: re.search(r"refused_topics\{[^}]*\} 1\.0", recorder.get("/metrics")[1]), "counted")
        assert any("lifecycle_msgs/msg/State" in reason for reason in recorder.status()["reasons"])
        assert recorder.text().count("NOT RECORDED") == 1
        assert recorder.stop() == 0
        assert texts(recorder.folder)["/study/known"] == ["x"]


@pytest.mark.parametrize("wanted", [False, True])
def test_what_identifies_people_is_left_out_unless_asked_for(node, tmp_path, wanted):
    """Faces' images and names are in the file only with record_identifying."""
    with Recorder(tmp_path, f"record_identifying:={str(wanted).lower()}") as recorder:
        image = node.create_publisher(Image, "/humans/faces/f1/cropped", 10)
        name = node.create_publisher(String, "/humans/persons/p1/name", LATCHED)
        plain = node.create_publisher(String, "/humans/persons/p1/face_id", LATCHED)
        matched(plain)
        if wanted:
            matched(image)
            matched(name)
        else:
            wait_for(lambda: len(recorder.status()["withheld"]) == 2, "withheld")
            assert image.get_subscription_count() == name.get_subscription_count() == 0
        image.publish(Image())
        name.publish(String(data="Ada"))
        plain.publish(String(data="f1"))
        wait_for(lambda: recorder.status()["messages"] >= (3 if wanted else 1), "recorded")
        assert recorder.stop() == 0
        with AnyReader([recorder.folder]) as reader:
            topics = {connection.topic for connection in reader.connections}
    assert ({"/humans/faces/f1/cropped", "/humans/persons/p1/name"} <= topics) == wanted
    assert "/humans/persons/p1/face_id" in topics


def test_lost_messages_are_counted(node, tmp_path):
    """What a stopped process did not take in is counted by the gaps in the publisher's numbers."""
    with Recorder(tmp_path) as recorder:
        publisher = node.create_publisher(String, "/study/flood", BEST_EFFORT)
        matched(publisher)
        publisher.publish(String(data="first"))
        wait_for(lambda: recorder.status()["messages"] >= 1, "recorded")
        recorder.process.send_signal(signal.SIGSTOP)
        for _ in range(3000):
            publisher.publish(String(data="x" * 2000))
        recorder.process.send_signal(signal.SIGCONT)

        def topic() -> dict[str, Any]:
            publisher.publish(String(data="last"))
            return next(t for t in recorder.status()["topics"] if t["topic"] == "/study/flood")

        wait_for(lambda: topic()["lost"] > 0, "losses counted")
        assert recorder.stop() == 0
        found = texts(recorder.folder)["/study/flood"]
        said = re.search(r"(\d+) messages, (\d+) lost", recorder.log.read_text())
    assert said is not None
    assert int(said[2]) > 0
    assert found[0] == "first"


def test_a_full_disk_is_said_and_survived(node, tmp_path):
    """On a full disk the recorder says so, is not ready, counts what it loses, and ends with a readable file."""
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=6m", "none", str(small)], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip("no right to mount a small file system")
    try:
        with Recorder(tmp_path, f"directory:={small}", "compression:=none", "free_floor_mb:=0") as recorder:
            recorder.directory = small
            publisher = node.create_publisher(String, "/study/x", 200)
            matched(publisher)
            sent = 0

            def full() -> bool:
                nonlocal sent
                for _ in range(20):
                    publisher.publish(String(data=f"{sent:06d}" + "x" * 5000))
                    sent += 1
                return "NOT RECORDING" in recorder.text()

            wait_for(full, "the disk is full")
            assert "No space left on device" in recorder.text()
            assert recorder.get("/readyz")[0] == 503
            assert recorder.status()["recording"] is False
            wait_for(lambda: (full(), recorder.status()["lost"] > 0)[1], "losses are counted")
            assert recorder.stop() == 0
            found = texts(recorder.folder)["/study/x"]
        assert [text[:6] for text in found] == [f"{i:06d}" for i in range(len(found))]
        assert 50 < len(found) < sent
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_a_wall_clock_set_back_an_hour_changes_the_stamps_alone(node, tmp_path):
    """Set back while recording: all is there in the order it came, and flushes, splits and metrics go on in time.

    The step is an event of recorder.json; a SIGTERM ends the recording as ever.
    """
    clock, sent = WallClock(tmp_path), 0
    with Recorder(tmp_path, "split_s:=0.8", **clock.env) as recorder:
        publisher = node.create_publisher(String, "/study/x", 200)
        latched = node.create_publisher(String, "/study/state", LATCHED)
        latched.publish(String(data="holds"))
        matched(publisher)
        matched(latched)
        folder = recorder.folder

        def until(condition, what: str) -> None:
            """Publish meanwhile. The deadline is far below the hour that a timer of the wall clock would wait."""

            def send() -> bool:
                nonlocal sent
                publisher.publish(String(data=str(sent)))
                sent += 1
                return condition()

            wait_for(send, what)

        def files() -> int:
            return len([*folder.glob("*.mcap")])

        def size() -> int:
            return sum(path.stat().st_size for path in folder.glob("*.mcap"))

        def shown() -> float:
            return float(re.findall(r"recorder_written_messages\{.*\} (.+)", recorder.get("/metrics")[1])[-1])

        def heard() -> set[str]:
            return {topic["topic"] for topic in recorder.status()["topics"] if topic["messages"]}

        until(lambda: heard() >= {"/study/x", "/study/state"}, "both topics, before the step")
        until(lambda: files() >= 2, "a second file")
        before, split = sent, files()
        clock.step(-3600.0)
        flushed = size()
        until(lambda: size() > flushed, "flushed")
        until(lambda: files() >= split + 2, "two more files")
        until(lambda: shown() > before, "the metrics")
        assert recorder.stop() == 0
    session = Reader(folder)
    records = [*session.messages(["/study/x"])]
    assert [session.decode(record).data for record in records] == [str(i) for i in range(sent)]
    steps = [after.log_ns - before.log_ns for before, after in pairwise(records)]
    assert [step for step in steps if step < 0] == [pytest.approx(-3600e9, abs=DEADLINE_S * 1e9)]
    written = [numbered(file) for file in session.files]
    came = next(index for index, found in enumerate(written) if ("/study/state", 1) in found)
    assert written[came + 1 :]
    for first, *others in written[came + 1 :]:  # /rosout is a log: not repeated
        assert first == ("/study/state", 0)
        assert all(number for _, number in others)
    about = json.loads((folder / "recorder.json").read_text())
    (event,) = about["events"]
    said = re.fullmatch(r"host clock stepped by (\S+) s", event["what"])
    assert said is not None, event
    assert float(said[1]) == pytest.approx(-3600.0, abs=1.0)  # two clocks are read one after the other
    topic = next(topic for topic in about["topics"] if topic["topic"] == "/study/x")
    assert (about["state"], topic["messages"], topic["lost"], topic["missed_at_start"]) == ("complete", sent, 0, 0)


def numbered(file: Path) -> list[tuple[str, int]]:
    """Topic and number of every message, in the order they were written; 0 is one repeated from the file before."""
    with file.open("rb") as stream:
        messages = make_reader(stream).iter_messages(log_time_order=False)
        return [(channel.topic, message.sequence) for _, channel, message in messages]


@pytest.mark.parametrize(
    ("argument", "named"),
    [
        ("directory:=/proc/nowhere", "directory"),
        ("record_when:=never", "record_when"),
        ("patterns:=[no_slash]", "patterns"),
        ("flush_interval_s:=soon", "flush_interval_s"),
    ],
)
def test_a_wrong_parameter_ends_with_78(ros_domain, tmp_path, argument, named):
    """A configuration that cannot work is one line that names the parameter, and status 78."""
    recorder = Recorder(tmp_path, argument)
    assert recorder.process.wait(20) == 78
    assert named in recorder.log.read_text()
