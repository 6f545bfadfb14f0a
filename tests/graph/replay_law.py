"""Plays a recording through the interpreters and clock-sync, records what they say, and compares it."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader

COMPUTED = ("/features", "/clock")
SERVICES = ("clock_sync", "interpreter_ecg", "interpreter_ppg")
TOLERANCE = 1e-9


@contextmanager
def process(package: str, log: Path, *parameters: str) -> Iterator[subprocess.Popen[bytes]]:
    """A service, ready; ended with SIGTERM."""
    command = [sys.executable, "-m", package, "--ros-args", *(word for p in parameters for word in ("-p", p))]
    with log.open("wb") as out:
        child = subprocess.Popen(command, stderr=out, stdout=out, env=os.environ)
    try:
        deadline = time.monotonic() + 30
        while "metrics on port" not in log.read_text():
            assert child.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.05)
        yield child
        child.send_signal(signal.SIGTERM)
        assert child.wait(10) == 0, log.read_text()
    finally:
        if child.poll() is None:
            child.kill()
            child.wait()


def recompute(bag: Path, rate: float, work: Path, timeout_s: float = 100.0) -> Path:
    """Play the raw part of bag through the services at this rate; return the recording of what they computed."""
    work.mkdir(parents=True)
    with ExitStack() as stack:
        exclude = 'exclude:=["/humans/physiological/*/*/*/raw"]'
        stack.enter_context(process("recorder", work / "recorder.log", f"directory:={work / 'out'}", exclude))
        for name in SERVICES:
            stack.enter_context(process(name, work / f"{name}.log"))
        replay = stack.enter_context(
            process("replay", work / "replay.log", f"bag:='{bag}'", f"rate:={rate}", "what:=raw")
        )
        assert replay.wait(timeout_s) == 0, (work / "replay.log").read_text()
    assert "NOT PLAYED" not in (work / "replay.log").read_text()
    return work / "out" / (work / "out" / "recording").read_text().strip()


def computed(bag: Path) -> dict[str, list[Any]]:
    """Features and clock models of a recording by topic, in their order."""
    found: dict[str, list[Any]] = defaultdict(list)
    with AnyReader([bag]) as reader:
        chosen = [c for c in reader.connections if c.topic.endswith(COMPUTED) and c.topic.startswith("/humans/")]
        for connection, _, data in reader.messages(chosen):
            found[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return dict(found)


def differences(a: dict[str, list[Any]], b: dict[str, list[Any]]) -> list[str]:
    """What differs, a line each: topics, numbers of messages, and fields by more than the tolerance.

    A clock model is kept last 1: a subscriber may miss one at 20x, so those with equal stamps are compared.
    """
    lines = [f"{topic}: only in one" for topic in sorted(a.keys() ^ b.keys())]
    for topic in sorted(a.keys() & b.keys()):
        if topic.endswith("/clock"):
            one, other = _by_stamp(a[topic]), _by_stamp(b[topic])
            both = sorted(one.keys() & other.keys())
            if len(both) < 0.8 * max(len(one), len(other)):
                lines.append(f"{topic}: {len(one)} and {len(other)} models, {len(both)} of one stamp")
            lines += [f"{topic} at {stamp} {line}" for stamp in both for line in _unequal(one[stamp], other[stamp], "")]
            continue
        if len(a[topic]) != len(b[topic]):
            lines.append(f"{topic}: {len(a[topic])} and {len(b[topic])} messages")
        for number, (one, other) in enumerate(zip(a[topic], b[topic], strict=False)):
            lines += [f"{topic} [{number}] {line}" for line in _unequal(one, other, "")]
    return lines


def _by_stamp(models: list[Any]) -> dict[tuple[int, int], Any]:
    return {(model.header.stamp.sec, model.header.stamp.nanosec): model for model in models}


def _unequal(a: Any, b: Any, where: str) -> list[str]:
    if hasattr(a, "__dataclass_fields__"):
        return [
            line
            for name in a.__dataclass_fields__
            for line in _unequal(getattr(a, name), getattr(b, name), f"{where}.{name}")
        ]
    if hasattr(a, "__len__") and not isinstance(a, str):
        if len(a) != len(b):
            return [f"{where}: {len(a)} and {len(b)} values"]
        return [line for i, pair in enumerate(zip(a, b, strict=True)) for line in _unequal(*pair, f"{where}[{i}]")]
    if isinstance(a, float) and isinstance(b, float):
        same = a == b or (math.isnan(a) and math.isnan(b)) or abs(a - b) <= TOLERANCE * max(1.0, abs(a))
        return [] if same else [f"{where}: {a!r} and {b!r}"]
    return [] if a == b else [f"{where}: {a!r} and {b!r}"]


def port(log: Path) -> int:
    """The HTTP port a service told in its log."""
    found = re.search(r"metrics on port (\d+)", log.read_text())
    assert found is not None
    return int(found[1])
