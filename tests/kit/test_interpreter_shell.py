"""The shell of an interpreter, and how streams are found: with a toy driver and a toy interpreter as real processes."""

import itertools
from array import array

from processes import poll
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sense4hri import qos
from sense4hri.crowd import FEW
from sense4hri.names import StreamName
from sense4hri.stamps import set_time, to_ns
from sense4hri_msgs.msg import ECG, PhysioRaw, PhysioRawChannel, SensorInfo, SensorInfoArray

P1 = StreamName("p1", "ecg", "toy_1")
START_NS = 10**15


def publish_ramp(publisher, n_frames, fs_hz=100, frame=50):
    """Send frames as a third-party driver would, far faster than real time."""
    for k in range(1, n_frames + 1):
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=array("d", [0.0] * frame))])
        message.header.frame_id = "bar_1"
        stamp_ns = START_NS + k * frame * 10**9 // fs_hz
        set_time(message.device_timestamp, stamp_ns)
        set_time(message.header.stamp, stamp_ns + 10**18)
        publisher.publish(message)


def test_features_appear_beside_every_stream_of_the_type(start, ears):
    """Each stream has its own updates: 100 samples each second of sample time, and the device's own rate beside."""
    topics = [P1.topic("features"), P1._replace(human_id="p2", sensor_id="toy_2").topic("features")]
    first, second = (ears.hear(ECG, topic, qos.deep(qos.FEATURES)) for topic in topics)
    start("toy_interpreter.py")
    start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    start("toy_driver.py", human_id="p2", sensor_id="toy_2")
    ears.until(lambda: len(first) >= 3 and len(second) >= 3, "three updates of both")
    ears.until(lambda: first[-1].heart_rate_bpm == 61.0, "the device's own rate has come too")
    assert {m.peak_count for m in first[1:]} == {100}
    assert {m.header.frame_id for m in second} == {"toy_2"}
    steps = {to_ns(b.device_timestamp) - to_ns(a.device_timestamp) for a, b in itertools.pairwise(first)}
    assert steps == {10**9}


def test_the_features_follow_human_id(start, ears):
    """When a driver's human_id is set, its features go on under the new name, and the old topic is left."""
    start("toy_interpreter.py")
    start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    before = ears.hear(ECG, P1.topic("features"), qos.FEATURES)
    after = ears.hear(ECG, P1._replace(human_id="Ada").topic("features"), qos.FEATURES)
    ears.until(lambda: before, "an update of p1")
    request = SetParameters.Request(parameters=[Parameter("human_id", value="Ada").to_parameter_msg()])
    assert ears.ask(SetParameters, "/driver_toy_toy_1/set_parameters", request).results[0].successful
    ears.until(lambda: after, "an update of Ada")
    ears.until(lambda: ears.node.count_publishers(P1.topic("features")) == 0, "the old topic is left")


def declare(ears, rate_hz):
    """Make the test's node say what its stream is like."""
    ears.node.declare_parameter("ecg.sampling_frequency_hz", rate_hz)
    ears.node.declare_parameter("ecg.unit", "uV")


def say(sensors, rate_hz):
    """Publish what a registry knows of a stream."""
    info = SensorInfo(
        sensor_id="bar_1", sensor_type="ecg", sampling_frequency_hz=rate_hz, unit="uV", channel_names=["ecg"]
    )
    sensors.publish(SensorInfoArray(sensors=[info]))


def test_the_node_is_believed_before_the_registry(start, ears):
    """A node that answers, though a second late, speaks for its stream, whatever the registry remembers of it."""
    say(ears.node.create_publisher(SensorInfoArray, "/study/sensors", qos.SENSORS), 200.0)
    declare(ears, 100.0)
    process = start("toy_interpreter.py")
    raw = ears.node.create_publisher(PhysioRaw, P1._replace(sensor_id="bar_1").topic("raw"), qos.RAW)
    poll(lambda: raw.get_subscription_count() > 1, "the interpreter looks at the data, for nobody answers")
    ears.until(lambda: "(from " in process.log(), "the interpreter knows the rate")
    assert "100 Hz, unit uV (from node)" in process.log()


def test_a_node_that_answers_late_is_believed_before_the_data(start, ears):
    """A busy node is asked on while its data is looked at, and its answer counts when it comes."""
    process = start("toy_interpreter.py")
    declare(ears, 123.0)  # the data would say 100 Hz
    raw = ears.node.create_publisher(PhysioRaw, P1._replace(sensor_id="bar_1").topic("raw"), qos.RAW)
    poll(lambda: raw.get_subscription_count() > 1, "the interpreter looks at the data, for nobody answers")
    publish_ramp(raw, 3)
    ears.until(lambda: "(from " in process.log(), "the interpreter knows the rate")
    assert "123 Hz, unit uV (from node)" in process.log()


def test_the_registry_is_believed_where_the_node_stays_silent(start, ears):
    """Where a node does not answer, what the registry says of its stream is enough, though no sample has come."""
    sensors = ears.node.create_publisher(SensorInfoArray, "/study/sensors", qos.SENSORS)
    process = start("toy_interpreter.py")
    raw = ears.node.create_publisher(PhysioRaw, P1._replace(sensor_id="bar_1").topic("raw"), qos.RAW)
    poll(lambda: raw.get_subscription_count() > 1, "the interpreter looks at the data, for nobody answers")
    say(sensors, 100.0)
    process.until("100 Hz, unit uV (from registry)")


def test_without_parameters_the_registry_speaks_for_a_stream(start, ears):
    """A replayed stream, whose publisher has no parameters, is read with the rate in /study/sensors from its start."""
    say(ears.node.create_publisher(SensorInfoArray, "/study/sensors", qos.SENSORS), 100.0)
    process = start("toy_interpreter.py")
    name = P1._replace(sensor_id="bar_1")
    got = ears.hear(ECG, name.topic("features"), qos.deep(qos.FEATURES))
    raw = ears.node.create_publisher(PhysioRaw, name.topic("raw"), qos.RAW)
    ears.until(lambda: raw.get_subscription_count() > 0, "the interpreter subscribes")
    publish_ramp(raw, 21)
    ears.until(lambda: len(got) >= 10, "ten updates")
    assert "100 Hz, unit uV (from registry)" in process.log()
    assert to_ns(got[0].device_timestamp) == START_NS + 10**7 + 10**9


def test_a_driver_that_lacks_a_parameter_is_still_asked_for_the_rest(start, ears):
    """A third-party driver without `vendor` is read by the rate and unit that it does declare."""
    process = start("toy_interpreter.py")
    name = P1._replace(sensor_id="bar_1")
    declare(ears, 100.0)
    ears.node.create_publisher(PhysioRaw, name.topic("raw"), qos.RAW)
    ears.until(lambda: "100 Hz, unit uV (from node)" in process.log(), "the interpreter knows the rate")


def test_a_stream_nobody_describes_gets_its_rate_from_the_data(start, ears):
    """With neither parameters nor registry the rate is learnt from the stamps and no sample is lost."""
    process = start("toy_interpreter.py")
    name = P1._replace(sensor_id="bar_1")
    got = ears.hear(ECG, name.topic("features"), qos.deep(qos.FEATURES))
    raw = ears.node.create_publisher(PhysioRaw, name.topic("raw"), qos.RAW)
    ears.until(lambda: raw.get_subscription_count() > 0, "the interpreter subscribes")
    ears.until(lambda: raw.get_subscription_count() > 1, "the rate is being learnt")
    publish_ramp(raw, 21)
    ears.until(lambda: len(got) >= 10, "ten updates")
    assert "unit unknown (from data)" in process.log()
    assert to_ns(got[0].device_timestamp) == START_NS + 10**7 + 10**9


def test_of_a_process_with_many_streams_those_that_speak_are_interpreted(start, ears):
    """Nothing is made of the silent ones, which are waited for with one subscription each."""
    declare(ears, 100.0)
    names = [P1._replace(sensor_id=f"bar_{number}") for number in range(FEW + 2)]
    raw = {name: ears.node.create_publisher(PhysioRaw, name.topic("raw"), qos.RAW) for name in names}
    start("toy_interpreter.py")

    def interpreted():
        return {name for name in names if ears.node.count_publishers(name.topic("features"))}

    ears.until(lambda: len(interpreted()) == FEW, "the first are read, before it is known that there are many")
    poll(lambda: all(one.get_subscription_count() for one in raw.values()), "the others are waited for")
    speaks, silent = set(names) - interpreted()

    def heard():
        publish_ramp(raw[speaks], 1)
        return speaks in interpreted()

    ears.until(heard, "what speaks is read")
    assert silent not in interpreted()


def test_a_message_that_cannot_be_used_is_counted_and_skipped(start, ears):
    """No channels at all, or a number that no sensor has, end up in a counter, and the stream goes on."""
    process = start("toy_interpreter.py")
    start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    got = ears.hear(ECG, P1.topic("features"), qos.FEATURES)
    intruder = ears.node.create_publisher(PhysioRaw, P1.topic("raw"), qos.RAW)
    ears.until(lambda: got, "an update")
    ears.until(lambda: intruder.get_subscription_count() > 0, "the interpreter hears the intruder")
    intruder.publish(PhysioRaw())
    intruder.publish(PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=[1e31])]))
    line = 'sense4hri_undecodable_frames_total{sensor_id="toy_1",sensor_type="ecg",service="toy_interpreter"} 2.0'
    ears.until(lambda: line in process.get("/metrics")[1], "the bad message is counted")
    n = len(got)
    ears.until(lambda: len(got) > n, "updates go on")


def test_every_stream_that_cannot_be_interpreted_is_named(start, ears):
    """A second bad stream is told as the first was, each with its reason; a good one beside them is interpreted."""
    process = start("toy_interpreter.py")
    declare(ears, -130.0)
    for sensor_id in ("bar_1", "bar_2"):
        ears.node.create_publisher(PhysioRaw, P1._replace(sensor_id=sensor_id).topic("raw"), qos.RAW)
    start("toy_driver.py", human_id="p1", sensor_id="toy_1")
    good = ears.hear(ECG, P1.topic("features"), qos.FEATURES)

    def told(sensor_id):
        reason = "says ecg.sampling_frequency_hz is -130"
        return any(f"/ecg/{sensor_id}/raw" in line and reason in line for line in process.log().splitlines())

    ears.until(lambda: told("bar_1") and told("bar_2"), process.log)
    ears.until(lambda: good, "the good one has features")


def test_an_interpreter_ends_cleanly(start):
    """SIGTERM ends an interpreter with status 0 within the 10 s that Docker gives."""
    process = start("toy_interpreter.py")
    poll(lambda: process.get("/readyz")[0] == 200, "ready")
    assert process.stop_within() == 0
    assert "Traceback" not in process.log()
