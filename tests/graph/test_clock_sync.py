"""clock-sync as a process: models beside every stream, through resets, moves and steps."""

import time
from collections.abc import Callable, Iterator
from unittest.mock import MagicMock

import numpy as np
import pytest
from clock_sync import links
from clock_sync.config import Config
from clock_sync.sync import MOST_GONE, SEGMENT_EVERY_S, ClockSync
from ears import Ears
from processes import DEADLINE_S, Process, poll
from rclpy.duration import Duration
from sense4hri import qos, stamps
from sense4hri.clock_model import ros_ns
from sense4hri.metrics import Metrics
from sense4hri.names import StreamName
from sense4hri_msgs.msg import (
    ClockMeasurement,
    ClockModel,
    PhysioRaw,
    PhysioRawChannel,
    SessionAck,
    SessionState,
    StreamHealth,
)

SECOND = 1_000_000_000


class Stream:
    """One raw stream of a played driver, and the models beside it."""

    def __init__(self, driver: Ears, name: StreamName) -> None:
        self.driver, self.name = driver, name
        node = driver.node
        self.models: list[ClockModel] = driver.hear(ClockModel, name.topic("clock"), qos.deep(qos.CLOCK, 5000))
        self.raw = node.create_publisher(PhysioRaw, name.topic("raw"), qos.RAW)
        self.health = node.create_publisher(StreamHealth, name.topic("health"), qos.HEALTH)
        self.measured = node.create_publisher(ClockMeasurement, name.topic("clock_measurement"), qos.CLOCK_MEASUREMENT)
        for end in (self.raw, self.health, self.measured):
            driver.until(lambda end=end: end.get_subscription_count() > 0, f"clock-sync listens to {end.topic_name}")

    def send(self, device_ns: int, received_ns: int) -> None:
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=[0.0])])
        message.header.frame_id = self.name.sensor_id
        stamps.set_time(message.header.stamp, received_ns)
        stamps.set_time(message.device_timestamp, device_ns)
        self.raw.publish(message)
        self.driver.spin(0.0)

    def tell(self, host: str, realtime_minus_monotonic_ns: int, stamp_ns: int = 0) -> None:
        """Publish health, and wait until it has got to clock-sync's end."""
        message = StreamHealth(host=host, realtime_minus_monotonic_ns=realtime_minus_monotonic_ns)
        stamps.set_time(message.header.stamp, stamp_ns)
        self.health.publish(message)
        assert self.health.wait_for_all_acked(Duration(seconds=DEADLINE_S))

    def model_of(self, received_ns: int) -> ClockModel:
        """Wait for the model that has used the packet of this receipt stamp."""

        def newest() -> ClockModel | None:
            found = [m for m in self.models if stamps.to_ns(m.header.stamp) >= received_ns]
            return found[-1] if found else None

        return self.driver.until(newest, "a model of the newest packet")

    def close(self) -> None:
        for end in (self.raw, self.health, self.measured):
            self.driver.node.destroy_publisher(end)


def offset_at(model: ClockModel, device_ns: int) -> int:
    return ros_ns(device_ns, stamps.to_ns(model.device_reference), model.offset_ns, model.skew_ppm) - device_ns


@pytest.fixture
def driver(opened: Callable[[Ears], Ears]) -> Callable[..., Ears]:
    """driver(sensor) is a driver that is not ours; the test publishes its streams."""
    drivers: list[Ears] = []

    def make(sensor: str, transport_delay_s: float = 0.0) -> Ears:
        rates = {f"{kind}.sampling_frequency_hz": 130.0 for kind in ("ecg", "accelerometer")}
        parameters = {"transport_delay_s": transport_delay_s, **rates}
        drivers.append(opened(Ears(f"driver_check_{sensor}", parameters, beside=drivers[0] if drivers else None)))
        return drivers[-1]

    return make


@pytest.fixture
def service(start: Callable[..., Process]) -> Iterator[Process]:
    """clock-sync that publishes with every packet; it ends cleanly."""
    running = start("clock_sync", publish_interval_s=0.0)
    yield running
    assert running.stop() == 0, running.log()


def test_a_model_is_beside_every_stream_of_the_device(driver, service):
    """ECG and accelerometer of one sensor get the same model, right within 5 ms, with the known delay subtracted."""
    link = links.simulate("strap", 1, 60.0)
    node = driver("h10", transport_delay_s=0.004)
    ecg = Stream(node, StreamName("p1", "ecg", "h10"))
    acc = Stream(node, StreamName("p1", "accelerometer", "h10"))
    for device, received in zip(link.device_ns.tolist(), link.received_ns.tolist(), strict=True):
        ecg.send(device, received)
        acc.send(device - 3_000_000, received)
        ecg.model_of(received)  # one at a time: of models, only the newest is kept for a subscriber
    newest = int(link.received_ns[-1])
    models = [stream.model_of(newest) for stream in (ecg, acc)]
    node.until(lambda: ecg.models[-1] == acc.models[-1], "the same model beside both")
    device = int(link.device_ns[-1])
    error_ns = device + offset_at(models[0], device) + 4_000_000 - links.EPOCH_NS - round(link.true_s[-1] * 1e9)
    assert abs(error_ns - 20_000_000) < 5_000_000
    assert {m.segment for m in ecg.models} == {1}
    assert models[0].header.frame_id == "h10"
    times = [stamps.to_ns(m.header.stamp) for m in ecg.models]
    assert max(np.diff(times)) <= 1.5 * SECOND
    segment = 'sense4hri_clock_segment{sensor_id="h10",service="clock_sync"} 1.0'
    metrics = poll(lambda: segment in (told := service.get("/metrics")[1]) and told, "the segment in the metrics")
    assert "sense4hri_clock_offset_seconds" in metrics
    assert "p1" not in metrics


def test_a_reset_opens_a_segment_and_a_move_does_not(driver, service):
    """Device time that jumps back makes segment 2 at once; the stream's move to another person keeps it."""
    node = driver("h10")
    first = Stream(node, StreamName("p1", "ecg", "h10"))
    for i in range(50):
        first.send(1000 * SECOND + i * SECOND // 2, links.EPOCH_NS + i * SECOND // 2)
    first.send(5 * SECOND, links.EPOCH_NS + 25 * SECOND)
    assert first.model_of(links.EPOCH_NS + 25 * SECOND).segment == 2
    opened = next(m for m in first.models if m.segment == 2)
    assert stamps.to_ns(opened.header.stamp) == links.EPOCH_NS + 25 * SECOND
    first.close()
    second = Stream(node, StreamName("p2", "ecg", "h10"))
    node.until(lambda: second.models, "the model is beside the moved stream before any packet")
    for i in range(20):
        second.send(6 * SECOND + i * SECOND // 2, links.EPOCH_NS + 26 * SECOND + i * SECOND // 2)
    assert second.model_of(links.EPOCH_NS + 26 * SECOND + 19 * SECOND // 2).segment == 2
    service.until("new epoch")


def test_a_step_of_the_host_clock_reaches_every_device_of_the_host(driver, service):
    """One driver's health tells of a step: every device of that host gets a new segment, no other does."""
    streams = {sensor: Stream(driver(sensor), StreamName("p1", "ecg", sensor)) for sensor in ("one", "two", "other")}
    for i in range(60):
        for stream in streams.values():
            stream.send(1000 * SECOND + i * SECOND // 2, links.EPOCH_NS + i * SECOND // 2)
    newest = links.EPOCH_NS + 59 * SECOND // 2
    before = {sensor: stream.model_of(newest) for sensor, stream in streams.items()}
    for sensor, stream in streams.items():
        stream.tell("lab2" if sensor == "other" else "lab1", 7 * SECOND)
    for i in (60, 61):  # what has come before the first of these is handled before the second
        for stream in streams.values():
            received = links.EPOCH_NS + i * SECOND // 2
            stream.send(1000 * SECOND + i * SECOND // 2, received)
            stream.model_of(received)
    streams["one"].tell("lab1", 10 * SECOND)
    for sensor in ("one", "two"):
        stream = streams[sensor]
        stream.driver.until(lambda models=stream.models: models[-1].segment == 2, f"{sensor} has segment 2")
        after = stream.models[-1]
        moved = offset_at(after, 1030 * SECOND) - offset_at(before[sensor], 1030 * SECOND)
        assert abs(moved - 3 * SECOND) < 5_000_000
    assert {m.segment for m in streams["other"].models} == {1}
    service.until("host 'lab1' was stepped")


@pytest.mark.parametrize("host", ["lab1", "lab2"])
def test_a_host_that_was_started_anew_is_no_step(driver, service, host):
    """Its account differs by days, its packets do not: the next one begins a segment, on another host as well."""
    stream, days_ns = Stream(driver("one"), StreamName("p1", "ecg", "one")), 3 * 86400 * SECOND
    began_ns = links.EPOCH_NS - (days_ns if host == "lab1" else 0)
    stream.tell("lab1", began_ns, links.EPOCH_NS)
    for i in range(120):
        received_ns = links.EPOCH_NS + i * SECOND // 2
        if i == 60:
            stream.model_of(received_ns - SECOND // 2)
            stream.tell(host, links.EPOCH_NS + 20 * SECOND, received_ns)
            stream.send(1000 * SECOND + i * SECOND // 2 - 1, received_ns - 1)
            stream.model_of(received_ns - 1)  # health is handled by then, before the next packet
        stream.send(1000 * SECOND + i * SECOND // 2, received_ns)
    newest = stream.model_of(links.EPOCH_NS + 119 * SECOND // 2)
    assert newest.segment == 2
    assert newest.state != ClockModel.HOLDOVER
    assert abs(offset_at(newest, 1059 * SECOND) - (links.EPOCH_NS - 1000 * SECOND)) < 5_000_000


def test_a_measurement_of_the_link_wins(driver, service):
    """A driver that measures its offset in two directions is believed rather than the packets."""
    stream = Stream(driver("lsl"), StreamName("p1", "eeg", "lsl"))
    for i in range(40):
        device, received = 1000 * SECOND + i * SECOND // 2, links.EPOCH_NS + i * SECOND // 2
        stream.send(device, received)
        measured = ClockMeasurement(offset_ns=received - device - 20_000_000, uncertainty_s=1e-3, method="test")
        stamps.set_time(measured.header.stamp, received)
        stamps.set_time(measured.device_timestamp, device)
        stream.measured.publish(measured)
        stream.model_of(received)
    stream.send(1020 * SECOND, links.EPOCH_NS + 20 * SECOND)
    model = stream.model_of(links.EPOCH_NS + 20 * SECOND)
    assert abs(offset_at(model, 1020 * SECOND) - (links.EPOCH_NS - 1000 * SECOND - 20_000_000)) < 1_000_000
    assert model.uncertainty_s < 2e-3
    assert model.latency_s == pytest.approx(0.02, abs=0.002)


def test_a_stream_without_device_time_has_no_model(driver, service):
    """A zero device stamp is no time: nothing is published for it."""
    stream = Stream(driver("none"), StreamName("p1", "ppg", "none"))
    other = Stream(driver("some"), StreamName("p1", "ppg", "some"))
    for i in range(10):
        stream.send(0, links.EPOCH_NS + i * SECOND)
    other.send(SECOND, links.EPOCH_NS)
    other.model_of(links.EPOCH_NS)
    assert stream.models == []


def test_a_sensor_id_that_is_there_twice_is_said_and_not_mixed(driver, service):
    """The second stream of the same sensor_id and type waits; the model stays that of the first."""
    first = Stream(driver("a"), StreamName("p1", "ecg", "same"))
    second = driver("b").node.create_publisher(PhysioRaw, StreamName("p2", "ecg", "same").topic("raw"), qos.RAW)
    service.until("the second waits")
    foreign = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=[0.0])])
    stamps.set_time(foreign.header.stamp, links.EPOCH_NS)
    for i in range(1, 6):
        stamps.set_time(foreign.device_timestamp, 1000 * SECOND - i)  # each a clock reset, were they heard
        second.publish(foreign)
        first.send(i * SECOND, links.EPOCH_NS + i * SECOND)
        first.model_of(links.EPOCH_NS + i * SECOND)
    assert {model.segment for model in first.models} == {1}
    assert first.driver.node.count_publishers(StreamName("p2", "ecg", "same").topic("clock")) == 0


def test_clocks_that_begin_anew_for_ever_are_a_line_each_at_times(driver, service):
    """Every packet of two devices shows an earlier time: each is a segment, and few of them are lines."""
    begun_s, ears = time.monotonic(), driver("h10")
    streams = [Stream(ears, StreamName("p1", "ecg", sensor)) for sensor in ("h10", "h11")]
    for number in range(20):
        for stream in streams:
            stream.send(links.EPOCH_NS - number * SECOND, links.EPOCH_NS + number * SECOND)
    for stream in streams:
        stream.driver.until(lambda models=stream.models: models and models[-1].segment == 20, "twenty segments")
    for sensor in ("h10", "h11"):
        lines = service.log().count(f"{sensor}: its clock began a new epoch")
        assert 1 <= lines <= 1 + (time.monotonic() - begun_s) / SEGMENT_EVERY_S


def test_of_devices_that_come_and_go_for_ever_the_newest_are_remembered():
    """A stranger may give a new name to every stream; one that is there is none of those that have gone."""
    service = MagicMock(config=Config())
    service.start.side_effect = lambda work: work.close()
    sync = ClockSync(service, MagicMock())
    stays, *others = [StreamName("p1", "ecg", f"x_{number}") for number in range(MOST_GONE + 10)]
    sync._find(stays)
    for name in others:
        sync._find(name)
        sync._remove(name)
    assert list(sync._devices) == [name.sensor_id for name in (stays, *others[-MOST_GONE:])]
    back = others[-MOST_GONE]
    sync._find(back)
    sync._remove(back)
    assert list(sync._devices)[-1] == back.sensor_id


def test_no_alert_judges_the_clock_of_a_device_that_has_gone():
    """What is not known is NaN; it is known again when the device is back."""
    service, name = MagicMock(config=Config(), metrics=Metrics("clock_sync")), StreamName("p1", "ecg", "h10_1")
    service.start.side_effect = lambda work: work.close()
    sync = ClockSync(service, MagicMock())

    def shown() -> set[str]:
        lines = service.metrics.text().decode().splitlines()
        return {line for line in lines if line.startswith(("sense4hri_clock_state", "sense4hri_clock_latency"))}

    sync._find(name)
    sync._take(sync._devices["h10_1"], "ecg", SECOND, links.EPOCH_NS)
    known = shown()
    assert 'sense4hri_clock_state{sensor_id="h10_1",service="clock_sync"} 0.0' in known
    sync._remove(name)
    assert {line.rpartition(" ")[2] for line in shown()} == {"NaN"}
    sync._find(name)
    assert shown() == known


def test_a_session_waits_for_the_streams_that_it_requires(driver, service):
    """Also where its warm-up is accepted: before a stream is heard nobody knows what its clock is like."""
    required, timeless = StreamName("p1", "ecg", "bar_1"), StreamName("p1", "eda", "foil_1")
    topics = [required.topic("raw"), timeless.topic("raw")]
    state = SessionState(session_id="s1", phase=SessionState.PREPARING, waiting_for=["clock_sync"])
    state.metadata_json, state.required_streams = '{"allow_warmup": true}', topics
    coordinator = driver("bar_1")
    acks = coordinator.hear(SessionAck, "/study/ack", qos.ACK)
    coordinator.node.create_publisher(SessionState, "/study/session", qos.SESSION).publish(state)

    def told(detail: str, ok: bool = False) -> bool:
        return bool(acks) and (acks[-1].ok, acks[-1].detail) == (ok, detail)

    coordinator.until(lambda: told(f"{', '.join(topics)} not heard yet"), "both are missed")
    bar, foil = Stream(coordinator, required), Stream(coordinator, timeless)
    foil.send(0, 1_000 * SECOND)
    coordinator.until(lambda: told(f"{topics[0]} not heard yet"), "the silent one is missed")
    bar.send(SECOND, 1_000 * SECOND)
    coordinator.until(lambda: told("clock of bar_1 not locked yet", ok=True), "the warm-up is accepted")


@pytest.mark.parametrize(("parameter", "value"), [("publish_interval_s", 2.0), ("latency_alarm_s", -1)])
def test_a_wrong_parameter_ends_with_78(start, parameter, value):
    """A configuration that cannot work is one line that names the parameter, and status 78."""
    process = start("clock_sync", **{parameter: value})
    assert process.wait() == 78
    assert parameter in process.log()
