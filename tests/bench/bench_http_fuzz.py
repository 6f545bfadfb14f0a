"""Strangers on every service's HTTP port: 10 000 requests each, slow connections, and browsers without end on the page.

Who dies, answers 5xx, writes a traceback or grows is a row of its own.
"""

import re
import sys
import tempfile
import tomllib
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import http_fuzz
from processes import Process, claimed_domain, poll

ROOT = Path(__file__).resolve().parents[2]
REQUESTS, SOCKETS, BROWSERS, SLOW = 10_000, 10_000, 1000, 100
WARM = 500  # requests until every cache is filled; what grows after them grows with strangers


def rows() -> list[dict[str, Any]]:
    """Return the measured rows."""
    with tempfile.TemporaryDirectory() as folder, claimed_domain() as domain:
        found = [row for service in nodes() for row in one(service, Path(folder), domain)]
    return found


def nodes() -> list[Path]:
    """Every service that runs until it is stopped."""
    files = sorted((ROOT / "services").glob("*/pyproject.toml"))
    kinds = {
        file.parent: tomllib.loads(file.read_text()).get("tool", {}).get("sense4hri", {}).get("kind") for file in files
    }
    return [service for service, kind in kinds.items() if kind != "commands"]


def one(service: Path, folder: Path, domain: int) -> list[dict[str, Any]]:
    """Measure every port of one service."""
    package = tomllib.loads((service / "pyproject.toml").read_text())["project"]["name"]
    own = {
        "web-gui": {"port": 0},
        "recorder": {"directory": folder / "recordings"},
        "metadata-registry": {"database": folder / "registry.sqlite"},
        "session-coordinator": {"state_file": folder / "session.json"},
        "sensor-bench": {"socket_path": folder / "bus"},
    }
    env = {"ROS_DOMAIN_ID": str(domain), "DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={folder}/no-bus"}
    given = ["--ros-args", "--params-file", service / "config" / "default.yaml"]
    process = Process(folder / f"{package}.log", package, *given, env=env, parameters=own.get(service.name, {}))
    try:
        measured = [assailed(service.name, process, process.port(), "")]
        if service.name == "web-gui":
            process.until("the page is at ")
            port = int(re.findall(r"the page is at http://127.0.0.1:(\d+)", process.log())[0])
            measured += [
                assailed(service.name, process, port, ", the page"),
                talked(process, port),
                crowded(process, port),
            ]
        return measured
    finally:
        process.end()


def assailed(name: str, process: Process, port: int, what: str) -> dict[str, Any]:
    """Send requests, then leave connections half open; how it stood that."""
    alive = lambda: process.child.poll() is None  # noqa: E731
    http_fuzz.assail(port, WARM, 2, alive)
    before_mb, statuses = resident_mb(process), Counter[int]()
    statuses.update(http_fuzz.assail(port, REQUESTS, 1, alive))
    with http_fuzz.slow_connections(port, SLOW):
        served = http_fuzz.told(port, "/openapi.json")[0] == 200
    failed = sum(count for status, count in statuses.items() if status >= 500)
    return row(f"{name}{what}: {REQUESTS} requests, {SLOW} slow connections", process, before_mb, failed, served)


def talked(process: Process, port: int) -> dict[str, Any]:
    """Have WebSockets say what no page says."""
    http_fuzz.talk(port, WARM, 2)
    before_mb = resident_mb(process)
    http_fuzz.talk(port, SOCKETS, 1, lambda: process.child.poll() is None)
    served = http_fuzz.told(port, "/access")[0] == 200
    return row(f"web-gui: {SOCKETS} hostile WebSockets", process, before_mb, 0, served)


def crowded(process: Process, port: int) -> dict[str, Any]:
    """Open the page in more browsers than it is for."""
    before_mb = resident_mb(process)
    with ExitStack() as stack:
        answers: Counter[int] = Counter()
        for _ in range(BROWSERS):
            status, connection = http_fuzz.browser(port)
            stack.enter_context(connection)
            answers[status] += 1
        served = http_fuzz.told(port, "/access")[0] == 200
    what = f"web-gui: {BROWSERS} browsers at once, {answers[101]} let in, {answers[429]} told that there are too many"
    return row(what, process, before_mb, sum(n for status, n in answers.items() if status >= 500), served)


def row(what: str, process: Process, before_mb: float, failed: int, served: bool) -> dict[str, Any]:
    """Return one row of the table."""
    poll(lambda: process.get("/healthz")[0] == 200, "healthy")
    grown_mb, tracebacks = resident_mb(process) - before_mb, process.log().count("Traceback")
    alive = process.child.poll() is None
    told = f"{'lives' if alive else 'dead'}, {failed} 5xx, {tracebacks} tracebacks, {grown_mb:+.1f} MB"
    told += "" if served else ", an ordinary request was not served"
    good = alive and served and not failed and not tracebacks and grown_mb < 0.1 * before_mb
    return {"what": what, "target": "0 dead, 0 5xx, no traceback, memory flat", "measured": told, "ok": good}


def resident_mb(process: Process) -> float:
    """Return the memory of a process in MB."""
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{process.child.pid}/status").read_text())
    return int(found.group(1)) / 1024 if found else float("nan")


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
