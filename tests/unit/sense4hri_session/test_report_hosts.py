"""A report of drivers on two hosts is on one timeline: that of the reference host."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from reported_session import ECG, EDA, EPOCH_NS, LENGTH_S, SECOND, at, entry, finish, stamp, told
from sense4hri.host_clocks import HostClocks
from sense4hri_report.collect import collect
from sense4hri_report.summary import summarise

AHEAD_NS = {"lab_a": 0, "lab_b": 800_000_000, "lab_c": 0}
LOST = range(100, 120)  # messages of 0.1 s: from 8 s to 10 s after the start
PEAK = 150


def play(study: Any, key: str, host: str, device: bool, step_s: float = 0.0) -> None:
    """130 Hz in messages of 13 samples; the same moments on every host, by the clock of each. step_s: set at 15 s."""
    for i in range(round((LENGTH_S + 4) * 10)):
        end_s = -2 + (i + 1) * 0.1
        ahead_ns = AHEAD_NS[host] + round(step_s * SECOND) * (end_s > 15)
        host_ns = at(end_s + 0.02) + ahead_ns
        if i % 10 == 0:
            about = {"header": {"stamp": stamp(host_ns), "frame_id": ""}, "state": 2, "host": host}
            about |= {"realtime_minus_monotonic_ns": 5 + ahead_ns, "nominal_rate_hz": 130.0}
            study.add(f"/humans/physiological/{key}/health", "StreamHealth", at(end_s), **about)
            if AHEAD_NS[host]:
                clock = {"host": host, "reference": "lab_a", "measured_at": stamp(host_ns), "state": 1}
                clock |= {"offset_ns": -ahead_ns, "skew_ppm": 0.0, "uncertainty_s": 1e-4}
                study.add("/study/host_clocks", "HostClockArray", at(end_s) - 1, clocks=[clock])
        if i in LOST:
            continue
        values = {"header": {"stamp": stamp(host_ns), "frame_id": ""}, "channels": channel(i)}
        values["device_timestamp"] = stamp(EPOCH_NS + round((end_s + 100) * SECOND) if device else 0)
        study.add(f"/humans/physiological/{key}/raw", "PhysioRaw", at(end_s + 0.03), **values)


def channel(i: int) -> list[dict[str, Any]]:
    return [{"channel_name": "c", "samples": np.full(13, 1000.0 if i == PEAK else float(i % 2))}]


def report(study: Any) -> tuple[Any, dict[str, Any]]:
    """What was found, and the report."""
    found = collect([finish(study, session=told(), host="lab_a")])
    return found, summarise(found, at(100))


def from_start(found: list[dict[str, Any]]) -> list[float]:
    return [each["since_start_s"] for each in found]


@pytest.mark.parametrize("device", [True, False])
def test_what_is_at_one_time_on_two_hosts_is_at_one_place(study, device):
    """Clocks 0.8 s apart: first and last samples, a gap and the drawing are where they truly were."""
    for key, host in ((ECG, "lab_a"), (EDA, "lab_b")):
        play(study, key, host, device)
    found, summary = report(study)
    one, other = (entry(summary, key) for key in (ECG, EDA))
    for key in ("first", "last"):
        assert one[key]["since_start_s"] == pytest.approx(other[key]["since_start_s"], abs=2e-3)
    assert [gap["lost_samples"] for gap in one["gaps"]] == [gap["lost_samples"] for gap in other["gaps"]]
    for edge in ("from", "to"):
        assert one["gaps"][0][edge]["since_start_s"] == pytest.approx(other["gaps"][0][edge]["since_start_s"], abs=2e-3)
    pictures = [stream.picture for stream in found.streams.values()]
    assert len({int(np.argmax(picture.channels["c"][1])) for picture in pictures}) == 1
    assert one["coverage"] == pytest.approx(other["coverage"], abs=1e-3)
    assert one["problems"] == other["problems"]


def test_what_came_before_its_host_was_measured_is_placed_too(study):
    """The host clocks' first word comes 5 s after the first sample: the first sample is where it was taken."""
    for key, host in ((ECG, "lab_a"), (EDA, "lab_b")):
        play(study, key, host, False)
    early = at(3)
    study.messages = [m for m in study.messages if m[2] != "/study/host_clocks" or m[0] > early]
    summary = report(study)[1]
    firsts = [entry(summary, key)["first"]["since_start_s"] for key in (ECG, EDA)]
    assert firsts[0] == pytest.approx(firsts[1], abs=2e-3)
    assert [len(entry(summary, key)["gaps"]) for key in (ECG, EDA)] == [1, 1]


def test_markers_of_a_sensor_lie_among_its_samples_others_as_stamped(study):
    """With the device's time and without; one without a stamp lies at its receipt."""
    for key, host in ((ECG, "lab_a"), (EDA, "lab_b")):
        play(study, key, host, True)
    ahead_ns = AHEAD_NS["lab_b"]
    sensor = EDA.split("/")[2]
    for stamp_ns, device_ns, source in (
        (at(20.02) + ahead_ns, 0, sensor),
        (at(20.1) + ahead_ns, EPOCH_NS + 120 * SECOND, sensor),
        (at(20.02), 0, "gui"),
        (0, 0, sensor),
    ):
        times = {"header": {"stamp": stamp(stamp_ns), "frame_id": ""}, "device_timestamp": stamp(device_ns)}
        study.add("/study/markers", "Marker", at(20.03), **times, name="trigger", source=source)
    assert from_start(report(study)[1]["markers"]) == pytest.approx([20.02] * 3 + [20.03], abs=2e-3)


def test_a_host_that_nobody_measured_is_named(study):
    """Its offset is taken as 0, which may be wrong; nothing is said of the reference."""
    for key, host in ((ECG, "lab_b"), (EDA, "lab_c")):
        play(study, key, host, True)
    remarks = report(study)[1]["remarks"]
    assert [remark for remark in remarks if "nobody has measured" in remark] == [
        "nobody has measured the clock of host lab_c against that of lab_a: its offset is taken as 0"
    ]


@pytest.mark.parametrize(("days", "said"), [(21, True), (0, False)])
def test_stamps_that_no_entry_says_anything_of_are_told(study, days, said):
    """A replay of three weeks before, recorded beside live hosts."""
    play(study, EDA, "lab_b", True)
    clock = {"host": "lab_b", "reference": "lab_a", "measured_at": stamp(at(5) + days * 86_400 * SECOND)}
    study.messages = [message for message in study.messages if message[2] != "/study/host_clocks"]
    study.add("/study/host_clocks", "HostClockArray", at(0), clocks=[clock | {"skew_ppm": 20.0}])
    sentence = "stamps of host lab_b were taken more than a day from"
    assert any(sentence in remark for remark in report(study)[1]["remarks"]) is said


def test_the_registry_names_the_host_of_a_driver_that_does_not(study):
    """As the exports ask it: first samples lie side by side."""
    for key, host in ((ECG, "lab_a"), (EDA, "lab_b")):
        play(study, key, host, True)
    study.messages = [message for message in study.messages if not message[2].endswith("/health")]
    about = [study.sensor(EDA, 130.0, "uS", ["c"], 12, host="lab-b")]
    study.add("/study/sensors", "SensorInfoArray", at(-2), sensors=about)
    summary = report(study)[1]
    firsts = [entry(summary, key)["first"]["since_start_s"] for key in (ECG, EDA)]
    assert firsts[0] == pytest.approx(firsts[1], abs=2e-3)


def test_events_and_what_a_driver_said_are_where_they_were(study):
    """A repeated message and a lost link, 0.8 s off by the driver's host: both to 2 ms."""
    play(study, EDA, "lab_b", True)
    raw = [message for message in study.messages if message[2].endswith("/raw")][200]
    study.add(raw[2], "PhysioRaw", raw[0] + 1, **raw[4])
    lost = [message for message in study.messages if message[2].endswith("/health")][20]
    lost[4]["state"] = 3
    about = entry(report(study)[1], EDA)
    assert from_start(about["events"]) == pytest.approx([(raw[0] - at(0.01)) / SECOND], abs=2e-3)
    (span,) = about["driver"]["not_streaming"]
    assert span["from"]["since_start_s"] == pytest.approx((lost[0] - at(-0.02)) / SECOND, abs=2e-3)


def test_a_sensor_on_another_host_changes_hands_when_it_did(study):
    """Nothing is said of it by the registry: the last sample of the one wearer is where it was."""
    play(study, EDA, "lab_b", True)
    before, after = f"/{EDA}/", f"/p3/{EDA.partition('/')[2]}/"
    study.messages = [(*m[:2], m[2].replace(before, after), *m[3:]) if m[0] > at(20.05) else m for m in study.messages]
    (moved,) = [event for event in report(study)[1]["events"] if event["source"] == "wearer"]
    assert moved["since_start_s"] == pytest.approx(20.02, abs=2e-3)


def test_the_step_of_a_measured_hosts_clock_is_where_it_was(study):
    """Set 2 s ahead at 15 s: the samples go on where they were, and the step is told of the time at which it was."""
    play(study, EDA, "lab_b", True, step_s=2.0)
    summary = report(study)[1]
    assert entry(summary, EDA)["last"]["since_start_s"] == pytest.approx(LENGTH_S + 2, abs=0.05)
    assert [step["step_s"] for step in summary["host_clock_steps"]] == [2.0]
    assert any("within seconds of it its times are less certain" in problem for problem in summary["problems"])
    assert 14 < summary["host_clock_steps"][0]["since_start_s"] < 17


def test_a_recording_on_one_host_asks_no_clock():
    """An empty name is nobody's, also where a host is called `host`."""
    assert not HostClocks().knows("")
