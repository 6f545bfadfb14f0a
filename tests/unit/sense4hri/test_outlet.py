"""What a driver's outlet says of the frames that came on it."""

import re
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from sense4hri import outlet, wire
from sense4hri.chunk import Chunk
from sense4hri.device import Samples, Stream
from sense4hri.health import Link, State, health_message
from sense4hri.outlet import Outlet

WALL_NS, DEVICE_NS = 1_700_000_000_000_000_000, 10**12
STREAM = Stream(10.0, "uS", 0.0, 100.0, 16, ("eda",))
IRREGULAR = replace(STREAM, sampling_frequency_hz=0.0)


class Host:
    """Both clocks of a host; the wall clock can be set."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.step_s = 0.0, 0.0
        monkeypatch.setattr(outlet.time, "monotonic", lambda: self.now_s)
        monkeypatch.setattr(outlet, "realtime_minus_monotonic_ns", lambda: WALL_NS + round(self.step_s * 1e9))

    def wall_ns(self, late_s: float = 0.0) -> int:
        return WALL_NS + round((self.now_s + self.step_s + late_s) * 1e9)


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch) -> Host:
    return Host(monkeypatch)


@pytest.fixture
def opened() -> Outlet:
    made = Outlet(SimpleNamespace(metrics=MagicMock(), publisher=MagicMock()), "eda", "box_1", STREAM)
    made.open("p1")
    return made


def publish(opened: Outlet, host: Host, stamp_ns: int) -> float:
    """Publish one sample taken now, received at that stamp; return the latency that health has then."""
    device_ns = DEVICE_NS + round(host.now_s * 1e9)
    opened.publish(Samples("eda", Chunk(("eda",), np.zeros((1, 1)), device_ns, stamp_ns)))
    return opened.counts.latency_s


@pytest.mark.parametrize("step_s", [10.0, 0.5, -10.0])
def test_a_host_clock_that_is_set_is_no_delay_of_the_link(host: Host, step_s: float, opened: Outlet) -> None:
    """Also where a frame was stamped before the step and published after it; a second later delays are as before."""
    latencies_s = []
    for number in range(200):
        host.now_s += 0.1
        before_ns = host.wall_ns()
        host.step_s = step_s if number >= 100 else 0.0
        latencies_s.append(publish(opened, host, before_ns if number == 100 else host.wall_ns(0.02 * (number % 2))))
    steady_s = np.resize([0.0, 0.02], 200)
    assert np.array(latencies_s)[:100] == pytest.approx(steady_s[:100], abs=1e-3)
    assert np.array(latencies_s)[112:] == pytest.approx(steady_s[112:], abs=1e-3)
    assert max(latencies_s) < 0.1


def test_the_newest_frame_says_whether_the_device_stamps_its_samples(host: Host, opened: Outlet) -> None:
    """Where it does not the times of samples rest on the declared rate."""
    publish(opened, host, host.wall_ns())
    assert opened.counts.device_time
    opened.publish(Samples("eda", Chunk(("eda",), np.zeros((1, 1)), None, WALL_NS)))
    assert not opened.counts.device_time


@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e31])
def test_a_number_that_no_message_may_hold_costs_no_other_sample(value: float, opened: Outlet) -> None:
    """Everybody refuses a message with one: it goes as NaN, its neighbours as they are, is counted and told of."""
    publish = opened._service.publisher.return_value.publish  # type: ignore[attr-defined]
    opened.publish(Samples("eda", Chunk(("eda",), np.array([[1.0], [value], [np.nan], [1e30]]), None, WALL_NS)))
    chunk = wire.chunk_of(publish.call_args.args[0])
    np.testing.assert_equal(chunk.samples[:, 0], [1.0, np.nan, np.nan, 1e30])
    told = health_message("box_1", State.STREAMING, 10.0, Link(), opened.counts)
    assert {each.name: each.values[0] for each in told.extra}["impossible_values_total"] == 1.0
    assert [reason for reason in told.reasons if "NaN" in reason]
    opened.publish(Samples("eda", Chunk(("eda",), np.zeros((1, 1)), None, WALL_NS + 1)))
    assert list(health_message("box_1", State.STREAMING, 10.0, Link(), opened.counts).reasons) == []


@pytest.mark.parametrize("times_ns", [None, np.empty(0, np.int64)])
def test_of_a_read_that_brought_no_sample_nothing_is_published(times_ns: np.ndarray | None, opened: Outlet) -> None:
    """A vendor's SDK returns an empty table now and then: no message, no end of the driver; what it says is lost is."""
    publish = opened._service.publisher.return_value.publish  # type: ignore[attr-defined]
    opened.publish(Samples("eda", Chunk(("eda",), np.zeros((0, 1)), None, WALL_NS), times_ns, lost=7))
    publish.assert_not_called()
    counts = opened.counts
    assert (counts.samples_total, counts.lost_samples_total, counts.gaps_total) == (0, 7, 1)


@pytest.mark.parametrize("shape", [(3,), (3, 2), (3, 1, 1), ()])
def test_samples_that_are_no_table_of_the_declared_channels_are_a_mistake_that_says_so(
    shape: tuple[int, ...], opened: Outlet
) -> None:
    """Whoever writes a driver is told which shape came, and what is declared."""
    with pytest.raises(ValueError, match=rf"eda samples of shape {re.escape(str(shape))}.*\('eda',\)"):
        opened.publish(Samples("eda", Chunk(("eda",), np.zeros(shape), None, WALL_NS)))


def test_irregular_samples_that_come_together_are_messages_of_their_own(opened: Outlet) -> None:
    """Each with its own device time, 0 = none, and received after the one before it; what is lost counts once."""
    publish = opened._service.publisher.return_value.publish  # type: ignore[attr-defined]
    opened.become(IRREGULAR)
    chunk = Chunk(("eda",), np.array([[1.0], [2.0], [3.0]]), DEVICE_NS + 70, WALL_NS)
    opened.publish(Samples("eda", chunk, np.array([DEVICE_NS, 0, DEVICE_NS + 70]), lost=7))
    sent = [wire.chunk_of(call.args[0]) for call in publish.call_args_list]
    assert [each.samples.tolist() for each in sent] == [[[1.0]], [[2.0]], [[3.0]]]
    assert [each.device_ns for each in sent] == [DEVICE_NS, None, DEVICE_NS + 70]
    assert [each.received_ns - WALL_NS for each in sent] == [0, 1, 2]
    assert (opened.counts.samples_total, opened.counts.lost_samples_total, opened.counts.gaps_total) == (3, 7, 1)


@pytest.mark.parametrize("times_ns", [None, np.array([DEVICE_NS])])
def test_irregular_samples_without_the_time_of_each_are_a_mistake_that_says_so(
    times_ns: np.ndarray | None, opened: Outlet
) -> None:
    """All of them would be taken for samples of one and the same time."""
    publish = opened._service.publisher.return_value.publish  # type: ignore[attr-defined]
    opened.become(IRREGULAR)
    with pytest.raises(ValueError, match=r"2 irregular samples of eda came together|1 times of 2 samples"):
        opened.publish(Samples("eda", Chunk(("eda",), np.zeros((2, 1)), DEVICE_NS, WALL_NS), times_ns))
    publish.assert_not_called()
