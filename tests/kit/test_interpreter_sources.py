"""What an interpreter publishes for each shape and each kind of stream, with toy interpreters as real processes."""

import math
import re
from array import array
from unittest.mock import MagicMock

from processes import DEADLINE_S
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sense4hri import metrics, qos
from sense4hri.interpreter import _Interpreter
from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.interpreter_streams import Shape
from sense4hri.names import StreamName
from sense4hri.stamps import set_time, to_ns
from sense4hri_msgs.msg import ECG, EDA, PPG, Marker, PhysioRaw, PhysioRawChannel, Respiration, SensorInfo
from sense4hri_msgs.msg import SensorInfoArray as Sensors

START_NS, RECEIVED_NS = 10**15, 10**18
BEST_EFFORT = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)


class Source:
    """A stream of the test's own; the registry speaks for it. Each frame is a tenth of a second at 100 Hz."""

    def __init__(self, ears, name, profile=qos.RAW):
        self._name, self._sent = name, 0
        self.raw = ears.node.create_publisher(PhysioRaw, name.topic("raw"), profile)

    def send(self, frames):
        for _ in range(frames):
            samples = array("d", [float(n) for n in range(self._sent, self._sent + 10)])
            self._sent += 10
            message = PhysioRaw(channels=[PhysioRawChannel(channel_name="a", samples=samples)])
            set_time(message.device_timestamp, START_NS + (self._sent - 1) * 10**7)
            set_time(message.header.stamp, RECEIVED_NS + (self._sent - 1) * 10**7)
            self.raw.publish(message)


def register(ears, *sensors):
    """Say (stream, unit) for each, as a registry does."""
    publisher = ears.node.create_publisher(Sensors, "/study/sensors", qos.SENSORS)
    infos = [
        SensorInfo(sensor_id=name.sensor_id, sensor_type=name.sensor_type, sampling_frequency_hz=100.0, unit=unit)
        for name, unit in sensors
    ]
    publisher.publish(Sensors(sensors=infos))


def known(process, *names):
    """Wait until the interpreter knows what the streams are."""
    for name in names:
        process.until(f"{name.topic('raw')}: 100 Hz")


def test_a_derived_stream_is_named_after_its_source(start, ears):
    """Respiration from ECG and from acceleration of one device are two streams; a belt's own keeps its name."""
    device = [StreamName("p1", sensor_type, "h10_1") for sensor_type in ("ecg", "accelerometer", "respiration")]
    sources = [Source(ears, name) for name in device]
    register(ears, *((name, "a.u.") for name in device))
    ids = ["h10_1_ecg", "h10_1_accelerometer", "h10_1"]
    topics = [f"/humans/physiological/p1/respiration/{sensor_id}/features" for sensor_id in ids]
    heard = [ears.hear(Respiration, topic, qos.deep(qos.FEATURES)) for topic in topics]
    process = start("toy_derived.py")
    known(process, *device)
    for source in sources:
        source.send(30)
    ears.until(lambda: all(heard), "an update of each")
    assert [got[0].header.frame_id for got in heard] == ids
    assert [[feature.name for feature in got[0].extra] for got in heard] == [
        ["source_ecg_h10_1"],
        ["source_accelerometer_h10_1"],
        [],
    ]
    assert math.isnan(heard[0][0].breaths_per_min), "nobody filled it"


def test_streams_that_cannot_be_used_say_why(start, ears):
    """Two such streams: both are logged and publish NaN with the reason at once; a restarted driver is tried again."""
    names = [StreamName("p1", "ecg", "bad_1"), StreamName("p2", "ecg", "bad_2")]
    sources = [Source(ears, name) for name in names]
    register(ears, *((name, "deg") for name in names))
    heard = [ears.hear(ECG, name.topic("features"), qos.deep(qos.FEATURES)) for name in names]
    process = start("toy_interpreter.py")
    known(process, *names)
    for source in sources:
        source.send(25)
    ears.until(lambda: all(len(got) >= 3 for got in heard), "at once and at two points of the grid")
    for name, got in zip(names, heard, strict=True):
        process.until(f"{name.topic('raw')}: cannot be interpreted: unit is 'deg', must be 'uV'")
        assert all(list(update.reasons) == ["unit is 'deg', must be 'uV'"] for update in got)
        assert all(math.isnan(u.heart_rate_bpm) and math.isnan(u.hrv.rmssd_ms) and u.peak_count == -1 for u in got)
        assert to_ns(got[0].device_timestamp) == START_NS
    ears.node.destroy_publisher(sources[0].raw)
    process.until(f"{names[0].topic('raw')}: gone")
    register(ears, (names[0], "uV"))
    again = Source(ears, names[0])
    ears.until(lambda: process.log().count(f"{names[0].topic('raw')}: 100 Hz") == 2, "it is known anew")
    again.send(25)
    ears.until(lambda: heard[0][-1].peak_count == 100, "the stream is interpreted now")


def test_what_others_call_things_makes_no_line_of_its_own_in_the_log(start, ears):
    """A unit with a newline and what clears a terminal stands in the log as one line of visible characters."""
    name = StreamName("p1", "ecg", "odd_1")
    Source(ears, name)
    register(ears, (name, "uV\n[INFO] all is well\x1b[2J\x07"))
    process = start("toy_interpreter.py")
    known(process, name)
    lines = process.log().splitlines()
    assert not [line for line in lines if line.startswith("[INFO] all is well")]
    assert all(line.isprintable() for line in lines)
    assert f"{name.topic('raw')}: 100 Hz, unit uV␊[INFO] all is well␛[2J␇ (from registry)" in process.log()


def test_two_streams_of_one_device_come_together(start, ears):
    """Each second of ppg is told with the greatest acceleration of that second; another device's is not looked at."""
    ppg, motion = StreamName("p1", "ppg", "v_1"), StreamName("p1", "accelerometer", "v_1")
    stranger = motion._replace(sensor_id="other")
    sources = [Source(ears, name) for name in (stranger, ppg, motion)]
    register(ears, (ppg, "counts"), (motion, "m/s^2"), (stranger, "m/s^2"))
    heard = ears.hear(PPG, ppg.topic("features"), qos.deep(qos.FEATURES))
    known(start("toy_motion.py"), ppg)
    ears.until(lambda: all(source.raw.get_subscription_count() for source in sources), "all are subscribed to")
    sources[0].send(90)
    sources[2].send(40)
    sources[1].send(40)
    ears.until(lambda: len(heard) >= 3, "three seconds")
    assert [u.extra[0].values[0] for u in heard[:3]] == [100.0, 200.0, 300.0]


def test_a_marker_is_taken_where_its_stamp_is(start, ears):
    """A baseline of this person, or of everybody, counts from its stamp on; one of another person does not."""
    name = StreamName("p1", "eda", "e_1")
    source = Source(ears, name)
    register(ears, (name, "uS"))
    heard = ears.hear(EDA, name.topic("features"), qos.deep(qos.FEATURES))
    markers = ears.node.create_publisher(Marker, "/study/markers", qos.MARKERS)
    known(start("toy_marked.py"), name)
    ears.until(lambda: markers.get_subscription_count() and source.raw.get_subscription_count(), "it listens")
    for human_id, at_s in (("p2", 1.0), ("p1", 2.0)):
        marker = Marker(human_id=human_id, name="baseline_end")
        set_time(marker.header.stamp, RECEIVED_NS + round(at_s * 1e9))
        markers.publish(marker)
    assert markers.wait_for_all_acked(Duration(seconds=DEADLINE_S))
    source.send(19)
    ears.until(lambda: heard, "an update, and with it what had come before")
    source.send(41)
    ears.until(lambda: len(heard) >= 5, "five updates")
    assert all(math.isnan(update.tonic_us) for update in heard[:1])
    assert [update.tonic_us for update in heard[2:5]] == [101.0, 201.0, 301.0]


def test_a_best_effort_driver_is_heard(start, ears):
    """A driver that offers less than the contract asks for is heard all the same."""
    name = StreamName("p1", "ecg", "radio_1")
    source = Source(ears, name, BEST_EFFORT)
    register(ears, (name, "uV"))
    heard = ears.hear(ECG, name.topic("features"), qos.deep(qos.FEATURES))
    known(start("toy_interpreter.py"), name)
    ears.until(lambda: source.raw.get_subscription_count() > 0, "a subscription that matches")
    source.send(25)
    ears.until(lambda: heard, "an update")


def test_a_best_effort_stream_of_which_nobody_knows_is_learned_from_its_data(start, ears):
    """Without parameters and without a registry its rate is told by its samples, whatever quality they come with."""
    name = StreamName("p1", "ecg", "radio_1")
    source = Source(ears, name, BEST_EFFORT)
    process = start("toy_interpreter.py")
    ears.until(lambda: source.send(1) or f"{name.topic('raw')}: 100 Hz" in process.log(), "the stream is known")


def test_a_stream_that_has_gone_makes_room_among_the_metrics(monkeypatch):
    """Not while somebody else wears its sensor; what is derived from it goes with it."""
    monkeypatch.setattr(metrics, "MOST_SERIES", 2)
    service = MagicMock(config=InterpreterConfig(), metrics=metrics.Metrics("toy"), start=lambda work: work.close())
    shape = Shape(object, tuple, Respiration, ("ecg", "ppg"), "respiration")
    interpreter = _Interpreter(service, shape)
    first, moved, other = (StreamName(*one) for one in (("p1", "ecg", "a"), ("p2", "ecg", "a"), ("p1", "ecg", "b")))

    def shown():
        text = service.metrics.text().decode()
        return set(re.findall(r'sense4hri_messages_total{.*sensor_id="(\w+)"', text))

    interpreter._found(first)
    interpreter._found(moved)
    interpreter._removed(first)
    interpreter._found(other)
    assert shown() == {"a", "a_ecg", "other"}
    interpreter._removed(other)
    interpreter._removed(moved)
    interpreter._found(other)
    assert shown() == {"b", "b_ecg", "other"}
