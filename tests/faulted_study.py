"""A demo study in a session whose services are killed, stopped and starved one after the other: what its page tells.

For tests/graph (a short form) and tests/bench (all of it). What a supervisor does, this does: who is gone is begun
again RESTART_S later.
"""

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import study_file
from aiohttp import ClientError, ClientSession, WSMsgType
from processes import Process, Processes, claimed_domain, poll
from sensor_bench_process import bus_pid_of

STRAP, BAND = "h10_1", "verity_1"
COORDINATOR, RECORDER, PAGE, BENCH = "session_coordinator", "recorder", "web_gui", "sensor_bench"
READY_S, SETTLES_S, RECOVERS_S = 90.0, 90.0, 90.0
RESTART_S, STOPPED_S = 1.0, 15.0
TELLS_S = 30.0
"""To wait for a sentence at most; the target is 5 s."""
CALM_S = 2.0
"""For so long nothing may be wrong before a fault, and after it."""
Start = Callable[..., Process]


class Told(NamedTuple):
    """What came of one fault. told_s, recovered_s: None = never; recovered: after the hand of the supervisor.

    from_ns, to_ns: host's clock, from the fault until it was over.
    """

    fault: str
    service: str
    told_s: float | None
    sentence: str
    recovered_s: float | None
    from_ns: int
    to_ns: int


class Place(NamedTuple):
    """Where a study runs. disk: for its recordings; small: it can be filled."""

    folder: Path
    disk: Path
    small: bool
    processes: Processes


@contextmanager
def place(disk_mb: int) -> Iterator[Place]:
    """Yield a place with a ROS domain of its own, and a disk of disk_mb where one can be mounted; all ends with it."""
    with tempfile.TemporaryDirectory() as name, claimed_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        folder, disk = Path(name), Path(name) / "disk"
        disk.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", f"size={disk_mb}m", "none", str(disk)]
        small = subprocess.run(mount, capture_output=True, check=False).returncode == 0
        processes = Processes(folder, folder)
        try:
            yield Place(folder, disk, small, processes)
        finally:
            processes.close()
            if small:
                subprocess.run(["umount", str(disk)], check=True)


class Page:
    """A browser's WebSocket to the page, without the browser: the problems of the newest message, and when it came."""

    def __init__(self, address: str) -> None:
        self._address, self._ended = address, threading.Event()
        self.problems: dict[str, str] = {}
        self.session: dict[str, Any] = {}
        self.heard_s, self.connected = time.monotonic(), False
        self._thread = threading.Thread(target=lambda: asyncio.run(self._listen()), daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join(5.0)

    async def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                async with ClientSession() as http, http.ws_connect(f"{self._address}/ws") as socket:
                    while not self._ended.is_set():
                        self._take(await socket.receive(1.0))
            except (ClientError, TimeoutError, ConnectionError):
                self.connected = False
                await asyncio.sleep(0.2)

    def _take(self, received: Any) -> None:
        if received.type is not WSMsgType.TEXT:
            raise ConnectionError("the page is gone")
        self.heard_s, self.connected = time.monotonic(), True
        message = json.loads(received.data)
        if message["type"] == "study":
            self.session = message["session"]
            self.problems = {problem["key"]: problem["text"] for problem in message["problems"]}

    def silent(self) -> str:
        """What the browser says of a page that is gone, or silent for as long as the browser bears it."""
        lost = not self.connected or time.monotonic() - self.heard_s > 3.0
        return "No connection to the server" if lost else ""


class FaultedStudy:
    """The demo's services with one person's strap and arm band, as processes.

    recordings: the folder for them. only: names of services, all where none is given; a sensor's driver has its name.
    """

    def __init__(self, folder: Path, recordings: Path, start: Start, only: Sequence[str] = ()) -> None:
        self._folder, self._start, self.recordings = folder, start, recordings
        study = study_file.read(study_file.find("demo"), {**os.environ, "RECORDINGS": str(recordings), "GUI_PORT": "0"})
        for volume in study.volumes():
            (folder / volume).mkdir(exist_ok=True)
        wanted = {s.sensor_id or s.package: s for s in study.processes if s.sensor_id in ("", STRAP, BAND)}
        self._services = {name: service for name, service in wanted.items() if not only or name in only}
        self.streams = [topic for topic in study.required_streams if topic.split("/")[5] in self._services]
        drivers = [name for name, service in self._services.items() if service.sensor_id]
        self.names = [*(name for name in self._services if name not in drivers), *drivers]
        self.running: dict[str, Process] = {}
        for group in (self.names[: -len(drivers)], drivers):
            self.running |= {name: self.begun(name) for name in group}
            for name in group:
                poll(lambda n=name: self.running[n].get("/readyz")[0] == 200, f"{name} is ready", READY_S)
        self.page = Page(self._address())

    def begin(self) -> None:
        """Start a session and wait until it is recorded and nothing is wrong."""
        required = [word for topic in self.streams for word in ("--require", topic)]
        self._session("start", "--study", "faults", "--session", "faults", "--allow-warmup", "--human", "p1", *required)
        poll(self.calm, lambda: f"all is well: {self.page.problems}", SETTLES_S)

    def end(self) -> None:
        """Stop the session, and wait for the reports of all its parts."""
        self._session("stop")
        self.page.close()
        poll(lambda: all((f / "report.json").exists() for f in self.folders()), self.running[RECORDER].log, SETTLES_S)

    def calm(self) -> bool:
        """True where the session is recorded and nothing has been wrong for a while."""
        end_s = time.monotonic() + CALM_S
        while time.monotonic() < end_s:
            if self.page.silent() or self._of(self.page.problems) or self.page.session.get("phase") != "recording":
                return False
            time.sleep(0.05)
        return True

    def killed(self, name: str) -> Told:
        """SIGKILL, and what runs it begins it again."""

        def again() -> None:
            self.running[name] = self.begun(name)
            if name == PAGE:
                self.page.close()
                self.page = Page(self._address())

        return self.suffer("SIGKILL", name, self.running[name].kill, again, RESTART_S)

    def stopped(self, name: str, seconds: float = STOPPED_S) -> Told:
        """SIGSTOP, and SIGCONT so much later."""
        send = self.running[name].send
        return self.suffer(
            f"SIGSTOP {seconds:g} s", name, lambda: send(signal.SIGSTOP), lambda: send(signal.SIGCONT), seconds
        )

    def bus_killed(self) -> Told:
        """D-Bus gone: the bench brings it back by itself."""
        process = bus_pid_of(self.running[BENCH].child.pid)
        return self.suffer("D-Bus daemon killed", "h10_1", lambda: os.kill(process, signal.SIGKILL), lambda: None, 0.0)

    def disk_full(self) -> Told:
        """The disk of the recordings is filled up, and room is made again after 15 s."""
        ballast = self.recordings / "ballast"

        def fill() -> None:
            with suppress(OSError), ballast.open("wb", buffering=0) as file:  # no byte is left
                while True:
                    file.write(bytes(1 << 12))

        return self.suffer("disk full for 15 s", RECORDER, fill, ballast.unlink, STOPPED_S)

    def suffer(
        self, fault: str, service: str, hurt: Callable[[], None], heal: Callable[[], None], wait_s: float
    ) -> Told:
        """Do what hurts, note what the page tells, heal so long after it began, and wait until nothing is wrong."""
        poll(self.calm, lambda: f"all is well before {fault} of {service}: {self.page.problems}", SETTLES_S)
        before = {*self._named()}
        from_ns, begun_s = time.time_ns(), time.monotonic()
        hurt()
        told: list[tuple[float, str]] = []

        def look() -> None:
            if not told and (sentence := self._sentence(service, before)):
                told.append((time.monotonic() - begun_s, sentence))

        while time.monotonic() - begun_s < wait_s:
            look()
            time.sleep(0.02)
        heal()
        healed_s = well_s = time.monotonic()
        while time.monotonic() - well_s < CALM_S and time.monotonic() - healed_s < RECOVERS_S:
            look()
            waits_for_sentence = not told and time.monotonic() - healed_s < TELLS_S
            well = not self.page.silent() and not self._of(self.page.problems)
            if waits_for_sentence or not well or self.page.session.get("phase") != "recording":
                well_s = time.monotonic()
            time.sleep(0.02)
        over = time.monotonic() - well_s >= CALM_S
        at_s, sentence = told[0] if told else (None, "")
        return Told(fault, service, at_s, sentence, well_s - healed_s if over else None, from_ns, time.time_ns())

    def folders(self) -> list[Path]:
        """Return the session's folders, the first one first."""
        found = [path.parent for path in self.recordings.rglob("recorder.json")]
        sessions = [folder for folder in found if json.loads((folder / "recorder.json").read_text())["session"]]
        return sorted(sessions, key=lambda folder: (len(folder.name), folder.name))

    def reports(self) -> list[dict[str, Any]]:
        """Return the reports of all parts."""
        return [json.loads((folder / "report.json").read_text()) for folder in self.folders()]

    def _sentence(self, service: str, before: set[str]) -> str:
        """What the page tells of the service and did not before; that it was begun anew, where that was at once."""
        if service == PAGE:
            return self.page.silent()
        new = [text for text in self._named() if text not in before]
        return next((text for text in new if service in text or service in text.replace(" ", "_")), "")

    def _named(self) -> list[str]:
        """Leave out what a strap says at any time: of its quality while features begin, and of its clock."""
        return [text for key, text in self.page.problems.items() if not key.startswith(("quality ", "clock ", "late "))]

    def _of(self, problems: dict[str, str]) -> list[str]:
        """Leave out also what lasts though all is well again: who was begun anew a moment ago, what was lost before."""
        past = re.compile(r"(quality|clock|afresh|losing|late) |recorder lost: ")
        return [text for key, text in problems.items() if not past.match(f"{key}: {text}")]

    def begun(self, name: str, **env: str) -> Process:
        """Start one of its services. env: what is other than the study says."""
        process = self._services[name].process(self._folder)
        parameters = {"record_when": "session", "free_floor_mb": 2} if name == RECORDER else {}
        _, _, *words = process.command  # without `python -m`
        return self._start(*words, env={**process.env, **env}, **parameters)

    def _address(self) -> str:
        self.running[PAGE].until("the page is at ")
        return re.findall(r"the page is at (\S+)", self.running[PAGE].log())[-1]

    def _session(self, *words: str) -> None:
        command = [sys.executable, "-m", "session_coordinator.cli", *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def said(reports: Sequence[dict[str, Any]], told: Told) -> list[str]:
    """What the reports say of a fault: their events in its time, or shortly after, that name the service."""
    name = told.service
    return [
        event["what"]
        for report in reports
        for event in report["events"]
        if told.from_ns - 1_000_000_000 <= event["ros_ns"] <= told.to_ns + 30_000_000_000
        and (name in event["what"] or name == event["source"] == RECORDER)
    ]


def lost(reports: Sequence[dict[str, Any]], told: Told, but: Sequence[str]) -> int:
    """How many samples of streams are missing in a fault's time, of all but these sensors."""
    return sum(
        gap["lost_samples"]
        for report in reports
        for stream in report["streams"]
        if stream["kind"] == "raw" and stream["stream"].rpartition("/")[2] not in but
        for gap in stream["gaps"]
        if gap["from"]["ros_ns"] < told.to_ns and gap["to"]["ros_ns"] > told.from_ns
    )
