"""A short study through the coordinator, with every service, one device that reboots, and one face."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
from hri_msgs.msg import Expression, IdsList
from processes import Process, Processes
from rclpy.qos import DurabilityPolicy, QoSProfile
from replay_law import SERVICES, ready, stamp_ns
from rosbags.highlevel import AnyReader
from sense4hri.stamps import from_ns
from std_msgs.msg import String

RAW = ("/humans/physiological/p1/ecg/band_1/raw", "/humans/physiological/p1/ppg/band_1/raw")
TAKE_PART = {"recorder", "clock_sync", "interpreter_ecg", "interpreter_ppg", "fusion_affect", "driver_band_band_1"}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Robot:
    """The robot's side: one person whose face shows another expression every three seconds, unstamped as real ones."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = node = rclpy.create_node("robot", context=self.context)
        self._faces = node.create_publisher(IdsList, "/humans/faces/tracked", 10)
        self._expression = node.create_publisher(Expression, "/humans/faces/f1/expression", 10)
        self._persons = node.create_publisher(IdsList, "/humans/persons/tracked", LATCHED)
        self._face_of = node.create_publisher(String, "/humans/persons/p1/face_id", LATCHED)
        self._persons.publish(IdsList(ids=["p1"]))
        self._face_of.publish(String(data="f1"))
        self._step, self._due_s = 0, time.monotonic()

    def is_heard(self) -> bool:
        """Whether somebody, fusion-affect, hears all of it; on a busy machine DDS may take seconds for that."""
        said = (self._faces, self._expression, self._persons, self._face_of)
        return all(publisher.get_subscription_count() for publisher in said)

    def until(self, condition: Callable[[], Any], what: str, seconds: float = 60.0) -> Any:
        """Go on being there until condition() is; fail with `what` at the deadline."""
        deadline = time.monotonic() + seconds
        while not (result := condition()):
            assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
            self._be()
        return result

    def _be(self) -> None:
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = max(self._due_s + 0.2, time.monotonic())
        faces = IdsList(ids=["f1"])
        faces.header.stamp = from_ns(time.time_ns())
        self._faces.publish(faces)
        if self._step % 3 == 0:
            word = ("neutral", "happy", "angry")[self._step // 15 % 3]
            self._expression.publish(Expression(expression=word, confidence=0.9))
        self._step += 1

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


class Study(NamedTuple):
    """A session that was recorded. start_ns, stop_ns: in ROS time."""

    folder: Path
    start_ns: int
    stop_ns: int

    def lateness_s(self) -> float:
        """How long after the raw message that brought them features came at most."""
        with AnyReader([self.folder]) as reader:
            wanted = [c for c in reader.connections if c.topic.endswith("/features")]
            late = [at_ns - stamp_ns(reader.deserialize(d, c.msgtype)) for c, at_ns, d in reader.messages(wanted)]
        return max(late) / 1e9

    def heard_late(self) -> list[str]:
        """What the coordinator noted of services that heard of the start after it."""
        with AnyReader([self.folder]) as reader:
            wanted = [c for c in reader.connections if c.topic == "/study/markers"]
            read = reader.messages(wanted) if wanted else ()  # rosbags takes none for all
            said = [reader.deserialize(data, c.msgtype) for c, _, data in read]
        return [marker.value for marker in said if " heard of the start " in marker.value]


def study(work: Path, seconds: float) -> Study:
    """Run a session of so many seconds, its device rebooted in the middle.

    Its start is announced 2 s ahead: an interpreter that a busy machine told of it too late would begin late.
    """
    work.mkdir(parents=True)
    services, robot = Processes(work, Path(__file__).parent), Robot()
    try:
        services.start("recorder", directory=work / "recordings", record_when="session")
        coordinator = services.start("session_coordinator", state_file=work / "session.json", lead_s=2.0)
        services.start("metadata_registry", database=work / "registry.sqlite")
        for name in SERVICES:
            services.start(name)
        for service in services.running:
            ready(service)
        band = services.start("replay_driver.py", human_id="p1", sensor_id="band_1")
        robot.until(lambda: set(_session(coordinator)["present_services"]) >= TAKE_PART, "everybody takes part")
        robot.until(robot.is_heard, "who is who is heard, before the first state")
        wish = {"study": "law", "human_ids": ["p1"], "required_streams": list(RAW), "allow_warmup": True}
        assert coordinator.ask("/start", wish)[0] == 200
        recording = robot.until(lambda: _in(coordinator, "RECORDING"), "recording")
        start_ns = recording["start_at_ns"]
        robot.until(lambda: time.time_ns() - start_ns > seconds / 2 * 1e9, "half of it")
        band.send(signal.SIGUSR1)
        robot.until(lambda: time.time_ns() - start_ns > seconds * 1e9, "all of it")
        stop_ns = time.time_ns()
        assert coordinator.ask("/stop", {})[0] == 200
        over = robot.until(lambda: _in(coordinator, "IDLE"), "the end")
        return Study(Path(over["directory"]), start_ns, stop_ns)
    finally:
        robot.close()
        services.close()


def _session(coordinator: Process) -> dict[str, Any]:
    status, told = coordinator.ask("/session")
    assert status == 200, told
    return told


def _in(coordinator: Process, phase: str) -> dict[str, Any] | None:
    told = _session(coordinator)
    assert told["phase"] != "FAILED", told
    return told if told["phase"] == phase else None
