"""The session that reports are made of in tests: its times, its streams and what the recorder tells of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
EPOCH_NS = 599_616_000 * SECOND
ECG, EDA = "p1/ecg/h10_1", "p2/eda/shimmer_1"
ECG_TOPIC, EDA_TOPIC = (f"/humans/physiological/{key}/raw" for key in (ECG, EDA))
LENGTH_S = 30.0


def at(seconds: float) -> int:
    """ROS time so long after the session's start."""
    return START_NS + round(seconds * SECOND)


def stamp(ns: int) -> dict[str, int]:
    return {"sec": ns // SECOND, "nanosec": ns % SECOND}


def stream(study: Any, key: str, from_s: float = -2.0, to_s: float = LENGTH_S + 2, without: Any = ()) -> None:
    """130 Hz in messages of 13 samples, those with the numbers in `without` left out."""
    noise = np.random.default_rng(1)
    for i in range(round((to_s - from_s) * 10)):
        if i not in without:
            end_s = from_s + (i + 1) * 0.1
            device_ns = EPOCH_NS + round((end_s + 100) * SECOND)
            study.raw(key, at(end_s + 0.02), device_ns, {"c": noise.normal(0, 100, 13)})


def told(**more: Any) -> dict[str, Any]:
    """The session in recorder.json."""
    about = {"session_id": "s1", "study": "Test", "task": "rest", "human_ids": ["p1", "p2"], "metadata": {}}
    times = {"start_at_ns": at(0), "stop_at_ns": at(LENGTH_S)}
    return about | times | {"required_streams": [ECG_TOPIC, "/humans/physiological/p2/*/*/raw"]} | more


def finish(study: Any, folder: str = "s1_rest_20261121T093000Z", lost: Any = (), **more: Any) -> Path:
    """Write the recording, and what the recorder would tell of it. lost: (topic, more of its account)."""
    path = study.write().rename(study.parent / folder)
    notes = json.loads((path / "recorder.json").read_text()) | more
    for topic, account in lost:
        next(item for item in notes["topics"] if item["topic"] == topic).update(account)
    (path / "recorder.json").write_text(json.dumps(notes))
    study.messages.clear()
    return path


def health(study: Any, key: str, second: float, offset_ns: int, **more: Any) -> None:
    about = {"header": {"stamp": stamp(at(second)), "frame_id": "h10_1"}, "state": 2, "host": "lab"}
    about |= {"realtime_minus_monotonic_ns": offset_ns, "nominal_rate_hz": 130.0}
    study.add(f"/humans/physiological/{key}/health", "StreamHealth", at(second), **about | more)


def entry(summary: dict[str, Any], key: str) -> dict[str, Any]:
    return next(item for item in summary["streams"] if item["stream"] == key)


def rewritten(folder: Path, split_at_ns: int = 0, **options: Any) -> None:
    """The recording as `ros2 bag record` writes it, without recorder.json; in two files where split_at_ns is given."""
    (old,) = folder.glob("*.mcap")
    parts = [(0, split_at_ns or 2**63), (split_at_ns, 2**63)][: 2 if split_at_ns else 1]
    for number, (begin, end) in enumerate(parts):
        with old.open("rb") as source, (folder / f"bag_{number}.mcap").open("wb") as target:
            writer, channels = Writer(target, **options), {}
            writer.start("ros2")
            for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
                if channel.topic not in channels:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", kind)
                head = channel.topic == "/study/session"
                if begin <= message.log_time < end or head:
                    log_ns = max(message.log_time, begin)
                    writer.add_message(channels[channel.topic], log_ns, message.data, message.publish_time)
            writer.finish()
    for path in (old, folder / "recorder.json", folder / "metadata.yaml"):
        path.unlink()
