"""Real processes on a ROS domain of the test's own, and a node that listens to them."""

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

HERE = Path(__file__).parent


def poll(condition: Callable[[], Any], seconds: float, what: str) -> Any:
    """Return the first true result of condition; fail after so many seconds."""
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"not within {seconds} s: {what}")
        time.sleep(0.02)
    return result


@pytest.fixture(name="poll")
def poll_fixture() -> Callable[..., Any]:
    """poll(condition, seconds, what) with a deadline."""
    return poll


class Process:
    """A service of ours as its own process; its log is kept in a file."""

    def __init__(self, log: Path, command: list[str], env: dict[str, str]) -> None:
        self.log_file = log
        with log.open("w") as out:
            self._process = subprocess.Popen(command, stdout=out, stderr=out, env={**os.environ, **env})

    def log(self) -> str:
        return self.log_file.read_text()

    def send(self, number: int) -> None:
        self._process.send_signal(number)

    def wait(self, seconds: float) -> int:
        """Return the exit status; fail where the process does not end."""
        try:
            return self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            pytest.fail(f"did not end within {seconds} s; its log:\n{self.log()}")

    def stop(self, seconds: float = 10.0) -> int:
        self.send(signal.SIGTERM)
        return self.wait(seconds)

    def end(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()

    def port(self) -> int:
        """Return the port of its metrics, as its log says."""
        words = poll(
            lambda: self.log().partition("metrics on port ")[2].split(), 15, f"a port in the log:\n{self.log()}"
        )
        return int(words[0])

    def get(self, path: str) -> tuple[int, str]:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port()}{path}", timeout=5) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as err:
            with err:
                return err.code, err.read().decode()


@pytest.fixture
def start(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """start("toy_driver.py", **parameters, env={}) runs a script of this folder with ROS parameters."""
    running: list[Process] = []

    def begin(script: str, env: dict[str, str] | None = None, **parameters: object) -> Process:
        given = [word for name, value in parameters.items() for word in ("-p", f"{name.replace('__', '.')}:={value}")]
        command = [sys.executable, str(HERE / script), *(["--ros-args", *given] if given else [])]
        process = Process(tmp_path / f"{len(running)}_{Path(script).stem}.log", command, env or {})
        running.append(process)
        return process

    yield begin
    for process in running:
        process.end()


class Listener:
    """A node of the test's own, spun while it waits."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        self.node = rclpy.create_node("kit_listener", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)

    def listen(self, kind: type, topic: str, qos: Any) -> list[Any]:
        got: list[Any] = []
        self.node.create_subscription(kind, topic, got.append, qos)
        return got

    def until(self, condition: Callable[[], Any], seconds: float, what: str) -> Any:
        deadline = time.monotonic() + seconds
        while not (result := condition()):
            if time.monotonic() > deadline:
                pytest.fail(f"not within {seconds} s: {what}")
            self._executor.spin_once(timeout_sec=0.05)
        return result

    def close(self) -> None:
        import rclpy

        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def listener(ros_domain: int) -> Iterator[Listener]:
    node = Listener()
    yield node
    node.close()
