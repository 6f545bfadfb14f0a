"""What metadata-registry and fusion-affect cost when idle, and how long an assignment and a state take."""

import contextlib
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from fusion_affect.fusion import Fusion
from fusion_affect.state import Expression
from fusion_affect.streams import Rate
from fusion_affect.tree import load
from metadata_registry.registry import Registry
from metadata_registry.store import Store
from sense4hri.names import StreamName

SETTLE_S, MEASURE_S = 8.0, 20.0
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def rows() -> list[dict]:
    """Everything measured here, for `make bench`."""
    return [*idle_rows(), assignment_row(), state_row()]


def idle_rows() -> list[dict]:
    """CPU and memory of both services on an empty graph."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        database = f"database:={folder}/registry.sqlite"
        with running("metadata_registry", database) as registry, running("fusion_affect") as fusion:
            time.sleep(SETTLE_S)
            before = {process.pid: cpu_s(process.pid) for process in (registry, fusion)}
            time.sleep(MEASURE_S)
            for name, process in (("metadata-registry", registry), ("fusion-affect", fusion)):
                percent = 100 * (cpu_s(process.pid) - before[process.pid]) / MEASURE_S
                measured = f"{percent:.2f} % of a core, {rss_mb(process.pid):.0f} MB RSS"
                found.append({"what": f"{name}, idle", "target": "< 1 %", "measured": measured, "ok": percent < 1})
    return found


def assignment_row(count: int = 200) -> dict:
    """Time of one assignment, on the disk when it returns."""
    with tempfile.TemporaryDirectory() as folder:
        registry = Registry(Store(Path(folder) / "registry.sqlite"))
        registry.seen(StreamName("p1", "ecg", "h10_1"), "/driver_bench_h10_1", "host", {}, 0)
        took_ms = []
        for number in range(count):
            begun = time.perf_counter()
            registry.assign("h10_1", f"p{number}", "", number)
            took_ms.append(1000 * (time.perf_counter() - begun))
    took_ms.sort()
    measured = f"p50 {took_ms[count // 2]:.2f} ms, p99 {took_ms[count * 99 // 100]:.2f} ms"
    return {"what": "metadata-registry, an assignment synced to disk", "target": "", "measured": measured, "ok": None}


def state_row(humans: int = 4, seconds: int = 300) -> dict:
    """Computing time of one state, all its inputs included."""
    fusion, second_ns, states = Fusion(load()), 1_000_000_000, 0
    names = [StreamName(f"p{n}", kind, f"{kind}_{n}") for n in range(humans) for kind in ("ecg", "ppg")]
    for n in range(humans):
        fusion.person_face(f"p{n}", f"f{n}")
    begun = time.perf_counter()
    for half in range(2 * seconds):
        now_ns = 10**18 + half * second_ns // 2
        fusion.faces([f"f{n}" for n in range(humans)], now_ns)
        for n in range(humans):
            fusion.expression(f"f{n}", Expression("neutral", 0.9), 0)
        for name in names if half % 2 else ():
            fusion.rate(name, "features", Rate(70.0, 0.9), now_ns)
        states += len(fusion.due())
    each_us = 1e6 * (time.perf_counter() - begun) / states
    return {"what": "fusion-affect, one state (4 people)", "target": "", "measured": f"{each_us:.0f} us", "ok": None}


@contextlib.contextmanager
def running(package: str, *parameters: str) -> Iterator[subprocess.Popen[bytes]]:
    """A service on a domain of its own."""
    env = {k: v for k, v in os.environ.items() if k != "METRICS_PORT"} | {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    env.setdefault("ROS_DOMAIN_ID", str(random.randint(60, 100)))
    arguments = [word for parameter in parameters for word in ("-p", parameter)]
    command = [sys.executable, "-m", package, "--ros-args", *arguments]
    process = subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(10)


def cpu_s(pid: int) -> float:
    """CPU time a process has used so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def rss_mb(pid: int) -> float:
    """Resident memory of a process, MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1000


if __name__ == "__main__":
    for row in rows():
        print(f"| {row['what']} | {row['target']} | {row['measured']} |")
