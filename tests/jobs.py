"""Test files as pytest processes of their own, several at a time; what each passed, failed and took."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, NamedTuple

import psutil

ROOT = Path(__file__).resolve().parents[1]
KIND_END_S = 15.0
"""How long a pytest process may take to end what it has started, once it is told to."""
NOTHING_COLLECTED = 5
LOOK_S = 3.0
SPARE_PERCENT, FULL_PERCENT = 85.0, 98.0
"""Of what the cores have beside what gives way: with less in use there is room for one more, with more one too many."""
GIVES_WAY = ("nice", "-n", "5")
"""Before the command of what gets the time that the others leave, and a third of theirs where they leave none."""
TAKEN_PERCENT = 25.0
"""Of all cores, that this takes at most where the others want all of them, and are as many."""


class Job(NamedTuple):
    """One pytest process. path: a file of tests, or a folder of them. alone: beside it only pure code may run."""

    group: str
    path: Path
    alone: bool = False

    @property
    def name(self) -> str:
        return self.path.name

    @property
    def pure(self) -> bool:
        """True of code that waits for no process, and may take any time."""
        return self.group == "unit"


@dataclass
class Result:
    """What one pytest process did. seconds: on the wall; cpu_s: of it and of all it had started and waited for."""

    job: Job
    status: int
    seconds: float
    cpu_s: float
    output: str
    passed: int = 0
    failed: int = 0
    skipped: Counter[str] = field(default_factory=Counter)
    tests: dict[str, float] = field(default_factory=dict)
    """Seconds of each test."""
    unstable: str = ""
    """What a first try printed that failed, where this is the second and has passed."""

    @property
    def ok(self) -> bool:
        return self.status in (0, NOTHING_COLLECTED)

    def said(self) -> str:
        """`3 passed, 1 skipped`, or how it ended where pytest could not tell."""
        counts = {"passed": self.passed, "failed": self.failed, "skipped": self.skipped.total()}
        told = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        if self.ok or self.failed:
            return told or "no tests"
        return f"{told + ', ' if told else ''}ended with {self.status}"


class Running:
    """A job under way, in a process group of its own, with a folder of its own for what its tests write.

    Processes that share pytest's folder clean up behind each other's backs. It is kept where a test has failed.
    """

    def __init__(self, job: Job, folder: Path, arguments: Sequence[str], before: Sequence[str] = ()) -> None:
        self.job, self.begun = job, time.monotonic()
        stem = folder / f"{job.group}-{job.path.stem}"
        self._log, self._report = stem.with_suffix(".log"), stem.with_suffix(".xml")
        self._report.unlink(missing_ok=True)
        self._scratch = Path(tempfile.mkdtemp(prefix="sense4hri-"))
        own = [f"--junitxml={self._report}", f"--basetemp={self._scratch / 't'}"]
        command = [*before, sys.executable, "-m", "pytest", str(job.path), *own, *arguments]
        with self._log.open("wb") as log:
            self._process = _begin(command, log)

    @property
    def age_s(self) -> float:
        return time.monotonic() - self.begun

    def result(self) -> Result | None:
        """Where it has ended, what came of it."""
        process_id, status, used = os.wait4(self._process.pid, os.WNOHANG)
        if process_id == 0:
            return None
        self._process.returncode = os.waitstatus_to_exitcode(status)
        self._signal(signal.SIGKILL)  # what a test has left behind
        cpu_s = used.ru_utime + used.ru_stime
        output = self._log.read_text(errors="replace")
        result = Result(self.job, self._process.returncode, self.age_s, cpu_s, output)
        if self._report.exists():
            _count(result, self._report)
        if result.ok:
            shutil.rmtree(self._scratch, ignore_errors=True)
        return result

    def interrupt(self) -> None:
        """Ask it to end, so that its fixtures end what they have started."""
        self._process.send_signal(signal.SIGINT)

    def end(self, reason: str) -> Result:
        """Wait until it has ended, which it was asked to; kill what is left."""
        deadline = time.monotonic() + KIND_END_S
        while (result := self.result()) is None:
            if time.monotonic() > deadline:
                self._signal(signal.SIGKILL)
            time.sleep(0.05)
        result.status = result.status or 1
        result.output += f"\n{reason}\n"
        return result

    def _signal(self, number: int) -> None:
        try:
            os.killpg(self._process.pid, number)
        except ProcessLookupError:
            pass


def _begin(command: list[str], log: IO[bytes]) -> subprocess.Popen[bytes]:
    environment = os.environ | {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    environment.pop("METRICS_PORT", None)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # each of a thousand processes would compile all it imports
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=subprocess.STDOUT,
        cwd=ROOT,
        env=environment,
        start_new_session=True,
    )


def _count(result: Result, report: Path) -> None:
    """Add what pytest has written down of each test."""
    for case in ElementTree.parse(report).iter("testcase"):
        name = f"{case.get('classname')}::{case.get('name')}"
        result.tests[name] = result.tests.get(name, 0.0) + float(case.get("time", 0.0))
        skipped = case.find("skipped")
        if skipped is not None:
            result.skipped[skipped.get("message", "")] += 1
        elif case.find("failure") is not None or case.find("error") is not None:
            result.failed += 1
        else:
            result.passed += 1


class Room:
    """How many jobs run side by side: one more each LOOK_S in which cores had nothing to do, one less where all had.

    Some jobs compute and some wait for what they have started. least, most: jobs. aside: jobs of pure code beside them,
    which give way to them; with none, pure code is a job like any other.
    """

    def __init__(self, least: int, most: int, aside: int = 0) -> None:
        self._least, self._most, self.aside = least, most, aside
        self._jobs, self._looked = least, time.monotonic()
        used_percent()  # the next one is of the time from here on

    def jobs(self) -> int:
        """As many as there may be now."""
        if time.monotonic() - self._looked >= LOOK_S:
            self._looked = time.monotonic()
            used = used_percent()
            more = (used < SPARE_PERCENT) - (used > FULL_PERCENT)
            self._jobs = min(max(self._jobs + more, self._least), self._most)
        return self._jobs


def used_percent() -> float:
    """Of what all cores had, since the last call, for those that do not give way."""
    times = psutil.cpu_times_percent()
    return 100 * (times.user + times.system) / (100 - min(times.nice, TAKEN_PERCENT))


def following(waiting: Sequence[Job], running: Sequence[Job], room: int, aside: int) -> Job | None:
    """The first job that may begin now: there is room for so many, and for `aside` of pure code beside them.

    Beside one that is alone there is pure code and nothing else, and a core is left over.
    """

    def gives_way(job: Job) -> bool:
        return job.pure and aside > 0

    alone = any(job.alone for job in running)
    most = {False: 0 if alone else room, True: min(aside, len(os.sched_getaffinity(0)) - 1) if alone else aside}
    begun = Counter(gives_way(job) for job in running)
    return next((job for job in waiting if begun[gives_way(job)] < most[gives_way(job)]), None)


def run(jobs: Sequence[Job], room: Room, limit_s: float, folder: Path, arguments: Sequence[str]) -> Iterator[Result]:
    """Run the jobs in their order, as many at a time as there is room for; yield each result as it comes.

    Those that are alone stand before the others.

    limit_s: a job that takes longer is ended and has failed. folder: for logs and reports. When the caller stops
    listening, or is interrupted, all that runs is ended.
    """
    waiting, running = list(jobs), list[Running]()
    try:
        while waiting or running:
            while job := following(waiting, [each.job for each in running], room.jobs(), room.aside):
                waiting.remove(job)
                before = GIVES_WAY if job.pure and room.aside else ()
                running.append(Running(job, folder, arguments, before))
            for each in [*running]:
                result = each.result()
                if result is None and each.age_s > limit_s:
                    each.interrupt()
                    result = each.end(f"{each.job.path} took longer than {limit_s:g} s and was ended")
                if result is not None:
                    running.remove(each)
                    yield result
            time.sleep(0.05)
    finally:
        for each in running:
            each.interrupt()
        for each in running:
            each.end("interrupted")
