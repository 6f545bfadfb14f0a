"""Every tool that reads recordings, each mutation in a process of its own with a limit of memory and of time.

    .venv/bin/python tests/hostile/tools.py [--seeds 0:3] [--only NAME ...] [--tools NAME ...] [--show]

Everything is imported once, then forked: a run costs what the tool costs.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit" / "sense4hri_session"))

import numpy as np
import sense4hri_report.__main__
import sense4hri_session.__main__
from recorder import recover
from replay import offers
from replay.bag import open_recording
from replay.recorded import BagError
from sense4hri import host_clocks
from sense4hri.modalities import MODALITIES
from sense4hri_recording import repair
from sense4hri_session import export, session, withdraw  # noqa: F401
from sense4hri_session.withdrawn import MADE_ANEW, Withdrawn

from hostile.mutations import MUTATIONS

MOST_S, MOST_BYTES = 20.0, 1 << 30  # of processor time: other programs may be running
HUNG_S = 90.0
OUT = "out"
"""Where an export goes, beside the recording."""


def play(folder: Path) -> int:
    """Everything of a recording as replay reads it."""
    try:
        with contextlib.closing(open_recording(folder)) as played:
            for topic in played.topics:
                offers.profile(topic)
            for _ in played.messages([topic.name for topic in played.topics], 0):
                pass
    except BagError as err:
        print(err, file=sys.stderr)
        return 1
    return 0


def report_here(found: Withdrawn) -> None:
    """The report that a withdrawal makes anew, without a process of its own."""
    if MADE_ANEW in found.files:
        sense4hri_report.__main__.main([str(found.now), "--quiet"])


withdraw._report = report_here
TOOLS: dict[str, Callable[[Path], int]] = {
    "repair": lambda folder: repair.main([str(folder)]),
    "recover": lambda folder: recover.main([str(folder)]),
    "report": lambda folder: sense4hri_report.__main__.main([str(folder), "--quiet"]),
    "export": lambda folder: sense4hri_session.__main__.main(
        [str(folder), "--quiet", "--out", str(folder.parent / OUT)]
    ),
    "withdraw": lambda folder: withdraw.main([str(folder), "--human", "p1", "--yes", "--quiet"]),
    "replay": play,
}
READS = ("report", "export", "replay")
MADE = ("report.json", "report.html", ".report.json", ".report.html", ".lock")


class Ran(NamedTuple):
    """What one tool made of one mutation. took_s: of processor time. wrong: empty, or what must not be."""

    mutation: str
    seed: int
    tool: str
    status: int
    took_s: float
    peak_mb: float
    said: str
    wrong: str


def base(parent: Path) -> Path:
    """A whole recording of a few seconds with everything that stands beside it."""
    from conftest import START_NS, Study, header, record

    study = record(Study(parent), 6.0, (3.0, 4.0))
    for second in range(6):
        now = START_NS + second * 10**9
        about = {"nominal_rate_hz": 130.0, "state": 2, "samples_total": 130 * second, "host": "lab"}
        study.add("/humans/physiological/p1/ecg/h10_1/health", "StreamHealth", now, header=header(now), **about)
        model = {"offset_ns": START_NS - 599_616_000 * 10**9, "skew_ppm": 40.0, "state": 1}
        study.add("/humans/physiological/p1/ecg/h10_1/clock", "ClockModel", now, header=header(now), **model)
    _every_type(study)
    folder = study.write(flush_every=40)
    told = {
        "session_id": "s1",
        "study": "Test",
        "task": "rest",
        "human_ids": ["p1", "p2"],
        "metadata": {"room": 3},
        "required_streams": ["/humans/physiological/*/ecg/*/raw"],
        "start_at_ns": START_NS,
        "stop_at_ns": START_NS + 5 * 10**9,
    }
    topic = {
        "topic": "/humans/physiological/p1/ecg/h10_1/raw",
        "type": "sense4hri_msgs/msg/PhysioRaw",
        "messages": 40,
        "lost": 1,
        "missed_at_start": 0,
        "losses": [{"after_ns": START_NS, "before_ns": START_NS + 10**9, "count": 1, "cause": "disk"}],
    }
    content = {
        "format": 1,
        "state": "recording",
        "session": told,
        "topics": [topic],
        "host": "lab",
        "opened_ns": START_NS,
        "software": {"recorder": "1"},
        "nodes": [{"node": "/driver", "parameters": {"human_id": "p1"}}],
        "refused": [{"topic": "/x", "why": "y"}],
        "withheld": ["/z"],
        "events": [{"at_ns": START_NS, "what": "begun"}],
    }
    (folder / "recorder.json").write_text(json.dumps(content))
    (folder / "report.json").write_text(json.dumps({"format": 1, "verdict": "complete", "streams": []}))
    return folder


def _every_type(study: Any) -> None:
    """Add a raw stream and features of every modality, and of each other message of the contract one."""
    from conftest import START_NS, header

    now = START_NS + 2 * 10**9
    for modality in MODALITIES.values():
        key = f"p2/{modality.sensor_type}/any_1"
        for second in range(3):
            received_ns, times_s = START_NS + second * 10**9, np.arange(10) / 10
            study.raw(key, received_ns, (1000 + second) * 10**9, {"left": times_s, "right": np.sin(times_s)})
        if modality.message:
            study.add(f"/humans/physiological/{key}/features", modality.message, now, header=header(now))
    measured = {"name": "heart_rate", "unit": "1/min", "values": [70.0]}
    for topic, kind, values in (
        ("/humans/physiological/p2/ecg/any_1/device", "PhysioDeviceFeature", {"features": [measured]}),
        ("/humans/physiological/p2/ecg/any_1/clock_measurement", "ClockMeasurement", {}),
        ("/study/ack", "SessionAck", {"session_id": "s1", "service": "recorder", "phase": 2, "ok": True}),
        (host_clocks.TOPIC, "HostClockArray", {"clocks": [{"host": "lab", "reference": "lab"}]}),
    ):
        study.add(topic, kind, now, header=header(now), **values)
    study.add(host_clocks.PROBES, "ClockProbe", now, from_host="lab", to_host="robot", t1_ns=now)


def state(root: Path) -> dict[str, str]:
    """Every file below, links not followed, and what is in it."""
    found = {}
    for folder, names, files in os.walk(root):
        for name in (*names, *files):
            path = Path(folder) / name
            if path.is_symlink():
                found[str(path)] = f"link to {os.readlink(path)}"
            elif path.is_file():
                found[str(path)] = hashlib.blake2b(path.read_bytes()).hexdigest()
    return found


def run(whole: Path, name: str, seed: int, tools: list[str], place: Path) -> Iterator[Ran]:
    """One mutation through the tools."""
    for tool in tools:
        root = place / f"{name}_{seed}_{tool}"
        folder = root / "study" / "p1" / whole.name
        shutil.copytree(whole, folder)
        MUTATIONS[name](folder, random.Random(f"{name} {seed}"))
        before = state(root)
        found = _forked(tool, folder)
        wrong = found.wrong or _harm(tool, found.status, folder, before, state(root))
        yield found._replace(mutation=name, seed=seed, wrong=wrong)
        shutil.rmtree(root, ignore_errors=True)


def _harm(tool: str, status: int, folder: Path, before: dict[str, str], after: dict[str, str]) -> str:
    """What a tool changed or made that it must not: readers nothing, repair no recording, nobody anything outside."""
    changed = [path for path in before.keys() | after.keys() if after.get(path) != before.get(path)]
    changed = [path for path in changed if tool != "export" or not path.startswith(f"{folder.parent}/{OUT}/")]
    own = [path for path in changed if _is_own(tool, folder, path)]
    outside = [path for path in changed if path not in own]
    if tool in READS:
        own = [path for path in own if not (tool == "report" and Path(path).name in MADE)]
    elif tool in ("repair", "recover"):
        own = [path for path in own if path.endswith(".mcap") and "_repaired" not in path]
    elif status != 1:
        own = []
    return f"changed {', '.join(sorted(outside + own))}" if outside + own else ""


def _is_own(tool: str, folder: Path, path: str) -> bool:
    """True for what is in the recording; a withdrawal moves that to a folder named after those who stay."""
    whose = slice(1, 2) if tool == "withdraw" else slice(0)
    parts, own = ([*each.relative_to(folder.parents[2]).parts[:3]] for each in (Path(path), folder))
    del parts[whose], own[whose]
    return parts == own and Path(path).name != folder.name


def _forked(tool: str, folder: Path) -> Ran:
    with tempfile.TemporaryFile("w+b") as output:
        begun = time.monotonic()
        pid = os.fork()
        if pid == 0:
            _child(tool, folder, output)
        deadline = begun + HUNG_S
        while True:
            done, status, usage = os.wait4(pid, os.WNOHANG)
            if done:
                break
            if time.monotonic() > deadline:
                os.kill(pid, signal.SIGKILL)
                _, status, usage = os.wait4(pid, 0)
                break
            time.sleep(0.005)
        took_s = usage.ru_utime + usage.ru_stime
        hung = time.monotonic() > deadline
        output.seek(0)
        said = output.read(20_000).decode("utf-8", "replace")
    code = os.waitstatus_to_exitcode(status)
    peak_mb = usage.ru_maxrss / 1024 - BASE_MB
    wrong = f"over {MOST_S:.0f} s" if took_s >= MOST_S else f"hung for {HUNG_S:.0f} s" if hung else ""
    if "Traceback (most recent" in said:
        wrong = "traceback"
    elif code not in (0, 1) and not wrong:
        wrong = f"ended with {code}"
    elif code == 1 and not said.strip() and not wrong:
        wrong = "said nothing"
    return Ran("", 0, tool, code, took_s, peak_mb, said, wrong)


def _child(tool: str, folder: Path, output: Any) -> None:
    status = 3
    try:
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
        sys.stdout = io.TextIOWrapper(os.fdopen(1, "wb", closefd=False), "utf-8", line_buffering=True)
        sys.stderr = io.TextIOWrapper(
            os.fdopen(2, "wb", closefd=False), "utf-8", "backslashreplace", line_buffering=True
        )
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, used + MOST_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (2 << 30, 2 << 30))
        status = TOOLS[tool](folder)
    except SystemExit as err:
        status = err.code if isinstance(err.code, int) else 1
    finally:
        if sys.exc_info()[0] is not None:
            traceback.print_exc()
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)


BASE_MB = 0.0


def sweep(names: list[str], seeds: range, tools: list[str]) -> Iterator[Ran]:
    """All mutations with all seeds through all tools."""
    global BASE_MB
    with tempfile.TemporaryDirectory() as folder:
        whole = base(Path(folder) / "whole")
        BASE_MB = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / (1 << 20)
        for seed in seeds:
            for name in names:
                yield from run(whole, name, seed, tools, Path(folder) / "runs")


def main() -> int:
    """Print a line of JSON with the counts, and with --show everything that went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", default="0:1", help="FROM:TO")
    parser.add_argument("--only", nargs="+", default=list(MUTATIONS), choices=list(MUTATIONS), metavar="MUTATION")
    parser.add_argument("--tools", nargs="+", default=list(TOOLS), choices=list(TOOLS))
    parser.add_argument("--show", action="store_true")
    options = parser.parse_args()
    low, _, high = options.seeds.partition(":")
    ran, wrong, slowest, largest = 0, [], 0.0, 0.0
    for one in sweep(options.only, range(int(low), int(high)), options.tools):
        ran += 1
        slowest, largest = max(slowest, one.took_s), max(largest, one.peak_mb)
        if one.wrong:
            wrong.append([one.mutation, one.seed, one.tool, one.wrong, one.said.strip()[-300:]])
        if options.show and (one.wrong or one.took_s > 5 or one.peak_mb > 500):
            tail = "" if not one.wrong else one.said.strip()[-int(os.environ.get("TAIL", "700")) :]
            print(
                f"{one.mutation} {one.seed} {one.tool}: {one.wrong} {one.took_s:.1f} s {one.peak_mb:.0f} MB\n{tail}\n",
                flush=True,
            )
    print(json.dumps({"ran": ran, "slowest_s": round(slowest, 1), "largest_mb": round(largest), "wrong": wrong}))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
