"""replay as a process: the law, refusals, control over HTTP."""

import json
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
from mcap.writer import Writer
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

sys.path.insert(0, str(Path(__file__).parent))
from replay_law import (
    bags,
    between,
    chosen,
    computed,
    differences,
    opened_inside,
    port,
    process,
    recompute,
    stamp_ns,
)
from replay_live import study

STRING = "string data\n"
SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS
LATCHED = "- {reliability: reliable, durability: transient_local, history: keep_last, depth: 1}"
RELIABLE = "- {reliability: reliable, durability: volatile, history: keep_last, depth: 10}"


def wait_for(condition, what: str, seconds: float = 20.0) -> Any:
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.02)
    return result


@pytest.fixture
def node(ros_domain: int) -> Iterator[Any]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("replay_test", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """20 s of /count at 10 Hz, a /said that late listeners are told, and /unknown of a type nobody has."""
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1000)
        writer.start(profile="ros2")
        string = writer.register_schema("std_msgs/msg/String", "ros2msg", STRING.encode())
        other = writer.register_schema("nobody_msgs/msg/Has", "ros2msg", STRING.encode())
        count = writer.register_channel("/count", "cdr", string, {"offered_qos_profiles": RELIABLE})
        said = writer.register_channel("/said", "cdr", string, {"offered_qos_profiles": LATCHED})
        unknown = writer.register_channel("/unknown", "cdr", other, {})
        for i in range(200):
            stamp = START_NS + i * SECOND_NS // 10
            if i % 50 == 0:
                writer.add_message(said, stamp, serialize_message(String(data=f"said {i}")), stamp)
                writer.add_message(unknown, stamp, serialize_message(String()), stamp)
            writer.add_message(count, stamp, serialize_message(String(data=str(i))), stamp)
        writer.finish()
    return path


class Heard:
    """What came on /count and /said, in order."""

    def __init__(self, node: Any) -> None:
        self._node = node
        self.count: list[int] = []
        self.said: list[str] = []
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(String, "/count", lambda m: self.count.append(int(m.data)), 1000)
        node.create_subscription(String, "/said", lambda m: self.said.append(m.data), latched)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)

    def until(self, condition, what: str, seconds: float = 20.0) -> None:
        deadline = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < deadline, f"not within {seconds} s: {what}; {self.count[-3:]} {self.said}"
            self._executor.spin_once(timeout_sec=0.02)


def ask(log: Path, path: str, body: dict[str, Any] | None = None) -> tuple[int, Any]:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(f"http://127.0.0.1:{port(log)}{path}", data)
    try:
        with urllib.request.urlopen(request, timeout=5) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as err:
        with err:
            return err.code, json.load(err)


def test_everything_arrives_once_and_in_order(node, bag, tmp_path):
    """As fast as the subscriber keeps up, every message arrives once, in order; an unknown type is refused by name."""
    heard = Heard(node)
    with process("replay", tmp_path / "replay.log", f"bag:='{bag}'", "rate:=0.0") as replay:
        heard.until(lambda: heard.count and heard.count[-1] == 199, "the last message")
        assert replay.wait(10) == 0
    assert heard.count == list(range(200))
    assert heard.said == [f"said {i}" for i in (0, 50, 100, 150)]
    assert (
        "NOT PLAYED: /unknown: its type nobody_msgs/msg/Has is not installed" in (tmp_path / "replay.log").read_text()
    )


def test_pause_seek_and_stop_over_http(node, bag, tmp_path):
    """A seek while paused goes on there after resuming, and says first what had been said before that place."""
    heard, log = Heard(node), tmp_path / "replay.log"
    with process("replay", log, f"bag:='{bag}'", "rate:=2.0", "linger_s:=0.0") as replay:
        heard.until(lambda: len(heard.count) > 3, "playing")
        assert ask(log, "/pause", {})[1]["state"] == "paused"
        assert ask(log, "/seek", {"s": 99})[0] == 400
        assert ask(log, "/seek", {"s": 12.05})[0] == 200
        assert ask(log, "/rate", {"rate": 20})[1]["rate"] == 20
        assert ask(log, "/play", {"bag": str(bag)})[0] == 409
        assert heard.count[-1] < 100
        assert ask(log, "/resume", {})[0] == 200
        heard.until(lambda: heard.count[-1] > 130, "what comes after the seek")
        assert ask(log, "/stop", {})[0] == 200
        assert replay.wait(10) == 0
    skipped = [b for a, b in zip(heard.count, heard.count[1:], strict=False) if b != a + 1]
    assert skipped == [121]
    assert "said 100" in heard.said


def test_a_topic_that_somebody_publishes_is_refused(node, bag, tmp_path):
    """Nothing is mixed into a live topic: it is left out, and the node is named; the rest is played."""
    node.create_publisher(String, "/count", 10)
    heard, log = Heard(node), tmp_path / "replay.log"
    with process("replay", log, f"bag:='{bag}'", "rate:=20.0", "linger_s:=0.0"):
        heard.until(lambda: "said 150" in heard.said, "the other topic")
        assert "published already, by /replay_test" in ask(log, "/status")[1]["refused"]["/count"]
    assert heard.count == []


def test_it_waits_for_a_bag_and_refuses_nonsense(node, bag, tmp_path):
    """Without a bag, POST /play starts one; unknown fields and files are answered with 400."""
    heard, log = Heard(node), tmp_path / "replay.log"
    with process("replay", log, "linger_s:=0.0"):
        assert ask(log, "/status") == (200, {"state": "idle"})
        assert ask(log, "/pause", {})[0] == 409
        assert "speed" in ask(log, "/play", {"bag": str(bag), "speed": 2})[1]["error"]
        assert "does not exist" in ask(log, "/play", {"bag": str(tmp_path / "none")})[1]["error"]
        assert ask(log, "/play", {"bag": str(bag), "rate": 0, "topics": ["/count"]})[0] == 200
        heard.until(lambda: heard.count and heard.count[-1] == 199, "the last message")
        wait_for(lambda: ask(log, "/status")[1]["state"] == "idle", "idle again")


@pytest.mark.parametrize(
    "parameter", ["bag:=/none", "rate:=-1.0", "what:=half", "remap:=['/a']", "topics:=['a']", "start_s:=1000.0"]
)
def test_a_wrong_parameter_is_named(ros_domain, bag, parameter):
    """Status 78 and one line with the parameter's name."""
    given = {"bag": f"bag:='{bag}'", parameter.partition(":=")[0]: parameter}
    command = [sys.executable, "-m", "replay", "--ros-args", *(w for p in given.values() for w in ("-p", p))]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert ended.returncode == 78
    last = ended.stderr.strip().splitlines()[-1]
    assert last.startswith("replay: configuration: ")
    assert f"'{parameter.partition(':=')[0]}'" in last


def test_a_loop_and_its_clock(node, bag, tmp_path):
    """A loop says everything again in order, latched topics too; /clock follows the recorded time, and goes back."""
    heard, log = Heard(node), tmp_path / "replay.log"
    ticks: list[int] = []
    node.create_subscription(Clock, "/clock", lambda m: ticks.append(m.clock.sec * SECOND_NS + m.clock.nanosec), 1000)
    with process("replay", log, f"bag:='{bag}'", "rate:=50.0", "loop:=true", "clock:=true", "start_s:=19.0"):
        heard.until(lambda: heard.count.count(199) >= 3, "the third round")
        assert ask(log, "/status")[1]["rounds"] >= 2
        assert ask(log, "/stop", {})[0] == 200
    first_round = heard.count[: heard.count.index(199) + 1]
    assert first_round == list(range(190, 200))
    assert heard.count[10:210] == list(range(200))
    assert min(ticks) >= START_NS
    assert max(ticks) <= START_NS + 20 * SECOND_NS
    backwards = [b for a, b in pairwise(ticks) if b < a]
    assert backwards
    assert max(backwards) < START_NS + SECOND_NS


@pytest.mark.timeout(240)
def test_the_law(ros_domain, tmp_path):
    """Recomputed at 1x and 20x everything is equal; from start_at, and the first clock segment inside, also to live."""
    recordings, start_ns, stop_ns = study(tmp_path / "live", 13.0)
    (bag,) = (found for found in bags(recordings) if "/humans/" in (found / "metadata.yaml").read_text())
    live = computed(recordings)
    once, fast = (computed(recompute(bag, rate, tmp_path / f"at_{rate:g}")) for rate in (1.0, 20.0))
    assert differences(once, fast) == []
    said = ("/features", "/state")
    session = between(live, start_ns, stop_ns)
    until_ns = min(stamp_ns(messages[-1]) for messages in chosen(session, *said).values())
    assert until_ns > stop_ns - 4 * SECOND_NS
    of_session = (chosen(between(them, start_ns, until_ns + 1), *said) for them in (live, once))
    assert differences(*of_session) == []
    (states,) = chosen(session, "/state").values()
    assert len({(state.state, state.expression) for state in states}) >= 3
    assert all(len(models) >= 5 for models in opened_inside(live).values())
    assert differences(opened_inside(live), opened_inside(once)) == []
