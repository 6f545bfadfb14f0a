"""Streams of drivers on several hosts, and a page on a third one, stand on one axis: in the reference host's time."""

from types import SimpleNamespace

import numpy as np
import pytest
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.stamps import SECOND_NS as S
from web_gui.hosts import PAGE, Hosts
from web_gui.model import Study
from web_gui.steady import Steady
from web_gui.stream import Info

NOW = 1_700_000_000 * S
AHEAD_NS = {"lab_a": 0, "lab_b": 3 * S, "lab_c": -800_000_000, "lab_d": 12 * S}  # of the clock of each host
EVENT_S = 10
WINDOW_NS = 60 * S


def clocks(*hosts):
    """What the reference's clock-sync says of these hosts."""
    at = SimpleNamespace(sec=NOW // S, nanosec=0)
    common = {"reference": "lab_a", "skew_ppm": 0.0, "uncertainty_s": 1e-4, "round_trip_s": 4e-4, "state": 1}
    about = [common | {"host": host, "offset_ns": -AHEAD_NS[host], "measured_at": at} for host in hosts]
    return SimpleNamespace(clocks=[SimpleNamespace(**each) for each in about])


@pytest.fixture
def study(monkeypatch):
    """The page runs on lab_c; lab_b, lab_c and lab_d have been measured."""
    monkeypatch.setenv("SENSE4HRI_HOST", "lab-c")
    page_ns = NOW + AHEAD_NS["lab_c"]
    study = Study(clock=Steady(lambda: page_ns, lambda: page_ns))
    study.hosts.take(clocks("lab_b", "lab_c", "lab_d"), study.clock.now_ns())
    return study


def play(study, sensor_id, host, device, seconds=20, told_first=True):
    """10 Hz, 1 where the event is, else 0; everything stamped by the clock of the driver's host."""
    name = StreamName("p1", "eda", sensor_id)
    health = {"state": 2, "host": host, "lost_samples_total": 0, "reasons": []}
    for second in range(seconds):
        true_ns = NOW - (seconds - 1 - second) * S
        host_ns, now_ns = true_ns + AHEAD_NS[host], true_ns + AHEAD_NS["lab_c"]
        stream = study.stream(name, now_ns)
        stream.learn(Info(10.0, "uS", {}))
        if told_first or second:
            stream.take_health(health, now_ns)
        signal = np.zeros((10, 1))
        signal[-1] = second == EVENT_S
        chunk = Chunk(("eda",), signal, 100 * S + second * S if device else None, host_ns)
        study.take_raw(name, chunk, now_ns)
        if device:
            offset_ns = host_ns - (100 * S + second * S)
            model = {"device_reference": 0, "offset_ns": offset_ns, "skew_ppm": 0.0, "segment": 1}
            stream.take_clock(model | {"header": {"stamp": host_ns}}, now_ns)
    return stream


def event_ns(stream):
    """Where the event stands on the axis."""
    line = stream.history.columns(NOW - WINDOW_NS, NOW + WINDOW_NS, 1, [0])
    return int(line.times_ns[np.nanargmax(line.high[:, 0])])


@pytest.mark.parametrize("device", [True, False])
def test_an_event_at_one_true_time_stands_at_one_place(study, device):
    """Of drivers on two hosts whose clocks are 3 s apart, with the device's time and without: within 5 ms."""
    for sensor_id, host in (("a_1", "lab_a"), ("b_1", "lab_b")):
        stream = play(study, sensor_id, host, device)
        assert abs(event_ns(stream) - (NOW - (19 - EVENT_S) * S)) < 5_000_000, host


@pytest.mark.parametrize("host", ["lab_a", "lab_b", "lab_c", "lab_d"])
def test_no_host_makes_its_data_late(study, host):
    """The delay is that of the way, whichever clocks the driver's host and the page's have; nothing is a replay."""
    stream = play(study, "s_1", host, True)
    assert abs(stream.delays.p99_s(NOW + AHEAD_NS["lab_c"])) < 5e-3
    assert not study.axis.replaying(NOW + AHEAD_NS["lab_c"])
    assert abs(study.axis.now_ns(NOW + AHEAD_NS["lab_c"]) - NOW) < 5_000_000


def test_what_came_before_its_host_was_known_is_moved(study):
    """The first second of a device with a clock, once the driver has said where it runs."""
    stream = play(study, "b_1", "lab_b", True, told_first=False)
    assert abs(stream.history.oldest_ns - (NOW - 19.9 * S)) < 5_000_000


def test_marks_of_a_device_without_a_clock_move_with_its_samples(study):
    """Their times are of the driver's host."""
    stream = play(study, "b_1", "lab_b", False)
    at_ns = NOW + AHEAD_NS["lab_b"] - 5 * S
    assert abs(stream.history.axis_times(np.array([at_ns]))[0] - (NOW - 5 * S)) < 5_000_000


@pytest.mark.parametrize(
    ("source", "host"), [("b_1", "lab_b"), (PAGE, "lab_c"), ("session-coordinator", "lab_a"), ("", "lab_a")]
)
def test_a_marker_stands_where_it_was_set(study, source, host):
    """By the clock of the sensor's driver or of the page; one of which nobody knows the host by its stamp."""
    play(study, "b_1", "lab_b", True)
    told = {"stamp_ns": NOW + AHEAD_NS[host], "name": "event", "value": "", "human_id": "", "source": source}
    study.take_marker(told, NOW)
    assert study.markers[-1].at_ns == NOW


def test_a_host_that_nobody_measured_is_as_it_says():
    """Offset 0, of a driver's host and of the page's."""
    hosts = Hosts("lab_c")
    hosts.sensors.told("c_1", "lab_c")
    assert hosts.of_here_ns(NOW) == hosts.marked_ns("c_1", NOW) == NOW
