"""The line below the packets."""

import numpy as np
import pytest
from clock_sync import links
from clock_sync.envelope import Envelope
from clock_sync.line import fit, half_gap, lower_hull
from hypothesis import given
from hypothesis import strategies as st

values = st.floats(-1e3, 1e3, allow_nan=False).map(lambda x: round(x, 3))


@given(st.lists(values, min_size=1, max_size=60))
def test_no_point_lies_below_the_hull(heights):
    """The hull begins and ends with the points, is convex, and lies below them all."""
    points = [(float(i), y) for i, y in enumerate(heights)]
    x, y = lower_hull(points)
    assert (x[0], x[-1]) == (0.0, float(len(points) - 1))
    assert np.all(np.interp(np.arange(len(points)), x, y) <= np.array(heights) + 1e-6)
    assert np.all(np.diff(np.diff(y) / np.diff(x)) >= -1e-6)


def test_exponential_delays_are_fitted_without_bias():
    """Over many draws the line's mean error is a small part of the mean delay, and its spread is the one it claims."""
    random = np.random.default_rng(2)
    tau = np.arange(0.0, 100.0, 2.0)
    errors, claimed = [], []
    for _ in range(200):
        line = fit([*zip(tau, 1.0 + 30e-6 * tau + random.exponential(0.01, len(tau)), strict=True)], 0.0, 60e-6, 0.1)
        errors.append(line.at(100.0) - 1.003)
        claimed.append(line.sigma_s(100.0))
    assert abs(np.mean(errors)) < 2e-4
    assert np.std(errors) == pytest.approx(np.mean(claimed), rel=0.4)


def test_a_packet_below_the_line_moves_it_down_at_once():
    """No packet arrives before it was sent: the line never stays above one."""
    random, envelope = np.random.default_rng(3), Envelope()
    for i in range(2000):
        tau = i * 0.1
        y = 0.5 + float(random.exponential(0.02))
        envelope.add(tau, y)
        assert envelope.line is not None
        assert envelope.line.at(tau) <= y + 1e-12


def test_half_the_gap_under_the_smallest_delays():
    """Delays 1 ms apart leave half a millisecond, random ones on average as much as lies under the smallest of them."""
    random = np.random.default_rng(4)
    assert half_gap(0.020 + 0.001 * random.integers(0, 30, 500)) == pytest.approx(0.0005)
    drawn = random.exponential(0.01, (300, 400))
    assert np.mean([half_gap(delays) for delays in drawn]) == pytest.approx(np.mean(drawn.min(axis=1)), rel=0.2)
    assert half_gap(np.full(100, 0.02)) == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_packets_in_step_with_the_polling_keep_half_the_gap_below_them(seed):
    """47 ms against 30 ms meet only delays 1 ms apart: the line lies half a millisecond under the earliest packets."""
    link, envelope = links.simulate("eeg", 7100 + seed, 120.0), Envelope()
    offset = link.received_ns[0] - link.device_ns[0]
    for device, y in zip(link.device_ns, (link.received_ns - link.device_ns - offset) * 1e-9, strict=True):
        envelope.add((device - link.device_ns[0]) * 1e-9, float(y))
    line, tau = envelope.line, (link.device_ns - link.device_ns[0]) * 1e-9
    assert line is not None
    below = (link.received_ns - link.device_ns - offset) * 1e-9 - line.at(tau)
    assert below[tau > 100].min() == pytest.approx(0.0005, abs=0.0001)


def test_a_copy_is_independent():
    """What is fed to a copy does not reach the original, now or later."""

    def feed(envelope, begin, end):
        for i in range(begin, end):
            envelope.add(i * 0.5, 0.01 * (i % 7))

    envelope, undisturbed = Envelope(), Envelope()
    feed(envelope, 0, 500)
    before, twin = envelope.line, envelope.copy()
    for i in range(500, 800):
        twin.add(i * 0.5, -0.5 - 0.003 * (i % 5))
    assert envelope.line == before
    assert twin.line != before
    feed(envelope, 500, 800)
    feed(undisturbed, 0, 800)
    assert envelope.line == undisturbed.line


@pytest.mark.parametrize("pause_s", [60.0, 1300.0, 4000.0])
def test_a_pause_of_any_length_ends_nothing(pause_s):
    """A sensor that was away, or a stranger's stamps: what the windows hold may all be older than they reach back."""
    envelope = Envelope()
    for second in np.arange(0.0, 62.5, 2.5):
        envelope.add(second, 0.02)
    for second in np.arange(62.5, 125.0, 2.5):
        envelope.add(pause_s + second, 0.021)
    assert envelope.line.at(pause_s + 125.0) == pytest.approx(0.021, abs=0.005)
