"""Every injected fault is in the report, with exact counts, and nothing that did not happen.

`tests/bench/bench_report.py` uses the same streams with a thousand faults of each kind.
"""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from recorder import schemas
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sense4hri_report import make_report

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
RAW = "sense4hri_msgs/msg/PhysioRaw"
KINDS = ("loss", "duplicate", "reorder", "reboot", "clock_reset")
FS_HZ, FRAME = 130.0, 13
EPOCH_NS = 599_616_000 * SECOND  # a strap's 2019-01-01
SKEW = 40e-6
APART = 12  # messages between two faults


@dataclass(frozen=True)
class Sent:
    """One message as it is recorded."""

    log_ns: int
    device_ns: int
    samples: Any


@dataclass
class Truth:
    """What was done to a stream. lost: samples of every loss in order. resets: kinds in order. at_s: when."""

    done: Counter[str] = field(default_factory=Counter)
    lost: list[int] = field(default_factory=list)
    resets: list[str] = field(default_factory=list)
    at_s: dict[str, list[float]] = field(default_factory=lambda: {kind: [] for kind in KINDS})


def faulty_stream(seed: int, each: int, kinds: tuple[str, ...] = KINDS, lead: int = 60) -> tuple[list[Sent], Truth]:
    """A strap's stream in which every kind of fault happens `each` times, in random order, after `lead` messages."""
    dice, noise = random.Random(seed), np.random.default_rng(seed)
    plan = [kind for kind in kinds for _ in range(each)]
    dice.shuffle(plan)
    truth, sent = Truth(), []
    true_s, zero_s, epoch_ns, log_ns = 0.0, 0.0, EPOCH_NS, 0

    def stamp_ns() -> int:
        return epoch_ns + round((true_s - zero_s) * (1 + SKEW) * SECOND)

    def frame(late_s: float = 0.0) -> Sent:
        nonlocal log_ns
        delay_s = 0.020 + noise.exponential(0.004) + late_s
        log_ns = max(log_ns + 1000, START_NS + round((true_s + delay_s) * SECOND))
        return Sent(log_ns, stamp_ns(), noise.normal(0, 100, FRAME))

    def steady(count: int) -> None:
        nonlocal true_s
        for _ in range(count):
            true_s += FRAME / FS_HZ
            sent.append(frame())

    def again(message: Sent) -> Sent:
        nonlocal log_ns
        log_ns += 1_000_000
        return Sent(log_ns, message.device_ns, message.samples)

    steady(lead)
    for kind in plan:
        steady(dice.randint(APART, APART + 6))
        truth.done[kind] += 1
        truth.at_s[kind].append(true_s)
        if kind == "loss":
            count = dice.choice((1, 1, 1, 2, 3, 7, 40))
            true_s += count * FRAME / FS_HZ
            truth.lost.append(count * FRAME)
        elif kind == "duplicate":
            sent.append(again(sent[-dice.choice((1, 1, 2, 5, 9))]))
        elif kind == "reorder":
            true_s += FRAME / FS_HZ
            device_ns = stamp_ns()
            steady(dice.choice((1, 1, 2, 3, 6)))
            sent.append(again(Sent(0, device_ns, noise.normal(0, 100, FRAME))))
        elif kind == "reboot":
            before_ns, pause_s = stamp_ns(), dice.uniform(2.0, 6.0)
            true_s += pause_s
            epoch_ns, zero_s = EPOCH_NS, true_s - dice.uniform(0.0, 0.9)
            if -SECOND < stamp_ns() - before_ns < (pause_s + 1) * SECOND:
                epoch_ns -= 3600 * SECOND  # a clock that by chance goes on as if nothing was is a loss to everybody
            truth.resets.append("reboot")
        else:
            jump_s = dice.choice((-1, 1)) * dice.choice((7.5, 60.0, 3600.0, 86400.0 * 365 * 4))
            epoch_ns += round(jump_s * SECOND)
            truth.resets.append("clock_reset")
    steady(2 * APART)
    return sent, truth


class Recording:
    """A folder of a recording made of raw messages alone, the sensors' registry and recorder.json."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        self._file = (folder / f"{folder.name}_0.mcap").open("wb")
        self._writer = Writer(self._file, 256 * 1024)
        self._writer.start(profile="ros2")
        self._store = get_typestore(Stores.EMPTY)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def add(self, topic: str, type_name: str, log_ns: int, build: Any) -> None:
        """One message; build(types) makes it."""
        if type_name not in self._schemas:
            text = schemas.definition(type_name)
            types = get_types_from_msg(text, type_name)
            self._store.register({key: value for key, value in types.items() if key not in self._store.types})
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", text.encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[type_name])
        data = bytes(self._store.serialize_cdr(build(self._store.types), type_name))
        self._writer.add_message(self._channels[topic], log_ns, data, log_ns)

    def raw(self, key: str, message: Sent) -> None:
        """One raw message."""
        self.add(f"/humans/physiological/{key}/raw", RAW, message.log_ns, lambda types: _raw(types, message))

    def close(self, notes: dict[str, Any] | None = None) -> Path:
        """The finished folder."""
        self._writer.finish()
        self._file.close()
        if notes is not None:
            (self.folder / "recorder.json").write_text(json.dumps(notes))
        return self.folder


def _raw(types: Any, message: Sent) -> Any:
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    channel = types["sense4hri_msgs/msg/PhysioRawChannel"]
    return types[RAW](
        header(time(*divmod(message.log_ns, SECOND)), "h10_1"),
        time(*divmod(message.device_ns, SECOND)),
        [channel("ecg", np.asarray(message.samples, np.float64))],
    )


def notes(session: dict[str, Any] | None, topics: list[dict[str, Any]] = (), **more: Any) -> dict[str, Any]:
    """A recorder.json as the recorder writes it."""
    content = {"format": 1, "state": "complete", "why": "", "session": session, "host": "h", "opened_ns": START_NS}
    return content | {"topics": list(topics), "refused": [], "withheld": [], "nodes": [], "events": []} | more


def session(start_ns: int, stop_ns: int | None, required: list[str] = ()) -> dict[str, Any]:
    """The session's part of it."""
    about = {"session_id": "s1", "study": "Test", "task": "rest", "human_ids": ["p1"], "metadata": {}}
    return about | {"required_streams": list(required), "start_at_ns": start_ns, "stop_at_ns": stop_ns}


def reported(entry: dict[str, Any]) -> Truth:
    """What the report says was done to a stream, in the same words."""
    found = Truth()
    losses = [gap for gap in entry["gaps"] if not gap["estimated"]]
    found.lost = [gap["lost_samples"] for gap in losses]
    resets = [event for event in entry["events"] if event["kind"] in ("reboot", "clock_reset")]
    found.resets = [event["kind"] for event in resets]
    found.done = Counter(
        loss=len(losses), duplicate=entry["duplicates"], reorder=entry["reordered"],
        reboot=entry["reboots"], clock_reset=entry["clock_resets"],
    )  # fmt: skip
    found.at_s["loss"] = [gap["from"]["since_start_s"] for gap in losses]
    for kind in KINDS[1:]:
        found.at_s[kind] = [event["since_start_s"] for event in entry["events"] if event["kind"] == kind]
    return found


def late_topics(
    recording: Recording, count: int, start_ns: int, seed: int
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Streams of 4 s, every other one late by 1.5 .. 3 s; returns the recorder's notes of them and the truth."""
    dice, topics, truth = random.Random(seed), [], {}
    for i in range(2 * count):
        key, late = f"p1/ecg/late_{i:04d}", i % 2 == 0
        late_s = round(dice.uniform(1.5, 3.0), 3) if late else -0.5
        missed = dice.randint(1, 20) if late else 0
        for n in range(40):
            true_s = late_s + (n + 1) * FRAME / FS_HZ
            if true_s > 4.0:
                break
            log_ns = start_ns + round((true_s + 0.02) * SECOND)
            recording.raw(key, Sent(log_ns, EPOCH_NS + round(true_s * SECOND), np.full(FRAME, float(n))))
        topic = f"/humans/physiological/{key}/raw"
        topics.append({"topic": topic, "type": RAW, "messages": n, "lost": 0, "missed_at_start": missed, "losses": []})
        truth[key] = (late_s + 0.02 + 1 / FS_HZ if late else None, missed)
    return topics, truth


def check_late(summary: dict[str, Any], truth: dict[str, Any]) -> Iterator[str]:
    """What is reported of late topics and is not so."""
    for entry in summary["streams"]:
        late_s, missed = truth[entry["stream"]]
        begins = [problem for problem in entry["problems"] if problem.startswith("begins")]
        if entry["missed_at_start"] != missed:
            yield f"{entry['stream']}: {missed} missed, said {entry['missed_at_start']}"
        if (late_s is None) != (not begins) or (late_s is not None and abs(entry["late_start_s"] - late_s) > 1 / FS_HZ):
            yield f"{entry['stream']}: {late_s} s late, said {entry['late_start_s']}"


@pytest.mark.parametrize("kind", [*KINDS, "all"])
def test_every_fault_is_reported_and_nothing_else(tmp_path, kind):
    """20 faults of a kind, or of each, are found where they happened, with exact counts, and no other is."""
    sent, truth = faulty_stream(7, 20, KINDS if kind == "all" else (kind,))
    recording = Recording(tmp_path / "r")
    for message in sent:
        recording.raw("p1/ecg/h10_1", message)
    (entry,) = make_report(recording.close())["streams"]
    found = reported(entry)
    assert found.done == Counter({name: truth.done[name] for name in KINDS})
    assert found.lost == truth.lost
    assert found.resets == truth.resets
    assert entry["lost_samples"] == sum(truth.lost)
    assert (entry["backwards"], entry["conflicting_stamps"], entry["undecodable_messages"]) == (0, 0, 0)
    for name in KINDS:
        assert np.abs(np.subtract(found.at_s[name], truth.at_s[name])).max(initial=0) < 7.0
    assert (entry["verdict"] == "complete") == (kind == "duplicate")


@pytest.mark.parametrize("then", ["goes on", "ends", "lost", "restarts"])
@pytest.mark.parametrize("inside", ["nothing", "duplicate", "reorder"])
def test_a_clock_set_back_into_an_old_gap_is_no_late_message(tmp_path, inside, then):
    """5 s are lost; 6 s later the clock is set back into that gap: one gap, one clock reset, whatever comes next."""
    recording, log_ns = Recording(tmp_path / "r"), START_NS
    stamps_ms = [*range(0, 6000, 100), *range(11000, 12000, 100), *range(7000, 8500, 100)]
    if inside == "duplicate":
        stamps_ms.insert(75, stamps_ms[73])
    elif inside == "reorder":
        stamps_ms.insert(76, stamps_ms.pop(73))
    after = {"goes on": (8500, 13000), "ends": (0, 0), "lost": (9000, 13000), "restarts": (-90000, -87000)}
    stamps_ms += range(*after[then], 100)
    for stamp_ms in stamps_ms:
        waited_s = {11000: 5.1, 9000: 0.6}.get(stamp_ms, 0.1)
        log_ns += round(waited_s * SECOND)
        samples = np.random.default_rng(10**6 + stamp_ms).normal(0, 1, FRAME)
        recording.raw("p1/ecg/h10_1", Sent(log_ns, EPOCH_NS + stamp_ms * 1_000_000, samples))
    (entry,) = make_report(recording.close())["streams"]
    expected = Counter(loss=1 + (then == "lost"), clock_reset=1 + (then == "restarts"), **{inside: 1})
    found = Counter(loss=entry["gaps_total"], clock_reset=entry["clock_resets"], duplicate=entry["duplicates"],
                    reorder=entry["reordered"])  # fmt: skip
    expected.pop("nothing", None)
    assert +found == +expected
    assert entry["gaps"][0]["lost_samples"] == 50 * FRAME


def test_a_clean_stream_over_a_bad_link_is_complete(tmp_path):
    """Jitter, stalls that drain in a burst, 200 ppm of skew and a declared rate 2 % off are no fault."""
    noise, recording, log_ns = np.random.default_rng(3), Recording(tmp_path / "r"), 0
    for i in range(3000):
        true_s = (i + 1) * FRAME / (FS_HZ * 1.02)
        stall_s = max(0.0, 4.0 - (true_s % 60)) if i > 700 else 0.0
        log_ns = max(log_ns + 1000, START_NS + round((true_s + 0.02 + noise.exponential(0.03) + stall_s) * SECOND))
        device_ns = EPOCH_NS + round(true_s * (1 + 200e-6) * SECOND)
        recording.raw("p1/ecg/h10_1", Sent(log_ns, device_ns, noise.normal(0, 1, FRAME)))
    summary = make_report(recording.close(notes(session(START_NS, START_NS + 295 * SECOND))))
    (entry,) = summary["streams"]
    assert (entry["verdict"], entry["problems"], entry["events"], entry["gaps"]) == ("complete", [], [], [])
    assert entry["measured_hz"] == pytest.approx(FS_HZ * 1.02, rel=3e-4)
    assert (summary["verdict"], summary["problems"]) == ("complete", [])


def test_a_device_that_only_reports_is_complete(tmp_path):
    """No sample is missed of a strap that has no raw stream."""
    recording, kind = Recording(tmp_path / "r"), "sense4hri_msgs/msg/PhysioDeviceFeature"

    def report(types: Any) -> Any:
        time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
        return types[kind](header(time(*divmod(START_NS, SECOND)), "strap_1"), time(0, 0), [])

    for second in range(20):
        recording.add("/humans/physiological/p1/ecg/strap_1/device", kind, START_NS + second * SECOND, report)
    summary = make_report(recording.close(notes(session(START_NS, START_NS + 20 * SECOND))))
    (entry,) = summary["streams"]
    assert (entry["kind"], entry["messages"], entry["verdict"]) == ("device", 20, "complete")
    assert (summary["verdict"], summary["problems"]) == ("complete", [])


def test_late_topics_are_named_with_what_was_missed(tmp_path):
    """Of 20 streams those 10 that began after the session's start are named, with how late and how much was missed."""
    recording = Recording(tmp_path / "r")
    topics, truth = late_topics(recording, 10, START_NS + SECOND, 1)
    about = session(START_NS + SECOND, START_NS + round(4.9 * SECOND))
    summary = make_report(recording.close(notes(about, topics)))
    assert list(check_late(summary, truth)) == []
    assert sum(entry["verdict"] == "complete" for entry in summary["streams"]) == 10
