"""Processes of a browser test: web-gui and the study it shows, on a ROS domain of their own."""

import json
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from processes import DEADLINE_S, poll

ROOT = Path(__file__).resolve().parents[2]
START_S = DEADLINE_S


def environment(domain: int) -> dict[str, str]:
    """Return the environment of the processes on this ROS domain."""
    own = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"}
    own |= {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "ROS_DOMAIN_ID": str(domain)}
    given = own.get("PYTHONPATH", "").split(os.pathsep)
    return own | {"PYTHONPATH": os.pathsep.join(filter(None, [str(Path(__file__).parent), *given]))}


@dataclass
class Process:
    """A child process, its log and how to end it."""

    popen: subprocess.Popen
    log: Path
    started_s: float = field(default_factory=time.time)

    def tell(self, line: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(line + "\n")
        self.popen.stdin.flush()

    def stop(self) -> int:
        if self.popen.stdin is not None and not self.popen.stdin.closed:
            self.popen.stdin.close()
        if self.popen.poll() is None:
            self.popen.terminate()
        try:
            return self.popen.wait(START_S)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            raise AssertionError(f"did not end within {START_S:g} s:\n{self.log.read_text()}") from None


@dataclass
class Stage:
    """Where the processes of a test module run."""

    folder: Path
    environment: dict[str, str]
    processes: list[Process] = field(default_factory=list)

    def start(self, name: str, *arguments: str, stdin: int = subprocess.DEVNULL) -> Process:
        log = self.folder / f"{name}.log"
        with log.open("ab") as output:
            popen = subprocess.Popen(
                [sys.executable, *arguments],
                stdin=stdin,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self.environment,
                cwd=self.folder,
                text=True,
            )
        self.processes.append(Process(popen, log))
        return self.processes[-1]

    def close(self) -> None:
        """End what a failed test has left running."""
        for process in self.processes:
            process.stop()

    def gui(self, port: int = 0, name: str = "gui", **parameters_: object) -> tuple[Process, str]:
        """Start web-gui; return it and its address."""
        parameters = self.folder / f"{name}.yaml"
        given = {"port": port} | parameters_
        parameters.write_text(json.dumps({"/**": {"ros__parameters": given}}))
        process = self.start(name, "-m", "web_gui", "--ros-args", "--params-file", str(parameters))
        process_id = process.popen.pid

        def address() -> str | None:
            assert process.popen.poll() is None, process.log.read_text()
            told = process.log.read_text().partition(f"(process {process_id})")[2]
            found = re.search(r"the page is at (\S+)", told)
            return found.group(1) if found else None

        return process, str(poll(address, "web-gui"))

    def study(self, *arguments: str) -> Process:
        """Start the third-party nodes."""
        script = str(Path(__file__).with_name("fake_study.py"))
        return self.start("study", script, *arguments, stdin=subprocess.PIPE)
