"""sensor_bench as a process of its own, for the graph tests: its bus, its HTTP interface, its end."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

READY_S = 60.0
SILENT_DOMAIN = 29
"""For a bench that publishes nothing; outside the range of the fixture `ros_domain`."""
ORIGINAL_KNOBS = {
    "latency_s": 0.03,
    "jitter_s": 0.01,
    "loss": 0.0,
    "down": False,
    "contact": True,
    "abort_connects": 0,
    "garbled_frames": 0,
}


class BenchProcess:
    """`python -m sensor_bench` with `parameters` over its defaults, in `domain` or the one of this process."""

    def __init__(self, folder: Path, domain: int | None = None, **parameters: Any) -> None:
        self.address = f"unix:path={folder}/bus"
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        values = {"socket_path": f"{folder}/bus", **parameters}
        file = folder / "bench.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
        environment = {**os.environ, "METRICS_PORT": str(self.port), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        if domain is not None:
            environment["ROS_DOMAIN_ID"] = str(domain)
        self.log_file = folder / "bench.log"
        with self.log_file.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "sensor_bench", "--ros-args", "--params-file", str(file)],
                env=environment,
                stdout=log,
                stderr=log,
            )

    def log(self) -> str:
        return self.log_file.read_text()

    def request(self, method: str, path: str, body: bytes | None = None) -> tuple[int, Any]:
        """Status and decoded JSON (or text) of one request."""
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", data=body, method=method)
        try:
            with urllib.request.urlopen(request, timeout=10) as reply:
                status, text = reply.status, reply.read()
        except urllib.error.HTTPError as error:
            with error:
                status, text = error.code, error.read()
        try:
            return status, json.loads(text)
        except ValueError:
            return status, text.decode()

    def get(self, path: str) -> Any:
        status, value = self.request("GET", path)
        assert status == 200, value
        return value

    def post(self, path: str, **values: Any) -> Any:
        status, value = self.request("POST", path, json.dumps(values).encode())
        assert status == 200, value
        return value

    def knobs(self, sensor: str, **values: Any) -> None:
        self.post(f"/devices/{sensor}/knobs", **values)

    def restore(self) -> None:
        """End all links and turn all knobs back, for the next test."""
        self.post("/adapter", present=True)
        self.post("/adapter", powered=True)
        for device in self.get("/devices"):
            self.knobs(device["sensor"], drop=True, **ORIGINAL_KNOBS)
        self.until(lambda: not any(device["connected"] for device in self.get("/devices")), "links ended")

    def until(self, condition: Callable[[], Any], what: str, seconds: float = 15.0) -> Any:
        """Poll until the condition holds; fail with the bench's log at the deadline."""
        deadline = time.monotonic() + seconds
        while not (value := condition()):
            assert time.monotonic() < deadline, f"not within {seconds} s: {what}\n{self.log()}"
            time.sleep(0.05)
        return value

    def until_ready(self) -> "BenchProcess":
        def ready() -> bool:
            assert self.process.poll() is None, self.log()
            try:
                return self.request("GET", "/readyz")[0] == 200
            except OSError:
                return False

        self.until(ready, "bench is ready", READY_S)
        return self

    def end(self) -> int:
        """SIGTERM; the exit status."""
        self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise
