"""clock-sync as a process: models beside every stream, through resets, moves and steps."""

import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from clock_sync import links
from rclpy.executors import SingleThreadedExecutor
from sense4hri import qos, stamps
from sense4hri.clock_model import ros_ns
from sense4hri.names import StreamName
from sense4hri_msgs.msg import ClockMeasurement, ClockModel, PhysioRaw, PhysioRawChannel, StreamHealth

SECOND = 1_000_000_000


def wait_for(condition, what: str, seconds: float = 20.0) -> Any:
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.02)
    return result


class Graph:
    """A node of the test that plays drivers and listens to models."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Any] = []

    def driver(self, name: str, transport_delay_s: float = 0.0) -> Any:
        node = rclpy.create_node(name, context=self.context)
        node.declare_parameter("transport_delay_s", transport_delay_s)
        for kind in ("ecg", "accelerometer"):
            node.declare_parameter(f"{kind}.sampling_frequency_hz", 130.0)
        self.executor.add_node(node)
        self.nodes.append(node)
        return node

    def spin_until(self, condition, what: str, seconds: float = 20.0) -> Any:
        def turn() -> Any:
            self.executor.spin_once(timeout_sec=0.02)
            return condition()

        return wait_for(turn, what, seconds)

    def close(self) -> None:
        for node in self.nodes:
            node.destroy_node()
        rclpy.shutdown(context=self.context)


class Stream:
    """One raw stream of a played driver, and the models beside it."""

    def __init__(self, graph: Graph, node: Any, name: StreamName) -> None:
        self.graph, self.node, self.name = graph, node, name
        self.models: list[ClockModel] = []
        self.raw = node.create_publisher(PhysioRaw, name.topic("raw"), qos.RAW)
        self.health = node.create_publisher(StreamHealth, name.topic("health"), qos.HEALTH)
        self.measured = node.create_publisher(ClockMeasurement, name.topic("clock_measurement"), qos.CLOCK_MEASUREMENT)
        self.listener = node.create_subscription(
            ClockModel, name.topic("clock"), self.models.append, qos.deep(qos.CLOCK, 5000)
        )
        graph.spin_until(lambda: self.raw.get_subscription_count() > 0, "clock-sync listens")
        graph.spin_until(lambda: self.health.get_subscription_count() > 0, "to health too")
        graph.spin_until(lambda: self.measured.get_subscription_count() > 0, "and to measurements")

    def send(self, device_ns: int, received_ns: int) -> None:
        message = PhysioRaw(channels=[PhysioRawChannel(channel_name="ecg", samples=[0.0])])
        message.header.frame_id = self.name.sensor_id
        stamps.set_time(message.header.stamp, received_ns)
        stamps.set_time(message.device_timestamp, device_ns)
        self.raw.publish(message)
        self.graph.executor.spin_once(timeout_sec=0.0)

    def tell(self, host: str, realtime_minus_monotonic_ns: int) -> None:
        self.health.publish(StreamHealth(host=host, realtime_minus_monotonic_ns=realtime_minus_monotonic_ns))

    def model_of(self, received_ns: int) -> ClockModel:
        """Wait for the model that has used the packet of this receipt stamp."""

        def newest() -> ClockModel | None:
            found = [m for m in self.models if stamps.to_ns(m.header.stamp) >= received_ns]
            return found[-1] if found else None

        return self.graph.spin_until(newest, "a model of the newest packet")

    def close(self) -> None:
        self.node.destroy_publisher(self.raw)
        self.node.destroy_publisher(self.health)
        self.node.destroy_publisher(self.measured)


def offset_at(model: ClockModel, device_ns: int) -> int:
    return ros_ns(device_ns, stamps.to_ns(model.device_reference), model.offset_ns, model.skew_ppm) - device_ns


@pytest.fixture
def graph(ros_domain: int) -> Iterator[Graph]:
    graph = Graph()
    yield graph
    graph.close()


@pytest.fixture
def log(ros_domain: int, tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "log"
    with path.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "clock_sync", "--ros-args", "-p", "publish_interval_s:=0.0"], stderr=file
        )
    yield path
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == 0, path.read_text()


def test_a_model_is_beside_every_stream_of_the_device(graph, log):
    """ECG and accelerometer of one sensor get the same model, right within 5 ms, with the known delay subtracted."""
    link = links.simulate("strap", 1, 60.0)
    node = graph.driver("driver_check_h10", transport_delay_s=0.004)
    ecg = Stream(graph, node, StreamName("p1", "ecg", "h10"))
    acc = Stream(graph, node, StreamName("p1", "accelerometer", "h10"))
    for device, received in zip(link.device_ns.tolist(), link.received_ns.tolist(), strict=True):
        ecg.send(device, received)
        acc.send(device - 3_000_000, received)
    newest = int(link.received_ns[-1])
    models = [stream.model_of(newest) for stream in (ecg, acc)]
    graph.spin_until(lambda: ecg.models[-1] == acc.models[-1], "the same model beside both")
    device = int(link.device_ns[-1])
    error_ns = device + offset_at(models[0], device) + 4_000_000 - links.EPOCH_NS - round(link.true_s[-1] * 1e9)
    assert abs(error_ns - 20_000_000) < 5_000_000
    assert {m.segment for m in ecg.models} == {1}
    assert models[0].header.frame_id == "h10"
    times = [stamps.to_ns(m.header.stamp) for m in ecg.models]
    assert max(np.diff(times)) <= 1.5 * SECOND
    text = log.read_text()
    port = re.search(r"metrics on port (\d+)", text)
    assert port is not None
    with urllib.request.urlopen(f"http://127.0.0.1:{port[1]}/metrics", timeout=5) as answer:
        metrics = answer.read().decode()
    assert 'sense4hri_clock_segment{sensor_id="h10",service="clock_sync"} 1.0' in metrics
    assert "sense4hri_clock_offset_seconds" in metrics
    assert "p1" not in metrics


def test_a_reset_opens_a_segment_and_a_move_does_not(graph, log):
    """Device time that jumps back makes segment 2 at once; the stream's move to another person keeps it."""
    node = graph.driver("driver_check_h10")
    first = Stream(graph, node, StreamName("p1", "ecg", "h10"))
    for i in range(50):
        first.send(1000 * SECOND + i * SECOND // 2, links.EPOCH_NS + i * SECOND // 2)
    first.send(5 * SECOND, links.EPOCH_NS + 25 * SECOND)
    assert first.model_of(links.EPOCH_NS + 25 * SECOND).segment == 2
    opened = next(m for m in first.models if m.segment == 2)
    assert stamps.to_ns(opened.header.stamp) == links.EPOCH_NS + 25 * SECOND
    first.close()
    second = Stream(graph, node, StreamName("p2", "ecg", "h10"))
    graph.spin_until(lambda: second.models, "the model is beside the moved stream before any packet")
    for i in range(20):
        second.send(6 * SECOND + i * SECOND // 2, links.EPOCH_NS + 26 * SECOND + i * SECOND // 2)
    assert second.model_of(links.EPOCH_NS + 26 * SECOND + 19 * SECOND // 2).segment == 2
    assert "new epoch" in log.read_text()


def test_a_step_of_the_host_clock_reaches_every_device_of_the_host(graph, log):
    """One driver's health tells of a step: every device of that host gets a new segment, no other does."""
    streams = {
        sensor: Stream(graph, graph.driver(f"driver_check_{sensor}"), StreamName("p1", "ecg", sensor))
        for sensor in ("one", "two", "other")
    }
    for i in range(60):
        for stream in streams.values():
            stream.send(1000 * SECOND + i * SECOND // 2, links.EPOCH_NS + i * SECOND // 2)
    newest = links.EPOCH_NS + 59 * SECOND // 2
    before = {sensor: stream.model_of(newest) for sensor, stream in streams.items()}
    for sensor, stream in streams.items():
        stream.tell("lab2" if sensor == "other" else "lab1", 7 * SECOND)
    metrics_settled = time.monotonic() + 0.5
    graph.spin_until(lambda: time.monotonic() > metrics_settled, "health has arrived")
    streams["one"].tell("lab1", 10 * SECOND)
    for sensor in ("one", "two"):
        graph.spin_until(lambda s=sensor: streams[s].models[-1].segment == 2, f"{sensor} has segment 2")
        after = streams[sensor].models[-1]
        moved = offset_at(after, 1030 * SECOND) - offset_at(before[sensor], 1030 * SECOND)
        assert abs(moved - 3 * SECOND) < 5_000_000
    assert {m.segment for m in streams["other"].models} == {1}
    assert "host 'lab1' was stepped" in log.read_text()


def test_a_measurement_of_the_link_wins(graph, log):
    """A driver that measures its offset in two directions is believed rather than the packets."""
    stream = Stream(graph, graph.driver("driver_check_lsl"), StreamName("p1", "eeg", "lsl"))
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


def test_a_stream_without_device_time_has_no_model(graph, log):
    """A zero device stamp is no time: nothing is published for it."""
    stream = Stream(graph, graph.driver("driver_check_none"), StreamName("p1", "ppg", "none"))
    other = Stream(graph, graph.driver("driver_check_some"), StreamName("p1", "ppg", "some"))
    for i in range(10):
        stream.send(0, links.EPOCH_NS + i * SECOND)
    other.send(SECOND, links.EPOCH_NS)
    other.model_of(links.EPOCH_NS)
    assert stream.models == []


def test_a_sensor_id_that_is_there_twice_is_said_and_not_mixed(graph, log):
    """The second stream of the same sensor_id and type waits; the model stays that of the first."""
    first = Stream(graph, graph.driver("driver_check_a"), StreamName("p1", "ecg", "same"))
    node = graph.driver("driver_check_b")
    second = node.create_publisher(PhysioRaw, StreamName("p2", "ecg", "same").topic("raw"), qos.RAW)
    wait_for(lambda: "the second waits" in log.read_text(), "the duplicate is reported")
    assert second.get_subscription_count() == 0
    first.send(SECOND, links.EPOCH_NS)
    assert first.model_of(links.EPOCH_NS).segment == 1


@pytest.mark.parametrize(
    ("argument", "named"),
    [("publish_interval_s:=2.0", "publish_interval_s"), ("latency_alarm_s:=-1", "latency_alarm_s")],
)
def test_a_wrong_parameter_ends_with_78(ros_domain, argument, named):
    """A configuration that cannot work is one line that names the parameter, and status 78."""
    done = subprocess.run(
        [sys.executable, "-m", "clock_sync", "--ros-args", "-p", argument],
        stderr=subprocess.PIPE,
        text=True,
        timeout=30,
        env=os.environ,
    )
    assert done.returncode == 78
    assert named in done.stderr
