"""Noise whose level wanders, without an eye, and eyes whose level wanders, too."""

import numpy as np
import pytest
from eog_signals import eyes
from interpreter_eog.config import Config
from interpreter_eog.stream import EogStream
from slow_signals import event_times_s
from slow_signals import play as play_signal

SECONDS, GOOD = 120, 0.7
FEW_S = np.array([20.0, 80.0])


def play(samples, fs_hz=100.0, names=("veog",), **options):
    """Updates of potentials."""
    return play_signal(lambda info: EogStream(Config(), info), samples, fs_hz, "eog", "uV", names=names, **options)


def noise(exponent, fs_hz, spread_uv, columns=1):
    """Two minutes with a power of 1/f to this exponent; 2: a random walk."""
    n = round(SECONDS * fs_hz)
    hz = np.fft.rfftfreq(n, 1 / fs_hz)[:, None]
    spectrum = np.fft.rfft(np.random.default_rng(31).normal(size=(n, columns)), axis=0)
    out = np.fft.irfft(spectrum * np.where(hz > 0, np.maximum(hz, hz[1]) ** (-exponent / 2), 0.0), n, axis=0)
    return spread_uv * out / out.std(axis=0)


def doubted(updates):
    return [any("veog wanders" in reason for reason in update.reasons) for update in updates]


FAST = pytest.mark.slow(reason="each kind of noise and both pairs of electrodes are among those at 100 Hz")


@pytest.mark.parametrize("names", [("veog",), ("heog", "veog")])
@pytest.mark.parametrize("fs_hz", [100.0, *(pytest.param(fs_hz, marks=FAST) for fs_hz in (250.0, 500.0))])
@pytest.mark.parametrize(("exponent", "spread_uv"), [(1.0, 40.0), (1.5, 70.0), (2.0, 200.0)])
def test_no_blink_of_noise_is_a_good_one(exponent, spread_uv, fs_hz, names):
    """Pink, brown and between, as large as an EOG: the reason, and a quality below 0.7 wherever blinks are counted."""
    updates = play(noise(exponent, fs_hz, spread_uv, len(names)), fs_hz, names)
    counted = [update for update in updates if update.blink_count > 0]
    assert len(event_times_s(updates, "blink_timestamps")) >= 5
    assert max(update.signal_quality for update in counted) < GOOD
    assert all(doubted(counted))


def test_noise_that_comes_and_goes_is_still_noise():
    """Brown noise between a tenth and twice its size every 17 s: from 40 s on four of five counts are doubted."""
    swell = 1 + 0.9 * np.sin(2 * np.pi * np.arange(SECONDS * 100) / 1700.0)
    updates = play(noise(2.0, 100.0, 200.0) * swell[:, None])[40:]
    assert sum(update.blink_count > 0 for update in updates) > 40
    assert np.mean(doubted([update for update in updates if update.blink_count > 0])) >= 0.8


@pytest.mark.parametrize(("last", "share"), [(1.0, 0.0), (10.0, 0.1)])
@pytest.mark.parametrize("names", [("veog",), ("heog", "veog")])
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow(reason="another draw of seed 0")) for seed in (1, 2, 3))]
)
def test_noise_without_a_blink_is_no_eye_either(seed, names, last, share):
    """Brown noise, as strong throughout or ten times as strong at the end: hardly good from half a minute on."""
    steps = np.random.default_rng(seed).normal(size=(SECONDS * 100, len(names)))
    walk = np.cumsum(steps * np.linspace(1, last, len(steps))[:, None], axis=0)
    updates = play(150 * walk / walk.std(axis=0), 100.0, names)[30:]
    assert np.mean([update.signal_quality >= GOOD for update in updates]) <= share


@pytest.mark.parametrize("noise_uv", [1.0, 3.0, 10.0])
def test_still_eyes_are_not_doubted(noise_uv):
    """Two minutes without a blink or a look up or down, on a drift of 60 uV a minute, have not wandered."""
    assert not any(
        doubted(play(eyes(SECONDS, 100.0, horizontal=[(at_s, 100.0) for at_s in (5, 50)], noise_uv=noise_uv)[:, 1]))
    )


@pytest.mark.parametrize("spread_uv", [25.0, 50.0])
def test_few_blinks_on_a_level_that_wanders_are_good(spread_uv):
    """One blink a minute on a random walk and a drift of 300 uV a minute: both are told, and nothing is doubted."""
    clean = eyes(SECONDS, 100.0, FEW_S, drift_uv_per_min=300.0)[:, 1:]
    updates = play(clean + noise(2.0, 100.0, spread_uv))
    np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), FEW_S, atol=0.05)
    assert not any(doubted(updates))
    assert min(update.signal_quality for update in updates[5:]) > GOOD


def test_lids_that_never_rest_go_one_way():
    """A blink a second: good from the ninth on, before that in doubt at most."""
    updates = play(eyes(60, 100.0, np.arange(1.5, 59.0))[:, 1])
    assert not any(doubted(updates[11:]))
    assert min(update.signal_quality for update in updates[11:]) > GOOD


def test_still_eyes_after_a_hole_are_not_doubted_for_it():
    """Blinks, 0.3 s without a number, then none for 20 s: what was before the hole is seen as well."""
    samples = eyes(40, 100.0, np.arange(2.0, 18.0, 4.0))[:, 1]
    samples[1900:1930] = np.nan
    assert not any(doubted(play(samples)))
