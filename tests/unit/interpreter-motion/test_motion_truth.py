"""Wearers who walk a known number of steps, stand and lie, and recordings of wrists that do not walk."""

import numpy as np
import pytest
from interpreter_motion.config import Config
from interpreter_motion.stream import MotionStream
from slow_signals import play as play_signal
from walking import GRAVITY, acceleration

XYZ = ("x", "y", "z")
CHEST = {"body_location": "chest"}


def play(samples, fs_hz, unit="m/s^2", config=None, parameters=CHEST, **options):
    """Updates of an accelerometer."""
    make = lambda info: MotionStream(config or Config(), info)  # noqa: E731
    return play_signal(make, samples, fs_hz, "accelerometer", unit, XYZ, parameters=parameters, **options)


def steps(update):
    """The steps so far."""
    return update.extra[0].values[0]


@pytest.mark.parametrize(
    ("fs_hz", "per_min"),
    [
        (10.0, 180),
        (12.5, 80),
        (16.0, 200),
        (25.0, 170),
        (52.0, 80),
        (52.0, 110),
        (200.0, 170),
        (1000.0, 110),
        (25.0, 230),
        (50.0, 240),
    ],
)
def test_steps_of_known_number(fs_hz, per_min):
    """At any rate and pace, 30 s and 20 s of walking: steps to 3 %, or two; their rate to 3 %; none before."""
    updates = play(acceleration(65, fs_hz, [(5, 35, per_min), (40, 60, per_min)]), fs_hz)
    assert steps(updates[-1]) == pytest.approx(50 * per_min / 60, abs=max(2, 0.03 * 50 * per_min / 60))
    assert updates[30].step_rate_per_min == pytest.approx(per_min, rel=0.03)
    assert updates[4].step_rate_per_min == 0


def test_intensity_is_the_acceleration_without_gravity():
    """Standing: the noise alone; a sine of 3 m/s^2 along one axis: 2.12."""
    times_s = np.arange(1500) / 50
    still = acceleration(30, 50.0, noise=0.1)
    assert play(still, 50.0)[-1].intensity_m_per_s2 == pytest.approx(0.1 * np.sqrt(3), rel=0.1)
    still[:, 0] += 3 * np.sin(2 * np.pi * times_s)
    assert play(still, 50.0)[-1].intensity_m_per_s2 == pytest.approx(3 / np.sqrt(2), rel=0.02)


def test_posture_is_learned_from_a_walk():
    """However the sensor is worn: unknown before the first walk, then told by the tilt from it."""
    up, flat, between = (0.3, -0.9, 0.2), (0.9, 0.3, 0.0), (1.0, -0.5, 0.2)
    parts = [acceleration(10, 50.0, up=up), acceleration(18, 50.0, [(0, 18, 100)], up=up)]
    parts += [acceleration(6, 50.0, up=direction) for direction in (flat, between, up)]
    updates = play(np.concatenate(parts), 50.0)
    assert [updates[i].posture for i in (8, 26, 32, 38, 44)] == ["unknown", "upright", "lying", "leaning", "upright"]
    assert any("learned while the wearer walks" in reason for reason in updates[8].reasons)
    assert any("upright was learned 5 s ago" in reason for reason in updates[32].reasons), updates[32].reasons
    assert updates[32].extra[1].values[0] == pytest.approx(90, abs=5)


def test_a_short_rhythm_teaches_no_posture():
    """Sixteen steps, or shakes, of a wearer who lies do not make lying upright."""
    updates = play(acceleration(30, 50.0, [(5, 13, 120)], up=(0, 0, 1)), 50.0)
    assert steps(updates[-1]) == pytest.approx(16, abs=2)
    assert {update.posture for update in updates} == {"unknown"}


def test_posture_by_a_parameter_and_of_the_trunk_only():
    """With `upright_axis` nobody has to walk; of a wrist nothing is told."""
    lying = acceleration(8, 50.0, up=(0, 0, 1))
    assert play(lying, 50.0, config=Config(upright_axis="-y"))[-1].posture == "lying"
    wrist = play(lying, 50.0, config=Config(upright_axis="-y"), parameters={"body_location": "left wrist"})[-1]
    assert wrist.posture == "unknown"
    assert any("left wrist" in reason for reason in wrist.reasons)


def test_a_wrist_at_rest_has_no_steps(shared_data):
    """Eight minutes of a Verity Sense at rest, five of an E4 at work: not one step; the rest moves less than 0.1."""
    path = shared_data / "polar" / "verity_sense" / "Polar_Sense_ACC.txt"
    verity = np.loadtxt(path, delimiter=";", skiprows=1, usecols=(2, 3, 4)) * GRAVITY / 1000
    resting = play(verity, 52.0, parameters={"body_location": "forearm"})
    assert steps(resting[-1]) == 0
    assert np.median([update.intensity_m_per_s2 for update in resting]) < 0.1
    assert np.median([update.signal_quality for update in resting]) > 0.9
    wristband = np.loadtxt(shared_data / "e4" / "flirt" / "ACC.csv", delimiter=",", skiprows=2) * GRAVITY / 64
    assert steps(play(wristband, 32.0)[-1]) == 0


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One walk, with missing samples, in frames of one, of 36 and of random sizes gives the same updates."""
    samples = acceleration(30, 25.0, [(3, 28, 100)])
    samples[300:330] = np.nan
    sizes = ([1] * 750, [36] * 21, np.random.default_rng(2).integers(1, 60, 200).tolist())
    texts = [repr([update._replace(received_ns=0) for update in play(samples, 25.0, sizes=cut)]) for cut in sizes]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 1000


@pytest.mark.parametrize("per_min", [26.0, 30.0, 36.0, 42.0])
@pytest.mark.parametrize("fs_hz", [25.0, 52.0, 200.0])
def test_steps_too_slow_to_be_told_are_not_called_none(fs_hz, per_min):
    """Who walks so slowly, or rocks, has no rate and a reason; who walks as usual has never that reason."""
    slow = play(acceleration(60, fs_hz, [(5, 55, per_min)]), fs_hz)[20:50]
    assert all(np.isnan(update.step_rate_per_min) for update in slow)
    assert all(any("a rhythm slower than 46 a minute" in reason for reason in update.reasons) for update in slow)
    usual = play(acceleration(40, fs_hz, [(10, 30, 110)]), fs_hz)
    assert not any("a rhythm slower" in reason for update in usual for reason in update.reasons)
