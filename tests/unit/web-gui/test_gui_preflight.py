"""The list before a session: what is in order, what is not and how it is mended."""

import numpy as np
import pytest
from sense4hri.beats import Beat
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.recorder_status import RecorderStatus
from web_gui import preflight
from web_gui.model import Study
from web_gui.problem_log import ProblemLog
from web_gui.snapshot import study_message
from web_gui.stream import Info

S = 1_000_000_000
NOW = 1_700_000_000 * S
HEALTH = {"state": 2, "lost_samples_total": 0, "battery_percent": 80.0, "contact": 1.0}
HEALTH |= {"nominal_rate_hz": 130.0, "measured_rate_hz": 129.0, "reasons": []}
CLOCK = {"device_reference": 0, "offset_ns": NOW - 100 * S, "skew_ppm": 1.0, "segment": 1, "state": 1}


def items(health=(), clock=()):
    """What is told of a strap with these values."""
    stream = Study().stream(StreamName("p1", "ecg", "h10_1"), NOW)
    stream.learn(Info(130.0, "uV", {}))
    stream.raw(Chunk(("ecg",), np.zeros((13, 1)), 100 * S, NOW), NOW)
    stream.take_health(HEALTH | dict(health), NOW)
    if clock is not None:
        stream.take_clock(CLOCK | dict(clock), NOW)
    return {item.what: item for item in preflight.of_stream(stream, NOW)}


def test_a_strap_in_order_is_told_as_that():
    """Every one of its four conditions, with the value; nothing to mend."""
    found = items()
    assert all(item.ok and not item.mend for item in found.values())
    told = ["streaming", "clock locked", "battery 80 %", "on the skin"]
    assert [item.found for item in found.values()] == told


@pytest.mark.parametrize(
    ("what", "health", "clock", "found"),
    [
        ("signal", {"state": 3}, (), "lost"),
        ("signal", {"measured_rate_hz": 100.0}, (), "77 % of its rate"),
        ("clock", (), None, "no clock model"),
        ("clock", (), {"state": 0}, "clock in warm-up"),
        ("clock", (), {"state": 2}, "clock in hold-over"),
        ("battery", {"battery_percent": 19.0}, (), "battery 19 %"),
        ("contact", {"contact": 0.0}, (), "off the skin"),
    ],
)
def test_what_is_not_in_order_says_how_it_is_mended(what, health, clock, found):
    """One thing at a time; the others stay in order."""
    told = items(health, clock)
    assert {item.what for item in told.values() if not item.ok} == {what}
    assert told[what].found == found
    assert len(told[what].mend) > 10


def test_what_a_device_does_not_tell_stands_in_nobodys_way():
    """An unknown battery is said to be that, and is not red."""
    found = items({"battery_percent": float("nan"), "contact": float("nan")})
    assert [(found[what].ok, found[what].found) for what in ("battery", "contact")] == [
        (True, "battery unknown"),
        (True, "contact unknown"),
    ]


def test_whoever_takes_part_in_sessions_must_answer():
    """A service that was killed, one that is not ready, and a recorder that nobody hears are red with a word each."""
    study = Study()
    study.services.expected = {"clock_sync", "fusion_affect", "robot", "recorder", "driver_polar_h10_1", "driver_lsl_1"}
    study.services.take(Beat("clock_sync", "1"), NOW - 9 * S)
    study.services.take(Beat("fusion_affect", "1", missing="no configuration"), NOW)
    study.stream(StreamName("p1", "ecg", "h10_1"), NOW)
    for driver in ("driver_polar_h10_1", "driver_lsl_1"):
        study.services.take(Beat(driver, "1", missing="the device is CONNECTING"), NOW)
    found = {item.what: item for item in preflight.of_study(study, NOW)}
    assert {name for name, item in found.items() if item.ok} == {"robot", "driver_polar_h10_1"}
    assert found["fusion_affect"].found == "no configuration"
    assert found["driver_lsl_1"].found == "the device is CONNECTING"
    assert all(item.mend for item in found.values() if not item.ok)
    study.session.coordinator = True
    study.session.recorder.take(RecorderStatus("recorder", message="waits for a session"), NOW)
    study.services.take(Beat("clock_sync", "2"), NOW)
    study.services.take(Beat("fusion_affect", "1"), NOW)
    study.services.take(Beat("driver_lsl_1", "1"), NOW)
    assert all(item.ok for item in preflight.of_study(study, NOW))


@pytest.mark.parametrize("name", ["clock_sync", "recorder", "session_coordinator"])
def test_two_nodes_of_one_name_are_in_the_way(name):
    """Whoever it is, the two who have an entry of their own among them; what is worse stays told."""
    study = Study()
    study.services.expected = {"clock_sync", "recorder", "session_coordinator"}
    study.session.coordinator = True
    study.session.recorder.take(RecorderStatus("recorder", message="waits for a session"), NOW)
    for run in "121":
        study.services.take(Beat(name, run), NOW)
    found = {item.what: item for item in preflight.of_study(study, NOW)}
    assert [item.what for item in found.values() if not item.ok] == [name]
    assert found[name].found == "two nodes have this name, and nobody can tell them apart"
    assert found[name].mend == "end one, or have them in two ROS domains"
    study.session.recorder.take(RecorderStatus("recorder", level="error", message="no space"), NOW)
    assert {item.what: item.found for item in preflight.of_study(study, NOW)}["recorder"] == "no space"


def test_the_page_gets_it_with_the_rate_at_which_a_recording_grows():
    """From the rates and channels of what streams: 130 values a second of a strap."""
    study = Study()
    stream = study.stream(StreamName("p1", "ecg", "h10_1"), NOW)
    stream.learn(Info(130.0, "uV", {}))
    stream.raw(Chunk(("ecg",), np.zeros((13, 1)), None, NOW), NOW)
    told = study_message(study, ProblemLog(), NOW)
    assert told["preflight"]["bytes_per_s"] == 1300
    assert [item["what"] for item in told["streams"][0]["preflight"]] == ["signal", "clock", "battery", "contact"]
