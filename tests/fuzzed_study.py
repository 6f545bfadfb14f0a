"""A study with one healthy stream and one stranger: what is left of it afterwards. For tests/graph and tests/bench."""

import json
import os
import re
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ears import ThirdPartyDriver
from processes import Process, poll
from rosbags.highlevel import AnyReader
from sense4hri.names import StreamName
from sense4hri_msgs.msg import ECG
from stranger import SERVICES

FS_HZ, FRAME, PLAYED_S = 100.0, 25, 3.0
HEALTHY = StreamName("p1", "ecg", "healthy_1")
TAKING = [
    name for name in SERVICES if name.startswith("interpreter_") and name not in ("interpreter_ecg", "interpreter_ppg")
]
STRANGER = Path(__file__).resolve().parent / "stranger.py"
TAKING_RAW = ("recorder", "interpreter_ecg", "interpreter_respiration", "clock_sync", "bridge_lsl")
SAID_WITHIN_S = 60.0
FIRST_PART = 4
"""Of as many parts: what the services remember of strangers in general is full after it."""


class Outcome(NamedTuple):
    """dead: services that ended or do not answer. tracebacks: those with one in the log. amiss: interpreters that did
    not take the stranger's stream of good form, or in whose step its values made an error.

    lost_samples (messages), lost_features: of the healthy stream. told_lost, told_missed: of lost_samples and of what
    the stranger sent to the healthy stream's topic, as recorder.json says it: on the way, and before the recorder was
    known to who published it. silent: messages of either that are neither recorded nor told. sent: by the stranger.
    uncounted: what the ECG interpreter did not count of the refused on the healthy stream. unnamed: services whose log
    does not name the stranger's node. resident_mib: memory of each service after the first part of it all, and at the
    end.
    """

    dead: list[str]
    tracebacks: list[str]
    amiss: list[str]
    lost_samples: int
    lost_features: int
    told_lost: int
    told_missed: int
    silent: int
    sent: int
    uncounted: int
    unnamed: list[str]
    resident_mib: dict[str, tuple[float, float]]


def fuzz(
    start: Callable[..., Process],
    opened: Callable[[ThirdPartyDriver], ThirdPartyDriver],
    folder: Path,
    count: int,
    settle_s: float = 0.0,
) -> Outcome:
    """Run every service of a study, one healthy stream, and a stranger who sends count things.

    settle_s: how long the services have to give memory back before it is looked at, twice.
    """
    given: dict[str, dict[str, Any]] = {
        "recorder": {"directory": folder / "recordings", "free_floor_mb": 0},
        "metadata_registry": {"database": folder / "registry.sqlite"},
        "session_coordinator": {"state_file": folder / "session.json"},
        "web_gui": {"port": 0},
        "bridge_lsl": {"topics": ["**"], "session": f"test-{os.getpid()}"},
    }
    running = {name: start(name, **given.get(name, {})) for name in SERVICES}
    driver = opened(ThirdPartyDriver(HEALTHY, ECG, _wave, FS_HZ, FRAME, "uV"))
    for process in running.values():
        process.port()
    driver.until_heard(by=TAKING_RAW)
    _play(driver)
    first = count // FIRST_PART
    sent = _visited(start, driver, first, seed=2)
    _wait(driver, settle_s)
    before_mib = _resident_mib(running)
    sent += _visited(start, driver, count - first, seed=1)
    counted = lambda: _refused(running["interpreter_ecg"], "PhysioRaw")  # noqa: E731
    dead = [name for name, process in running.items() if process.child.poll() is not None or not _alive(process)]
    if not dead:
        driver.until(lambda: counted() >= sent[HEALTHY.topic("raw")], lambda: f"{counted()} of {sent}", SAID_WITHIN_S)
    _wait(driver, settle_s)
    after_mib = _resident_mib(running)
    logs = {name: process.log() for name, process in running.items()}
    if running["recorder"].child.poll() is None:
        running["recorder"].stop()
    recorded, foreign, told_lost, told_missed = _recorded(folder / "recordings")
    return Outcome(
        dead,
        [name for name, log in logs.items() if "Traceback" in log],
        [
            name
            for name in TAKING
            if "Hz, unit" not in logs[name].partition("bad_4/raw: ")[2] or "its samples make" in logs[name]
        ],
        driver.sent // FRAME - recorded,
        _due(driver) - len(driver.features),
        told_lost,
        told_missed,
        driver.sent // FRAME + sent[HEALTHY.topic("raw")] - recorded - foreign - told_lost - told_missed,
        sum(sent.values()),
        0 if dead else max(0, sent[HEALTHY.topic("raw")] - counted()),
        [name for name in SERVICES if name != "recorder" and not re.search(r"refused from .*/stranger", logs[name])],
        {name: (before_mib[name], after_mib[name]) for name in after_mib},
    )


def _visited(start: Callable[..., Process], driver: ThirdPartyDriver, count: int, seed: int) -> Counter[str]:
    """Have a stranger send count things while the healthy stream plays; return how many it sent to each topic."""
    stranger = start(str(STRANGER), str(count), str(seed), HEALTHY.topic("raw"))
    while "done" not in stranger.log():
        assert stranger.child.poll() is None, stranger.log()
        _play(driver)
    _play(driver)
    stranger.end()
    return Counter({topic: int(number) for number, topic in re.findall(r"sent (\d+) to (\S+)", stranger.log())})


def _resident_mib(running: dict[str, Process]) -> dict[str, float]:
    """Return the memory of every service that still runs, as it tells it."""
    alive = {name: process for name, process in running.items() if process.child.poll() is None}
    return {name: _told(process, "process_resident_memory_bytes") / (1 << 20) for name, process in alive.items()}


def _told(process: Process, metric: str) -> float:
    found = re.search(rf"^{re.escape(metric)} (\S+)$", process.get("/metrics")[1], re.M)
    assert found, f"{metric} is not told"
    return float(found[1])


def _wait(driver: ThirdPartyDriver, seconds: float) -> None:
    ends_s = time.monotonic() + seconds
    driver.until(lambda: time.monotonic() >= ends_s, "so much time has passed", 2 * seconds + 1)


def _play(driver: ThirdPartyDriver) -> None:
    """Play some seconds, and wait for what was made of all that was played so far."""
    driver.play(PLAYED_S)
    driver.until(
        lambda: len(driver.features) >= _due(driver), lambda: f"{len(driver.features)} of {_due(driver)} features"
    )


def _due(driver: ThirdPartyDriver) -> int:
    return int((driver.sent - 1) / FS_HZ)


def _wave(times_s: Any) -> dict[str, Any]:
    """A heart of 60 beats per minute."""
    return {"ecg": 1000.0 * np.exp(-(((times_s % 1.0) - 0.5) ** 2) / 2e-4)}


def _alive(process: Process) -> bool:
    return poll(lambda: process.get("/healthz")[0] == 200, "alive") is True


def _refused(process: Process, kind: str) -> int:
    found = re.search(
        rf'sense4hri_refused_messages_total{{field="{kind}"[^}}]*}} ([0-9.]+)', process.get("/metrics")[1]
    )
    return int(float(found[1])) if found else 0


def _recorded(recordings: Path) -> tuple[int, int, int, int]:
    """Messages on the healthy stream's topic: recorded, recorded of the stranger's, told lost, told missed."""
    (folder,) = {path.parent for path in recordings.rglob("*.mcap")}
    with AnyReader([folder]) as reader:
        connections = [each for each in reader.connections if each.topic == HEALTHY.topic("raw")]
        sizes = [len(cdr) for _, _, cdr in reader.messages(connections)]
    own = sum(size > 8 * FRAME for size in sizes)
    topics = json.loads((folder / "recorder.json").read_text())["topics"]
    told = [one for one in topics if one["topic"] == HEALTHY.topic("raw")]
    lost, missed = (sum(one[name] for one in told) for name in ("lost", "missed_at_start"))
    return own, len(sizes) - own, lost, missed
