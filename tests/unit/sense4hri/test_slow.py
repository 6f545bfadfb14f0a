"""The even grid of slow signals."""

import numpy as np
import pytest
from sense4hri.slow import Slow, newest_run, smoothed


def gridded(values, fs_hz, cut=None, bridged_s=1.0):
    """All points of one column, given in parts of `cut` samples."""
    slow, times_ns = Slow(1, bridged_s), np.round(np.arange(len(values)) / fs_hz * 1e9).astype(np.int64) + 10**18
    columns = np.asarray(values, float)[:, None]
    cut = cut or len(values)
    parts = [slow.push(columns[i : i + cut], times_ns[i : i + cut]) for i in range(0, len(values), cut)]
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


@pytest.mark.parametrize("fs_hz", [2.0, 4.0, 13.3, 100.0, 1000.0])
def test_a_ramp_stays_where_it_is_at_any_rate(fs_hz):
    """Points are 0.1 s apart and lie on the line of the samples."""
    values, times_ns, _ = gridded(np.arange(round(20 * fs_hz)) / fs_hz, fs_hz)
    assert (np.diff(times_ns) == 10**8).all()
    assert len(times_ns) >= 190
    inside = slice(round(10 / fs_hz) + 1, None)
    np.testing.assert_allclose(values[inside, 0], ((times_ns - 10**18) / 1e9)[inside], atol=0.5 / fs_hz + 1e-6)


@pytest.mark.parametrize("mains_hz", [50.0, 60.0])
def test_the_mains_are_gone(mains_hz):
    """A hum of 1 leaves less than a hundredth; the spread tells of it."""
    hum = np.sin(2 * np.pi * mains_hz * np.arange(10_000) / 1000)
    values, _, spread = gridded(hum, 1000.0)
    assert np.abs(values).max() < 0.01
    np.testing.assert_allclose(spread, np.sqrt(0.5), rtol=0.02)


@pytest.mark.parametrize("cut", [1, 7, 33])
def test_the_cut_does_not_matter(cut):
    """Samples one by one, or in parts of any size, with missing ones among them, give the same points."""
    values = np.random.default_rng(1).normal(size=600)
    values[100:140] = np.nan
    for one, whole in zip(gridded(values, 30.0, cut), gridded(values, 30.0), strict=True):
        np.testing.assert_array_equal(one, whole[: len(one)])
        assert 0 <= len(whole) - len(one) <= 1


def test_a_long_hole_is_missing_and_a_short_one_is_drawn_through():
    """Half a second without a number becomes a line, 3 s become NaN, and what is after it is found by newest_run."""
    values = np.arange(200.0)
    values[50:55], values[100:130] = np.nan, np.nan
    points = gridded(values, 10.0)[0][:, 0]
    np.testing.assert_allclose(points[50:55], np.arange(50, 55) + 0.5)
    assert np.isnan(points[102:128]).all()
    assert 128 <= newest_run(points) <= 131
    assert np.isfinite(points[newest_run(points) :]).all()


def test_smoothing_is_not_late():
    """A symmetric bump stays at its place, a constant what it is."""
    bump = np.exp(-0.5 * ((np.arange(200) - 90) / 8) ** 2)
    assert smoothed(bump, 0.5).argmax() == 90
    np.testing.assert_allclose(smoothed(np.full(50, 3.0), 0.5), 3.0)


def test_nothing_gives_nothing():
    """No samples, and samples that are no numbers, give no points."""
    slow = Slow(2, 1.0)
    assert slow.push(np.empty((0, 2)), np.empty(0, np.int64)).values.shape == (0, 2)
    points = slow.push(np.full((5, 2), np.nan), np.arange(5) * 10**8)
    assert [len(column) for column in points] == [0, 0, 0]
