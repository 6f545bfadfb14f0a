"""What a driver knows of a stream by when its samples came."""

import math

import pytest
from sense4hri import health
from sense4hri.health import State, StreamCounts


class Came:
    """The counts of a stream, and the clock by which its samples come, one to a frame."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        monkeypatch.setattr(health.time, "monotonic", lambda: self.now_s)

    def every(self, rate_hz: float, number: int) -> StreamCounts:
        counts = StreamCounts(nominal_hz=rate_hz)
        for _ in range(number):
            self.now_s += 1 / rate_hz
            counts.arrived(1)
        return counts


@pytest.fixture
def came(monkeypatch: pytest.MonkeyPatch) -> Came:
    return Came(monkeypatch)


def test_a_stream_that_has_ended_has_no_rate(came: Came) -> None:
    """The rate is that of the last 10 s: NaN once nothing has come for so long."""
    counts = came.every(130.0, 1000)
    assert counts.measured_rate_hz() == pytest.approx(130.0)
    came.now_s += 9.0
    assert counts.measured_rate_hz() == pytest.approx(130.0)
    came.now_s += 1.1
    assert math.isnan(counts.measured_rate_hz())


@pytest.mark.parametrize(("rate_hz", "silent_s"), [(130.0, 3.0), (1.0, 3.0), (0.2, 15.0), (1 / 60, 180.0)])
def test_a_stream_is_silent_after_three_of_its_samples(came: Came, rate_hz: float, silent_s: float) -> None:
    """At least 3 s; between two samples that are further apart it is not, and has its rate."""
    counts = came.every(rate_hz, 4)
    assert counts.measured_rate_hz() == pytest.approx(rate_hz)
    came.now_s += silent_s - 0.1
    assert counts.state() is State.STREAMING
    came.now_s += 0.2
    assert counts.state() is State.LOST


@pytest.mark.parametrize(("rate_hz", "patience_s"), [(130.0, 3.0), (1.0, 3.0), (0.2, 15.0)])
def test_a_stream_of_a_device_that_has_just_begun_is_starting(came: Came, rate_hz: float, patience_s: float) -> None:
    """Until its first sample, for as long as three of its samples may take and 3 s at least; then it is lost."""
    counts = StreamCounts(nominal_hz=rate_hz)
    came.now_s += 100.0  # the device is looked for
    counts.begin()
    came.now_s += patience_s - 0.1
    assert counts.state() is State.STARTING
    came.now_s += 0.2
    assert counts.state() is State.LOST
    counts.arrived(1)
    assert counts.state() is State.STREAMING


def test_a_slow_stream_of_a_device_that_is_back_is_starting(came: Came) -> None:
    """What came before the device was lost says nothing of its stream since; it has as long as at first."""
    counts = came.every(1.0, 4)
    came.now_s += 60.0
    counts.begin()
    assert counts.state() is State.STARTING
    came.now_s += 3.1
    assert counts.state() is State.LOST


def test_what_has_no_rate_is_never_silent(came: Came) -> None:
    """Reports and irregular samples may take as long as they like."""
    counts = StreamCounts(nominal_hz=0.0)
    came.now_s += 1000.0
    assert counts.state() is State.STREAMING
