"""sense4hri.harmonics: the mains under a muscle."""

import numpy as np
import pytest
from sense4hri.harmonics import lines_at, lines_seen


def test_harmonics_are_found_where_sampling_puts_them_and_taken_under_a_burst() -> None:
    """60 Hz and its third harmonic at 256 Hz beside noise, 20 times as loud in the second half: to 5 % in the first."""
    time_s = np.arange(512) / 256
    hum_uv = 50 * np.sin(2 * np.pi * 60.05 * time_s) + 20 * np.sin(2 * np.pi * 180.15 * time_s + 1)
    noise = np.random.default_rng(3).normal(0, 1, 512)
    assert lines_seen(hum_uv + noise, 256.0, 4.0) == pytest.approx([60, 76])
    found = lines_at((hum_uv + np.where(time_s > 1, 20 * noise, noise))[:, None], 256.0, [60, 76])[:, 0]
    assert np.sqrt(np.mean((found - hum_uv)[64:256] ** 2)) < 0.05 * np.sqrt(np.mean(hum_uv**2))


def test_nothing_else_is_taken() -> None:
    """Noise, and too few values, have no lines; without lines nothing is taken."""
    noise = np.random.default_rng(3).normal(0, 1, 512)
    assert lines_seen(noise, 256.0, 4.0) == []
    assert lines_seen(np.sin(2 * np.pi * 60 * np.arange(200) / 256), 256.0, 4.0) == []
    assert not lines_at(noise[:, None], 256.0, []).any()


def test_channels_with_the_same_mains_are_fitted_together() -> None:
    """Eight channels with the line at strengths and phases of their own, one without: each to 1 uV."""
    time_s = np.arange(2000) / 1000
    strengths_uv = np.array([0, 5, 10, 20, 40, 80, 160, 320])
    hum_uv = strengths_uv * np.sin(2 * np.pi * 49.9 * time_s[:, None] + np.arange(8))
    values = hum_uv + np.random.default_rng(3).normal(0, 10, hum_uv.shape)
    off = (lines_at(values, 1000.0, [50.0]) - hum_uv)[200:-200]
    assert np.sqrt(np.mean(off**2, axis=0)).max() < 1.0
