"""A small synthetic study whose truth is known, written by the recorder's own Bag writer; no ROS runs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import string_messages
from recorder import schemas
from recorder.bag import Bag
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sense4hri_recording.layout import new_directory
from sense4hri_recording.rosbag2 import Channel

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
BYTES = "(bytes)"
QOS = string_messages.QOS | {"durability": "volatile"}


@dataclass
class Study:
    """Messages in, a recording out; `write` may be called in any order of time."""

    parent: Path
    messages: list[tuple[int, int, str, str, dict[str, Any]]] = field(default_factory=list)
    definitions: dict[str, str] = field(default_factory=dict)
    """Of types that are not installed, or are in the file as somebody else has them, by name."""

    def add(self, topic: str, kind: str, log_ns: int, **values: Any) -> None:
        self.messages.append((log_ns, len(self.messages), topic, kind, values))

    def add_bytes(self, topic: str, kind: str, log_ns: int, data: bytes) -> None:
        """A message as somebody sent it, of its type or not."""
        self.add(topic, kind, log_ns, **{BYTES: data})

    def raw(self, key: str, log_ns: int, device_ns: int, channels: dict[str, np.ndarray]) -> None:
        named = [{"channel_name": name, "samples": samples} for name, samples in channels.items()]
        stamp = {"header": header(log_ns), "device_timestamp": time(device_ns)}
        self.add(f"/humans/physiological/{key}/raw", "PhysioRaw", log_ns, **stamp, channels=named)

    def sensor(self, key: str, rate: float, unit: str, channels: list[str], bits: int, **more: Any) -> dict[str, Any]:
        human, kind, sensor = key.split("/")
        about = {"human_id": human, "sensor_type": kind, "sensor_id": sensor, "sampling_frequency_hz": rate}
        return about | {"unit": unit, "channel_names": channels, "resolution_bits": bits, "vendor": "Maker"} | more

    def write(self, ordered: list[Any] | None = None, flush_every: int = 0) -> Path:
        """Write the recording and return its folder. ordered: the messages in this order, not in that of log time.

        flush_every: messages in a chunk; 0: as many as fit.
        """
        bag = Bag(new_directory(self.parent, "19700101T000000Z"))
        channels: dict[str, Channel] = {}
        for number, (log_ns, _, topic, kind, values) in enumerate(ordered or sorted(self.messages), 1):
            name = kind if "/" in kind else f"sense4hri_msgs/msg/{kind}"
            text = self.definitions.get(name) or schemas.definition(name)
            store, type_hash = typestore(name, text)
            if topic not in channels:
                channels[topic] = Channel(topic, name, type_hash, [QOS], text)
            data = values[BYTES] if BYTES in values else bytes(store.serialize_cdr(build(store, name, values), name))
            head = values.get("header")
            stamp = head["stamp"] if isinstance(head, dict) else {"sec": 0, "nanosec": 0}
            publish_ns = stamp["sec"] * SECOND + stamp["nanosec"]
            bag.write(channels[topic], data, log_ns, publish_ns or log_ns)
            if flush_every and number % flush_every == 0:
                bag.flush()
        bag.close()
        return bag.directory


@cache
def typestore(name: str, text: str) -> tuple[Any, str]:
    """What serialises messages of a type, and the type's hash; made once for each definition, which takes 50 ms."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, name))
    return store, store.hash_rihs01(name)


def build(store: Any, name: str, values: dict[str, Any]) -> Any:
    """A message of rosbags from a dict; what is not given is empty, NaN or zero."""
    kind, fields = store.types[name], store.fielddefs[name][1]
    unknown = set(values) - {key for key, _ in fields}
    assert not unknown, f"{name} has no {unknown}"
    return kind(**{key: _value(store, spec, values.get(key)) for key, spec in fields})


def _value(store: Any, spec: Any, value: Any) -> Any:
    number, detail = spec
    if number == 1:
        base = detail[0]
        empty = "" if base == "string" else float("nan") if base.startswith("float") else 0
        return empty if value is None else value
    if number == 2:
        return build(store, detail, value or {})
    inner = detail[0]
    if inner[0] == 1 and inner[1][0] not in ("string",):
        return np.array([] if value is None else value, dtype={"float64": np.float64}.get(inner[1][0], inner[1][0]))
    return [_value(store, inner, item) for item in value or []]


def time(ns: int) -> dict[str, int]:
    return {"sec": ns // SECOND, "nanosec": ns % SECOND}


def header(ns: int, frame_id: str = "") -> dict[str, Any]:
    return {"stamp": time(ns), "frame_id": frame_id}


BEAT_S = 0.8
BEATS = np.arange(1.0, 89.0, BEAT_S)


def heart(true_s: np.ndarray) -> np.ndarray:
    """A narrow peak at every beat, whole uV as a chest strap sends."""
    away = np.abs(true_s[:, None] - BEATS[None, :]).min(axis=1)
    return np.rint(1000 * np.exp(-((away / 0.03) ** 2)))


@dataclass(frozen=True)
class Device:
    """A device clock and a one-way link with a smallest delay of 20 ms."""

    epoch_ns: int
    skew: float

    def stamp_ns(self, true_s: float) -> int:
        return self.epoch_ns + round(true_s * (1 + self.skew) * SECOND)


STRAP, WRIST = Device(599_616_000 * SECOND, 40e-6), Device(820_569_600 * SECOND, -70e-6)


def record(study: Study, duration_s: float = 90.0, gap: tuple[float, float] = (40.0, 45.0)) -> Study:
    """Two people: p1 with a strap (ecg, accelerometer) and a wrist sensor (ppg), p2 with an EDA without device time."""
    random = np.random.default_rng(4)

    def receipt(true_s: float) -> int:
        return START_NS + round((true_s + 0.020 + random.exponential(0.004)) * SECOND)

    def stream(key: str, device: Device | None, rate: float, frame: int, signal: Any, hole: bool) -> None:
        for i in range(int(duration_s * rate / frame)):
            true = (np.arange(i * frame, (i + 1) * frame) + 1) / rate
            if hole and gap[0] <= true[-1] < gap[1]:
                continue
            study.raw(key, receipt(true[-1]), device.stamp_ns(true[-1]) if device else 0, signal(true))

    stream("p1/ecg/h10_1", STRAP, 130.1, 13, lambda t: {"ecg": heart(t)}, True)
    stream("p1/accelerometer/h10_1", STRAP, 50.0, 10, lambda t: {"x": np.sin(t), "y": 0 * t, "z": 9.81 + 0 * t}, False)
    stream("p1/ppg/verity_1", WRIST, 55.0, 11, lambda t: {"ppg_0": 1e5 * np.sin(t), "ambient": 7.0 + 0 * t}, False)
    stream("p2/eda/e4_1", None, 4.0, 4, lambda t: {"eda": 2 + np.sin(t / 10)}, False)
    sensors = [
        study.sensor("p1/ecg/h10_1", 130.0, "uV", ["ecg"], 14),
        study.sensor("p1/accelerometer/h10_1", 50.0, "m/s^2", ["x", "y", "z"], 16),
        study.sensor("p1/ppg/verity_1", 55.0, "counts", ["ppg_0", "ambient"], 22),
        study.sensor("p2/eda/e4_1", 4.0, "uS", ["eda"], 12),
    ]
    study.add("/study/sensors", "SensorInfoArray", START_NS, header=header(START_NS), sensors=sensors)
    worn = [{"sensor_id": "h10_1", "human_id": "p1", "since": time(START_NS), "source": "config"}]
    for at in (0, 1):
        study.add("/study/assignments", "SensorAssignmentArray", START_NS + at, assignments=worn)
    for at, name, value in ((10.5, "baseline_start", ""), (30.25, "stimulus", "image 7"), (60.0, "my_own", "ä")):
        now = START_NS + round(at * SECOND)
        study.add("/study/markers", "Marker", now + 5_000_000, header=header(now), name=name, value=value, source="gui")
    for second in range(2, int(duration_s)):
        beats = BEATS[(second - 1 < BEATS) & (second >= BEATS)]
        if gap[0] - 1 <= second < gap[1] + 1:
            continue
        received = [m[0] for m in study.messages if m[2].endswith("ecg/h10_1/raw")]
        study.add(
            "/humans/physiological/p1/ecg/h10_1/features",
            "ECG",
            min(r for r in received if r >= START_NS + second * SECOND) + 3_000_000,
            header=header(min(r for r in received if r >= START_NS + second * SECOND), "h10_1"),
            device_timestamp=time(STRAP.stamp_ns(float(second))),
            peak_timestamps=[time(STRAP.stamp_ns(float(b))) for b in beats],
            rr_intervals_ms=np.full(len(beats), BEAT_S * 1e3),
            heart_rate_bpm=75.0,
            reasons=["hrv needs 30 s"] if second < 30 else [],
        )
        now = START_NS + second * SECOND
        state = {"human_id": "p1", "state": "calm_relaxed", "heart_rate_bpm": 75.0}
        study.add("/humans/physiological/p1/state", "UserState", now, header=header(now), **state)
        face = {"expression": "happy" if second > 30 else "neutral", "confidence": 0.9}
        study.add("/humans/faces/face_a/expression", "hri_msgs/msg/Expression", now, header=header(now), **face)
    about = {"session_id": "s1", "study": "Test", "task": "rest", "metadata_json": json.dumps({"room": 3}), "phase": 2}
    study.add("/study/session", "SessionState", START_NS, header=header(START_NS), **about)
    return study


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """An empty study to add messages to."""
    return Study(tmp_path)


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of the synthetic study; tests only read it."""
    folder = record(Study(tmp_path_factory.mktemp("recordings"))).write()
    before = {path: path.read_bytes() for path in folder.iterdir()}
    yield folder
    assert {path: path.read_bytes() for path in folder.iterdir()} == before, "a recording was changed by reading it"


@pytest.fixture(scope="module")
def new_study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """An empty study that a module's tests share."""
    return Study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="session")
def short_study() -> Callable[[Study], Study]:
    """Fills a study with the first seconds of the synthetic one."""
    return lambda study: record(study, 6.0, (3.0, 4.0))
