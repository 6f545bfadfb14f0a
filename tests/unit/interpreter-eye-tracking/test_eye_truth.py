"""Recordings of trackers with events of their own, and simulated gaze that is known."""

import numpy as np
import pytest
from gaze import EYELINK_HZ, EYELINK_PX_PER_DEG, extra_of, eyelink, in_deg, looking, matched
from interpreter_eye_tracking.config import Config
from interpreter_eye_tracking.stream import EyeStream
from slow_signals import event_times_s, play

PLACES = np.random.default_rng(3).uniform([-15, -10], [15, 10], (40, 2))


def make(info):
    return EyeStream(Config(), info)


def of_screen(gaze, fs_hz, px_per_deg=None):
    """Updates of gaze in px."""
    known = {} if px_per_deg is None else {"eye_tracking.px_per_deg": px_per_deg}
    return play(make, gaze, fs_hz, "eye_tracking", "px", ("gaze_x", "gaze_y"), parameters=known)


@pytest.mark.parametrize("eye", ["L", "R"])
@pytest.mark.parametrize("px_per_deg", [None, EYELINK_PX_PER_DEG])
def test_the_events_of_an_eyelink(shared_data, eye, px_per_deg):
    """Saccades and fixations of the tracker itself, F1 0.9 and onsets within 6 ms in the middle, and every blink."""
    truth = eyelink(shared_data, eye)
    updates = of_screen(truth.gaze, EYELINK_HZ, px_per_deg)
    onsets_s = event_times_s(updates, "saccade_timestamps")
    for saccades in (truth.saccades, truth.saccades[~truth.lid]):
        f1, errors_s = matched(saccades[:, 0], onsets_s, 0.02)
        assert f1 > 0.92
        assert np.median(errors_s) <= 0.006
    f1, errors_s = matched(truth.fixations[:, 0], event_times_s(updates, "fixation_timestamps"), 0.02)
    assert f1 > 0.92
    assert np.median(errors_s) <= 0.006
    np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), truth.blinks[:, 0], atol=0.001)
    durations_s = [ms / 1000 for update in updates for ms in update.blink_durations_ms]
    np.testing.assert_allclose(durations_s, truth.blinks[:, 1] - truth.blinks[:, 0] + 0.002, atol=0.001)
    assert np.median([update.signal_quality for update in updates[1:]]) > 0.8
    assert np.isfinite(updates[-1].saccade_amplitude_deg) == (px_per_deg is not None)


def test_a_reading_recording_without_blinks(shared_data):
    """pymovements' toy at 1 kHz: saccades and rests follow each other as in reading, none is lost, nobody blinks."""
    path = shared_data / "eye" / "pymovements" / "trial_0_1.csv"
    table = np.genfromtxt(path, names=True)
    updates = of_screen(np.column_stack([table["x"], table["y"]]), 1000.0)
    last = updates[-1]
    assert last.blink_count == 0
    assert last.valid_ratio == 1.0
    assert abs(last.fixation_count - last.saccade_count) <= 2
    assert 2.5 < last.saccade_count / last.window_s < 6
    assert 150 < last.fixation_duration_ms < 350


@pytest.mark.parametrize("fs_hz", [30.0, 60.0, 250.0, 2000.0])
def test_jumps_between_known_places(fs_hz):
    """At any rate: each jump within two samples, its length within 5 % in the middle, each rest where it was."""
    gaze, onsets_s = looking(fs_hz, [*PLACES, *[PLACES[-1]] * 5], noise=0.05)
    updates = in_deg(gaze, fs_hz, make)
    found_s = event_times_s(updates, "saccade_timestamps")
    f1, errors_s = matched(onsets_s, found_s, max(0.02, 2 / fs_hz))
    assert f1 > 0.95
    assert np.median(errors_s) <= max(0.006, 0.5 / fs_hz)
    lengths = np.hypot(*np.diff(PLACES, axis=0).T)
    amplitudes = np.array([a for update in updates for a in update.saccade_amplitudes_deg])
    near = [np.abs(onsets_s - at_s).argmin() for at_s in found_s]
    assert np.median(np.abs(amplitudes / lengths[near] - 1)) < 0.05
    rests = PLACES[np.searchsorted(onsets_s, event_times_s(updates, "fixation_timestamps"))]
    where = [np.concatenate([extra_of(update, name) for update in updates]) for name in ("fixation_x", "fixation_y")]
    assert np.median(np.abs(np.array(where).T - rests)) < 0.1


def test_entropy_and_spread_of_four_corners():
    """Equal times in four places are 2 bits; their spread is the distance from the middle; staring is 0 bits."""
    corners = [(-8.0, -6.0), (8.0, -6.0), (8.0, 6.0), (-8.0, 6.0)] * 10
    last = in_deg(looking(120.0, corners)[0], 120.0, make)[-1]
    assert last.gaze_entropy_bits == pytest.approx(2.0, abs=0.01)
    assert last.gaze_dispersion_deg == pytest.approx(10.0, abs=0.3)
    two = [(0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.3, 0.0)] * 10
    assert in_deg(looking(120.0, two, noise=0.01)[0], 120.0, make)[-1].gaze_entropy_bits == pytest.approx(0.0, abs=0.01)
