"""Breathing from an accelerometer at the chest: gravity tilts with every breath."""

import numpy as np
import pytest
from breathing_signals import chest
from interpreter_respiration.config import Config
from interpreter_respiration.stream import RespirationStream
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import event_times_s
from slow_signals import play as play_signal

FS_HZ, SECONDS = 50.0, 90
TIMES_S = np.arange(round(SECONDS * FS_HZ))[:, None] / FS_HZ
STEPS = 3.0 * np.abs(np.sin(np.pi * 1.9 * TIMES_S)) * (0.2, 0.3, 1.0)


def play(samples, fs_hz=FS_HZ, unit="m/s^2", **options):
    """Updates of an acceleration."""
    make = lambda info: RespirationStream(Config(), info)  # noqa: E731
    return play_signal(make, samples, fs_hz, "accelerometer", unit, names=("x", "y", "z"), **options)


def rates(updates):
    return np.array([update.breaths_per_min for update in updates])


@pytest.mark.parametrize(("per_min", "fs_hz"), [(8.0, 25.0), (15.0, 50.0), (25.0, 200.0)])
def test_rate_and_height_are_those_of_the_breaths(per_min, fs_hz):
    """A tilt of 1 degree: rate within 2 %, one time per breath, height of the swing; in and out stay unknown."""
    updates = play(chest(SECONDS, fs_hz, per_min), fs_hz)
    last = updates[-1]
    assert last.breaths_per_min == pytest.approx(per_min, rel=0.02)
    np.testing.assert_allclose(np.diff(event_times_s(updates, "breath_timestamps")), 60 / per_min, atol=0.8)
    assert last.amplitude == pytest.approx(2 * 9.81 * np.radians(1.0), rel=0.25)
    assert np.isnan(last.inhale_exhale_ratio)
    assert any("inhale_exhale_ratio" in reason for reason in last.reasons)
    assert last.signal_quality > 0.6


def test_the_position_does_not_matter():
    """Axes swapped and mirrored give the same rate."""
    turned = play(chest(SECONDS, FS_HZ)[:, [2, 0, 1]] * (-1, 1, -1))
    assert turned[-1].breaths_per_min == pytest.approx(15.0, rel=0.02)


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (chest(SECONDS, FS_HZ, tilt_deg=0.0), "nothing but noise"),
        (np.tile((0.0, 0.0, 9.81), (4500, 1)), "nothing but noise"),
        (chest(SECONDS, FS_HZ) - (5.0, 5.0, 8.0), "gravity"),
        (np.full((4500, 3), np.nan), "no number"),
    ],
    ids=["table", "constant", "no gravity", "nan"],
)
def test_what_is_no_chest_is_told(samples, word):
    """On a table, without gravity or a number: no rate, and the reason."""
    updates = play(samples)
    assert np.isnan(rates(updates)).all()
    assert updates[-1].signal_quality < 0.25
    assert any(word in reason for update in updates[20:] for reason in update.reasons), updates[-1].reasons


def test_walking_is_no_breathing():
    """Steps of 3 m/s^2 over a breath: no rate, or the right one."""
    told = rates(play(chest(SECONDS, FS_HZ) + STEPS))
    assert (np.abs(told[np.isfinite(told)] - 15.0) < 1).all()


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One chest, with missing samples, in frames of one, of 7 and of random sizes gives the same updates."""
    samples = chest(60, 25.0)
    samples[700:760] = np.nan
    sizes = ([1] * 1500, [7] * 220, np.random.default_rng(2).integers(1, 40, 200).tolist())
    texts = [repr([update._replace(received_ns=0) for update in play(samples, 25.0, sizes=cut)]) for cut in sizes]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 1000


@pytest.mark.parametrize(
    ("names", "parameters", "message"),
    [
        (("x", "y", "z"), {"body_location": "wrist"}, "body_location is 'wrist': breathing is felt at chest"),
        (("x", "z"), {}, "channels are x, z; breathing needs y too"),
    ],
)
def test_what_cannot_feel_a_breath_is_refused(names, parameters, message):
    """A wrist, and a device with two axes, are named."""
    info = StreamInfo(StreamName("p1", "accelerometer", "s1"), 50.0, "m/s^2", names, parameters=parameters)
    with pytest.raises(ValueError, match=message):
        RespirationStream(Config(), info)
