"""What strangers cost: 500 silent topics, 5 000 messages/s, 8 MB messages, for a minute each.

    .venv/bin/python tests/bench/bench_flood.py

First the recorder, then all services of a study together, of which each adds topics for every stream.
A stream of 100 messages/s of the study's own is recorded meanwhile. Behind: how long its messages waited in the
recorder before they were taken in, asked for ten times a second; memory is the recorder's, before and after. A flood
that ended before its time, or could not send what it should, is no flood: its row is not ok and says so.
"""

import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
from bench_recorder import BENCH, ENV, Load, Publisher, numbers_in, start_recorder
from process_memory import resident_mib

Row = dict[str, Any]
FLOODS = {"500 silent topics": (500, 0, 100), "5 000 messages/s": (25, 5000, 200), "8 MB messages": (5, 2, 8_000_000)}
SECONDS, AFTER_S = 60.0, 60.0
SERVICES = ("web_gui", "interpreter_ecg", "clock_sync", "recorder", "metadata_registry", "session_coordinator")
SETTLE_S = 10.0


def metric(log: Path, name: str) -> float:
    """A metric of the recorder with this log."""
    port = re.findall(r"metrics on port (\d+)", log.read_text())[-1]
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20) as answer:
        return float(re.findall(rf"{name}(?:\{{[^}}]*\}})? (\d\S*)", answer.read().decode())[-1])


def sent_by(flood: subprocess.Popen[str]) -> int:
    """How many messages a flood that is over says it has sent; -1 where it did not end as it should."""
    said, _ = flood.communicate()
    found = re.search(r"^sent (\d+)$", said, re.MULTILINE)
    return int(found[1]) if found and flood.returncode == 0 else -1


def settled(log: Path, enough: float) -> tuple[float, float]:
    """Memory in bytes, and after how many seconds: as soon as it is as little as that, or after AFTER_S."""
    begun = time.monotonic()
    while True:
        memory, waited_s = metric(log, "process_resident_memory_bytes"), time.monotonic() - begun
        if memory <= enough or waited_s > AFTER_S:
            return memory, waited_s
        time.sleep(1.0)


def late_ms(heard: Path, begun_ns: int, over_ns: int) -> float:
    """99 % of what was sent in this time the bare listener took within so long, ms."""
    sent_ns, taken_ns = np.frombuffer(heard.read_bytes(), np.int64).reshape(-1, 2).T
    flooded = (sent_ns >= begun_ns) & (sent_ns <= over_ns)
    return float(np.percentile(taken_ns[flooded] - sent_ns[flooded], 99)) / 1e6


def flooded(what: str, folder: Path) -> Row:
    """One flood."""
    name = re.sub(r"\W", "_", what)
    root, log = folder / name, folder / f"{name}.log"
    process = start_recorder(root, log)
    publisher = Publisher(folder, Load("own", 100.0, 200, together=2))
    heard = folder / f"{name}.heard"
    words = [sys.executable, str(BENCH / "bare_listener.py"), publisher.topic, str(heard)]
    listener = subprocess.Popen(words, env=ENV)
    publisher.wait_begun()
    time.sleep(5.0)
    before, bare_before = metric(log, "process_resident_memory_bytes"), resident_mib(listener.pid)
    words = [str(word) for word in (*FLOODS[what], SECONDS)]
    command = [sys.executable, str(BENCH / "flood_publisher.py"), *words]
    flood = subprocess.Popen(command, env=ENV, stdout=subprocess.PIPE, text=True)
    behind_s, begun_ns = [], time.time_ns()
    while flood.poll() is None:
        behind_s.append(metric(log, "recorder_behind_seconds"))
        time.sleep(0.1)
    flood_sent, flood_wanted = sent_by(flood), FLOODS[what][1] * SECONDS
    over_ns = time.time_ns()
    after, after_s = settled(log, 1.1 * before)
    bare_more = 100 * (resident_mib(listener.pid) / bare_before - 1)
    sent = len(publisher.stop())
    process.terminate()
    process.wait(20)
    listener.terminate()
    listener.wait(20)
    floor_ms = late_ms(heard, begun_ns, over_ns)
    lost = sent - len(set(numbers_in(root, publisher.topic)))
    p99_ms, more = 1000 * float(np.percentile(behind_s, 99)), 100 * (after / before - 1)
    return {
        "what": f"recorder beside a stranger, {what}, {SECONDS:.0f} s: a healthy stream waits, p99; memory after; lost",
        "target": "<= 100 ms, within 10 %, 0",
        "measured": f"{p99_ms:.0f} ms, {more:+.0f} % of {before / 1e6:.0f} MB after {after_s:.0f} s, "
        f"{lost} of {sent}; bare rclpy beside it, which hears one topic, {floor_ms:.0f} ms, "
        f"{bare_more:+.0f} % of {bare_before:.0f} MiB; the flood sent {flood_sent} of {flood_wanted:.0f}",
        "ok": p99_ms <= 100.0 and after <= 1.1 * before and lost == 0 and flood_sent >= 0.95 * flood_wanted,
    }


def study_flooded(what: str, folder: Path) -> Row:
    """One flood beside the services of a study: the memory of each before, at its end, and after it has left."""
    parameters = {
        "web_gui": ["port:=0"],
        "recorder": [f"directory:={folder / 'study'}", "free_floor_mb:=0"],
        "metadata_registry": [f"database:={folder / 'registry.sqlite'}"],
        "session_coordinator": [f"state_file:={folder / 'session.json'}"],
    }
    running = {}
    for name in SERVICES:
        words = [word for parameter in parameters.get(name, ()) for word in ("-p", parameter)]
        command = [sys.executable, "-m", name, *(["--ros-args", *words] if words else [])]
        running[name] = subprocess.Popen(command, env=ENV, stderr=subprocess.DEVNULL)
    time.sleep(SETTLE_S)
    before = {name: resident_mib(process.pid) for name, process in running.items()}
    words = [str(word) for word in (*FLOODS[what], SECONDS)]
    flood = subprocess.Popen(
        [sys.executable, str(BENCH / "flood_publisher.py"), *words], env=ENV, stdout=subprocess.DEVNULL
    )
    time.sleep(SECONDS - SETTLE_S)
    meanwhile = {name: resident_mib(process.pid) for name, process in running.items()}
    flood.wait()
    time.sleep(AFTER_S)
    after = {name: resident_mib(process.pid) for name, process in running.items()}
    for process in running.values():
        process.terminate()
        process.wait(20)
    told = [
        f"{name} {100 * (after[name] / before[name] - 1):+.0f} % of {before[name]:.0f} MiB ({meanwhile[name]:.0f})"
        for name in SERVICES
    ]
    return {
        "what": f"a study beside a stranger, {what}, {SECONDS:.0f} s: memory of each service after {AFTER_S:.0f} s",
        "target": "within 10 %",
        "measured": f"{', '.join(told)}; in brackets while it is there",
        "ok": all(after[name] <= 1.1 * before[name] for name in SERVICES),
    }


def rows() -> list[Row]:
    """Measure: at most ten minutes."""
    with tempfile.TemporaryDirectory() as name:
        found = [flooded(what, Path(name)) for what in FLOODS]
        return [*found, study_flooded(next(iter(FLOODS)), Path(name))]


if __name__ == "__main__":
    for row in rows():
        print(f"{row['what']}: {row['measured']} (target {row['target']})", flush=True)
