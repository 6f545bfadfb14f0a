"""A short study through the coordinator, with every service, one device that reboots, and one face."""

from __future__ import annotations

import json
import signal
import sys
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from hri_msgs.msg import Expression, IdsList
from rclpy.qos import DurabilityPolicy, QoSProfile
from replay_law import Process, port, running
from sense4hri.stamps import from_ns
from std_msgs.msg import String

DRIVER = Path(__file__).with_name("replay_driver.py")
RAW = ("/humans/physiological/p1/ecg/band_1/raw", "/humans/physiological/p1/ppg/band_1/raw")
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

    def until(self, condition: Callable[[], Any], what: str, seconds: float = 40.0) -> Any:
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


def ask(process: Process, path: str, fields: dict[str, Any] | None = None) -> Any:
    """GET, or POST the fields."""
    body = None if fields is None else json.dumps(fields).encode()
    with urllib.request.urlopen(f"http://127.0.0.1:{port(process.log)}{path}", body, timeout=10) as answer:
        return json.load(answer)


def study(work: Path, seconds: float) -> tuple[Path, int, int]:
    """Run a session of so many seconds, its device rebooted in the middle; return recordings, start_at, stop_at."""
    work.mkdir(parents=True)
    commands = {
        "recorder": ["recorder", f"directory:={work / 'recordings'}"],
        "coordinator": ["session_coordinator", f"state_file:={work / 'session.json'}"],
        "registry": ["metadata_registry", f"database:={work / 'registry.sqlite'}"],
        "clock_sync": ["clock_sync"],
        "ecg": ["interpreter_ecg"],
        "ppg": ["interpreter_ppg"],
        "fusion": ["fusion_affect"],
        "band": [str(DRIVER), "human_id:=p1", "sensor_id:=band_1"],
    }
    robot = Robot()
    try:
        with running(work, commands) as processes:
            coordinator = processes["coordinator"]
            robot.until(lambda: len(ask(coordinator, "/session")["present_services"]) >= 6, "everybody takes part")
            wish = {"study": "law", "human_ids": ["p1"], "required_streams": list(RAW), "allow_warmup": True}
            assert ask(coordinator, "/start", wish)["success"]
            recording = robot.until(lambda: _in(coordinator, "RECORDING"), "recording")
            start_ns = recording["start_at_ns"]
            robot.until(lambda: time.time_ns() - start_ns > seconds / 2 * 1e9, "half of it")
            processes["band"].child.send_signal(signal.SIGUSR1)
            robot.until(lambda: time.time_ns() - start_ns > seconds * 1e9, "all of it")
            stop_ns = time.time_ns()
            assert ask(coordinator, "/stop", {})["success"]
            robot.until(lambda: _in(coordinator, "IDLE"), "the end")
    finally:
        robot.close()
    return work / "recordings", start_ns, stop_ns


def _in(coordinator: Process, phase: str) -> dict[str, Any] | None:
    told = ask(coordinator, "/session")
    assert told["phase"] != "FAILED", told
    return told if told["phase"] == phase else None


if __name__ == "__main__":
    print(study(Path(sys.argv[1]), float(sys.argv[2])))
