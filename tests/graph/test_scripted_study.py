"""A study to which everything happens, with real processes; its report says exactly that, and its export opens."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import scripted_study
from ears import Ears
from processes import Process, poll
from scripted_study import BAND, STRAP, STREAMS
from sense4hri import qos
from sense4hri_msgs.msg import PhysioRaw
from wall_clock import WallClock

STUDY = Path(__file__).resolve().parents[2] / "compose" / "studies" / "demo"
SERVICES = ("clock_sync", "interpreter_ecg", "interpreter_ppg", "fusion_affect")
READY_S = 90.0


class ProcessLab:
    """The demo's services and sensors as processes that share one wall clock."""

    def __init__(self, folder: Path, start: Callable[..., Process], ears: Ears) -> None:
        self._folder, self._start, self._ears = folder, start, ears
        self.clock = WallClock(folder)
        self.recordings = folder / "recordings"
        self._heard = {topic: ears.hear(PhysioRaw, topic, qos.RAW) for topic in STREAMS.values()}
        self.recorder = self._recorder()
        self.bench = self._begin("sensor_bench", socket_path=str(folder / "bus"))
        others = [self._begin(service) for service in SERVICES]
        others.append(self._begin("metadata_registry", database=str(folder / "registry.sqlite")))
        others.append(self._begin("session_coordinator", state_file=str(folder / "session.json")))
        for process in (self.recorder, self.bench, *others):
            poll(lambda p=process: p.get("/readyz")[0] == 200, f"{process.log_file.name}: ready", READY_S)
        self._drivers = {sensor: self._driver(sensor) for sensor in (STRAP, BAND)}

    def _begin(self, *command: str, **parameters: Any) -> Process:
        env = {"DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={self._folder / 'bus'}", **self.clock.env}
        return self._start(*command, env=env, **parameters)

    def _recorder(self) -> Process:
        return self._begin("recorder", directory=str(self.recordings), record_when="session")

    def _driver(self, sensor: str) -> Process:
        return self._begin("driver_polar", "--ros-args", "--params-file", str(STUDY / f"{sensor}.yaml"))

    def session(self, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "session_coordinator.cli", *arguments]
        env = {**os.environ, **self.clock.env}
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=env)

    def start(self, sensor: str) -> None:
        self._drivers[sensor] = self._driver(sensor)

    def kill(self, service: str) -> None:
        if service == "recorder":
            self.recorder.kill()
            self.recorder = self._recorder()
        else:
            self._drivers[service].kill()
            self.start(service)

    def knobs(self, sensor: str, **values: Any) -> None:
        status, answer = self.bench.ask(f"/devices/{sensor}/knobs", values)
        assert status == 200, answer

    def samples(self, topic: str) -> int:
        for _ in range(50):
            self._ears.spin(0)
        return len(self._heard[topic])

    def until_reported(self) -> None:
        """Wait for the report of the last folder."""
        poll(
            lambda: all((folder / "report.html").exists() for folder in scripted_study.folders(self.recordings)),
            self.recorder.log,
            60,
        )


@pytest.mark.timeout(400)
def test_the_report_says_what_was_done(start, ears, tmp_path):
    """A killed driver and recorder, a cut link and a stepped clock stand in the reports, nothing else does."""
    lab = ProcessLab(tmp_path, start, ears)
    story = scripted_study.play(lab)
    lab.until_reported()
    scripted_study.check(lab.recordings, story, tmp_path / "exports")
