"""`sense4hri-check-driver` does to every driver what a study may: another wearer, and a device that stops for a while.

    .venv/bin/python tests/bench/run.py pulled_plugs

The drivers of each study in `compose/studies` that plays one driver's devices, and what plays them, without the rest.
Each sensor goes to somebody and back; what plays the first one stops for 8 s. About a minute for each sensor; its
times are those of devices that answer, so a machine on which they do not has departures of its own.
"""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "compose"))

import study_file
from driver_check import DriverCheck
from processes import Process, claimed_domain

LISTENED_S = 5
OF_THE_DEMO = ("polar",)
"""Drivers whose virtual study is the demo."""


def rows() -> list[dict[str, Any]]:
    """A row for each driver."""
    drivers = sorted(
        path.name.removeprefix("driver-")
        for path in (Path(__file__).resolve().parents[2] / "services").glob("driver-*")
    )
    return [row(name) for name in drivers]


def row(name: str) -> dict[str, Any]:
    """What the command says of the sensors of one driver's study."""
    with tempfile.TemporaryDirectory() as folder, claimed_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)  # before the study is read, which names it for each of its processes
        study = study_file.read(study_file.find("demo" if name in OF_THE_DEMO else name))
        with playing(study, Path(folder)) as running:
            departures = pulled(study, running)
    return {
        "what": f"driver-{name}: {len(study.sensors)} sensors change wearer and back, a plug is pulled for 8 s",
        "target": "0 departures",
        "measured": f"{len(departures)} departures{': ' if departures else ''}{'; '.join(departures)}",
        "ok": not departures,
    }


def pulled(study: study_file.Study, running: dict[str, Process]) -> list[str]:
    """Where the sensors of a study depart from the contract."""
    first, *others = study.sensors
    moved = [DriverCheck(sensor.sensor_id, LISTENED_S, "--human-id", "p9") for sensor in others]
    told = [line for check in moved for line in check.departures()]
    plug = running[(study.of("sensor_bench") or first).name]  # without a bench the driver itself is stopped
    last = DriverCheck(first.sensor_id, LISTENED_S, "--human-id", "p9", "--stop-pid", str(plug.child.pid))
    return told + last.departures()


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
            words = process.command[process.command.index("-m") + 1 :]
            running[service.name] = Process(folder / f"{service.name}.log", *words, env=process.env)
            running[service.name].port()
        yield running
    finally:
        for process in reversed(running.values()):
            process.end()
