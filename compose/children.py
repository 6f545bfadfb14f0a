"""The processes of a study: started, watched, and ended by their own id."""

import contextlib
import json
import os
import re
import signal
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sense4hri.access import authorization
from sense4hri.child_process import end_with_parent
from study_file import Process

PORT = re.compile(r"metrics on port (\d+)")


class Child:
    """One service as a process; its log is a file."""

    def __init__(self, name: str, process: Process, log: Path) -> None:
        self.name, self._log_file = name, log
        inherited = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"}
        self._port: int | None = None
        self.reported = False
        with log.open("w") as out:
            self._process = subprocess.Popen(
                process.command,
                stdout=out,
                stderr=out,
                stdin=subprocess.DEVNULL,
                env=inherited | process.env,
                cwd=process.folder,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )

    def running(self) -> bool:
        """True while the process lives."""
        return self._process.poll() is None

    def status(self) -> int | None:
        """Return the exit status, None while it runs."""
        return self._process.poll()

    def log(self) -> str:
        """Return what it has logged so far."""
        return self._log_file.read_text(errors="replace")

    def last_words(self, lines: int = 5) -> str:
        """Return the end of its log, in one line."""
        return " / ".join(self.log().splitlines()[-lines:]) or "nothing"

    def get(self, path: str) -> dict[str, Any]:
        """Return the JSON object its HTTP port gives at path; empty where it gives none."""
        try:
            request = urllib.request.Request(f"{self._url()}{path}", headers=authorization())
            with urllib.request.urlopen(request, timeout=2) as answer:
                return dict(json.load(answer))
        except (OSError, ValueError):
            return {}

    def ready(self, path: str = "/readyz") -> bool:
        """True once `/readyz` says so; of a driver, whose sensor may be away, `/healthz`."""
        try:
            with urllib.request.urlopen(f"{self._url()}{path}", timeout=2) as answer:
                return answer.status == 200
        except (OSError, ValueError):
            return False

    def terminate(self) -> None:
        """Send SIGTERM."""
        if self.running():
            self._process.send_signal(signal.SIGTERM)

    def wait(self, until: float) -> bool:
        """Wait till the monotonic time `until`; False where it had to be killed. What it has started ends with it."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(max(0.0, until - time.monotonic()))
        in_time = not self.running()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        return in_time

    def _url(self) -> str:
        if self._port is None:
            found = PORT.search(self.log())
            if found is None:
                raise ValueError("no port yet")
            self._port = int(found[1])
        return f"http://127.0.0.1:{self._port}"


class Children:
    """All of them. last: names of those that end one by one, in this order, after all others."""

    def __init__(self, logs: Path, last: Sequence[str]) -> None:
        self._logs, self._last, self._all = logs, last, dict[str, Child]()

    def __getitem__(self, name: str) -> Child:
        return self._all[name]

    def start(self, name: str, process: Process) -> Child:
        """Start a process under this name."""
        self._all[name] = Child(name, process, self._logs / f"{name}.log")
        return self._all[name]

    def fallen(self) -> list[Child]:
        """Return those that ended by themselves since the last call."""
        fallen = [child for child in self._all.values() if not child.running() and not child.reported]
        for child in fallen:
            child.reported = True
        return fallen

    def end(self, seconds: float) -> list[Child]:
        """End all of them, each within so many seconds of its SIGTERM; return those that had to be killed."""
        last = [self._all[name] for name in self._last if name in self._all]
        first = [child for child in self._all.values() if child not in last]
        killed = []
        for group in (first, *([child] for child in last)):
            until = time.monotonic() + seconds
            for child in group:
                child.terminate()
            killed += [child for child in group if not child.wait(until)]
        self._all.clear()
        return killed
