"""What everything of one participant costs at once: all nine modalities and an accelerometer, all services, recording.

    .venv/bin/python tests/bench/run.py nine_modalities        # about 2 minutes

The processes are those of `make demo STUDY=nine-modalities`; it is measured once every stream has features.
"""

import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from bench_scaling import cpu_s
from process_memory import resident_mib

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "compose"))
import study_file  # noqa: E402

SETTLE_S, MEASURE_S, LONGEST_START_S, STOP_S = 20.0, 60.0, 90.0, 20.0
TARGET_PERCENT = 60.0
FRAMES_PER_S = 10.0  # of every stream: driver-file's `frame_s`
STREAMS = 10


class Study:
    """A study's processes, begun together."""

    def __init__(self, folder: Path, name: str = "nine-modalities") -> None:
        self._folder = folder
        env = {key: value for key, value in os.environ.items() if key != "METRICS_PORT"}
        env |= {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "ROS_DOMAIN_ID": str(random.randint(90, 101))}
        self.study = study_file.read(study_file.find(name), env | {"RECORDINGS": str(folder / "recordings")})
        for volume in self.study.volumes():
            (folder / volume).mkdir(exist_ok=True)
        self.children: dict[str, subprocess.Popen[bytes]] = {}
        for service in self.study.processes:
            process = service.process(folder)
            words = ["-p", "port:=0"] if service.package == "web_gui" else []
            with self._log(service.name).open("w") as out:
                child = subprocess.Popen([*process.command, *words], stdout=out, stderr=out, env=env | process.env)
            self.children[service.name] = child

    def port(self, name: str) -> int:
        """Return where a service answers HTTP. Raises RuntimeError where it never begins."""
        deadline = time.monotonic() + LONGEST_START_S
        while not (found := re.search(r"metrics on port (\d+)", self._log(name).read_text())):
            if time.monotonic() > deadline:
                raise RuntimeError(f"{name} did not start: {self._log(name).read_text()[-2000:]}")
            time.sleep(0.1)
        return int(found[1])

    def topics(self) -> list[dict[str, Any]]:
        """Return what the recorder has of every topic."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port('recorder')}/recording", timeout=30) as answer:
            return list(json.load(answer)["topics"])

    def end(self) -> None:
        """End all, by their own ids."""
        for child in self.children.values():
            child.terminate()
        for child in self.children.values():
            try:
                child.wait(STOP_S)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"


def messages(topics: list[dict[str, Any]], field: str) -> dict[str, int]:
    """Return how many messages of a field were recorded, by topic."""
    return {topic["topic"]: topic["messages"] for topic in topics if topic["topic"].endswith(f"/{field}")}


def measure() -> tuple[dict[str, float], dict[str, float], float, int, list[str]]:
    """Return CPU (% of a core) and memory (MiB) by service, raw messages against due, lost ones, mute interpreters."""
    with tempfile.TemporaryDirectory() as folder:
        study = Study(Path(folder))
        try:
            for name in study.children:
                study.port(name)
            time.sleep(SETTLE_S)
            first, used, begun_s = study.topics(), _used(study), time.monotonic()
            time.sleep(MEASURE_S)
            took_s, after, last = time.monotonic() - begun_s, _used(study), study.topics()
            percent = {name: 100 * (after[name] - used[name]) / took_s for name in used}
            memory = {name: resident_mib(child.pid) for name, child in study.children.items()}
        finally:
            study.end()
    came = sum(messages(last, "raw").values()) - sum(messages(first, "raw").values())
    before, features = messages(first, "features"), messages(last, "features")
    mute = [topic for topic, count in features.items() if count - before.get(topic, 0) < 0.9 * took_s]
    lost = sum(topic["lost"] for topic in last)
    return percent, memory, came / took_s / (STREAMS * FRAMES_PER_S), lost, mute


def _used(study: Study) -> dict[str, float]:
    return {name: cpu_s(child.pid) for name, child in study.children.items()}


def rows() -> list[dict[str, Any]]:
    """One row for all services together, one for what was lost, one for each service's share."""
    percent, memory, rate, lost, mute = measure()
    total = sum(percent.values())
    each = ", ".join(f"{name} {share:.1f}" for name, share in sorted(percent.items(), key=lambda pair: -pair[1]))
    what = f"one participant, {STREAMS} streams, recording, all {len(percent)} processes"
    kept = lost == 0 and abs(rate - 1) < 0.01 and not mute
    told = f"{lost} lost, rate {rate:.3f}" + (f", too few features: {', '.join(mute)}" if mute else "")
    return [
        _row(what, f"<= {TARGET_PERCENT:g} % of a core", f"{total:.0f} %", total <= TARGET_PERCENT),
        _row("the same: messages lost, and come against due", "0 lost, rate 1", told, kept),
        _row("the same, by process", "none set", f"{each} % of a core", None),
        _row("the same, memory (RSS)", "none set", f"{sum(memory.values()):.0f} MiB", None),
    ]


def _row(what: str, target: str, measured: str, ok: bool | None) -> dict[str, Any]:
    return {"what": what, "target": target, "measured": measured, "ok": ok}


if __name__ == "__main__":
    for row in rows():
        print(row["what"], "|", row["target"], "|", row["measured"], "|", row["ok"])
