"""fusion-affect as a process; the test plays the interpreters, the drivers' health and ROS4HRI."""

import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from hri_msgs.msg import Expression, IdsList
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import ECG, PPG, SensorAssignment, SensorAssignmentArray, UserState
from std_msgs.msg import String

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class World:
    """What fusion-affect hears, and what it says; `send` is called again and again while a test waits."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("world", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.states: dict[str, list[UserState]] = {}
        self.publishers: dict[str, Any] = {}
        self.rates: dict[StreamName, float] = {}
        self.faces: tuple[str, ...] = ()
        self.expressions: dict[str, str] = {}
        self.sent_s = 0.0

    def listen(self, human_id: str) -> None:
        got = self.states.setdefault(human_id, [])
        self.node.create_subscription(UserState, f"/humans/physiological/{human_id}/state", got.append, qos.STATE)

    def publish(self, topic: str, message: Any, profile: QoSProfile) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, profile)
        self.publishers[topic].publish(message)

    def send(self) -> None:
        """Rates and faces stamped now; expressions without a stamp, as the recogniser sends them."""
        stamp = from_ns(time.time_ns())
        tracked = IdsList(ids=list(self.faces))
        tracked.header.stamp = stamp
        self.publish("/humans/faces/tracked", tracked, QoSProfile(depth=1))
        for face_id, word in self.expressions.items():
            message = Expression(expression=word, confidence=0.9)
            self.publish(f"/humans/faces/{face_id}/expression", message, QoSProfile(depth=10))
        for name, bpm in self.rates.items():
            features = (ECG if name.sensor_type == "ecg" else PPG)(
                heart_rate_bpm=bpm, signal_quality=0.9, window_s=10.0
            )
            features.header.stamp = stamp
            self.publish(name.topic("features"), features, qos.FEATURES)

    def until(self, true: Callable[[], Any], what: str, timeout_s: float = 60.0) -> Any:
        """Keep the world going until true() is; fail with `what` at the deadline."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if value := true():
                return value
            if time.monotonic() - self.sent_s > 0.25:
                self.sent_s = time.monotonic()
                self.send()
            self.executor.spin_once(timeout_sec=0.05)
        last = {human: states[-1:] for human, states in self.states.items()}
        pytest.fail(f"not within {timeout_s} s: {what}; last: {last}")

    def state(self, human_id: str, state: str) -> UserState:
        """Wait for a new state of this participant."""
        seen = self.states[human_id]
        seen.clear()
        self.until(lambda: seen and seen[-1].state == state, f"{human_id} is {state}")
        return seen[-1]

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Fusion:
    """The process under test."""

    def __init__(self, log: Path, *parameters: str) -> None:
        self.log = log
        arguments = [word for parameter in parameters for word in ("-p", parameter)]
        with log.open("wb") as output:
            command = [sys.executable, "-m", "fusion_affect", "--ros-args", *arguments]
            self.process = subprocess.Popen(command, stdout=output, stderr=output)

    def metric(self, name: str) -> float:
        port = self.log.read_text().split("metrics on port ")[1].split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as answer:
            lines = [line for line in answer.read().decode().splitlines() if line.startswith(name)]
        return float(lines[0].split()[-1])

    def stop(self) -> int:
        self.process.terminate()
        try:
            return self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait(5)


@pytest.fixture
def world(ros_domain: int) -> Iterator[World]:
    world = World()
    yield world
    world.close()


@pytest.fixture
def fusion(ros_domain: int, tmp_path: Path) -> Iterator[Fusion]:
    fusion = Fusion(tmp_path / "fusion.log")
    yield fusion
    if fusion.process.poll() is None:
        fusion.stop()


def test_from_expression_and_heart_rate_to_state(world: World, fusion: Fusion) -> None:
    """One wearer before one camera: the state follows heart rate and expression, or is unknown with a reason."""
    ecg, ppg = StreamName("p1", "ecg", "h10_1"), StreamName("p1", "ppg", "verity_1")
    world.listen("p1")
    world.rates, world.faces, world.expressions = {ecg: 70.0, ppg: 71.0}, ("abcde",), {"abcde": "neutral"}
    calm = world.state("p1", "calm_relaxed")
    assert calm.heart_rate_bpm == pytest.approx(70.5)
    assert (calm.face_id, calm.expression, calm.header.frame_id) == ("abcde", "neutral", "p1")
    assert calm.header.stamp.nanosec == 0
    assert calm.reasons

    world.expressions = {"abcde": "scared"}
    world.rates = {ecg: 110.0, ppg: 110.0}
    world.state("p1", "stressed_anxious")
    world.rates = {ecg: 110.0, ppg: 70.0}
    assert any("disagree" in reason for reason in world.state("p1", "unknown").reasons)
    world.rates = {ecg: 70.0, ppg: 70.0}
    world.state("p1", "alert_active")
    world.faces = ("abcde", "fghij")
    assert any("2 faces" in reason for reason in world.state("p1", "unknown").reasons)
    assert fusion.metric("sense4hri_unstamped_expressions_total") > 0
    assert fusion.stop() == 0


def test_persons_and_assignments_that_were_there_before(world: World, ros_domain: int, tmp_path: Path) -> None:
    """Latched persons and assignments sent before the fusion started still tell two participants' faces apart."""
    world.listen("p1")
    world.listen("p2")
    world.faces, world.expressions = ("f1", "f2"), {"f1": "neutral", "f2": "angry"}
    world.rates = {StreamName("p1", "ecg", "h10_1"): 70.0, StreamName("p2", "ecg", "h10_2"): 100.0}
    world.publish("/humans/persons/tracked", IdsList(ids=["p1", "anna"]), LATCHED)
    world.publish("/humans/persons/p1/face_id", String(data="f1"), LATCHED)
    world.publish("/humans/persons/anna/face_id", String(data="f2"), LATCHED)
    named = SensorAssignment(sensor_id="h10_2", human_id="p2", person_id="anna", source="operator", confidence=1.0)
    world.publish("/study/assignments", SensorAssignmentArray(assignments=[named]), qos.ASSIGNMENTS)
    fusion = Fusion(tmp_path / "fusion.log")
    try:
        assert world.state("p1", "calm_relaxed").person_id == "p1"
        stressed = world.state("p2", "stressed_anxious")
        assert (stressed.person_id, stressed.face_id) == ("anna", "f2")
    finally:
        assert fusion.stop() == 0


def test_a_sensor_that_changes_hands(world: World, fusion: Fusion) -> None:
    """When a sensor's topics move to another human_id the state moves along, and the old one falls silent."""
    world.listen("p1")
    world.listen("p2")
    world.faces, world.expressions = ("f1",), {"f1": "neutral"}
    old, new = StreamName("p1", "ecg", "h10_1"), StreamName("p2", "ecg", "h10_1")
    world.rates = {old: 70.0}
    world.state("p1", "calm_relaxed")
    world.rates = {new: 70.0}
    world.node.destroy_publisher(world.publishers.pop(old.topic("features")))
    world.state("p2", "calm_relaxed")
    world.states["p1"].clear()
    world.state("p2", "calm_relaxed")
    world.state("p2", "calm_relaxed")
    assert world.states["p1"] == []


@pytest.mark.parametrize(
    ("parameter", "named"),
    [
        ("tree_file:=/no/such/tree.yaml", b"tree_file /no/such/tree.yaml: No such file"),
        ("heart_rate_source:=guess", b"heart_rate_source"),
        ("baseline_s:=-1", b"baseline_s"),
        ("baseline_s:=soon", b"baseline_s"),
    ],
)
def test_wrong_configuration(ros_domain: int, parameter: str, named: bytes) -> None:
    """A wrong parameter or tree ends the process with status 78 and a line that names it."""
    command = [sys.executable, "-m", "fusion_affect", "--ros-args", "-p", parameter]
    done = subprocess.run(command, capture_output=True, timeout=30, check=False)
    assert done.returncode == 78
    assert named in done.stderr
