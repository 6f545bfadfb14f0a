"""metadata-registry as a process, beside driver processes, on a private ROS domain."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from ears import Ears
from processes import Process
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue, SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sense4hri import diagnostics, qos
from sense4hri.recorder_status import NAME
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import PhysioRaw, SensorAssignmentArray, SensorInfoArray, SessionState
from sense4hri_msgs.srv import AssignSensor, ListSensors

OVER_AFTER_S = 3.0
DRIVER = """
import asyncio, sys, time
import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.device import DriverConfig, Identity, Samples, Stream
from sense4hri.driver import run_driver

class Device:
    async def stream(self):
        yield Identity(firmware_version="1.2.3")
        while True:
            await asyncio.sleep(0.1)
            yield Samples("ecg", Chunk(("ecg",), np.zeros((13, 1)), time.monotonic_ns(), time.time_ns()))

streams = {"ecg": Stream(130.0, "uV", -20000.0, 20000.0, 14, ("ecg",))}
sys.exit(run_driver(sys.argv[1], DriverConfig, lambda config: streams, lambda config, streams: Device()))
"""


class Peer(Ears):
    """Listens to the registry and calls it."""

    def __init__(self) -> None:
        super().__init__("registry_test")
        self._sensors = self.hear(SensorInfoArray, "/study/sensors", qos.SENSORS)
        self._assignments = self.hear(SensorAssignmentArray, "/study/assignments", qos.ASSIGNMENTS)

    @property
    def sensors(self) -> list[Any]:
        """What the registry said last."""
        return self._sensors[-1].sensors if self._sensors else []

    @property
    def assignments(self) -> list[Any]:
        return self._assignments[-1].assignments if self._assignments else []

    def wait(self, condition: Callable[[], Any], what: str) -> None:
        self.until(condition, lambda: f"{what}; sensors {self.sensors}, assignments {self.assignments}", 60)

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """Return the response of a service."""
        return self.ask(kind, name, kind.Request(**fields))

    def topics(self) -> set[str]:
        """Raw topics that have a publisher."""
        names = [name for name, _ in self.node.get_topic_names_and_types() if name.endswith("/raw")]
        return {name for name in names if self.node.count_publishers(name)}


@pytest.fixture
def peer(opened: Callable[[Peer], Peer]) -> Peer:
    return opened(Peer())


class Cast:
    """Starts the registry, always with the same database, and drivers."""

    def __init__(self, folder: Path, start: Callable[..., Process]) -> None:
        self._folder, self._start = folder, start
        self._script = folder / "driver.py"
        self._script.write_text(DRIVER)

    def registry(self, **parameters: Any) -> Process:
        return self._start("metadata_registry", database=self._folder / "registry.sqlite", **parameters)

    def assign(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "metadata_registry.cli", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

    def driver(self, human_id: str, kind: str = "fake") -> Process:
        return self._start(str(self._script), kind, sensor_id="strap_1", human_id=human_id, vendor="ACME")


@pytest.fixture
def cast(tmp_path: Path, start: Callable[..., Process]) -> Cast:
    return Cast(tmp_path, start)


def test_assignment_survives_kill_of_registry_and_of_driver(peer: Peer, cast: Cast) -> None:
    """An operator's assignment moves the driver, and is there again after kill -9 of the registry and of the driver."""
    registry, driver = cast.registry(), cast.driver("p1")
    peer.wait(lambda: peer.sensors and peer.sensors[0].firmware_version == "1.2.3", "the sensor is described")
    sensor = peer.sensors[0]
    assert (sensor.sensor_id, sensor.sensor_type, sensor.human_id) == ("strap_1", "ecg", "p1")
    assert (sensor.node, sensor.vendor, sensor.unit) == ("/driver_fake_strap_1", "ACME", "uV")
    assert sensor.sampling_frequency_hz == 130.0
    assert list(sensor.channel_names) == ["ecg"]
    assert json.loads(sensor.parameters_json)["ecg.resolution_bits"] == 14
    peer.wait(lambda: peer.sensors[0].host and peer.sensors[0].online, "its host is known from its health")
    peer.wait(lambda: [(a.human_id, a.source) for a in peer.assignments] == [("p1", "config")], "it is assigned")

    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p2", person_id="anna")
    assert answer.success, answer.message
    registry.kill()
    registry = cast.registry()
    moved = {"/humans/physiological/p2/ecg/strap_1/raw"}
    peer.wait(lambda: peer.topics() == moved, "the driver has moved its topics")
    peer.wait(lambda: peer.assignments and peer.assignments[0].source == "operator", "the assignment is published")
    assert (peer.assignments[0].human_id, peer.assignments[0].person_id) == ("p2", "anna")

    peer.wait(lambda: peer.sensors[0].online and peer.sensors[0].human_id == "p2", "the sensor is online on p2")

    driver.kill()
    peer.wait(lambda: not peer.sensors[0].online, "the driver is missed")
    assert peer.call(ListSensors, "/study/list_sensors", human_id="p2").sensors[0].sensor_id == "strap_1"
    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p3")
    assert answer.success
    assert "will be set when it is back" in answer.message
    assert "strap_1  ecg  p2  offline" in cast.assign().stdout
    refused = cast.assign("strap_9", "p3")
    assert (refused.returncode, "known are: strap_1" in refused.stderr) == (1, True)
    cast.driver("p1")
    peer.wait(lambda: "/humans/physiological/p3/ecg/strap_1/raw" in peer.topics(), "the driver has been told again")
    peer.wait(lambda: peer.sensors[0].online and peer.sensors[0].human_id == "p3", "the sensor is back")
    assert registry.stop() == 0


def test_driver_that_vanishes_in_the_middle(peer: Peer, cast: Cast) -> None:
    """A driver that hangs while it is assigned is told when it is back; what is set by hand afterwards is undone."""
    registry = cast.registry()
    driver = cast.driver("p1")
    known = lambda: peer.sensors and peer.sensors[0].online and peer.sensors[0].firmware_version  # noqa: E731
    peer.wait(known, "the sensor is known with what its driver says of it: it is not asked any more")
    driver.send(signal.SIGSTOP)
    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p4")
    assert not answer.success
    assert answer.message.startswith("not done: ")
    peer.wait(lambda: "does not take human_id 'p4'" in registry.log(), "the failure is logged")
    driver.kill()
    cast.driver("p1")
    moved = "/humans/physiological/p4/ecg/strap_1/raw"
    peer.wait(lambda: moved in peer.topics(), "the driver has been told")
    peer.wait(lambda: "has taken human_id 'p4'" in registry.log(), "the registry knows")
    told = registry.log().count("has taken human_id 'p4'")
    by_hand = ParameterMessage(name="human_id", value=ParameterValue(type=4, string_value="p9"))
    peer.call(SetParameters, "/driver_fake_strap_1/set_parameters", parameters=[by_hand])
    peer.wait(lambda: registry.log().count("has taken human_id 'p4'") > told, "it has been set back")


class Deaf(Ears):
    """A third-party driver that takes human_id and goes on under the old one, or does not take it."""

    def __init__(self, refuses: bool) -> None:
        super().__init__("driver_other_strap_1", {"human_id": "p1", "sensor_id": "strap_1"})
        self._raw = self.node.create_publisher(PhysioRaw, "/humans/physiological/p1/ecg/strap_1/raw", qos.RAW)
        if refuses:
            no = SetParametersResult(successful=False, reason="worn by somebody else")
            self.node.add_on_set_parameters_callback(lambda parameters: no)


@pytest.mark.parametrize(
    ("refuses", "why"), [(False, "does not move its topics"), (True, "worn by somebody else")], ids=["deaf", "refuses"]
)
def test_an_assignment_that_the_graph_does_not_bear_out_is_not_done(
    peer: Peer, cast: Cast, opened: Callable[[Deaf], Deaf], refuses: bool, why: str
) -> None:
    """Answer, entry and assignments agree with the topics, whatever the driver says; who is in an order stays."""
    deaf = opened(Deaf(refuses))
    registry = cast.registry()

    def both(condition: Callable[[], Any], what: str) -> None:
        peer.wait(lambda: (deaf.spin(0.01), condition())[1], what)

    both(lambda: [(a.human_id, a.source) for a in peer.assignments] == [("p1", "config")], "the sensor is known")
    client = peer.node.create_client(AssignSensor, "/study/assign_sensor")
    both(client.service_is_ready, "assigning is served")
    asked = client.call_async(AssignSensor.Request(sensor_id="strap_1", human_id="p2", person_id="anna"))
    both(asked.done, "the registry answers")
    answer = asked.result()
    assert not answer.success
    assert answer.message.startswith("not done: sensor_id 'strap_1' is still on 'p1', not on 'p2': ")
    assert why in answer.message
    both(lambda: "!assignment_not_done" in peer.sensors[0].parameters_json, "the sensor's entry says so")
    assert "'p2' was asked for" in json.loads(peer.sensors[0].parameters_json)["!assignment_not_done"]
    both(lambda: [(a.human_id, a.person_id) for a in peer.assignments] == [("p1", "")], "so do the assignments")
    assert registry.ask("/assignments")[1][0]["human_id"] == "p1"
    counted = 'assignments_not_done{service="metadata_registry"} 1.0'
    both(lambda: counted in registry.request("/metrics")[1], "it is counted")
    status, told = registry.ask("/participants/p2/delete", {"confirm": "p2"})
    assert (status, "is to wear, strap_1: assign it to 'unassigned' first" in told["error"]) == (409, True)
    orders = [client.call_async(AssignSensor.Request(sensor_id="strap_1", human_id=name)) for name in ("p3", "p4")]
    both(lambda: all(order.done() for order in orders), "both are answered")
    assert [order.result().message.endswith("the order stands until another one is given") for order in orders] == [
        False,
        True,
    ]


def test_two_drivers_of_one_sensor_id_are_reported_once(peer: Peer, cast: Cast) -> None:
    """A sensor_id that two drivers claim is one error line, shows in its description, and cannot be assigned."""
    registry = cast.registry()
    cast.driver("p1", "one")
    peer.wait(lambda: peer.sensors, "the first is known")
    cast.driver("p2", "two")
    peer.wait(
        lambda: peer.sensors and "!duplicate_sensor_id" in peer.sensors[0].parameters_json, "the second is reported"
    )
    claimed = json.loads(peer.sensors[0].parameters_json)["!duplicate_sensor_id"]
    assert claimed == ["/driver_one_strap_1", "/driver_two_strap_1"]
    assert len(peer.sensors) == 1
    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p3")
    assert not answer.success
    assert "/driver_one_strap_1" in answer.message
    peer.wait(lambda: registry.log().count("is claimed by") == 2, "the error, and the refusal")


def test_http_offers_the_same(peer: Peer, cast: Cast) -> None:
    """Sensors, assignments and assigning over HTTP; what is malformed is status 400 and names the field."""
    cast.driver("p1")
    registry = cast.registry()
    peer.wait(lambda: peer.sensors and peer.assignments, "the sensor is known and assigned")
    assert registry.ask("/sensors")[1][0]["sensor_id"] == "strap_1"
    assert registry.ask("/assignments")[1][0]["human_id"] == "p1"
    status, answer = registry.ask("/assign", b'{"sensor_id": "strap_1", "human_id": "p5", "person_id": ""}')
    assert status == 200, answer
    peer.wait(lambda: "/humans/physiological/p5/ecg/strap_1/raw" in peer.topics(), "the driver has moved")
    for body, named in [
        (b"", "sensor_id"),
        (b"[]", "object"),
        (b'{"sensor_id": 5, "human_id": "p1"}', "sensor_id"),
        (b'{"sensor_id": "strap_1"}', "human_id"),
        (b'{"sensor_id": "strap_1", "human_id": "p 1"}', "'p 1'"),
        (b'{"sensor_id": "strap_1", "human": "p1"}', "'human'"),
    ]:
        status, answer = registry.ask("/assign", body)
        assert status == 400
        assert named in json.dumps(answer)
    assert registry.ask("/assign")[0] == 405


@pytest.mark.parametrize("is_killed", [False, True], ids=["a session that ends", "a coordinator that is killed"])
def test_a_participant_is_told_and_deleted(peer: Peer, cast: Cast, is_killed: bool) -> None:
    """Not while it wears a sensor or its session runs or is prepared; then all of it goes, on the graph too."""
    driver, registry = cast.driver("p1"), cast.registry()
    sessions = peer.node.create_publisher(SessionState, "/study/session", qos.SESSION)
    state = SessionState(session_id="visit-p1", phase=SessionState.RECORDING, human_ids=["p1"], start_at=from_ns(5))
    sessions.publish(state)

    def whole() -> Any:
        status, told = registry.ask("/participants/p1")
        return told if status == 200 and told["assignments"] and told["readings"] and told["sessions"] else None

    peer.wait(whole, "assignment, reading and session are kept")
    told = whole()
    assert [w["until_ns"] for w in told["assignments"]] == [0]
    assert (told["sessions"][0]["session_id"], told["sessions"][0]["state"]) == ("visit-p1", "running")
    delete, sure = "/participants/p1/delete", {"confirm": "p1"}
    for path, body, status in ((delete, {}, 400), (delete, {"confirm": "p2"}, 400), (delete, sure, 409)):
        assert registry.ask(path, body)[0] == status
    assert registry.ask("/participants/p9/delete", {"confirm": "p9"})[0] == 404
    assert driver.stop() == 0
    peer.wait(lambda: "which runs: stop it first" in str(registry.ask(delete, sure)[1]), "only the session is left")
    sessions.publish(SessionState(session_id="visit-2", phase=SessionState.PREPARING, human_ids=["p1"]))
    peer.wait(lambda: "which is being prepared: stop it first" in str(registry.ask(delete, sure)[1]), "one to come")
    if is_killed:
        peer.node.destroy_publisher(sessions)
    else:
        sessions.publish(SessionState())
    peer.wait(lambda: registry.ask(delete, sure)[0] == 200, "it is deleted")
    peer.wait(
        lambda: not peer.sensors and [each.human_id for each in peer.assignments] == ["unassigned"],
        "the graph is told",
    )
    assert registry.ask("/participants") == (200, [])
    assert registry.ask("/participants/p1")[0] == 404
    assert registry.stop() == 0


def test_a_session_that_nobody_conducts_or_records_any_more_is_over(peer: Peer, cast: Cast) -> None:
    """Its coordinator was killed while it recorded: those who took part can be deleted, but not while it is recorded.

    Nor while no recorder says that it is not, nor a moment after the coordinator has gone; a restart changes nothing.
    """
    registry = cast.registry(session_over_after_s=OVER_AFTER_S)
    sessions = peer.node.create_publisher(SessionState, "/study/session", qos.SESSION)
    beats = peer.node.create_publisher(DiagnosticArray, diagnostics.TOPIC, qos.HEALTH)
    sessions.publish(SessionState(session_id="s1", phase=SessionState.RECORDING, human_ids=["p1"], start_at=from_ns(5)))
    state = lambda: [one["state"] for one in registry.ask("/sessions")[1]]  # noqa: E731
    peer.wait(lambda: state() == ["running"], "it runs")
    peer.node.destroy_publisher(sessions)

    def refused(session_id: str | None = None) -> str:
        if session_id is not None:
            values = [KeyValue(key="session_id", value=session_id)]
            beats.publish(DiagnosticArray(status=[DiagnosticStatus(name=NAME, hardware_id="recorder", values=values)]))
        status, answer = registry.ask("/participants/p1/delete", {"confirm": "p1"})
        return answer["error"] if status == 409 else ""

    peer.wait(lambda: "no recorder says whether" in refused(), "nobody knows whether it is recorded")
    peer.wait(lambda: "a recorder still records" in refused("s1"), "it is recorded")
    passed_s = time.monotonic() + 2 * OVER_AFTER_S
    peer.wait(lambda: refused("s1") and time.monotonic() > passed_s, "it is recorded for long")
    assert state() == ["running"]
    assert registry.stop() == 0
    registry = cast.registry(session_over_after_s=OVER_AFTER_S)
    begun_s = time.monotonic()
    peer.wait(lambda: "no recorder records it, so in" in refused(""), "no recorder records it")
    peer.wait(lambda: not refused(""), "it is over, and p1 deleted")
    assert time.monotonic() - begun_s >= OVER_AFTER_S
    assert state() == ["failed"]
    assert registry.ask("/participants") == (200, [])
    registry.until("session 's1' is over")


def test_unusable_database_is_a_configuration_error(start: Callable[..., Process], tmp_path: Path) -> None:
    """A database that cannot be opened ends the process with status 78 and one line that names the parameter."""
    process = start("metadata_registry", database=tmp_path / "no" / "folder.sqlite")
    assert process.wait() == 78
    assert "parameter 'database'" in process.log()


def test_a_best_effort_publisher_is_told(peer: Peer, cast: Cast) -> None:
    """A plain node's raw without reliability is a known sensor, and its entry names the quality of service."""
    raw = "/humans/physiological/p1/eda/plain_1/raw"
    peer.node.create_publisher(PhysioRaw, raw, QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
    registry = cast.registry()
    peer.wait(lambda: peer.sensors and "!quality_of_service" in peer.sensors[0].parameters_json, "it is told")
    assert "best effort" in json.loads(registry.ask("/sensors")[1][0]["parameters_json"])["!quality_of_service"]


def test_a_driver_is_read_again_in_its_turn(peer: Peer, cast: Cast, opened: Callable[[Ears], Ears]) -> None:
    """However many drivers there are, one of them is asked in every interval: what asking costs does not grow."""
    asked: list[tuple[str, float]] = []
    names = ("one", "two", "three", "four")
    for name in names:
        node = opened(Ears(name, beside=peer)).node

        def listed(*request: Any, name: str = name, answer: Any = node.list_parameters) -> Any:
            asked.append((name, time.monotonic()))
            return answer(*request)

        node.list_parameters = listed  # type: ignore[method-assign]
        node.create_publisher(PhysioRaw, f"/humans/physiological/p1/ecg/{name}/raw", qos.RAW)
    cast.registry(scan_interval_s=0.05, refresh_interval_s=0.5)
    peer.wait(lambda: len(asked) >= 20, "they are asked again")
    turns = asked[8:20]  # all have been found by then
    assert [[one for one, _ in turns].count(name) for name in names] == [3, 3, 3, 3]
    assert turns[-1][1] - turns[0][1] > 3.0
