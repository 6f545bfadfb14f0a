"""What may come in off the graph."""

import math
import struct
from array import array

import pytest
from sense4hri import intake
from sense4hri.errors import Refused
from sense4hri_msgs.msg import (
    ECG,
    ClockMeasurement,
    ClockModel,
    Marker,
    PhysioFeature,
    PhysioRaw,
    PhysioRawChannel,
    SensorInfo,
    SensorInfoArray,
    SessionState,
    StreamHealth,
    UserState,
)

INT64 = 2**63 - 1


def raw(samples, name="ecg"):
    return PhysioRaw(channels=[PhysioRawChannel(channel_name=name, samples=array("d", samples))])


def stamped(message, field, seconds, nanoseconds):
    part = message
    for name in field.split("."):
        part = getattr(part, name)
    part.sec, part.nanosec = seconds, nanoseconds
    return message


FIT = [
    *(kind() for kind in (ECG, ClockModel, Marker, PhysioRaw, SensorInfoArray, SessionState, StreamHealth, UserState)),
    raw([math.nan, -1e20, 1e-300]),
    stamped(raw([1.0]), "header.stamp", 2**31 - 1, 999_999_999),
    ClockModel(offset_ns=-(1 << 61), skew_ppm=-350.0, latency_s=math.nan),
    ECG(rr_intervals_ms=[math.nan, 800.0], heart_rate_bpm=math.nan),
    StreamHealth(samples_total=-1, extra=[PhysioFeature(name="x", values=[math.nan])]),
    Marker(name="note", value="\x15\n" * 1000, human_id="p1", session_id="20260101T101010_a-1"),
    SensorInfoArray(sensors=[SensorInfo(sensor_id="Shimmer_1", sensor_type="ecg")]),
]


@pytest.mark.parametrize("message", FIT, ids=lambda message: type(message).__name__)
def test_what_the_contract_allows_comes_in(message):
    """Messages with nothing in them, NaN, both ends of time, and ids of drivers that break the contract's form."""
    intake.check(message)


UNFIT = [
    (stamped(raw([1.0]), "header.stamp", -1, 0), "header.stamp is -1 s"),
    (stamped(raw([1.0]), "device_timestamp", 0, 2**32 - 1), "device_timestamp is 0 s and 4294967295 ns"),
    (raw([1.0, math.inf]), r"channels\[0\].samples holds a number beyond"),
    (raw([1.0, -1e307]), r"channels\[0\].samples holds a number beyond"),
    (raw([1.0], "x" * 257), r"channels\[0\].channel_name has 257 characters"),
    (ClockModel(offset_ns=INT64), "offset_ns is 9223372036854775807"),
    (ClockModel(offset_ns=-INT64 - 1), "offset_ns is -9223372036854775808"),
    (ClockModel(skew_ppm=math.nan), "skew_ppm is nan"),
    (ClockModel(skew_ppm=1e307), "skew_ppm is 1e"),
    (ClockModel(uncertainty_s=math.inf), "uncertainty_s is inf"),
    (ClockModel(state=9), "state is 9"),
    (ClockMeasurement(offset_ns=INT64), "offset_ns is"),
    (ClockMeasurement(uncertainty_s=math.nan), "uncertainty_s is nan"),
    (StreamHealth(latency_s=math.inf), "latency_s is inf"),
    (StreamHealth(samples_total=INT64), "samples_total is"),
    (StreamHealth(lost_samples_total=-2), "lost_samples_total is -2"),
    (StreamHealth(realtime_minus_monotonic_ns=INT64), "realtime_minus_monotonic_ns is"),
    (StreamHealth(state=5), "state is 5"),
    (StreamHealth(extra=[PhysioFeature(name="x", values=[1e307])]), r"extra\[0\].values holds a number beyond"),
    (StreamHealth(reasons=["x"] * 10_001), "reasons has 10001 entries"),
    (ECG(extra=[PhysioFeature(unit="u" * 1000)]), r"extra\[0\].unit has 1000 characters"),
    (stamped(ECG(), "header.stamp", 0, 10**9), "header.stamp is 0 s"),
    (SessionState(phase=5), "phase is 5"),
    (SessionState(session_id="../../etc"), "session_id is '../../etc', which is no id: letters, digits"),
    (SessionState(human_ids=["x" * 70_000]), r"human_ids\[0\] has 70000 characters"),
    (Marker(human_id="p/1"), "human_id is no id; it is not repeated here, for it may be a name"),
    (Marker(value="x" * (1 << 20)), "value has 1048576 characters"),
    (SensorInfoArray(sensors=[SensorInfo(parameters_json="x" * (1 << 21))]), r"sensors\[0\].parameters_json has"),
    (UserState(confidence=-math.inf), "confidence is -inf"),
]


@pytest.mark.parametrize(("message", "why"), UNFIT, ids=lambda entry: entry[:40] if isinstance(entry, str) else "")
def test_what_somebody_would_stumble_over_is_refused(message, why):
    """The sentence names the field and what is wrong with it."""
    with pytest.raises(Refused, match=why):
        intake.check(message)


def test_serialised_messages_are_refused_by_their_length_and_their_stamps():
    """Who takes bytes is spared what is too long, is none, is cut short, or has stamps that are none."""
    stamps, frame_id = struct.pack("<iI", 1_700_000_000, 5), struct.pack("<I", 4) + b"h10\0"
    cdr = b"\0\1\0\0" + stamps + frame_id + stamps + struct.pack("<I", 0)
    intake.check_bytes(cdr)
    intake.check_stamps(cdr)
    for bad in (b"", b"\0\1", b"\xff" * 100, bytes(intake.MOST_BYTES + 1)):
        with pytest.raises(Refused, match="bytes"):
            intake.check_bytes(bad)
    for length in range(4, 28):
        with pytest.raises(Refused, match="cut short"):
            intake.check_stamps(cdr[:length])
    with pytest.raises(Refused, match="device_timestamp"):
        intake.check_stamps(cdr[:20] + struct.pack("<iI", -5, 0) + cdr[28:])
    with pytest.raises(Refused, match="cut short"):
        intake.check_stamps(cdr[:12] + struct.pack("<I", 0x7FFF_FFFF) + cdr[16:])


def test_which_messages_begin_with_two_stamps():
    """Raw and features do; what has no device time does not."""
    assert [intake.has_both_stamps(kind) for kind in (PhysioRaw, ECG, StreamHealth, Marker)] == [
        True,
        True,
        False,
        True,
    ]
