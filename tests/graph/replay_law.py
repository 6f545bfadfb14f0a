"""Plays a recording through the services that compute from it, records what they say, and compares it."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.highlevel import AnyReader

COMPUTED = ("/features", "/clock", "/state")
SERVICES = ("clock_sync", "interpreter_ecg", "interpreter_ppg", "fusion_affect")
TOLERANCE = 1e-9
Messages = dict[str, list[Any]]
"""By topic, in their order."""


class Process(NamedTuple):
    """A service, and where its output goes."""

    child: subprocess.Popen[bytes]
    log: Path


@contextmanager
def running(work: Path, commands: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Process]]:
    """Services started together, each a module or script and its parameters; all ready; ended with SIGTERM."""
    processes: dict[str, Process] = {}
    try:
        for name, (program, *parameters) in commands.items():
            first = [program] if program.endswith(".py") else ["-m", program]
            words = [word for p in parameters for word in ("-p", p)]
            log = work / f"{name}.log"
            with log.open("wb") as out:
                command = [sys.executable, *first, "--ros-args", *words]
                processes[name] = Process(subprocess.Popen(command, stderr=out, stdout=out, env=os.environ), log)
        deadline = time.monotonic() + 40
        for child, log in processes.values():
            while "metrics on port" not in log.read_text():
                assert child.poll() is None, log.read_text()
                assert time.monotonic() < deadline, log.read_text()
                time.sleep(0.05)
        yield processes
        for child, _ in processes.values():
            if child.poll() is None:
                child.send_signal(signal.SIGTERM)
        for child, log in processes.values():
            assert child.wait(15) == 0, log.read_text()
    finally:
        for child, _ in processes.values():
            if child.poll() is None:
                child.kill()
                child.wait()


@contextmanager
def process(package: str, log: Path, *parameters: str) -> Iterator[subprocess.Popen[bytes]]:
    """One service, ready; ended with SIGTERM."""
    with running(log.parent, {log.stem: [package, *parameters]}) as processes:
        yield processes[log.stem].child


def recompute(bag: Path, rate: float, work: Path, *parameters: str, timeout_s: float = 100.0) -> Path:
    """Play the raw part of bag through the services at this rate; return the folder of what they computed."""
    work.mkdir(parents=True)
    exclude = 'exclude:=["/humans/physiological/*/*/*/raw"]'
    commands = {name: [name] for name in SERVICES} | {"recorder": ["recorder", f"directory:={work / 'out'}", exclude]}
    with running(work, commands):
        played = [f"bag:='{bag}'", f"rate:={rate}", "what:=raw", *parameters]
        with running(work, {"replay": ["replay", *played]}) as processes:
            assert processes["replay"].child.wait(timeout_s) == 0, processes["replay"].log.read_text()
    assert "NOT PLAYED" not in (work / "replay.log").read_text()
    return work / "out"


def bags(folder: Path) -> list[Path]:
    """Every recording in a folder, in the order of their names."""
    return sorted(found.parent for found in folder.rglob("metadata.yaml"))


def computed(folder: Path) -> Messages:
    """Features, clock models and states of all recordings in a folder."""
    found: Messages = defaultdict(list)
    for bag in bags(folder):
        with AnyReader([bag]) as reader:
            chosen = [c for c in reader.connections if c.topic.endswith(COMPUTED) and c.topic.startswith("/humans/")]
            for connection, _, data in reader.messages(chosen):
                found[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return dict(found)


def between(messages: Messages, from_ns: int, until_ns: int) -> Messages:
    """Those stamped from_ns or later and before until_ns."""
    return {t: [m for m in said if from_ns <= stamp_ns(m) < until_ns] for t, said in messages.items()}


def chosen(messages: Messages, *endings: str) -> Messages:
    """The topics with one of these endings."""
    return {topic: said for topic, said in messages.items() if topic.endswith(endings)}


def opened_inside(messages: Messages) -> Messages:
    """The clock models from the second segment of each topic on; segments are numbered from there."""
    found = {}
    for topic, models in chosen(messages, "/clock").items():
        first = models[0].segment
        found[topic] = [replace(model, segment=model.segment - first) for model in models if model.segment > first]
    return found


def differences(a: Messages, b: Messages) -> list[str]:
    """What differs, a line each: topics, numbers of messages, and fields by more than the tolerance.

    A clock model is kept last 1: a subscriber may miss one at 20x, so those with equal stamps are compared.
    """
    lines = [f"{topic}: only in one" for topic in sorted(a.keys() ^ b.keys())]
    for topic in sorted(a.keys() & b.keys()):
        one, other = _by_stamp(a[topic]), _by_stamp(b[topic])
        both = sorted(one.keys() & other.keys())
        if topic.endswith("/clock"):
            if len(both) < 0.8 * max(len(one), len(other)):
                lines.append(f"{topic}: {len(one)} and {len(other)} models, {len(both)} of one stamp")
        elif one.keys() != other.keys():
            lines.append(f"{topic}: stamped differently: {sorted(one.keys() ^ other.keys())}")
        lines += [f"{topic} at {stamp} {line}" for stamp in both for line in unequal(one[stamp], other[stamp])]
    return lines


def stamp_ns(message: Any) -> int:
    """Its header stamp in ns of ROS time."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _by_stamp(messages: list[Any]) -> dict[tuple[int, int], Any]:
    """By stamp, and how many came with that stamp before."""
    found: dict[tuple[int, int], Any] = {}
    for message in messages:
        number = 0
        while (stamp_ns(message), number) in found:
            number += 1
        found[stamp_ns(message), number] = message
    return found


def unequal(a: Any, b: Any, where: str = "", tolerance: float = TOLERANCE) -> list[str]:
    """The fields of two messages that differ, a line each; numbers by more than the tolerance, relative above 1."""
    if hasattr(a, "__dataclass_fields__"):
        return [
            line
            for name in a.__dataclass_fields__
            for line in unequal(getattr(a, name), getattr(b, name), f"{where}.{name}", tolerance)
        ]
    if hasattr(a, "__len__") and not isinstance(a, str):
        if len(a) != len(b):
            return [f"{where}: {len(a)} and {len(b)} values"]
        return [
            line
            for i, (one, other) in enumerate(zip(a, b, strict=True))
            for line in unequal(one, other, f"{where}[{i}]", tolerance)
        ]
    if isinstance(a, float) and isinstance(b, float):
        same = a == b or (math.isnan(a) and math.isnan(b)) or abs(a - b) <= tolerance * max(1.0, abs(a))
        return [] if same else [f"{where}: {a!r} and {b!r}"]
    return [] if a == b else [f"{where}: {a!r} and {b!r}"]


def port(log: Path) -> int:
    """The HTTP port a service told in its log."""
    found = re.search(r"metrics on port (\d+)", log.read_text())
    assert found is not None
    return int(found[1])
