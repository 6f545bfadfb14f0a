"""A study to which everything happens, with real processes; its report says exactly that, and its export opens."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import scripted_study
import study_file
from ears import Ears
from processes import Process, poll
from scripted_study import BAND, STRAP, STREAMS
from sense4hri import qos
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import PhysioRaw
from wall_clock import WallClock

PAGE = "web_gui"
READY_S = 90.0
DRAIN_S, LATE_NS = 0.3, 10**9


class ProcessLab:
    """The demo's services and sensors, all but the page, as processes that share one wall clock."""

    def __init__(self, folder: Path, start: Callable[..., Process], ears: Ears) -> None:
        self._folder, self._start, self._ears = folder, start, ears
        self.clock = WallClock(folder)
        self.recordings = folder / "recordings"
        self._heard = {topic: ears.hear(PhysioRaw, topic, qos.RAW) for topic in STREAMS.values()}
        study = study_file.read(study_file.find("demo"), {**os.environ, "RECORDINGS": str(self.recordings)})
        for volume in study.volumes():
            (folder / volume).mkdir()
        self._services = {service.sensor_id or service.package: service for service in study.processes}
        others = [name for name, service in self._services.items() if not service.sensor_id and name != PAGE]
        self._running = {name: self._begin(name) for name in others}
        for process in self._running.values():
            poll(lambda p=process: p.get("/readyz")[0] == 200, f"{process.log_file.name}: ready", READY_S)
        self._running |= {sensor: self._begin(sensor) for sensor in (STRAP, BAND)}

    def _begin(self, name: str) -> Process:
        process = self._services[name].process(self._folder)
        parameters = {"record_when": "session"} if name == "recorder" else {}
        _, _, *words = process.command  # without `python -m`
        return self._start(*words, env=process.env | self.clock.env, **parameters)

    def session(self, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "session_coordinator.cli", *arguments]
        env = {**os.environ, **self.clock.env}
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=env)

    def start(self, sensor: str) -> None:
        self._running[sensor] = self._begin(sensor)

    def kill(self, service: str) -> None:
        self._running[service].kill()
        self.start(service)

    def knobs(self, sensor: str, **values: Any) -> None:
        status, answer = self._running["sensor_bench"].ask(f"/devices/{sensor}/knobs", values)
        assert status == 200, answer

    def samples(self, topic: str) -> int:
        drained = time.monotonic() + DRAIN_S  # what has come while a command was waited for is no news
        while time.monotonic() < drained:
            if self._heard_late():
                drained = time.monotonic() + DRAIN_S
        return len(self._heard[topic])

    def _heard_late(self) -> bool:
        """Hear one thing, if anything has come; True where it was sent long ago, as after a machine stood still."""
        before = {topic: len(heard) for topic, heard in self._heard.items()}
        self._ears.spin(0)
        fresh = [heard[-1] for topic, heard in self._heard.items() if len(heard) > before[topic]]
        return any(to_ns(message.header.stamp) < self.clock.now_ns() - LATE_NS for message in fresh)

    def parts(self) -> int:
        return len(scripted_study.folders(self.recordings))

    def until_reported(self) -> None:
        """Wait for the report of the last folder."""
        poll(
            lambda: all((folder / "report.html").exists() for folder in scripted_study.folders(self.recordings)),
            self._running["recorder"].log,
            120,
        )


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_report_says_what_was_done(start, ears, tmp_path):
    """A killed driver and recorder, a cut link and a stepped clock stand in the reports, nothing else does."""
    lab = ProcessLab(tmp_path, start, ears)
    story = scripted_study.play(lab)
    lab.until_reported()
    scripted_study.check(lab.recordings, story, tmp_path / "exports")
