"""What spoils a belt, an accelerometer at the chest or an ECG lowers the quality of the breathing seen in it."""

from functools import cache, partial

import numpy as np
import pytest
from breathing_signals import belt, chest, ecg
from interpreter_respiration.config import Config
from interpreter_respiration.heart import HeartStream
from interpreter_respiration.stream import RespirationStream
from quality_ladder import assert_falls, played_once
from slow_signals import play

AXES = ("x", "y", "z")
BELT = played_once(
    partial(play, lambda info: RespirationStream(Config(), info), sensor_type="respiration", unit="a.u.")
)
CHEST = played_once(
    partial(play, lambda info: RespirationStream(Config(), info), sensor_type="accelerometer", unit="m/s^2", names=AXES)
)
HEART = played_once(partial(play, lambda info: HeartStream(Config(), info), sensor_type="ecg", unit="uV"))
RESTING_HZ = 100.0


@cache
def resting(shared_data, name):
    """Five minutes of rest of one person, belt ("RSP") or ECG."""
    path = shared_data / "multimodal" / "neurokit" / "bio_resting_5min_100hz.csv"
    return np.genfromtxt(path, delimiter=",", names=True)[name]


def white(x):
    return np.random.default_rng(1).normal(size=x.shape)


def wave(hz, t_s):
    return np.sin(2 * np.pi * hz * t_s)


# breaths have a standard deviation of 1
BELT_LADDERS = {
    "noise": lambda x, t_s, k: x + 0.6 * k * white(x),
    "drift": lambda x, t_s, k: x + 1.2 * k * wave(1 / 45, t_s),
    "ramp": lambda x, t_s, k: x + 5 * k * t_s / 60,
    "mains": lambda x, t_s, k: x + 0.25 * k * wave(50.03, t_s),
    "clipping": lambda x, t_s, k: np.clip(x, -1.5 + 0.25 * k, 1.5 - 0.25 * k),
    "motion": lambda x, t_s, k: x + np.where(0.8 * k > t_s % 25, 14.0, 0.0),
    "loss": lambda x, t_s, k: np.where(2.5 * k > t_s % 30, np.nan, x),
    "speech": lambda x, t_s, k: x * (1 - 0.22 * k) + k / 2 / np.sqrt(len(x) / t_s[-1]) * np.cumsum(white(x)),
}


@pytest.mark.parametrize("kind", BELT_LADDERS)
def test_a_belt(kind):
    """Noise, drift up and down or one way, mains, clipping, motion, loss, irregular movement."""
    t_s = np.arange(round(120 * 25.0)) / 25.0
    clean = belt(t_s) * 1.4
    assert_falls(lambda k: BELT(BELT_LADDERS[kind](clean, t_s, k), 25.0)[20:])


@pytest.mark.parametrize("fs_hz", [10.0, 17.86, 25.0, 100.0])
@pytest.mark.parametrize("mains_hz", [50.03, 59.97])
def test_mains_at_whatever_they_are_folded_to(mains_hz, fs_hz):
    """Drift, waves that are faster than breaths, or as they are: the rates of belts fold mains to any of these."""
    t_s = np.arange(round(120 * fs_hz)) / fs_hz
    assert_falls(lambda k: BELT(belt(t_s) + 0.2 * k * wave(mains_hz, t_s), fs_hz)[20:])


@pytest.mark.parametrize("kind", BELT_LADDERS)
def test_a_belt_at_rest(kind, shared_data):
    """The same on a recording."""
    clean = resting(shared_data, "RSP")
    clean, t_s = (clean - clean.mean()) / clean.std(), np.arange(len(clean)) / RESTING_HZ
    assert_falls(lambda k: BELT(BELT_LADDERS[kind](clean, t_s, k), RESTING_HZ)[20:], least=0.75)


DIRECTION = (0.5, 0.6, 0.6)
CHEST_LADDERS = {
    "noise": lambda x, t_s, k: x + 0.04 * k * white(x),
    "drift": lambda x, t_s, k: x + 0.12 * k * wave(1 / 45, t_s) * DIRECTION,
    "mains": lambda x, t_s, k: x + 0.04 * k * wave(59.97, t_s) * DIRECTION,
    "motion": lambda x, t_s, k: x + np.where(0.3 * k > t_s % 20, 3 * np.abs(wave(0.95, t_s)), 0) * (0.2, 0.3, 1.0),
    "loss": lambda x, t_s, k: np.where(2.5 * k > t_s % 30, np.nan, x),
}


@pytest.mark.parametrize("kind", CHEST_LADDERS)
def test_an_accelerometer_at_the_chest(kind):
    """Noise, drift, mains that an analog one picks up, steps, loss."""
    clean, t_s = chest(90, 50.0), (np.arange(90 * 50) / 50.0)[:, None]
    assert_falls(lambda k: CHEST(CHEST_LADDERS[kind](clean, t_s, k), 50.0)[20:])


# uV
HEART_LADDERS = {
    "noise": lambda x, t_s, k: x + 25 * k * white(x),
    "drift": lambda x, t_s, k: x + 120 * k * np.sqrt(t_s[1]) * np.cumsum(white(x)),
    "mains": lambda x, t_s, k: x + 50 * k * wave(50.03, t_s),
    "motion": lambda x, t_s, k: x + np.where(3 * k > t_s % 20, 400 * wave(1.9, t_s), 0.0),
    "loss": lambda x, t_s, k: np.where(0.02 * k > (t_s + 0.5) % 2, np.nan, x),
}


@pytest.mark.parametrize("kind", HEART_LADDERS)
def test_an_ecg(kind):
    """Noise, drift, mains, steps, loss."""
    clean, t_s = ecg(90, 130.0), np.arange(90 * 130) / 130.0
    assert_falls(lambda k: HEART(HEART_LADDERS[kind](clean, t_s, k), 130.0)[45:])


@pytest.mark.parametrize("kind", HEART_LADDERS)
def test_an_ecg_at_rest(kind, shared_data):
    """The same on the first minutes of a recording."""
    clean = 1000 * resting(shared_data, "ECG")[:15_000]
    t_s = np.arange(len(clean)) / RESTING_HZ
    assert_falls(lambda k: HEART(HEART_LADDERS[kind](clean, t_s, k), RESTING_HZ)[45:], least=0.6)
