"""The shell of a driver: what it publishes, counts and survives, with a toy for a device."""

import math
import signal

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sense4hri import diagnostics, qos, wire
from sense4hri.names import StreamName
from sense4hri_msgs.msg import ClockMeasurement, Marker, PhysioDeviceFeature, PhysioRaw, StreamHealth

P1 = StreamName("p1", "ecg", "toy_1")


def test_every_sample_arrives_once_in_order_with_the_stamps_of_the_last(start, ears):
    """What the device sent is what a subscriber gets, bit for bit, each sample once."""
    raw = ears.hear(PhysioRaw, P1.topic("raw"), qos.deep(qos.RAW))
    start("toy_driver.py", human_id="p1", sensor_id="toy_1", gain=0.1)
    ears.until(lambda: len(raw) >= 5, "five frames")
    chunks = [wire.chunk_of(serialize_message(message)) for message in raw]
    values = np.concatenate([chunk.samples[:, 0] for chunk in chunks])
    assert np.array_equal(values, np.arange(round(values[0] * 10), round(values[0] * 10) + len(values)) * 0.1)
    assert all(chunk.device_ns == 10**15 + round((chunk.samples[-1, 0] * 10 + 1) * 1e7) for chunk in chunks)
    assert {message.header.frame_id for message in raw} == {"toy_1"}


def test_parameters_of_the_contract_are_answered(start, ears):
    """Anyone can ask a driver for its sensor and stream parameters, also those the device told it."""
    process = start("toy_driver.py", human_id="p1", sensor_id="toy_1", ecg__sampling_frequency_hz=100)
    process.until("streaming")
    names = [
        "human_id",
        "sensor_id",
        "serial_number",
        "transport_delay_s",
        "ecg.sampling_frequency_hz",
        "ecg.channel_names",
    ]
    values = ears.ask(GetParameters, "/driver_toy_toy_1/get_parameters", GetParameters.Request(names=names)).values
    assert [v.string_value for v in values[:3]] == ["p1", "toy_1", "TOY-1"]
    assert values[4].double_value == 100.0
    assert list(values[5].string_array_value) == ["ecg"]


def test_every_parameter_of_a_stream_says_what_it_is(start, ears):
    """The kit declares them: `ros2 param describe` has a sentence, and a unit where there is one."""
    start("toy_driver.py", human_id="p1", sensor_id="toy_1").until("streaming")
    names = ears.ask(ListParameters, "/driver_toy_toy_1/list_parameters", ListParameters.Request()).result.names
    request = DescribeParameters.Request(names=[name for name in names if name.startswith("ecg.")])
    told = ears.ask(DescribeParameters, "/driver_toy_toy_1/describe_parameters", request).descriptors
    descriptions = {each.name: each.description for each in told}
    assert len(descriptions) == 6
    assert [name for name, text in descriptions.items() if not text] == []
    assert descriptions["ecg.sampling_frequency_hz"].endswith("[Hz]")


def test_what_the_study_says_of_the_device_stays(start, ears):
    """A configured serial number is not the device's; what the study leaves empty is."""
    process = start("toy_driver.py", human_id="p1", sensor_id="toy_1", serial_number="OUR-7")
    process.until("streaming")
    request = GetParameters.Request(names=["serial_number", "firmware_version"])
    values = ears.ask(GetParameters, "/driver_toy_toy_1/get_parameters", request).values
    assert [each.string_value for each in values] == ["OUR-7", "1.2.3"]


def test_of_what_a_device_says_without_end_as_much_is_told_as_others_read(start, ears, monkeypatch):
    """Who asks refuses a text of more than 256 characters, and the stream with it; the log says what was cut."""
    monkeypatch.setenv("TOY_FAULTS", "long")
    process = start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    process.until("the device says a model of 400 characters: the first 256 are kept")
    process.until("streaming")
    request = GetParameters.Request(names=["model"])
    values = ears.ask(GetParameters, "/driver_toy_toy_1/get_parameters", request).values
    assert values[0].string_value == "toy " * 64


def test_setting_human_id_moves_the_topics(start, ears):
    """After human_id is set, raw, device and health come under the new name and the old topic has no publisher."""
    start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    moved = P1._replace(human_id="Ada")
    raw = ears.hear(PhysioRaw, moved.topic("raw"), qos.RAW)
    device = ears.hear(PhysioDeviceFeature, moved.topic("device"), qos.DEVICE)
    health = ears.hear(StreamHealth, moved.topic("health"), qos.HEALTH)
    request = SetParameters.Request(parameters=[Parameter("human_id", value="Ada").to_parameter_msg()])
    assert ears.ask(SetParameters, "/driver_toy_toy_1/set_parameters", request).results[0].successful
    ears.until(lambda: raw and device and health, "messages under the new name")
    ears.until(lambda: ears.node.count_publishers(P1.topic("raw")) == 0, "the old topic is left")


@pytest.mark.parametrize(("name", "value"), [("human_id", "23bd5"), ("human_id", "a__b"), ("vendor", "x")])
def test_what_must_not_be_set_is_refused_by_name(start, ears, name, value):
    """An illegal human_id, or any other parameter at run time, is refused with a reason that names it."""
    start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    result = ears.ask(SetParameters, "/driver_toy_toy_1/set_parameters", request).results[0]
    assert not result.successful
    assert name in result.reason


def test_an_impossible_device_time_costs_no_sample(start, ears):
    """A frame whose device time no message can carry is published without one, counted, and breaks nothing.

    So is an event; of a clock that shows it nothing is measured.
    """
    markers = ears.hear(Marker, "/study/markers", qos.MARKERS)
    measured = ears.hear(ClockMeasurement, P1.topic("clock_measurement"), qos.CLOCK_MEASUREMENT)
    raw = ears.hear(PhysioRaw, P1.topic("raw"), qos.deep(qos.RAW))
    health = ears.hear(StreamHealth, P1.topic("health"), qos.HEALTH)
    start("toy_driver.py", env={"TOY_FAULTS": "time"}, human_id="p1", sensor_id="toy_1")
    ears.until(lambda: health and health[-1].samples_total >= 60, "health of the frames")
    told = {feature.name: feature.values[0] for feature in health[-1].extra}
    assert told["impossible_device_times_total"] == 2.0
    assert measured == []
    assert all(marker.device_timestamp == Time() for marker in markers)
    assert (health[-1].gaps_total, health[-1].lost_samples_total, health[-1].duplicates_total) == (0, 0, 0)
    assert [wire.chunk_of(serialize_message(message)).device_ns for message in raw].count(None) <= 1


def test_a_lost_link_is_logged_once_counted_and_taken_up_again(start, ears):
    """After DeviceLost the driver streams again, with one reconnect in health and the loss in no sample's place."""
    health = ears.hear(StreamHealth, P1.topic("health"), qos.HEALTH)
    process = start("toy_driver.py", env={"TOY_FAULTS": "lost,bad,gap"}, human_id="p1", sensor_id="toy_1")
    last = ears.until(
        lambda: [m for m in health if m.reconnects_total == 1 and m.state == m.STREAMING], "streaming again"
    )[-1]
    assert (last.gaps_total, last.lost_samples_total) == (1, 10)
    assert last.extra[0].values[0] == 1.0
    assert (last.battery_percent, last.rssi_dbm) == (81.0, -60.0)
    assert process.log().count("the toy was unplugged") == 1


def test_a_slow_stream_of_a_device_that_has_just_begun_is_starting(start, ears, tmp_path):
    """However long the device was looked for: lost only once its rate allows no longer that nothing has come."""
    slow = ears.hear(StreamHealth, StreamName("p1", "temperature", "toy_1").topic("health"), qos.HEALTH)
    away = tmp_path / "away"
    away.touch()
    start("toy_driver.py", env={"TOY_FAULTS": "slow", "TOY_AWAY": str(away)}, human_id="p1", sensor_id="toy_1")
    ears.until(lambda: len(slow) >= 5, "looked for longer than three samples take")
    away.unlink()
    ears.until(lambda: slow[-1].reasons == ["connected, but no samples come"], "given up")
    found = [each for each in slow[5:] if each.reasons != ["the toy is out of reach"]]
    assert (found[0].state, *found[0].reasons) == (StreamHealth.STARTING, "no sample has come yet")
    assert found[-1].state == StreamHealth.LOST


def test_why_a_device_is_not_found_is_said_on_the_graph_alone(start, ears, tmp_path):
    """Also by one that has no stream yet to say it on: its heartbeat does; /readyz, open to all, names no device."""
    away = tmp_path / "away"
    away.touch()
    told = ears.hear(DiagnosticArray, diagnostics.TOPIC, qos.HEALTH)
    process = start("toy_driver.py", env={"TOY_AWAY": str(away)}, human_id="p1", sensor_id="toy_1")
    lost = "the device is LOST: the toy is out of reach"
    ears.until(lambda: lost in [beat.missing for message in told for beat in diagnostics.beats(message)], "why")
    ears.until(lambda: process.get("/readyz") == (503, "not ready: the device is LOST\n"), "no name of a device")
    away.unlink()
    ears.until(lambda: not diagnostics.beats(told[-1])[0].missing, "it is there")


def test_of_a_lost_device_nobody_knows_contact_and_signal(start, ears, tmp_path):
    """Both were told over the link that is gone; the charge of its battery stays what it was."""
    health, away = ears.hear(StreamHealth, P1.topic("health"), qos.HEALTH), tmp_path / "away"
    start("toy_driver.py", env={"TOY_AWAY": str(away)}, human_id="p1", sensor_id="toy_1")
    ears.until(lambda: health and health[-1].state == StreamHealth.STREAMING, "streaming")
    assert (health[-1].contact, health[-1].rssi_dbm) == (1.0, -60.0)
    away.touch()
    ears.until(lambda: health[-1].reasons == ["the toy is out of reach"], "lost")
    assert math.isnan(health[-1].contact)
    assert math.isnan(health[-1].rssi_dbm)
    assert health[-1].battery_percent == 81.0


@pytest.mark.parametrize(("fault", "gaps", "lost"), [("counted", 1, 10), ("uncounted", 0, -1)])
def test_a_device_without_a_clock_tells_its_losses_by_its_count_or_nobody_does(start, ears, fault, gaps, lost):
    """Samples that a device counts as missing are in health to the sample; where it does not count, health says -1."""
    health = ears.hear(StreamHealth, P1.topic("health"), qos.HEALTH)
    start("toy_driver.py", env={"TOY_FAULTS": f"{fault},gap"}, human_id="p1", sensor_id="toy_1")
    last = ears.until(lambda: [m for m in health if m.samples_total >= 50], "health of the frames")[-1]
    assert (last.gaps_total, last.lost_samples_total) == (gaps, lost)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_driver_releases_its_device_and_exits_with_0(start, number):
    """SIGTERM and SIGINT run the device's own clean-up before the process ends with status 0."""
    process = start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    process.until("streaming")
    assert process.stop_within(number=number) == 0
    assert "toy released" in process.log()


def test_a_device_that_is_lost_while_it_is_released_does_not_hold_the_driver_up(start):
    """Told to stop, the driver does not look for it again: it ends in time, with status 0 and without a complaint."""
    process = start("toy_driver.py", env={"TOY_FAULTS": "stuck"}, human_id="p1", sensor_id="toy_1")
    process.until("streaming")
    assert process.stop_within() == 0
    assert "toy released" in process.log()
    assert "trying again" not in process.log()
    assert "stopped before" not in process.log()


@pytest.mark.parametrize(
    ("parameters", "env", "named"),
    [
        ({"human_id": "p1"}, {}, "'sensor_id' is required"),
        ({"sensor_id": "Toy"}, {}, "'sensor_id' is 'Toy'"),
        ({"sensor_id": "toy_1", "human_id": "9x"}, {}, "'human_id' is '9x'"),
        ({"sensor_id": "toy_1", "gain": "much"}, {}, "'gain' is 'much', must be a number"),
        ({"sensor_id": "toy_1", "labels": [1, 2]}, {}, "'labels'"),
        ({"sensor_id": "toy_1"}, {"TOY_FAULTS": "config"}, "the toy offers 100"),
        (
            {"sensor_id": "toy_1", "ecg__sampling_frequency_hz": 200},
            {},
            "parameter 'ecg.sampling_frequency_hz' is 200, the device has 100",
        ),
        (
            {"sensor_id": "toy_1", "ecg__sampling_frequency_hz": 0},
            {},
            "parameter 'ecg.sampling_frequency_hz' is 0, the device has 100",
        ),
        (
            {"sensor_id": "toy_1", "ecg__sampling_frequency_hz": 200},
            {"TOY_FAULTS": "asked"},
            "parameter 'ecg.sampling_frequency_hz' is 200, the device has 125",
        ),
        ({"sensor_id": "toy_1"}, {"METRICS_PORT": "http"}, "METRICS_PORT is 'http'"),
    ],
)
def test_a_wrong_configuration_is_one_line_and_status_78(start, parameters, env, named):
    """The process ends with 78 and one line that names the parameter."""
    process = start("toy_driver.py", env=env, **parameters)
    assert process.wait() == 78
    assert named in process.log()
    assert "Traceback" not in process.log()


@pytest.mark.parametrize(
    ("words", "env", "named"),
    [
        (("-p", "labels:=[a:b]"), {}, "labels:=[a:b]"),
        (("--params-file", "/there/is/none.yaml"), {}, "/there/is/none.yaml"),
        (("--params-file", __file__), {}, __file__),
        (("--parameters", "p.yaml"), {}, "--parameters"),
        ((), {"ROS_DOMAIN_ID": "lab"}, "ROS_DOMAIN_ID"),
    ],
)
def test_words_that_ros_cannot_read_are_a_wrong_configuration(start, words, env, named):
    """A parameter that is no YAML, a file that is none or not there: status 78, the last line says which."""
    process = start("toy_driver.py", "--ros-args", *words, env=env)
    assert process.wait() == 78
    last = process.log().splitlines()[-1]
    assert last.startswith("driver_toy: configuration: ")
    assert named in last
    assert "Traceback" not in process.log()


def test_a_rate_that_only_the_connected_device_knows_is_held_against_what_that_says(start, ears):
    """The driver's table says 100 Hz, the study 128, the device 125: it streams, at the study's rate."""
    start(
        "toy_driver.py", env={"TOY_FAULTS": "asked"}, sensor_id="toy_1", human_id="p1", ecg__sampling_frequency_hz=128
    ).until("streaming")
    request = GetParameters.Request(names=["ecg.sampling_frequency_hz"])
    (rate,) = ears.ask(GetParameters, "/driver_toy_toy_1/get_parameters", request).values
    assert rate.double_value == 128.0


def test_a_taken_metrics_port_is_a_configuration_error(start):
    """METRICS_PORT set and taken: status 78, the port named."""
    port = start("toy_driver.py", sensor_id="toy_1").port()
    other = start("toy_driver.py", env={"METRICS_PORT": str(port)}, sensor_id="toy_2")
    assert other.wait() == 78
    assert str(port) in other.log()


def test_metrics_name_no_participant(start, ears):
    """/metrics counts samples by sensor and never says who wears it; /readyz turns 200 with the first sample."""
    process = start("toy_driver.py", human_id="Ada", sensor_id="toy_1")
    ears.until(lambda: process.get("/readyz")[0] == 200, "ready")
    counted = 'sense4hri_samples_total{sensor_id="toy_1",sensor_type="ecg",service="driver_toy"}'
    text = ears.until(lambda: counted in (told := process.get("/metrics")[1]) and told, "samples are counted")
    assert "Ada" not in text
    assert process.get("/healthz")[0] == 200
    assert process.get("/nothing")[0] == 404
