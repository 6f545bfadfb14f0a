"""Services as real processes: begun with their parameters, asked over HTTP, ended; their log is kept in a file."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

DEADLINE_S = 120.0
"""How long to wait for what takes moments on an idle machine; one that many share is fifty times as slow."""
ENDED_S = 60.0
"""Within which a process that was told to has ended, on a busy machine too."""
DOCKER_STOP_S = 10.0
"""From SIGTERM to SIGKILL."""

FIRST_DOMAIN, DOMAINS = 30, 60


def withheld_s(*pids: int) -> float:
    """For how long the threads of these processes have been kept waiting for a core so far, all together, in s.

    By the kernel's own count: next to 0 on an idle machine, and 0 for a process that has ended.
    """
    files = [file for pid in pids for file in Path(f"/proc/{pid}/task").glob("*/schedstat")]
    return sum(map(_withheld_ns, files)) / 1e9


def _withheld_ns(schedstat: Path) -> int:
    try:
        return int(schedstat.read_text().split()[1])
    except OSError:  # the thread has ended
        return 0


def ended_within(child: subprocess.Popen[Any], seconds: float, *others: int) -> int | None:
    """Return the exit status of a process that ends within so many seconds of its own; None where it does not.

    What others on this machine had of its cores meanwhile, while it or one of `others` (process ids) waited for one,
    does not count.
    """
    begun_s, first_s, waited_s = time.monotonic(), withheld_s(child.pid, *others), 0.0
    while child.poll() is None and time.monotonic() - begun_s < seconds + waited_s:
        time.sleep(0.02)
        waited_s = max(waited_s, withheld_s(child.pid, *others) - first_s)
    return child.poll()


@contextmanager
def claimed_domain() -> Iterator[int]:
    """A ROS domain that no other test on this machine has meanwhile."""
    for number in range(DOMAINS):
        domain = FIRST_DOMAIN + (os.getpid() + number) % DOMAINS
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
            try:
                claim.bind(f"\0sense4hri-test-domain-{domain}")
            except OSError:
                continue
            yield domain
            return
    pytest.fail("no free ROS domain")


def poll(
    condition: Callable[[], Any], what: str | Callable[[], str], seconds: float = DEADLINE_S, pause_s: float = 0.02
) -> Any:
    """Return the first true result of condition; fail with `what` after so many seconds."""
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        if time.monotonic() > deadline:
            pytest.fail(f"not within {seconds:g} s: {what if isinstance(what, str) else what()}")
        time.sleep(pause_s)
    return result


def wait_for(condition: Callable[[], Any], seconds: float, what: str) -> Any:
    """Poll what only a command of Docker or Kubernetes tells, which takes a core for some time: less often."""
    return poll(condition, what, seconds, pause_s=0.3)


class Process:
    """One process.

    command: the script (`*.py`) or module to run with this Python, and its arguments. parameters: ROS parameters by
    name. env: what is other than in this process's environment. before: words that run it elsewhere and become it.
    """

    def __init__(
        self,
        log: Path,
        *command: str | Path,
        env: Mapping[str, str] | None = None,
        parameters: Mapping[str, Any] | None = None,
        before: Sequence[str] = (),
    ) -> None:
        self.log_file = log
        words = [str(word) for word in command]
        if not words[0].endswith(".py"):
            words.insert(0, "-m")
        if parameters:
            words.append("--ros-args")
        for name, value in (parameters or {}).items():
            words += ["-p", f"{name}:={json.dumps(value, default=str)}"]
        with log.open("w") as out:
            self.child = subprocess.Popen(
                [*before, sys.executable, *words], stdout=out, stderr=out, env={**os.environ, **(env or {})}
            )

    def log(self) -> str:
        """Everything it has printed."""
        return self.log_file.read_text()

    def until(self, text: str, seconds: float = DEADLINE_S) -> None:
        """Wait for this text in its log; fail at once where the process ends without it."""

        def said() -> bool:
            ended = self.child.poll() is not None
            if text in self.log():
                return True
            if ended:
                pytest.fail(f"ended with {self.child.returncode} before {text!r}:\n{self.log()}")
            return False

        poll(said, lambda: f"{text!r} in:\n{self.log()}", seconds)

    def wait(self, seconds: float = ENDED_S) -> int:
        """Return the exit status; fail where the process does not end."""
        try:
            return self.child.wait(seconds)
        except subprocess.TimeoutExpired:
            self.kill()
            pytest.fail(f"did not end within {seconds:g} s:\n{self.log()}")

    def send(self, number: int) -> None:
        self.child.send_signal(number)

    def stop(self, seconds: float = ENDED_S) -> int:
        """SIGTERM; the exit status."""
        self.send(signal.SIGTERM)
        return self.wait(seconds)

    def stop_within(self, seconds: float = DOCKER_STOP_S, number: int = signal.SIGTERM) -> int:
        """SIGTERM, or another signal; the exit status. Fails where it needs more than so many seconds of its own."""
        self.send(number)
        status = ended_within(self.child, seconds)
        if status is None:
            self.kill()
            pytest.fail(f"did not end within {seconds:g} s:\n{self.log()}")
        return status

    def kill(self) -> None:
        """SIGKILL, as hard as can be."""
        self.child.kill()
        self.child.wait()

    def end(self) -> None:
        """End what a test has left running: kindly, for others may be linked to it, but surely."""
        if self.child.poll() is None:
            self.send(signal.SIGTERM)
        try:
            self.child.wait(10)
        except subprocess.TimeoutExpired:
            self.kill()

    def port(self) -> int:
        """Port of its HTTP endpoint, as its log says."""
        self.until("metrics on port ")
        words = poll(lambda: self.log().partition("metrics on port ")[2].split(), "the number of the port")
        return int(words[0])

    def request(
        self,
        path: str,
        body: bytes | None = None,
        method: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> tuple[int, str]:
        """Status and text of one HTTP request: GET, or POST with a body, which is JSON unless the headers differ."""
        given = {"Content-Type": "application/json"} if headers is None else dict(headers)
        request = urllib.request.Request(f"http://127.0.0.1:{self.port()}{path}", body, given, method=method)
        try:
            with urllib.request.urlopen(request, timeout=DEADLINE_S) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as err:
            with err:
                return err.code, err.read().decode()

    def get(self, path: str) -> tuple[int, str]:
        return self.request(path)

    def ask(self, path: str, fields: Mapping[str, Any] | bytes | None = None) -> tuple[int, Any]:
        """Status and decoded JSON of a GET, or of a POST of the fields."""
        body = fields if fields is None or isinstance(fields, bytes) else json.dumps(fields).encode()
        status, text = self.request(path, body)
        return status, json.loads(text)


class Processes:
    """What one test runs; everything is ended with it."""

    def __init__(self, logs: Path, scripts: Path) -> None:
        self._logs, self._scripts = logs, scripts
        self.running: list[Process] = []

    def start(self, *command: str, env: Mapping[str, str] | None = None, **parameters: Any) -> Process:
        """Start a module, or a script beside the test. In the name of a parameter `__` stands for the dot."""
        first = str(self._scripts / command[0]) if command[0].endswith(".py") else command[0]
        given = {name.replace("__", "."): value for name, value in parameters.items()}
        log = self._logs / f"{len(self.running)}_{Path(command[0]).stem}.log"
        self.running.append(Process(log, first, *command[1:], env=env, parameters=given))
        return self.running[-1]

    def close(self) -> None:
        """Tell all to end, then wait for each."""
        for process in self.running:
            if process.child.poll() is None:
                process.send(signal.SIGTERM)
        for process in self.running:
            process.end()
