"""`sense4hri-check-driver` does to every driver what a study may: another wearer, and a device that stops for a while.

The drivers of each study in `compose/studies` that plays one driver's devices, and what plays them, without the rest.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import study_file
from driver_check import DriverCheck
from processes import Process

ROOT = Path(__file__).resolve().parents[2]
LISTENED_S = 5
OF_THE_DEMO = ("polar",)
"""Drivers whose virtual study is the demo."""
PORTS = re.compile(r"\b(50020|8090)\b")
"""Of the virtual eye trackers, which another test may have opened at the same time."""


def studies() -> list[str]:
    """For each driver the study that plays its devices."""
    drivers = sorted(path.name.removeprefix("driver-") for path in (ROOT / "services").glob("driver-*"))
    return ["demo" if name in OF_THE_DEMO else name for name in drivers]


@pytest.mark.slow
@pytest.mark.parametrize("name", studies())
def test_another_wearer_and_a_pulled_plug_are_stood(name, ros_domain, tmp_path):
    """Each sensor goes to somebody and back; what plays the first one stops for 8 s, which is told, and goes on."""
    study = study_file.read(study_file.find(name))
    first, *others = study.sensors
    with playing(study, tmp_path) as running:
        moved = [DriverCheck(sensor.sensor_id, LISTENED_S, "--human-id", "p9") for sensor in others]
        assert [line for check in moved for line in check.departures()] == []
        plug = running[(study.of("sensor_bench") or first).name]  # without a bench the driver itself is stopped
        pulled = DriverCheck(first.sensor_id, LISTENED_S, "--human-id", "p9", "--stop-pid", str(plug.child.pid))
        assert pulled.departures() == []


@contextmanager
def playing(study: study_file.Study, folder: Path) -> Iterator[dict[str, Process]]:
    """The drivers of a study and what plays their devices, by service, and nothing else of it."""
    running: dict[str, Process] = {}
    for name in study.volumes():
        (folder / name).mkdir()
    bench = study.of("sensor_bench")
    try:
        for service in (*((bench,) if bench else ()), *study.sensors):
            process = service.process(folder)
            words = [free(word) for word in process.command[process.command.index("-m") + 1 :]]
            running[service.name] = Process(folder / f"{service.name}.log", *words, env=process.env)
            running[service.name].port()
        yield running
    finally:
        for process in reversed(running.values()):
            process.end()


def free(word: str) -> str:
    """A port of the study becomes one of this process's own."""
    return PORTS.sub(lambda found: str(10000 + (int(found[0]) + os.getpid()) % 20000), word)
