"""sense4hri.hum: mains is taken away to a hundredth, and nothing else is."""

import numpy as np
import pytest
from sense4hri.hum import folded_hz, hum, offset_hz


@pytest.mark.parametrize(
    ("hz", "fs_hz", "at_hz"), [(50, 250, 50), (50, 130, 50), (60, 100, 40), (50, 55, 5), (60, 55, 5)]
)
def test_where_sampling_puts_it(hz: float, fs_hz: float, at_hz: float) -> None:
    """Mains above half the rate is folded below it."""
    assert folded_hz(hz, fs_hz) == pytest.approx(at_hz)


@pytest.mark.parametrize("hz", [49.85, 50.0, 60.1])
def test_hum_is_fitted(hz: float) -> None:
    """A line near the mains, drifting, in the middle of three seconds of noise ten times smaller."""
    time_s = np.arange(750) / 250
    line = (500 + 20 * time_s) * np.sin(2 * np.pi * hz * time_s + 1)
    found = hum(line + np.random.default_rng(1).normal(0, 50, 750), 250.0)
    assert np.abs(found - line)[125:625].max() < 25


def test_one_of_two_mains() -> None:
    """Only the line asked for is fitted, and how far it is from its frequency is told to 0.02 Hz."""
    time_s = np.arange(750) / 250
    wanted, other = np.sin(2 * np.pi * 59.8 * time_s), np.sin(2 * np.pi * 50.1 * time_s)
    line = hum(wanted + other, 250.0, mains=(60.0,))
    assert np.abs(line - wanted)[125:625].max() < 0.05
    assert offset_hz(line, 60.0, 250.0) == pytest.approx(-0.2, abs=0.02)


def test_nothing_else_is_taken() -> None:
    """Noise, a line that is not the mains, and too few values have no hum."""
    time_s = np.arange(750) / 250
    assert not hum(np.random.default_rng(2).normal(0, 50, 750), 250.0).any()
    assert not hum(np.sin(2 * np.pi * 44 * time_s), 250.0).any()
    assert not hum(np.sin(2 * np.pi * 50 * time_s[:200]), 250.0).any()


def test_channels_are_fitted_each_for_itself() -> None:
    """Of channels with different hum, and one without, each loses what it loses alone."""
    time_s = np.arange(750) / 250
    values = np.random.default_rng(3).normal(0, 5, (750, 3))
    values[:, 0] += 200 * np.sin(2 * np.pi * 50.1 * time_s)
    values[:, 2] += 80 * np.sin(2 * np.pi * 59.9 * time_s + 1)
    found = hum(values, 250.0)
    for column in range(3):
        np.testing.assert_allclose(found[:, column], hum(values[:, column].copy(), 250.0), atol=1e-9)
    assert not found[:, 1].any()
    assert np.ptp(found[:, 0]) > 390
