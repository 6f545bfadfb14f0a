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
    found = lines_at(hum_uv + np.where(time_s > 1, 20 * noise, noise), 256.0, [60, 76])
    assert np.sqrt(np.mean((found - hum_uv)[64:256] ** 2)) < 0.05 * np.sqrt(np.mean(hum_uv**2))


def test_nothing_else_is_taken() -> None:
    """Noise, and too few values, have no lines; without lines nothing is taken."""
    noise = np.random.default_rng(3).normal(0, 1, 512)
    assert lines_seen(noise, 256.0, 4.0) == []
    assert lines_seen(np.sin(2 * np.pi * 60 * np.arange(200) / 256), 256.0, 4.0) == []
    assert not lines_at(noise, 256.0, []).any()
