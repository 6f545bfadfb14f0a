"""sense4hri.living: what is no signal is found, however the samples are cut."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sense4hri.living import Living, frozen

FS_HZ = 100.0
TIMES_NS = np.arange(400) * 10_000_000
WAVE = np.sin(np.arange(400.0))


def alive(values, sizes=(400,)):
    """Which samples are signal, shape (n,), after what was undone; and the values of those."""
    living, kept, i, k = Living(), np.zeros(len(values), bool), 0, 0
    given_values = np.full(len(values), np.nan)
    while i < len(values):
        n = min(sizes[k % len(sizes)], len(values) - i)
        k += 1
        for stretch in living.split(values[i : i + n], TIMES_NS[i : i + n]):
            kept[i - stretch.undone : i] = False
            kept[i : i + len(stretch.values)] = stretch.alive
            given_values[i : i + len(stretch.values)] = stretch.values
            i += len(stretch.values)
    return kept, given_values


@settings(max_examples=30)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=7))
def test_what_does_not_vary_is_no_signal(sizes: list[int]) -> None:
    """NaN, a held value and a rail of more than 0.2 s are none from their first sample to their last."""
    values = WAVE.copy()
    values[50:80], values[150:180], values[250:271] = np.nan, 8000.0, values[249]
    kept, _ = alive(values, sizes)
    assert np.array_equal(np.flatnonzero(~kept), [*range(49, 80), *range(150, 180), *range(249, 271)])


def test_short_holes_are_filled() -> None:
    """Up to 0.2 s the last value stands in; a stream that begins with NaN begins at 0."""
    values = WAVE.copy()
    values[0], values[100:115] = np.nan, np.nan
    kept, filled = alive(values)
    assert kept.all()
    assert filled[0] == 0
    assert np.all(filled[100:115] == WAVE[99])


def test_missing_samples_end_a_run() -> None:
    """Equal values before and after missing samples are not one run."""
    living = Living()
    for at in range(0, 60, 15):
        assert [s.alive for s in living.split(np.full(15, 7.0), TIMES_NS[at : at + 15])] == [True]
        living.interrupted()


def test_what_is_frozen_is_told_from_rest():
    """A run of 30 equal values in noise is frozen, one of 10 is not, nor any of a coarse or mostly constant channel."""
    noise = np.random.default_rng(1).normal(size=(200, 2))
    noise[50:80], noise[120:130, 0] = noise[50], 1.0
    assert np.flatnonzero(frozen(noise, 20)).tolist() == list(range(50, 80))
    assert not frozen(noise, 40).any()
    assert not frozen(np.round(noise), 20).any()
    assert not frozen(np.where(np.arange(200)[:, None] < 180, 1.0, noise), 20).any()


@pytest.mark.parametrize("cut", [slice(0, 195), slice(55, 200)], ids=["goes on", "cut off"])
def test_what_is_seen_of_a_run_at_an_end_is_no_resolution(cut):
    """A run of 30 of which 5 are seen yet, or still, takes nothing from what is known of the one of 40."""
    noise = np.random.default_rng(1).normal(size=(200, 1))
    noise[30:60], noise[90:130], noise[190:] = 1.0, 2.0, 3.0
    told = np.flatnonzero(frozen(noise[cut], 20)) + cut.start
    assert set(range(90, 130)) <= set(told.tolist()) <= {*range(30, 60), *range(90, 130)}
