"""check-driver: stamps, counts and parameters of a stream, as they would be heard."""

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from check_driver import __main__, health, parameters, times
from check_driver.findings import Findings
from check_driver.heard import Frame, Health, Heard
from check_driver.topics import Topics
from rcl_interfaces.msg import ParameterType
from sense4hri.host_clocks import this_host
from sense4hri.names import StreamName
from sense4hri.stamps import set_time
from sense4hri_msgs.msg import (
    ClockMeasurement,
    PhysioDeviceFeature,
    PhysioFeature,
    PhysioRaw,
    PhysioRawChannel,
    StreamHealth,
)

RATE_HZ, T0_NS = 50.0, 1_700_000_000_000_000_000
NAME = StreamName("p1", "eda", "box_1")


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--stop-pid", "-1", "-1 is no process"),  # to kill(2) that is every process there is
        ("--stop-pid", "0", "0 is no process"),
        ("--stop-pid", "4194305", "4194305 is no process"),  # above the largest that Linux gives
        ("--stop-pid", "9" * 30, "is no process"),
        ("--stop-pid", "it", "'it'"),
        ("--seconds", "0", "0 is not above 0"),
        ("--seconds", "-5", "-5 is not above 0"),
        ("--seconds", "nan", "nan is not above 0"),
    ],
)
def test_what_cannot_be_checked_by_is_said_at_once(monkeypatch, capsys, option, value, said):
    """Not after a minute's listening, nor as a verdict on nothing; the line names the option and what was given."""
    monkeypatch.setattr(__main__, "Line", lambda *names: pytest.fail("it listens"))
    with pytest.raises(SystemExit, match="2"):
        __main__.main(["box_1", option, value])
    line = capsys.readouterr().err.splitlines()[-1]
    assert option in line
    assert said in line


def frames(sizes, device_ns=5_000_000_000):
    """Frames of these sizes, stamped with their last samples; device_ns: of the first sample, None = no clock."""
    found, count = [], 0
    for size in sizes:
        count += size
        at_ns = round(count / RATE_HZ * 1e9)
        stamp_ns = T0_NS + at_ns
        found.append(Frame(at_ns / 1e9, stamp_ns, 0 if device_ns is None else device_ns + at_ns, size))
    return found


def told(given, rate_hz=RATE_HZ):
    findings = Findings()
    times.check(given, rate_hz, "raw", findings)
    return [each.what for each in findings.departures()]


@pytest.mark.parametrize("device_ns", [5_000_000_000, None])
def test_right_stamps_are_right(device_ns):
    """With a device's clock or without, in messages of one size or of several."""
    assert told(frames([10] * 60, device_ns)) == []
    assert told(frames([8, 12] * 30, device_ns)) == []


def changed(given, index, **fields):
    return [*given[:index], given[index]._replace(**fields), *given[index + 1 :]]


RIGHT = frames([8, 12] * 30)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (changed(RIGHT, 30, stamp_ns=T0_NS), "header.stamp goes back"),
        (changed(RIGHT, 30, device_ns=RIGHT[29].device_ns), "device_timestamp stands still"),
        (changed(RIGHT, 30, device_ns=1), "device_timestamp goes back"),
        (changed(RIGHT, 30, device_ns=0), "sometimes zero, sometimes not"),
        ([each._replace(device_ns=each.stamp_ns) for each in RIGHT], "where the device gives no time it must be zero"),
        ([each._replace(device_ns=each.device_ns // 2) for each in RIGHT], "gains 0.5 s in a second"),
        ([each._replace(device_ns=each.device_ns - each.n * 20_000_000) for each in RIGHT], "of the last sample"),
        (frames([16, 24] * 30), "samples/s came"),
    ],
)
def test_a_wrong_stamp_is_told(given, sentence):
    """Each fault has its own sentence, and no second one."""
    if "samples/s" in sentence:
        given = [each._replace(stamp_ns=T0_NS + (each.stamp_ns - T0_NS) // 2, device_ns=0) for each in given]
    (found,) = told(given)
    assert sentence in found


def test_a_stall_and_its_burst_change_no_rate():
    """What a busy machine delivers a second late all at once was measured at its rate all the same."""
    late = [each._replace(stamp_ns=max(each.stamp_ns, T0_NS + 1_500_000_000)) for each in frames([5] * 80)]
    assert told(late) == []


def test_a_machine_that_catches_up_or_falls_behind_accuses_no_clock():
    """Late by two seconds and less and less, for a third of the time; by one from the middle on: the clock is good."""
    given = frames([5] * 300)
    late_ns = [max(0, round(2e9 * (1 - n / 100))) for n in range(300)]
    late = [each._replace(stamp_ns=each.stamp_ns + ns) for each, ns in zip(given, late_ns, strict=True)]
    assert told(late) == []
    behind = [each._replace(stamp_ns=each.stamp_ns + 10**9 * (n > 150)) for n, each in enumerate(given)]
    assert told(behind) == []
    slow = [each._replace(device_ns=round(each.device_ns * 0.97)) for each in given]
    assert told(slow) == ["device_timestamp gains 0.97 s in a second of the host"]
    fast = [each._replace(device_ns=round(each.device_ns * 1.03)) for each in given]
    assert told(fast) == ["device_timestamp gains 1.03 s in a second of the host"]


def test_a_machine_that_falls_behind_for_most_of_the_time_accuses_no_rate():
    """Later and later by up to 1.5 s, then at once no more: by its own clock the device keeps its rate."""
    given = frames([5] * 80)
    late_ns = [each.stamp_ns + round(1.5e9 * max(0, n - 8) / 60) * (n < 68) for n, each in enumerate(given)]
    came_ns = np.maximum.accumulate(late_ns).tolist()
    late = [each._replace(stamp_ns=at_ns) for each, at_ns in zip(given, came_ns, strict=True)]
    assert told(late) == []
    assert told([each._replace(device_ns=0) for each in late]) == ["40.1 samples/s came, 50 Hz are declared"]


def test_samples_put_in_order_by_their_device_time_are_a_remark():
    """Each keeps its own receipt, which then goes back by little; without a device's clock nothing tells the order."""
    given = changed(RIGHT, 30, stamp_ns=RIGHT[29].stamp_ns - 1_000_000)
    assert told(given) == []
    assert told([each._replace(device_ns=0) for each in given]) == ["header.stamp goes back"]


def test_an_irregular_stream_has_a_message_for_each_sample():
    """Rate 0 and ten samples in a message cannot be placed."""
    assert told(frames([1] * 30), 0.0) == []
    assert "more than one sample" in told(frames([10] * 30), 0.0)[0]


def test_of_an_irregular_stream_another_unit_of_time_is_told():
    """Milliseconds written as microseconds; events that are passed on less and less late accuse no clock."""
    given = frames([1] * 300)
    assert told([each._replace(device_ns=each.device_ns // 1000) for each in given], 0.0) == [
        "device_timestamp gains 0.001 s in a second of the host"
    ]
    late = [each._replace(stamp_ns=each.stamp_ns + 3 * 10**8 - n * 10**6) for n, each in enumerate(given)]
    assert told(late, 0.0) == []


def heard_of(given, **fields):
    """A stream with health once a second; fields: what health says otherwise."""
    heard = Heard(NAME, Findings(), ("eda",), 0.1, 2.0, given)
    for second in range(1, int(given[-1].heard_s)):
        came = sum(each.n for each in given if each.heard_s <= second)
        values = {
            "state": StreamHealth.STREAMING,
            "host": this_host(),
            "realtime_minus_monotonic_ns": time.time_ns() - time.monotonic_ns(),
            "nominal_rate_hz": RATE_HZ,
            "measured_rate_hz": RATE_HZ,
            "samples_total": came,
            "battery_percent": math.nan,
            "contact": math.nan,
            "latency_s": math.nan,
        }
        heard.health.append(Health(float(second), StreamHealth(**(values | fields))))
    return heard


def judged(heard):
    health.check(heard, RATE_HZ, (0.0, heard.frames[-1].heard_s), True, heard.findings)
    return [each.what for each in heard.findings.departures()]


def test_right_health_is_right():
    """Counts that follow what came, unknown values as NaN."""
    assert judged(heard_of(frames([10] * 60))) == []


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"state": 9}, "state 9 is none"),
        ({"state": StreamHealth.LOST, "reasons": ["out of range"]}, "state 3 while samples come"),
        ({"battery_percent": 0.0, "rssi_dbm": 0.0, "contact": 0.0, "latency_s": 0.0}, "what is not known is NaN"),
        ({"gaps_total": -2}, "gaps_total is -2, must be -1"),
        ({"host": ""}, "host is empty"),
        ({"battery_percent": -1.0}, "battery_percent is -1"),
        ({"nominal_rate_hz": 10.0}, "nominal_rate_hz is 10"),
        ({"measured_rate_hz": 25.0}, "measured_rate_hz is 25"),
        ({"measured_rate_hz": math.nan}, "measured_rate_hz is nan"),
        ({"samples_total": 0}, "samples_total has grown by 0"),
        ({"rssi_dbm": -math.inf}, "rssi_dbm is infinite"),
        ({"latency_s": math.inf}, "latency_s is infinite"),
        ({"realtime_minus_monotonic_ns": 0}, "realtime_minus_monotonic_ns is not"),
    ],
)
def test_what_health_says_wrongly_is_told(fields, sentence):
    """Each value against what came, or against what it can be."""
    found = judged(heard_of(frames([10] * 60), **fields))
    assert any(sentence in each for each in found), found


def test_a_link_that_is_lost_and_back_streams_in_between():
    """Two accounts in a row that say so, with samples before, between and after them, are two short losses."""
    heard = heard_of(frames([10] * 60))
    for each in heard.health[3:5]:
        each.message.state, each.message.reasons = StreamHealth.LOST, ["out of range"]
    assert judged(heard) == []


def test_a_stream_that_is_there_later_is_asked_from_then_on():
    """Of 12 s it was there for the last 6, with health once a second."""
    heard = heard_of(frames([10] * 60))
    heard.health = heard.health[5:]
    assert any("6 messages in 12 s" in each for each in judged(heard))
    heard.findings, heard.since_s = Findings(), heard.health[0].heard_s - 0.5
    assert judged(heard) == []


@pytest.mark.parametrize(
    ("rate_hz", "listened_s", "departs"),
    [(50.0, 10.0, True), (0.0, 60.0, False), (0.01, 60.0, False), (0.2, 60.0, True)],
)
def test_an_event_may_not_happen_nor_a_slow_sample_come(rate_hz, listened_s, departs):
    """Nothing came: a departure of a stream whose samples were due, a remark of any other."""
    findings = Findings()
    topics = SimpleNamespace(streams={NAME: Heard(NAME, findings)}, published=lambda: [NAME.topic("raw")])
    __main__._judge(topics, {"eda.sampling_frequency_hz": rate_hz}, "/driver_box_box_1", (0.0, listened_s), findings)
    assert any(each.what == "nothing came" for each in findings.departures()) == departs
    assert any("nothing came" in each.what for each in findings.remarks()) != departs


@pytest.mark.parametrize(("counted", "departures"), [(1, []), (2, ["samples_total has grown by"])])
def test_samples_of_an_irregular_stream_are_counted_too(counted, departures):
    """Whatever their rate, of which nothing is said: each is one that came."""
    heard = heard_of(frames([1] * 500), nominal_rate_hz=0.0, measured_rate_hz=math.nan)
    for each in heard.health:
        each.message.samples_total *= counted
    health.check(heard, 0.0, (0.0, heard.frames[-1].heard_s), True, heard.findings)
    assert [each.what[:26] for each in heard.findings.departures()] == departures


def test_samples_found_later_than_health_are_no_departure():
    """What was published before its topic was found is counted by the driver and was heard by nobody."""
    heard = heard_of(frames([10] * 60))
    heard.frames = heard.frames[-40:]
    assert judged(heard) == []


def test_a_stall_in_a_few_seconds_says_nothing_of_the_measured_rate():
    """Of 4 s, one of them a standstill, most pairs of frames have it between them; of longer the median tells."""
    given = [each._replace(stamp_ns=each.stamp_ns + 10**9 * (n > 5)) for n, each in enumerate(frames([10] * 60))]
    short = heard_of(given)
    short.frames, short.health = short.frames[:15], short.health[:3]
    assert judged(short) == []
    assert judged(heard_of(given)) == []


def test_a_burst_in_a_few_seconds_says_nothing_of_the_measured_rate():
    """The first 4 of 10 s came all at once from a busy machine: the burst is in most pairs of frames, not in all."""
    given = frames([5] * 100)
    late = [each._replace(stamp_ns=max(each.stamp_ns, given[37].stamp_ns)) for each in given]
    assert np.median(times.paces(late)) > 1.2 * RATE_HZ
    assert judged(heard_of(late)) == []
    assert any("measured_rate_hz is 35" in each for each in judged(heard_of(late, measured_rate_hz=35.0)))


def test_seldom_health_is_told():
    """Every third second is not once a second."""
    heard = heard_of(frames([10] * 60))
    heard.health = heard.health[::3]
    assert any("must be one a second" in each for each in judged(heard))


def test_a_loss_nobody_counts_is_told():
    """Ten samples are missing by device time, and health says none."""
    given = frames([10] * 60)
    assert any("lost_samples_total has grown by 0" in each for each in judged(heard_of(given[:30] + given[31:])))


def test_parameters_are_held_against_the_samples():
    """Names of channels, range and unit that the samples contradict."""
    heard = heard_of(frames([10] * 60))
    values = {"human_id": "p1", "sensor_id": "box_1", "eda.unit": "mV", "eda.range_min": 0.5, "eda.range_max": 1.0}
    values["eda.resolution_bits"] = -3
    parameters.agree(values | {"eda.channel_names": ["left"]}, heard, "/driver_box_box_1", heard.findings)
    found = " ".join(each.what for each in heard.findings.departures())
    for sentence in ("unit 'mV' of eda", "samples of eda are 0.1 to 2", "eda.channel_names is ['left']", "bits is -3"):
        assert sentence in found


@pytest.mark.parametrize(("delay_s", "right"), [(0.0, True), (0.05, True), (-0.1, False), (math.inf, False)])
def test_a_delay_is_a_number_of_seconds(delay_s, right):
    """0 or above; an infinite one would be subtracted from every time."""
    heard = Heard(NAME, Findings())
    parameters.agree({"transport_delay_s": delay_s}, heard, "/driver_box_box_1", heard.findings)
    assert ["transport_delay_s" in each.what for each in heard.findings.departures()] == [True] * (not right)


def test_a_message_is_looked_at_as_it_comes():
    """Channels of unequal length, another frame_id, a heart rate of 0, a unit that is not the contract's."""
    heard = Heard(NAME, Findings())
    channels = [PhysioRawChannel(channel_name=name, samples=[1.0] * size) for name, size in (("a", 1), ("b", 2))]
    heard.raw(PhysioRaw(channels=channels), time.time_ns())
    features = [PhysioFeature(name="heart_rate", unit="bpm", values=[0.0])]
    heard.device(PhysioDeviceFeature(features=features), time.time_ns())
    found = " ".join(each.what for each in heard.findings.departures())
    for sentence in ("unequal length", "must be the sensor_id", "header.stamp is zero", "heart_rate is 0", "'bpm'"):
        assert sentence in found


def stamped(message, device_ns=0):
    """The message of box_1, received now."""
    at_ns = time.time_ns()
    message.header.frame_id = "box_1"
    set_time(message.header.stamp, at_ns)
    set_time(message.device_timestamp, at_ns if device_ns is None else device_ns)
    return message, at_ns


@pytest.mark.parametrize(("device_ns", "copied"), [(None, True), (0, False), (10**18, False)])
def test_a_report_s_device_time_is_no_copy(device_ns, copied):
    """As of samples: where the device gives no time it must be zero."""
    heard = Heard(NAME, Findings())
    for _ in range(3):
        features = [PhysioFeature(name="contact", unit="1", values=[1.0, math.nan])]
        heard.device(*stamped(PhysioDeviceFeature(features=features), device_ns))
    found = [each.what for each in heard.findings.departures()]
    assert found == ["device_timestamp is header.stamp: where the device gives no time it must be zero"] * copied


@pytest.mark.parametrize(
    ("device_s", "back"),
    [((50, 51, 51, 52), 0), ((50, 0, 51), 0), ((50, 45, 52), 0), ((50, 0, 39), 1), ((50, 1, 2), 1)],
)
def test_a_report_s_device_time_does_not_go_back(device_s, back):
    """Two reports may be of one time, one may have none, and a long fixation is told after the blink that it held."""
    heard = Heard(NAME, Findings())
    for each in device_s:
        features = [PhysioFeature(name="contact", unit="1", values=[1.0])]
        heard.device(*stamped(PhysioDeviceFeature(features=features), each * 10**9))
    assert ["goes back" in each.what for each in heard.findings.departures()] == [True] * back


def test_what_a_device_reports_is_finite():
    """Infinity is no heart rate, and no half width of a clock's measurement; NaN is right where it cannot be known."""
    heard = Heard(NAME, Findings())
    for value in (math.inf, math.nan):
        features = [PhysioFeature(name="heart_rate", unit="1/min", values=[value])]
        heard.device(*stamped(PhysioDeviceFeature(features=features)))
    heard.clock_measurement(*stamped(ClockMeasurement(method="ntp", uncertainty_s=math.inf), 10**9))
    found = sorted(each.what for each in heard.findings.departures())
    assert ["is infinite" in found[0], "uncertainty_s" in found[1]] == [True, True]


def test_a_share_is_no_percentage():
    """A confidence is 0 to 1, a contact 0 or 1."""
    heard = Heard(NAME, Findings())
    heard.device(*stamped(PhysioDeviceFeature(features=[PhysioFeature(name="contact", unit="%", values=[98.0])])))
    for confidence in (1.0, math.nan, 95.0):
        channels = [PhysioRawChannel(channel_name="confidence", samples=[confidence])]
        heard.raw(*stamped(PhysioRaw(channels=channels)))
    found = [each.what for each in heard.findings.departures()]
    assert found == ["confidence is not within 0 to 1", "contact is [98.0], must be 0 or 1"]


def test_what_a_driver_s_node_publishes_beside_its_sensor_is_told():
    """Another sensor, or what interpreters and clock-sync publish; its own topics and others of ROS are right."""
    topics = [NAME.topic("raw"), NAME.topic("clock"), StreamName("p1", "eda", "box_2").topic("raw"), "/rosout"]
    node = SimpleNamespace(get_publisher_names_and_types_by_node=lambda *_: [(topic, []) for topic in topics])
    findings = Findings()
    Topics(node, "box_1", findings).beside("/driver_box_box_1")
    assert [(each.section, each.where) for each in findings.departures()] == [(2, topic) for topic in topics[1:3]]


def test_a_message_that_waited_here_came_when_it_came():
    """On a machine that is too busy it is handled late: that is not the driver's fault, nor its rate."""
    heard, came_ns = Heard(NAME, Findings()), time.time_ns() - 10_000_000_000
    message = PhysioRaw(channels=[PhysioRawChannel(channel_name="eda", samples=[1.0])])
    message.header.frame_id, message.header.stamp.sec = "box_1", came_ns // 1_000_000_000
    heard.raw(message, came_ns)
    assert heard.findings.departures() == []
    assert heard.frames[0].heard_s < time.monotonic() - 9.9
    heard.raw(message, came_ns + 6_000_000_000)
    assert ["more than 5 s" in each.what for each in heard.findings.departures()] == [True]


def test_every_parameter_of_the_contract_is_asked_for():
    """Eight of the sensor, six of each stream, each of one type."""
    assert (len(parameters.OF_SENSOR), len(parameters.OF_STREAM)) == (8, 6)
    assert {*parameters.OF_SENSOR.values(), *parameters.OF_STREAM.values()} == set(parameters.KINDS)
    assert ParameterType.PARAMETER_NOT_SET not in parameters.KINDS


@pytest.mark.parametrize(("lost", "falls"), [((-1, 0), False), ((4, -1), False), ((4, -1, 3), True), ((4, 3), True)])
def test_what_is_not_known_does_not_fall(lost, falls):
    """-1 is not a number of samples: before it and after it the total must not fall."""
    heard = heard_of(frames([10] * 60))
    for each, number in zip(heard.health, (*lost, *[lost[-1]] * len(heard.health)), strict=False):
        each.message.lost_samples_total = number
    assert ("lost_samples_total falls" in judged(heard)) == falls


def test_a_sensor_that_somebody_moves_meanwhile_is_on_nobody_else_any_more():
    """Its topics of before are a remark; topics under two wearers at the same time are a departure."""
    findings, moved = Findings(), NAME._replace(human_id="p2")
    streams = {name: Heard(name, findings) for name in (NAME, moved)}
    published = {moved.topic("health"): ["/driver_box_box_1"]}
    topics = SimpleNamespace(streams=streams, published=lambda: published)
    node = __main__._node(topics, "box_1", findings)
    __main__._judge(topics, {}, node, (0.0, 1.0), findings)
    assert findings.departures() == []
    assert ["box_1 is no longer on p1" in each.what for each in findings.remarks()] == [True]
    published[NAME.topic("health")] = ["/driver_box_box_1"]
    __main__._node(topics, "box_1", findings)
    assert ["is on p1 and p2 at once" in each.what for each in findings.departures()] == [True]


def test_a_driver_that_ends_meanwhile_is_told():
    """Nobody publishes what was there at the beginning: that is no driver without departures."""
    findings = Findings()
    gone = SimpleNamespace(published=dict, streams={NAME: Heard(NAME, findings)})
    assert __main__._node(gone, "box_1", findings) is None
    assert ["has ended meanwhile" in each.what for each in findings.departures()] == [True]
