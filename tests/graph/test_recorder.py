"""The recorder as a process: what is in the file when things go wrong."""

import json
import re
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from ears import Ears
from lifecycle_msgs.msg import State
from mcap.reader import make_reader
from processes import Process, poll, withheld_s
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from sense4hri import diagnostics, qos
from sense4hri.crowd import MOST, TOO_MANY
from sense4hri.recorder_status import RecorderStatus
from sense4hri_recording.reader import Reader
from sense4hri_recording.repair import main as repair
from sensor_msgs.msg import Image
from std_msgs.msg import Header, String
from wall_clock import WallClock

BENCH = Path(__file__).resolve().parents[1] / "bench"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


class Recorder(Process):
    """A recorder with these parameters over its defaults, and without reports; killed at the end of `with`."""

    def __init__(self, folder: Path, env: Mapping[str, str] | None = None, **parameters: Any) -> None:
        given = {"directory": str(folder / "recordings"), "reports": False, **parameters}
        self.directory = Path(given["directory"])
        super().__init__(folder / "recorder.log", "recorder", env=env, parameters=given)

    def __enter__(self) -> "Recorder":
        self.until("recording to")
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    @property
    def folder(self) -> Path:
        return self.directory / (self.directory / "recording").read_text().strip()

    def status(self) -> dict[str, Any]:
        return self.ask("/recording")[1]

    def counts(self) -> dict[str, int]:
        """Messages of each topic that are in the recording, or on their way into it."""
        return {topic["topic"]: topic["messages"] for topic in self.status()["topics"]}


@pytest.fixture
def node(ears: Ears) -> Node:
    return ears.node


def matched(publisher: Any) -> None:
    poll(lambda: publisher.get_subscription_count() > 0, f"{publisher.topic_name} is recorded")


def said_until(publisher: Publisher, text: str, heard: Callable[[], bool]) -> int:
    """Say it again and again, until it was heard: how often. Best effort may lose the first of them."""
    said = []

    def say() -> bool:
        said.append(publisher.publish(String(data=text)))
        return heard()

    poll(say, f"{text} was heard", pause_s=0.2)
    return len(said)


def texts(recording: Path) -> dict[str, list[str]]:
    """The `data` of every String message, by topic, as rosbags reads them."""
    found: dict[str, list[str]] = {}
    with AnyReader([recording]) as reader:
        for connection, _, raw in reader.messages(c for c in reader.connections if c.msgtype == "std_msgs/msg/String"):
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype).data)
    return found


def send(recorder: Recorder, count: int, *publishers: Publisher) -> None:
    """Publish so many on each; once a socket's buffer could be full, only when those before have been taken in."""
    for i in range(count):
        if i and i % 50 == 0:
            poll(lambda i=i: all(recorder.counts().get(each.topic_name, 0) >= i for each in publishers), "taken in")
        for each in publishers:
            each.publish(String(data=str(i)))


def test_two_that_publish_the_same_are_no_loss(node, tmp_path):
    """A second one on a topic that came a moment ago numbers its messages itself."""
    names = [f"/study/shared_{k}" for k in range(8)]
    with Recorder(tmp_path) as recorder:
        for name in names:
            first = node.create_publisher(String, name, 200)
            matched(first)
            send(recorder, 5, first)
            second = node.create_publisher(String, name, 200)
            matched(second)
            send(recorder, 2, second, first, second)
        poll(lambda: all(recorder.counts()[name] == 11 for name in names), "all are taken in")
        assert recorder.stop() == 0
        topics = json.loads((recorder.folder / "recorder.json").read_text())["topics"]
    assert sum(one["lost"] for one in topics if one["topic"] in names) == 0


def test_terminated_it_has_lost_nothing(node, tmp_path):
    """After SIGTERM every message published before it is in the file, of late topics and best-effort ones too."""
    with Recorder(tmp_path) as recorder:
        first = node.create_publisher(String, "/study/first", 200)
        unreliable = node.create_publisher(String, "/study/unreliable", BEST_EFFORT)
        matched(first)
        matched(unreliable)
        send(recorder, 300, first)
        late = node.create_publisher(String, "/humans/physiological/p1/late", 200)
        latched = node.create_publisher(String, "/tf_static", LATCHED)
        latched.publish(String(data="for ever"))
        matched(late)
        matched(latched)
        send(recorder, 300, late, unreliable)
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
        poll(lambda: recorder.counts().get("/study/image"), "recorded")
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
        poll(lambda: recorder.counts().get("/study/x") == 1, "recorded")
        second = node.create_publisher(String, "/study/x", BEST_EFFORT)
        # best effort: what a publisher says before the recorder too knows of it is heard by nobody
        sent = {"first": 1, "second": said_until(second, "second", lambda: recorder.counts()["/study/x"] > 1)}
        sent["third"] = said_until(first, "third", lambda: recorder.counts()["/study/x"] > 1 + sent["second"])
        assert recorder.stop() == 0
        heard = Counter(texts(recorder.folder)["/study/x"])
        assert heard.keys() == sent.keys()
        assert heard <= Counter(sent)  # one subscription, in place of the one before


def test_killed_it_leaves_a_prefix(node, tmp_path):
    """After kill -9 the repaired folder holds a gap-free beginning that misses at most half a second.

    More only where this process or the recorder had to wait for a core.
    """
    with Recorder(tmp_path) as recorder:
        publisher = node.create_publisher(String, "/study/x", 200)
        matched(publisher)
        sent_s = []
        for i in range(200):
            publisher.publish(String(data=str(i)))
            sent_s.append(time.monotonic())
            time.sleep(0.01)
        killed_s, withheld = time.monotonic(), withheld_s(recorder.child.pid)
        recorder.kill()
        assert repair([str(recorder.folder)]) == 0
        found = texts(recorder.folder)["/study/x"]
    assert found == [str(i) for i in range(len(found))]
    waited_s = max(b - a for a, b in pairwise(sent_s)) - 0.01
    assert len(found) >= sum(at_s < killed_s - 0.5 - waited_s - withheld for at_s in sent_s)


def test_a_type_that_is_not_installed_is_said_once(node, tmp_path):
    """A topic of an unknown type is named in the log once, in the status and in the metrics; the rest is recorded."""
    hidden = tmp_path / "path" / "lifecycle_msgs"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").touch()
    with Recorder(tmp_path, {"PYTHONPATH": str(hidden.parent)}) as recorder:
        unknown = node.create_publisher(State, "/study/unknown", 10)
        known = node.create_publisher(String, "/study/known", 10)
        matched(known)
        recorder.until("NOT RECORDED: /study/unknown")
        known.publish(String(data="x"))
        unknown.publish(State())
        poll(lambda: "recorder_refused_topics{" in recorder.get("/metrics")[1], "metrics")
        poll(lambda: re.search(r"refused_topics\{[^}]*\} 1\.0", recorder.get("/metrics")[1]), "counted")
        assert any("lifecycle_msgs/msg/State" in reason for reason in recorder.status()["reasons"])
        assert recorder.log().count("NOT RECORDED") == 1
        assert recorder.stop() == 0
        assert texts(recorder.folder)["/study/known"] == ["x"]


@pytest.mark.parametrize("wanted", [False, True])
def test_what_identifies_people_is_left_out_unless_asked_for(node, tmp_path, wanted):
    """Faces' images and names are in the file only with record_identifying."""
    with Recorder(tmp_path, record_identifying=wanted) as recorder:
        image = node.create_publisher(Image, "/humans/faces/f1/cropped", 10)
        name = node.create_publisher(String, "/humans/persons/p1/name", LATCHED)
        plain = node.create_publisher(String, "/humans/persons/p1/face_id", LATCHED)
        matched(plain)
        if wanted:
            matched(image)
            matched(name)
        else:
            poll(lambda: len(recorder.status()["withheld"]) == 2, "withheld")
            assert image.get_subscription_count() == name.get_subscription_count() == 0
        image.publish(Image())
        name.publish(String(data="Ada"))
        plain.publish(String(data="f1"))
        poll(lambda: recorder.status()["messages"] >= (3 if wanted else 1), "recorded")
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
        said_until(publisher, "first", lambda: recorder.counts().get("/study/flood", 0) > 0)
        recorder.send(signal.SIGSTOP)
        for _ in range(3000):
            publisher.publish(String(data="x" * 2000))
        recorder.send(signal.SIGCONT)

        def topic() -> dict[str, Any]:
            publisher.publish(String(data="last"))
            return next(t for t in recorder.status()["topics"] if t["topic"] == "/study/flood")

        poll(lambda: topic()["lost"] > 0, "losses counted")
        assert recorder.stop() == 0
        found = texts(recorder.folder)["/study/flood"]
        said = re.search(r"(\d+) messages, (\d+) lost", recorder.log())
    assert said is not None
    assert int(said[2]) > 0
    assert found[0] == "first"


def test_losses_are_counted_beside_another_publisher(node, tmp_path):
    """What the histories of two publishers of one topic could not keep for a stopped recorder is counted of both."""
    own = [node.create_publisher(String, "/study/own", 200) for _ in range(2)]
    with Recorder(tmp_path) as recorder:
        for publisher in own:
            matched(publisher)
        recorder.send(signal.SIGSTOP)
        for i in range(5000):
            for publisher in own[: 1 + (i % 3 > 0)]:
                publisher.publish(String(data=f"{i}" + "x" * 2000))
        recorder.send(signal.SIGCONT)
        sent = 5000 + 3333

        def told() -> dict[str, Any]:
            found = [one for one in recorder.status()["topics"] if one["topic"] == "/study/own"]
            return found[0] if found else {"messages": 0, "lost": 0, "missed_at_start": 0}

        def counted() -> bool:
            nonlocal sent
            for publisher in own:
                publisher.publish(String(data="last"))
            sent += 2
            return told()["messages"] > 2

        poll(counted, "it hears them again")
        poll(lambda: told()["messages"] + told()["lost"] == sent, lambda: f"{told()} of {sent}")
        assert told()["lost"] > 2000
        assert recorder.stop() == 0
        assert len(texts(recorder.folder)["/study/own"]) + told_at_the_end(recorder, "/study/own") == sent


def told_at_the_end(recorder: Recorder, topic: str) -> int:
    """How many messages of a topic are lost, as recorder.json says."""
    topics = json.loads((recorder.folder / "recorder.json").read_text())["topics"]
    return sum(one["lost"] for one in topics if one["topic"] == topic)


def flooded(recorder: Recorder) -> int:
    """How many topics of a flood it records."""
    return sum("/flood_" in topic for topic in recorder.counts())


def left_out(recorder: Recorder) -> int:
    """How many topics it has named as those of too many of a process."""
    return sum("NOT RECORDED" in line and TOO_MANY in line for line in recorder.log().splitlines())


def test_silent_topics_of_a_stranger_keep_no_stream_waiting(node, tmp_path):
    """Beside 500 topics of one node the study's own are taken in at once: the recorder is not behind, none is lost.

    Of the stranger's as many are recorded as a process may have; every other is named.
    """
    with Recorder(tmp_path) as recorder:
        own = node.create_publisher(String, "/study/own", 1000)
        matched(own)
        flood = Process(tmp_path / "flood.log", BENCH / "flood_publisher.py", "500", "0", "100", "3600")
        try:
            poll(lambda: flooded(recorder) == MOST, lambda: f"{MOST} are recorded, not {flooded(recorder)}")
            behind_s, withheld = [], withheld_s(recorder.child.pid)
            for i in range(4000):
                own.publish(String(data=str(i)))
                if i % 200 == 199:
                    poll(
                        lambda i=i: recorder.counts()["/study/own"] > i - 800,
                        "no more in flight than the history holds",
                    )
                    found = re.search(r"recorder_behind_seconds\{.*\} (.+)", recorder.get("/metrics")[1])
                    behind_s.append(float(found[1]))
            withheld = withheld_s(recorder.child.pid) - withheld
            assert flooded(recorder) == MOST
            poll(lambda: left_out(recorder) == 500 - MOST, lambda: f"{left_out(recorder)} others are named")
            assert flood.child.poll() is None, flood.log()
            assert recorder.stop() == 0
        finally:
            flood.kill()
        assert texts(recorder.folder)["/study/own"] == [str(i) for i in range(4000)]
        assert median(behind_s) < 1.0 + withheld


@pytest.mark.parametrize("thread", ["hearing", "writing"])
def test_a_thread_that_hangs_is_told_and_ends_the_recorder(start, ears, tmp_path, thread):
    """It says on /diagnostics that it does not record and why, is not ready, and is ended where it stays so."""
    told = ears.hear(DiagnosticArray, diagnostics.TOPIC, qos.deep(qos.HEALTH))

    def newest() -> str:
        ears.spin()
        found = [each for each in (RecorderStatus.parse(one) for array in told for one in array.status) if each]
        return found[-1].message if found else ""

    env = {"HANG": thread, "HANG_AT": str(tmp_path / "hang")}
    recorder = start("hung_recorder.py", env=env, directory=tmp_path / "recordings", reports=False)
    poll(lambda: newest() == "records", lambda: f"it records: {newest()}")
    (tmp_path / "hang").touch()
    why = f"NOT RECORDING: no answer from the {thread} thread"
    poll(lambda: newest().startswith(why), lambda: f"{why}: {newest()}")
    assert recorder.wait() == 1
    assert f"no answer from the {thread} thread for" in recorder.log()


def test_a_full_disk_is_said_and_survived(node, tmp_path):
    """On a full disk the recorder says so, is not ready, counts what it loses, and ends with a readable file."""
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=6m", "none", str(small)], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip("no right to mount a small file system")
    try:
        with Recorder(tmp_path, directory=str(small), compression="none", free_floor_mb=0) as recorder:
            publisher = node.create_publisher(String, "/study/x", 200)
            matched(publisher)
            sent = 0

            def full() -> bool:
                nonlocal sent
                for _ in range(20):
                    publisher.publish(String(data=f"{sent:06d}" + "x" * 5000))
                    sent += 1
                return "NOT RECORDING" in recorder.log()

            poll(full, "the disk is full")
            assert "No space left on device" in recorder.log()
            assert recorder.get("/readyz")[0] == 503
            assert recorder.status()["recording"] is False
            poll(lambda: (full(), recorder.status()["lost"] > 0)[1], "losses are counted")
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
    with Recorder(tmp_path, clock.env, split_s=0.8) as recorder:
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

            poll(send, what)

        def files() -> int:
            return len([*folder.glob("*.mcap")])

        def size() -> int:
            return sum(path.stat().st_size for path in folder.glob("*.mcap"))

        def shown() -> float:
            return float(re.findall(r"recorder_written_messages\{.*\} (.+)", recorder.get("/metrics")[1])[-1])

        def heard() -> set[str]:
            return {topic for topic, messages in recorder.counts().items() if messages}

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
    assert [step for step in steps if step < 0] == [pytest.approx(-3600e9, abs=60e9)]
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
    ("name", "value"),
    [
        ("directory", "/proc/nowhere"),
        ("record_when", "never"),
        ("patterns", ["no_slash"]),
        ("flush_interval_s", "soon"),
    ],
)
def test_a_wrong_parameter_ends_with_78(ros_domain, tmp_path, name, value):
    """A configuration that cannot work is one line that names the parameter, and status 78."""
    recorder = Recorder(tmp_path, **{name: value})
    assert recorder.wait() == 78
    assert name in recorder.log()
