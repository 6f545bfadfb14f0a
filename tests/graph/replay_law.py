"""Plays a recording through the services that compute from it, records what they say, and compares it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from processes import Process, Processes, poll
from rosbags.highlevel import AnyReader

COMPUTED = ("/features", "/clock", "/state")
SERVICES = ("clock_sync", "interpreter_ecg", "interpreter_ppg", "fusion_affect")
READY_S = 90.0
"""Many services that start together on a busy machine take their time."""
TOLERANCE = 1e-9
Messages = dict[str, list[Any]]
"""By topic, in their order."""


def ready(process: Process) -> Process:
    """Wait until a service takes part in everything it is there for."""
    process.until("metrics on port ", READY_S)
    poll(lambda: process.get("/readyz")[0] == 200, lambda: f"ready:\n{process.log()}", READY_S)
    return process


def recompute(
    bag: Path, rate: float, work: Path, domain: int, timeout_s: float = 240.0, names: Sequence[str] = SERVICES
) -> Messages:
    """Play the raw part of bag through services of these names, on a ROS domain; return what they computed."""
    work.mkdir(parents=True)
    services = Processes(work, work)
    env = {"ROS_DOMAIN_ID": str(domain), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "METRICS_PORT": ""}
    try:
        out, exclude = work / "out", ["/humans/physiological/*/*/*/raw"]
        running = [services.start(name, env=env) for name in names]
        running.append(services.start("recorder", env=env, directory=out, exclude=exclude))
        for service in running:
            ready(service)
        replay = services.start("replay", env=env, bag=bag, rate=rate, what="raw", wait_for=list(names))
        assert replay.wait(timeout_s) == 0, replay.log()
        assert "NOT PLAYED" not in replay.log()
        for service in running:
            assert service.stop() == 0, service.log()
        return computed(out)
    finally:
        services.close()


def computed(folder: Path) -> Messages:
    """Features, clock models and states of the recordings in a folder, in the order of their receipt.

    What was said before a file began stands at its head once more: equal clock models are taken once.
    """
    found: Messages = defaultdict(list)
    said = set()
    with AnyReader(sorted(listed.parent for listed in folder.rglob("metadata.yaml"))) as reader:
        wanted = [c for c in reader.connections if c.topic.endswith(COMPUTED) and c.topic.startswith("/humans/")]
        for connection, _, data in reader.messages(wanted):
            if connection.topic.endswith("/clock") and (connection.topic, data) in said:
                continue
            said.add((connection.topic, data))
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
