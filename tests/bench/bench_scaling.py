"""What each further participant costs: ECG, IMU and PPG in real time, a process per sensor, all services, recording.

    .venv/bin/python tests/bench/run.py scaling         # 2, 8, 16 and 24 participants: 48 sensors, about 10 minutes
    SCALING=1,2 .venv/bin/python tests/bench/run.py scaling

Samples come packed as the straps pack them; PACKETS_PER_S=5 is harder: so many packets of every stream.

Every point waits until what it costs no longer changes, for those that start cost everybody: all participants of DDS
learn of each other. Then it measures; the curve ends where the cores do, or where a service ends, which the row says.
In real time without loss: every stream has within one packet of rate x window in the recording, and none is lost.
"""

import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from process_memory import MOST_FURTHER_MIB, further_mib, own_and_proportional_mib
from scaling_counts import behind, packets
from scaling_driver import KINDS, packets_per_s
from scaling_on_paper import drivers_percent, most_participants, percent_with

DRIVER = Path(__file__).with_name("scaling_driver.py")
KEPT = Path(__file__).resolve().parents[2] / "build" / "bench"
"""Where the log of a service that has ended is kept."""
POINTS = tuple(map(int, os.environ.get("SCALING", "2,8,16,24").split(",")))
STEP_S, ALIKE, LONGEST_SETTLE_S = 10.0, 0.1, 150.0  # settled: two steps cost alike, and the cores are not full
MEASURE_S, LONGEST_START_S = 20.0, 400.0
WORK, WORK_EVERY_S = range(20_000), 0.05  # to be added up: some 0.4 ms, 1 % of a core
TICKS_PER_S = os.sysconf("SC_CLK_TCK")
SERVICES = ("interpreter_ecg", "interpreter_ppg", "clock_sync", "recorder", "web_gui")
OTHERS = ("fusion_affect", "metadata_registry", "session_coordinator")
ON_PAPER = (48, 96)  # participants
FULL = 0.97  # of all cores
IN_REAL_TIME = "every stream within one packet of rate x window, 0 lost"


class Point(NamedTuple):
    """One number of participants. percent: CPU of one core, by package, over MEASURE_S. mib: each driver's (PSS).

    lost: packets while it was measured; lost_before: since the study began, most of them while others started.
    began_ns, ended_ns: on this host's clock. behind: what is told of streams without all their packets in that time.
    work_ms: the CPU time that one and the same work took meanwhile, NaN where that is not known.
    """

    participants: int
    percent: dict[str, float]
    machine: float
    lost: int
    lost_before: int
    mib: tuple[float, ...]
    began_ns: int
    ended_ns: int
    behind: tuple[str, ...] = ()
    work_ms: float = math.nan

    @property
    def own(self) -> float:
        """What the study itself takes, as a share of all cores; others may run on this machine."""
        return sum(self.percent.values()) / 100 / (os.cpu_count() or 1)


class Ended(Exception):
    """A process of the study has ended by itself; a sentence says which, and where its log is."""


class Study:
    """All services, and participants that are added. Its methods raise Ended."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._everybody, self.drivers, self.services = folder, {}, [], {}
        self._env = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"}
        self._env |= {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "ROS_DOMAIN_ID": str(random.randint(90, 101))}

    def begin(self) -> None:
        """Start all services and wait until they have begun."""
        folder = self._folder
        parameters = {
            "recorder": (f"directory:={self.recordings}",),
            "web_gui": ("port:=0",),
            "metadata_registry": (f"database:={folder}/registry.sqlite",),
            "session_coordinator": (f"state_file:={folder}/session.json",),
        }
        for name in (*SERVICES, *OTHERS):
            words = [word for one in parameters.get(name, ()) for word in ("-p", one)]
            self.services[name] = self._start(name, ["-m", name], ["--ros-args", *words] if words else [])
        for name in self._everybody:
            self._port(name)

    @property
    def recordings(self) -> Path:
        """Where the recorder writes."""
        return self._folder / "recordings"

    def grow(self, participants: int) -> None:
        """Add participants until there are so many, and wait until everybody has begun."""
        for number in range(len(self.drivers) // 2, participants):
            for kind in ("strap", "band"):
                words = ["-p", f"sensor_id:={kind}_{number}", "-p", f"human_id:=p{number}"]
                name = f"{kind}_{number}"
                self.drivers.append(self._start(name, [str(DRIVER)], ["--ros-args", *words], KIND=kind))
        for name in self._everybody:
            self._port(name)

    def measure(self) -> Point:
        """Return what everything costs now."""
        pids = {name: [child.pid] for name, child in self.services.items()}
        pids["drivers"] = [child.pid for child in self.drivers]
        self._settle(pids)
        lost_before, began_ns = self._lost(), time.time_ns()
        before, busy, at = self._used(pids), _busy_s(), time.monotonic()
        work_ms = worked_ms(MEASURE_S)
        took_s, after, busy_s = time.monotonic() - at, self._used(pids), _busy_s() - busy
        ended_ns = time.time_ns()
        percent = {name: 100 * (after[name] - before[name]) / took_s for name in pids}
        machine = busy_s / took_s / (os.cpu_count() or 1)
        lost = self._lost() - lost_before
        size = tuple(own_and_proportional_mib(child.pid)[1] for child in self.drivers)
        participants = len(self.drivers) // 2
        return Point(participants, percent, machine, lost, lost_before, size, began_ns, ended_ns, work_ms=work_ms)

    def counted(self, point: Point) -> Point:
        """Return a point with what is behind in the recording; once the study has ended."""
        rates = {
            f"/humans/physiological/p{number}/{stream}/{kind}_{number}/raw": packets_per_s(stream)
            for number in range(point.participants)
            for kind, streams in KINDS.items()
            for stream in streams
        }
        found = packets(self.recordings, point.began_ns, point.ended_ns)
        return point._replace(behind=tuple(behind(found, rates, (point.ended_ns - point.began_ns) / 1e9)))

    def _settle(self, pids: dict[str, list[int]]) -> None:
        """Wait until two steps cost alike and the cores are not full, or LONGEST_SETTLE_S."""
        cores, before = os.cpu_count() or 1, math.inf
        for _ in range(round(LONGEST_SETTLE_S / STEP_S)):
            begun, at = sum(self._used(pids).values()), time.monotonic()
            time.sleep(STEP_S)
            share = (sum(self._used(pids).values()) - begun) / (time.monotonic() - at) / cores
            if share < FULL and abs(share - before) <= ALIKE * share:
                return
            before = share

    def end(self) -> None:
        """End all, by their own ids."""
        for child in self._everybody.values():
            child.terminate()
        for child in self._everybody.values():
            try:
                child.wait(20)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()

    def _start(self, name: str, command: list[str], words: list[str], **env: str) -> subprocess.Popen[bytes]:
        with self._log(name).open("w") as out:
            child = subprocess.Popen([sys.executable, *command, *words], stdout=out, stderr=out, env=self._env | env)
        self._everybody[name] = child
        return child

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _port(self, name: str) -> int:
        deadline = time.monotonic() + LONGEST_START_S
        while not (found := re.search(r"metrics on port (\d+)", self._log(name).read_text())):
            self._all_there()
            if time.monotonic() > deadline:
                raise RuntimeError(f"{name} did not start within {LONGEST_START_S:g} s: {self._log(name).read_text()}")
            time.sleep(0.1)
        return int(found[1])

    def _lost(self) -> int:
        """Return what the recorder says is lost, asked until it answers: on a busy machine it may say 503 for long."""
        deadline = time.monotonic() + LONGEST_START_S
        while True:
            self._all_there()
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{self._port('recorder')}/recording", timeout=30) as told:
                    return sum(topic["lost"] for topic in json.load(told)["topics"])
            except OSError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.5)

    def _all_there(self) -> None:
        """Raise Ended where one has ended; its log outlasts the bench."""
        for name, child in self._everybody.items():
            if child.poll() is not None:
                KEPT.mkdir(parents=True, exist_ok=True)
                kept = shutil.copy(self._log(name), KEPT / f"scaling_{name}.log")
                raise Ended(f"{name} ended with status {child.returncode}, log: {kept.relative_to(KEPT.parents[1])}")

    def _used(self, pids: dict[str, list[int]]) -> dict[str, float]:
        self._all_there()
        return {name: sum(map(cpu_s, each)) for name, each in pids.items()}


def cpu_s(pid: int) -> float:
    """Return the CPU that a process has used so far, in s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def worked_ms(seconds: float) -> float:
    """Do the same small work again and again for so long, and return the CPU time that one takes, in ms.

    Two threads of one core take more of it the busier the other one is, and a machine that others share at any time.
    """
    deadline, used_s, times = time.monotonic() + seconds, 0.0, 0
    while time.monotonic() < deadline or not times:
        begun_s = time.thread_time()
        sum(WORK)
        used_s, times = used_s + time.thread_time() - begun_s, times + 1
        time.sleep(WORK_EVERY_S)
    return 1e3 * used_s / times


def _busy_s() -> float:
    fields = list(map(int, Path("/proc/stat").read_text().split("\n")[0].split()[1:9]))
    return (sum(fields) - fields[3] - fields[4]) / TICKS_PER_S


def points() -> tuple[list[Point], dict[int, str]]:
    """Measure one number of participants after the other, until the cores are full or somebody ends.

    Returns what was measured, and for the number at which somebody ended the sentence that says so.
    """
    found: list[Point] = []
    ended: dict[int, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        study = Study(Path(folder))
        participants = POINTS[0]
        try:
            study.begin()
            for participants in POINTS:
                study.grow(participants)
                found.append(study.measure())
                print(found[-1], file=sys.stderr, flush=True)
                if found[-1].own > FULL:
                    break
        except Ended as err:
            ended[participants] = str(err)
        finally:
            study.end()
        return [study.counted(point) for point in found], ended


def rows() -> list[dict[str, Any]]:
    """One row per number of participants, and one per service with what a further participant costs."""
    found, ended = points()
    table = [_point_row(point) for point in found]
    table += [_row(_what(number), IN_REAL_TIME, sentence, False) for number, sentence in ended.items()]
    good = [point.participants for point in found if _keeps_up(point)]
    most = f"{max(good, default=0)} of {max([*ended, *(point.participants for point in found)])} tried"
    table.append(_row("participants in real time without loss", ">= 24", most, max(good, default=0) >= 24))
    table += [_service_row(name, found) for name in SERVICES]
    table.append(_row(_per_added("drivers"), "none set", _listed(_added(found, "drivers")), None))
    table.append(_memory_row(found))
    return table + _paper_rows(found) if len(found) > 1 else table


def _paper_rows(found: list[Point]) -> list[dict[str, Any]]:
    """What was not tried: with how many participants each process is full, and how many cores larger studies take."""
    tried = [point.participants for point in found]
    curves = {name: [point.percent[name] for point in found] for name in found[0].percent}
    drivers = curves.pop("drivers")
    full = {name: most_participants(tried, curves[name]) for name in SERVICES}
    listed = ", ".join(f"{name} {most:.0f}" for name, most in sorted(full.items(), key=lambda entry: entry[1]))
    table = [_row("on paper: participants with which one process fills a core", "none set", listed, None)]
    for wanted in ON_PAPER:
        share = drivers_percent(tried, drivers, wanted)
        services = sum(percent_with(tried, curve, wanted) for curve in curves.values())
        text = f"{services:.0f} % of a core for the services, {share:.0f} % for the drivers"
        table.append(_row(f"on paper: {_what(wanted)}", "none set", text, None))
    return table


def _keeps_up(point: Point) -> bool:
    return point.lost == 0 and not point.behind


def _what(participants: int) -> str:
    return f"{participants} participants, {2 * participants} sensors"


def _point_row(point: Point) -> dict[str, Any]:
    each = ", ".join(f"{name} {point.percent[name]:.0f}" for name in (*SERVICES, "drivers"))
    cores = f"{100 * point.own:.0f} % of all cores ({each} % of one), all of this machine {100 * point.machine:.0f} %"
    streams = f"{len(point.behind)} streams not: {point.behind[0]}" if point.behind else "every stream"
    measured = f"{cores}, {streams}, {point.lost} lost ({point.lost_before} before, while all started)"
    return _row(_what(point.participants), IN_REAL_TIME, measured, _keeps_up(point))


def _memory_row(found: list[Point]) -> dict[str, Any]:
    """What each driver after those of the first point took."""
    size = further_mib(found[0].mib, found[-1].mib) if found else math.nan
    ok = None if math.isnan(size) else size <= MOST_FURTHER_MIB
    text = "one point only" if ok is None else f"{size:.0f} MiB with its share of what all have (PSS)"
    return _row("memory of a further driver process", f"<= {MOST_FURTHER_MIB:.0f} MiB", text, ok)


def _service_row(name: str, found: list[Point]) -> dict[str, Any]:
    """What a further participant costs it; even where the largest and the smallest are within 20 % of the mean."""
    costs = _added(found, name)
    mean = sum(costs) / len(costs) if costs else 0.0
    even = all(abs(cost - mean) <= 0.2 * mean for cost in costs) if len(costs) > 1 else None
    measured = _listed(costs) + trend(costs, even) + _at_one_speed(found, name)
    return _row(_per_added(name), "even within 20 %", measured, even)


def _added(found: list[Point], name: str) -> list[float]:
    """Its cost per added participant, from point to point, in % of a core."""
    return _slopes(found, [point.percent[name] for point in found])


def _at_one_speed(found: list[Point], name: str) -> str:
    """The same, were all points measured on cores as fast as those of the first one; empty where that is not known."""
    slower = [point.work_ms / found[0].work_ms for point in found]
    if len(found) < 2 or not all(map(math.isfinite, slower)):
        return ""
    costs = _slopes(found, [point.percent[name] / times for point, times in zip(found, slower, strict=True)])
    told = ", ".join(f"{times:.2f}" for times in slower)
    return f"; by the speed of the first point ({told} times the CPU for one work): {_listed(costs)}"


def _slopes(found: list[Point], percent: list[float]) -> list[float]:
    return [
        (more - less) / (after.participants - before.participants)
        for (before, less), (after, more) in pairwise(zip(found, percent, strict=True))
    ]


def _per_added(name: str) -> str:
    return f"{name}, per added participant, from point to point"


def _listed(costs: list[float]) -> str:
    return f"{', '.join(f'{cost:.2f}' for cost in costs)} % of a core" if costs else "one point only"


def trend(costs: list[float], even: bool | None) -> str:
    """Return which way a cost that is not even goes: one that falls is a miss of the bound too, and no burden."""
    return "" if even is not False else ", falling" if costs[-1] < costs[0] else ", rising"


def _row(what: str, target: str, measured: str, ok: bool | None) -> dict[str, Any]:
    return {"what": what, "target": target, "measured": measured, "ok": ok}


if __name__ == "__main__":
    for row in rows():
        print(row["what"], "|", row["target"], "|", row["measured"], "|", row["ok"])
