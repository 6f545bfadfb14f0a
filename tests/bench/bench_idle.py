"""What each service costs while nothing streams: CPU and memory of real processes, all on one private ROS domain.

.venv/bin/python tests/bench/bench_idle.py
"""

import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

SETTLE_S, LONGEST_START_S, MEASURE_S = 15.0, 120.0, 30.0
READY = "metrics on port"  # what every service logs when it has started
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
MIB = 1024 * 1024


class Cost(NamedTuple):
    """What one process cost."""

    cpu_percent: float  # of one core
    rss_mib: float


def rows() -> list[dict[str, Any]]:
    """One row per service; CPU below 1 % of a core is the target."""
    with tempfile.TemporaryDirectory() as folder:
        services = {
            "clock_sync": (),
            "interpreter_ecg": (),
            "interpreter_ppg": (),
            "fusion_affect": (),
            "metadata_registry": (f"database:={folder}/registry.sqlite",),
            "recorder": (f"directory:={folder}/recordings",),
            "web_gui": ("port:=0",),
        }
        costs = measured(services, Path(folder))
    return [
        {
            "what": f"{package.replace('_', '-')} without a stream",
            "target": "< 1 % of a core",
            "measured": f"{cost.cpu_percent:.2f} %, {cost.rss_mib:.0f} MiB RSS",
            "ok": cost.cpu_percent < 1.0,
        }
        for package, cost in costs.items()
    ]


def measured(services: dict[str, tuple[str, ...]], folder: Path) -> dict[str, Cost]:
    """Run every package with its parameters side by side; return what each cost over MEASURE_S after settling."""
    env = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"}
    env |= {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "ROS_DOMAIN_ID": str(random.randint(90, 101))}
    running: dict[str, subprocess.Popen[bytes]] = {}
    try:
        for package, parameters in services.items():
            words = [word for parameter in parameters for word in ("-p", parameter)]
            command = [sys.executable, "-m", package, *(["--ros-args", *words] if words else [])]
            with (folder / f"{package}.log").open("wb") as log:
                running[package] = subprocess.Popen(command, env=env, stdout=log, stderr=log)
        wait_until_ready([folder / f"{package}.log" for package in services])
        begun = time.monotonic()
        before = {package: cpu_s(process) for package, process in running.items()}
        time.sleep(MEASURE_S)
        elapsed_s = time.monotonic() - begun
        return {
            package: Cost(100 * (cpu_s(process) - before[package]) / elapsed_s, rss_mib(process))
            for package, process in running.items()
        }
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait_until_ready(logs: list[Path]) -> None:
    """Return SETTLE_S after the last service has started. Raises TimeoutError that names one which does not."""
    deadline = time.monotonic() + LONGEST_START_S
    for log in logs:
        while READY not in log.read_text():
            if time.monotonic() > deadline:
                raise TimeoutError(f"{log.stem} did not start within {LONGEST_START_S:.0f} s")
            time.sleep(0.1)
    time.sleep(SETTLE_S)


def cpu_s(process: "subprocess.Popen[bytes]") -> float:
    """Return the CPU time of a process so far, user and system, in s. Raises RuntimeError where it has ended."""
    if process.poll() is not None:
        raise RuntimeError(f"{process.args!r} ended with {process.returncode}")
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def rss_mib(process: "subprocess.Popen[bytes]") -> float:
    """Return the resident memory of a process in MiB."""
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MIB


if __name__ == "__main__":
    print("| what | target | measured | ok |\n|---|---|---|---|")
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {'yes' if entry['ok'] else 'NO'} |")
