"""metadata-registry as a process, beside driver processes, on a private ROS domain."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from sense4hri import qos
from sense4hri_msgs.msg import SensorAssignmentArray, SensorInfoArray
from sense4hri_msgs.srv import AssignSensor, ListSensors

DRIVER = """
import asyncio, sys, time
import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.driver import DriverConfig, Identity, Samples, Stream, run_driver

class Device:
    async def stream(self):
        yield Identity(firmware_version="1.2.3")
        while True:
            await asyncio.sleep(0.1)
            yield Samples("ecg", Chunk(("ecg",), np.zeros((13, 1)), time.monotonic_ns(), time.time_ns()))

streams = {"ecg": Stream(130.0, "uV", -20000.0, 20000.0, 14, ("ecg",))}
sys.exit(run_driver(sys.argv[1], DriverConfig, lambda config: streams, lambda config, streams: Device()))
"""


class Peer:
    """A node of the test that listens to the registry and calls it."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("registry_test", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.sensors: list[Any] = []
        self.assignments: list[Any] = []
        self.node.create_subscription(
            SensorInfoArray, "/study/sensors", lambda m: setattr(self, "sensors", m.sensors), qos.SENSORS
        )
        self.node.create_subscription(
            SensorAssignmentArray,
            "/study/assignments",
            lambda m: setattr(self, "assignments", m.assignments),
            qos.ASSIGNMENTS,
        )

    def until(self, true: Callable[[], Any], what: str, timeout_s: float = 60.0) -> Any:
        """Spin until true() is; fail with `what` at the deadline."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if value := true():
                return value
            self.executor.spin_once(timeout_sec=0.05)
        pytest.fail(f"not within {timeout_s} s: {what}; sensors {self.sensors}, assignments {self.assignments}")

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """Return the response of a service of the registry."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, f"{name} is served")
        future = client.call_async(kind.Request(**fields))
        self.until(future.done, f"{name} answers", 10.0)
        self.node.destroy_client(client)
        return future.result()

    def topics(self) -> set[str]:
        """Raw topics that have a publisher."""
        names = [name for name, _ in self.node.get_topic_names_and_types() if name.endswith("/raw")]
        return {name for name in names if self.node.count_publishers(name)}

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def peer(ros_domain: int) -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.close()


class Processes:
    """Processes of a test, ended with it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.running: list[subprocess.Popen[bytes]] = []
        (folder / "driver.py").write_text(DRIVER)

    def start(self, log: str, *command: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{log}.log").open("ab") as output:
            process = subprocess.Popen([sys.executable, *command], stderr=output, stdout=output)
        self.running.append(process)
        return process

    def registry(self) -> subprocess.Popen[bytes]:
        database = str(self.folder / "registry.sqlite")
        return self.start("registry", "-m", "metadata_registry", "--ros-args", "-p", f"database:={database}")

    def driver(self, human_id: str, kind: str = "fake") -> subprocess.Popen[bytes]:
        parameters = ["-p", "sensor_id:=strap_1", "-p", f"human_id:={human_id}", "-p", "vendor:=ACME"]
        return self.start(f"driver_{kind}", str(self.folder / "driver.py"), kind, "--ros-args", *parameters)

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text()

    def close(self) -> None:
        for process in self.running:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
        for process in self.running:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(5)


@pytest.fixture
def processes(ros_domain: int, tmp_path: Path) -> Iterator[Processes]:
    processes = Processes(tmp_path)
    yield processes
    processes.close()


def kill(process: subprocess.Popen[bytes]) -> None:
    os.kill(process.pid, signal.SIGKILL)
    process.wait(5)


def test_assignment_survives_kill_of_registry_and_of_driver(peer: Peer, processes: Processes) -> None:
    """An operator's assignment moves the driver, and is there again after kill -9 of the registry and of the driver."""
    registry, driver = processes.registry(), processes.driver("p1")
    peer.until(lambda: peer.sensors and peer.sensors[0].firmware_version == "1.2.3", "the sensor is described")
    sensor = peer.sensors[0]
    assert (sensor.sensor_id, sensor.sensor_type, sensor.human_id) == ("strap_1", "ecg", "p1")
    assert (sensor.node, sensor.vendor, sensor.unit) == ("/driver_fake_strap_1", "ACME", "uV")
    assert sensor.sampling_frequency_hz == 130.0
    assert list(sensor.channel_names) == ["ecg"]
    assert json.loads(sensor.parameters_json)["ecg.resolution_bits"] == 14
    peer.until(lambda: peer.sensors[0].host and peer.sensors[0].online, "its host is known from its health")
    peer.until(lambda: [(a.human_id, a.source) for a in peer.assignments] == [("p1", "config")], "it is assigned")

    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p2", person_id="anna")
    assert answer.success, answer.message
    kill(registry)
    registry = processes.registry()
    moved = {"/humans/physiological/p2/ecg/strap_1/raw"}
    peer.until(lambda: peer.topics() == moved, "the driver has moved its topics")
    peer.until(lambda: peer.assignments and peer.assignments[0].source == "operator", "the assignment is published")
    assert (peer.assignments[0].human_id, peer.assignments[0].person_id) == ("p2", "anna")

    peer.until(lambda: peer.sensors[0].online and peer.sensors[0].human_id == "p2", "the sensor is online on p2")

    kill(driver)
    peer.until(lambda: not peer.sensors[0].online, "the driver is missed")
    assert peer.call(ListSensors, "/study/list_sensors", human_id="p2").sensors[0].sensor_id == "strap_1"
    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p3")
    assert answer.success
    assert "will be set when it is back" in answer.message
    processes.driver("p1")
    peer.until(lambda: "/humans/physiological/p3/ecg/strap_1/raw" in peer.topics(), "the driver has been told again")
    peer.until(lambda: peer.sensors[0].online and peer.sensors[0].human_id == "p3", "the sensor is back")
    registry.terminate()
    assert registry.wait(5) == 0


def test_driver_that_vanishes_in_the_middle(peer: Peer, processes: Processes) -> None:
    """A driver that hangs while it is assigned is told when it is back; what is set by hand afterwards is undone."""
    processes.registry()
    driver = processes.driver("p1")
    peer.until(lambda: peer.sensors and peer.sensors[0].online, "the sensor is known")
    os.kill(driver.pid, signal.SIGSTOP)
    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p4")
    assert answer.success
    assert "again when it is back" in answer.message
    peer.until(lambda: "does not take human_id 'p4'" in processes.log("registry"), "the failure is logged")
    kill(driver)
    processes.driver("p1")
    moved = "/humans/physiological/p4/ecg/strap_1/raw"
    peer.until(lambda: moved in peer.topics(), "the driver has been told")
    by_hand = ParameterMessage(name="human_id", value=ParameterValue(type=4, string_value="p9"))
    peer.call(SetParameters, "/driver_fake_strap_1/set_parameters", parameters=[by_hand])
    peer.until(lambda: processes.log("registry").count("has taken human_id 'p4'") == 2, "it has been set back")


def test_two_drivers_of_one_sensor_id_are_reported_once(peer: Peer, processes: Processes) -> None:
    """A sensor_id that two drivers claim is one error line, shows in its description, and cannot be assigned."""
    processes.registry()
    processes.driver("p1", "one")
    peer.until(lambda: peer.sensors, "the first is known")
    processes.driver("p2", "two")
    peer.until(
        lambda: peer.sensors and "!duplicate_sensor_id" in peer.sensors[0].parameters_json, "the second is reported"
    )
    claimed = json.loads(peer.sensors[0].parameters_json)["!duplicate_sensor_id"]
    assert claimed == ["/driver_one_strap_1", "/driver_two_strap_1"]
    assert len(peer.sensors) == 1
    answer = peer.call(AssignSensor, "/study/assign_sensor", sensor_id="strap_1", human_id="p3")
    assert not answer.success
    assert "/driver_one_strap_1" in answer.message
    assert processes.log("registry").count("is claimed by") == 2  # the error, and the refusal


def test_http_offers_the_same(peer: Peer, processes: Processes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sensors, assignments and assigning over HTTP; what is malformed is status 400 and names the field."""
    processes.driver("p1")
    processes.registry()
    peer.until(lambda: peer.sensors, "the sensor is known")
    port = processes.log("registry").split("metrics on port ")[1].split()[0]

    def ask(path: str, body: bytes | None = None) -> tuple[int, Any]:
        request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", data=body)
        try:
            with urllib.request.urlopen(request, timeout=5) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as err:
            with err:
                return err.code, json.load(err)

    assert ask("/sensors")[1][0]["sensor_id"] == "strap_1"
    assert ask("/assignments")[1][0]["human_id"] == "p1"
    status, answer = ask("/assign", b'{"sensor_id": "strap_1", "human_id": "p5", "person_id": ""}')
    assert status == 200, answer
    peer.until(lambda: "/humans/physiological/p5/ecg/strap_1/raw" in peer.topics(), "the driver has moved")
    for body, named in [
        (b"", "JSON"),
        (b"[]", "object"),
        (b'{"sensor_id": 5, "human_id": "p1"}', "sensor_id"),
        (b'{"sensor_id": "strap_1"}', "human_id"),
        (b'{"sensor_id": "strap_1", "human_id": "p 1"}', "'p 1'"),
        (b'{"sensor_id": "strap_1", "human": "p1"}', "'human'"),
    ]:
        status, answer = ask("/assign", body)
        assert status == 400
        assert named in json.dumps(answer)
    assert ask("/assign")[0] == 405


def test_unusable_database_is_a_configuration_error(ros_domain: int, tmp_path: Path) -> None:
    """A database that cannot be opened ends the process with status 78 and one line that names the parameter."""
    done = subprocess.run(
        [sys.executable, "-m", "metadata_registry", "--ros-args", "-p", f"database:={tmp_path}/no/folder.sqlite"],
        capture_output=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == 78
    assert b"parameter 'database'" in done.stderr
