"""sensor_bench as a process of its own: its bus, its HTTP interface, its knobs."""

import json
import subprocess
from pathlib import Path
from typing import Any

from processes import Process, poll

READY_S = 90.0
"""On a busy machine the simulated waveforms take their time."""
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


def bus_pid_of(bench_pid: int) -> int:
    """Return the process id of a bench's D-Bus daemon."""
    listed = subprocess.run(["ps", "--ppid", str(bench_pid), "-o", "pid=,comm="], capture_output=True, text=True)
    return next(int(line.split()[0]) for line in listed.stdout.splitlines() if "dbus-daemon" in line)


class BenchProcess(Process):
    """`python -m sensor_bench` with `parameters` over its defaults, in `domain` or the one of this process."""

    def __init__(self, folder: Path, domain: int | None = None, **parameters: Any) -> None:
        self.folder, self.socket = folder, folder / "bus"
        self.address = f"unix:path={self.socket}"
        env = {"METRICS_PORT": "", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        if domain is not None:
            env["ROS_DOMAIN_ID"] = str(domain)
        given = {"socket_path": str(self.socket), **parameters}
        super().__init__(folder / "bench.log", "sensor_bench", env=env, parameters=given)

    def until_ready(self) -> "BenchProcess":
        """Wait until the sensors advertise and the HTTP interface answers."""
        self.until("DBUS_SYSTEM_BUS_ADDRESS=", READY_S)
        poll(lambda: self.get("/readyz")[0] == 200, "the bench is ready")
        return self

    def bus_pid(self) -> int:
        """Process id of its D-Bus daemon."""
        return bus_pid_of(self.child.pid)

    def read(self, path: str) -> Any:
        """JSON of a GET that must succeed."""
        status, value = self.ask(path)
        assert status == 200, value
        return value

    def post(self, path: str, **values: Any) -> None:
        status, text = self.request(path, json.dumps(values).encode())
        assert status == 200, text

    def knobs(self, sensor: str, **values: Any) -> None:
        self.post(f"/devices/{sensor}/knobs", **values)

    def device(self, sensor: str) -> dict[str, Any]:
        return next(each for each in self.read("/devices") if each["sensor"] == sensor)

    def truth(self, sensor: str) -> dict[str, Any]:
        return self.read("/truth")["devices"][sensor]

    def restore(self) -> None:
        """End all links and turn all knobs back, for the next test."""
        self.post("/adapter", present=True)
        self.post("/adapter", powered=True)
        for device in self.read("/devices"):
            self.knobs(device["sensor"], drop=True, **ORIGINAL_KNOBS)
        poll(lambda: not any(device["connected"] for device in self.read("/devices")), "links ended")
