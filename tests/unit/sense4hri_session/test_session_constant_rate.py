"""Streams at a constant rate: the signal between its samples, and nothing where none were."""

from types import SimpleNamespace

import numpy as np
import pytest
from sense4hri_session.blocks import Block
from sense4hri_session.constant_rate import ConstantRate, Span

SECOND = 1_000_000_000
RATE_HZ = 130.1


def stream(at_s, values, frame=13):
    """Something with samples (n,) at these times, in messages of so many."""
    time_ns = np.rint(np.asarray(at_s) * SECOND).astype(np.int64)
    blocks = [
        Block(time_ns[i : i + frame], None, 0, ("x",), np.asarray(values)[i : i + frame, None], 1, True)
        for i in range(0, len(time_ns), frame)
    ]
    return SimpleNamespace(channels=("x",), true_rate_hz=130.0, blocks=lambda: iter(blocks))


def resampled(source, rate_hz=130.0):
    grid = ConstantRate(source, 0, rate_hz, Span(-(1 << 62), 1 << 62))
    values = np.concatenate(list(grid.pieces()))[:, 0]
    return np.arange(len(values)) / rate_hz, values, grid


@pytest.mark.parametrize(("frequency_hz", "error"), [(1.0, 1e-6), (10.0, 1e-3), (20.0, 0.01), (30.0, 0.05)])
def test_a_sine_comes_through(frequency_hz, error):
    """Up to 30 Hz, in the QRS complex, nothing is lost; straight lines would lose a quarter there."""
    at = np.arange(20_000) / RATE_HZ
    grid, values, _ = resampled(stream(at, np.sin(2 * np.pi * frequency_hz * at)))
    inside = slice(20, -20)
    assert np.abs(values - np.sin(2 * np.pi * frequency_hz * grid))[inside].max() < error


def test_the_size_of_the_messages_does_not_matter():
    """Messages of 1, of 73 and of 20000 samples give the same."""
    at = np.arange(20_000) / RATE_HZ
    noise = np.random.default_rng(1).normal(size=len(at))
    one, *others = (resampled(stream(at, noise, frame))[1] for frame in (1, 73, 20_000))
    for other in others:
        np.testing.assert_allclose(one, other, atol=1e-6)


def test_a_gap_is_empty_and_bends_nothing():
    """Between the last sample before and the first after a gap there is NaN, and beside it the signal."""
    at = np.arange(20_000) / RATE_HZ
    at = at[(at < 40) | (at > 90.5)]
    grid, values, found = resampled(stream(at, np.sin(at)))
    hole = (grid > at[at < 60].max()) & (grid < at[at > 60].min())
    assert np.isnan(values[hole]).all()
    assert np.abs(values - np.sin(grid))[~hole].max() < 1e-4
    assert [(round(a, 2), round(b, 2)) for a, b in found.gaps] == [(39.99, 50.51)]


def test_numbers_beyond_any_unit_are_a_gap():
    """A damaged sample of 1e308, or an infinite one, is none on the grid; what is further away is as it was."""
    at = np.arange(20_000) / 130
    values = np.sin(at)
    values[10_000:10_003] = 1e308, -1e308, np.inf
    grid, found, told = resampled(stream(at, values))
    assert np.isnan(found[10_000:10_003]).all()
    assert np.abs(found - np.sin(grid))[np.abs(grid - at[10_000]) > 1].max() < 1e-6
    assert [(round(a, 3), name) for a, _, name in told.absent] == [
        (pytest.approx(at[9_999], abs=1e-3), "x")
    ]  # from the last value on


def test_samples_that_a_new_clock_puts_close_together_do_not_swing():
    """Where a clock was set, two samples lie 1 us apart: the curve stays between its samples."""
    at = np.arange(2000) / RATE_HZ
    at[1000:] -= 1 / RATE_HZ - 1e-6
    values = np.where(np.arange(2000) < 1000, 0.0, 1.0)
    _, found, _ = resampled(stream(at, values))
    assert found.min() >= -1e-9
    assert found.max() <= 1 + 1e-9


def test_a_missing_value_is_missing_alone():
    """A NaN among the samples empties the points beside it and no others."""
    at = np.arange(2000) / RATE_HZ
    values = np.sin(at)
    values[1000] = np.nan
    grid, found, _ = resampled(stream(at, values))
    assert np.abs(grid[np.isnan(found)] - at[1000]).max() <= 1 / RATE_HZ
    assert np.isnan(found).sum() in (1, 2)


def test_a_clock_that_was_set_back_is_counted():
    """Samples at times that were there already are left out and counted."""
    at = np.arange(2000) / RATE_HZ
    at[1000:] -= 3.0
    _, values, found = resampled(stream(at, np.sin(at)))
    assert found.backwards == round(3.0 * RATE_HZ)
    assert np.isfinite(values).all()
