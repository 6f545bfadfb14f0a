"""fusion-affect as a process; the test plays the interpreters, the drivers' health and ROS4HRI."""

import math
import time
from collections.abc import Callable
from typing import Any

import pytest
from ears import Ears
from hri_msgs.msg import Expression, IdsList
from processes import DEADLINE_S, Process
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.stamps import from_ns
from sense4hri.wire import feature
from sense4hri_msgs.msg import (
    ECG,
    PPG,
    HostClock,
    HostClockArray,
    PhysioDeviceFeature,
    SensorAssignment,
    SensorAssignmentArray,
    StreamHealth,
    UserState,
)
from std_msgs.msg import String

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SEND_S = 0.25


class World(Ears):
    """What fusion-affect hears, and what it says; rates and faces are sent again and again while a test waits."""

    def __init__(self) -> None:
        super().__init__("world")
        self.states: dict[str, list[UserState]] = {}
        self.publishers: dict[str, Any] = {}
        self.rates: dict[StreamName, float] = {}
        self.reports: dict[StreamName, dict[str, float]] = {}
        """What sensors say of themselves, by name."""
        self.faces: tuple[str, ...] = ()
        self.expressions: dict[str, str] = {}
        self.ahead_s = 0.0
        """Of the clock of the drivers' host, lab_b."""
        self._sent_s = 0.0

    def listen(self, human_id: str) -> None:
        self.states[human_id] = self.hear(UserState, f"/humans/physiological/{human_id}/state", qos.STATE)

    def publish(self, topic: str, message: Any, profile: QoSProfile) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, profile)
        self.publishers[topic].publish(message)

    def spin(self, seconds: float = 0.05) -> None:
        """Keep the world going."""
        if time.monotonic() - self._sent_s > SEND_S:
            self._sent_s = time.monotonic()
            self._send()
        super().spin(seconds)

    def _send(self) -> None:
        """Rates and faces stamped now; expressions without a stamp, as the recogniser sends them."""
        stamp = from_ns(time.time_ns())
        tracked = IdsList(ids=list(self.faces))
        tracked.header.stamp = stamp
        self.publish("/humans/faces/tracked", tracked, QoSProfile(depth=1))
        for face_id, word in self.expressions.items():
            message = Expression(expression=word, confidence=0.9)
            self.publish(f"/humans/faces/{face_id}/expression", message, QoSProfile(depth=10))
        for name, bpm in self.rates.items():
            kind = ECG if name.sensor_type == "ecg" else PPG
            features = kind(heart_rate_bpm=bpm, signal_quality=0.9, window_s=10.0)
            features.header.stamp = from_ns(time.time_ns() + round(self.ahead_s * 1e9))
            self.publish(name.topic("features"), features, qos.FEATURES)

        for name, said in self.reports.items():
            report = PhysioDeviceFeature(features=[feature(told, "1", value) for told, value in said.items()])
            report.header.stamp = from_ns(time.time_ns())
            self.publish(name.topic("device"), report, qos.DEVICE)

    def state(self, human_id: str, state: str, true: Callable[[UserState], bool] = lambda said: True) -> UserState:
        """Wait for a new state of this participant, one of which this is true."""
        seen = self.states[human_id]
        seen.clear()
        self.until(
            lambda: seen and seen[-1].state == state and true(seen[-1]),
            lambda: f"{human_id} is {state}; last: {seen[-1:]}",
        )
        return seen[-1]

    def silent(self, human_id: str, other: str) -> bool:
        """True where this participant has no new state while another has two."""
        self.states[human_id].clear()
        for _ in range(2):
            self.state(other, "calm_relaxed")
        return not self.states[human_id]


def metric(fusion: Process, name: str) -> float:
    lines = [line for line in fusion.get("/metrics")[1].splitlines() if line.startswith(name)]
    return float(lines[0].split()[-1])


@pytest.fixture
def world(opened: Callable[[World], World]) -> World:
    return opened(World())


@pytest.fixture
def fusion(start: Callable[..., Process]) -> Process:
    return start("fusion_affect")


def test_from_expression_and_heart_rate_to_state(world: World, fusion: Process) -> None:
    """One wearer before one camera: the state follows heart rate and expression, or is unknown with a reason."""
    ecg, ppg = StreamName("p1", "ecg", "h10_1"), StreamName("p1", "ppg", "verity_1")
    world.listen("p1")
    world.rates, world.faces, world.expressions = {ecg: 70.0, ppg: 71.0}, ("abcde",), {"abcde": "neutral"}
    calm = world.state("p1", "calm_relaxed", lambda said: said.heart_rate_bpm == pytest.approx(70.5))  # of both
    assert (calm.face_id, calm.expression, calm.header.frame_id) == ("abcde", "neutral", "p1")
    assert calm.header.stamp.nanosec == 0
    assert calm.reasons

    world.expressions = {"abcde": "scared"}
    world.rates = {ecg: 110.0, ppg: 110.0}
    world.state("p1", "stressed_anxious")
    world.rates = {ecg: 110.0, ppg: 70.0}
    world.state("p1", "unknown", lambda said: any("disagree" in reason for reason in said.reasons))
    world.rates = {ecg: 70.0, ppg: 70.0}
    world.state("p1", "alert_active")
    world.faces = ("abcde", "fghij")
    world.state("p1", "unknown", lambda said: any("2 faces" in reason for reason in said.reasons))
    assert metric(fusion, "sense4hri_unstamped_expressions_total") > 0
    assert fusion.stop() == 0


def test_a_strap_that_says_it_lies_on_the_table_has_no_heart_rate(world: World, fusion: Process) -> None:
    """A sensor's own heart rate counts while it is on the skin, or where it does not say."""
    ecg = StreamName("p1", "ecg", "h10_1")
    world.listen("p1")
    world.faces, world.expressions = ("abcde",), {"abcde": "neutral"}
    for contact in ({}, {"contact": math.nan}, {"contact": 1.0}):
        world.reports = {ecg: {"heart_rate": 70.0} | contact}
        world.state("p1", "calm_relaxed")
    world.reports = {ecg: {"heart_rate": 70.0, "contact": 0.0}}
    world.state("p1", "unknown", lambda said: "ecg/h10_1 device is missing: no skin contact" in said.reasons)


def test_a_heart_rate_of_a_host_whose_clock_is_off_meets_the_face_of_now(world: World, fusion: Process) -> None:
    """A driver's host a minute ahead, as /study/host_clocks says: the state has both, stamped now."""
    world.ahead_s = 60.0
    _of_another_host(world, -60 * 10**9, time.time_ns())
    world.faces, world.expressions = ("abcde",), {"abcde": "neutral"}
    calm = world.state("p1", "calm_relaxed", lambda said: said.heart_rate_bpm == pytest.approx(70.0))
    assert calm.expression == "neutral"
    assert abs(calm.header.stamp.sec - time.time()) < 30


def test_a_host_measured_weeks_after_its_stamps_is_not_corrected_and_that_is_logged(
    world: World, fusion: Process
) -> None:
    """As of a replay beside a live clock-sync: the heart rate's time stays that of its stamp."""
    _of_another_host(world, -60 * 10**9, time.time_ns() + 21 * 86_400 * 10**9)
    fusion.until("stamps of host lab_b were taken more than a day from when its clock was measured")
    said = world.state("p1", "unknown", lambda said: said.heart_rate_bpm == pytest.approx(70.0))
    assert abs(said.header.stamp.sec - time.time()) < 30


def _of_another_host(world: World, offset_ns: int, measured_at_ns: int) -> None:
    """Have a heart rate of 70 from a driver on lab_b, whose clock /study/host_clocks tells of."""
    ecg = StreamName("p1", "ecg", "h10_1")
    world.listen("p1")
    measured_at = from_ns(measured_at_ns)
    entry = HostClock(host="lab_b", reference="lab_a", offset_ns=offset_ns, skew_ppm=0.0, measured_at=measured_at)
    health = StreamHealth(host="Lab-B", state=StreamHealth.STREAMING)
    for topic, message, profile in (
        ("/study/host_clocks", HostClockArray(clocks=[entry]), qos.HOST_CLOCKS),
        (ecg.topic("health"), health, qos.HEALTH),
    ):
        health.header.stamp = from_ns(time.time_ns() + round(world.ahead_s * 10**9))
        world.publish(topic, message, profile)
        heard = world.publishers[topic]
        world.until(lambda heard=heard: heard.get_subscription_count(), f"fusion hears {topic}")
        world.publish(topic, message, profile)
        assert heard.wait_for_all_acked(Duration(seconds=DEADLINE_S))
    world.rates = {ecg: 70.0}


def test_persons_and_assignments_that_were_there_before(world: World, start: Callable[..., Process]) -> None:
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
    fusion = start("fusion_affect")
    assert world.state("p1", "calm_relaxed").person_id == "p1"
    stressed = world.state("p2", "stressed_anxious")
    assert (stressed.person_id, stressed.face_id) == ("anna", "f2")
    assert fusion.stop() == 0


def test_a_sensor_that_changes_hands(world: World, fusion: Process) -> None:
    """When a sensor's topics move to another human_id the state moves along, and the old one falls silent."""
    world.listen("p1")
    world.listen("p2")
    world.faces, world.expressions = ("f1",), {"f1": "neutral"}
    old, new = StreamName("p1", "ecg", "h10_1"), StreamName("p2", "ecg", "h10_1")
    world.rates = {old: 70.0}
    world.state("p1", "calm_relaxed")
    world.rates = {new: 70.0}
    world.node.destroy_publisher(world.publishers.pop(old.topic("features")))
    world.until(lambda: world.silent("p1", other="p2"), "the old one falls silent")


@pytest.mark.parametrize(
    ("parameter", "value", "named"),
    [
        ("tree_file", "/no/such/tree.yaml", "tree_file /no/such/tree.yaml: No such file"),
        ("heart_rate_source", "guess", "heart_rate_source"),
        ("baseline_s", -1, "baseline_s"),
        ("baseline_s", "soon", "baseline_s"),
    ],
)
def test_wrong_configuration(start: Callable[..., Process], parameter: str, value: object, named: str) -> None:
    """A wrong parameter or tree ends the process with status 78 and a line that names it."""
    process = start("fusion_affect", **{parameter: value})
    assert process.wait() == 78
    assert named in process.log()
