"""What is published when gaze is noise, frozen, lost, doubted or without a scale."""

import numpy as np
import pytest
from gaze import EYELINK_HZ, EYELINK_PX_PER_DEG, extra_of, eyelink, in_deg, looking
from interpreter_eye_tracking.config import Config
from interpreter_eye_tracking.stream import EyeStream
from quality_ladder import assert_falls, held, played_once
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo

FS_HZ = 120.0
CLEAN, ONSETS_S = looking(FS_HZ, np.random.default_rng(7).uniform([-15, -10], [15, 10], (60, 2)), noise=0.05)
TIMES_S = np.arange(len(CLEAN)) / FS_HZ


def make(info):
    return EyeStream(Config(), info)


def noise(seed, sd, n=2400):
    return np.random.default_rng(seed).normal(0, sd, (n, 2))


@pytest.mark.parametrize(
    ("samples", "unit", "word"),
    [
        (np.full((2400, 2), 3.0), "deg", "frozen"),
        (np.vstack([CLEAN[:1200], np.tile(CLEAN[1199], (600, 1))]), "deg", "frozen"),
        (np.full((2400, 2), np.nan), "deg", "lost the eyes"),
        (np.zeros((2400, 2)), "px", "lost the eyes"),
        (np.column_stack([CLEAN, np.full(len(CLEAN), 0.3)]), "deg", "lost the eyes"),
        (noise(1, 8.0), "deg", "noise"),
        (500 + noise(2, 100.0), "px", "noise"),
        (np.random.default_rng(3).uniform(0, 1, (2400, 2)), "1", "noise"),
    ],
    ids=["constant", "stuck", "nan", "zero", "doubted", "noise_deg", "noise_px", "uniform"],
)
def test_what_is_no_gaze_is_told(samples, unit, word):
    """Frozen, lost, doubted or nothing but noise: the reason, and nothing else."""
    last = in_deg(samples, FS_HZ, make, unit=unit)[-1]
    assert (last.fixation_count, last.saccade_count, last.blink_count) == (-1, -1, -1)
    assert np.isnan([last.gaze_x, last.gaze_y, last.gaze_entropy_bits, last.gaze_dispersion_deg]).all()
    assert last.signal_quality == 0
    assert word in last.reasons[0]
    assert not last.saccade_timestamps


@pytest.mark.parametrize(
    ("unit", "scale", "mark"),
    [
        ("1", 0.02, -1.0),
        ("1", 0.02, -32768.0),
        ("px", 40.0, -1.0),
        ("px", 40.0, -32768.0),
        ("deg", 1.0, 0.0),
        ("deg", 1.0, -32768.0),
    ],
)
def test_what_trackers_write_for_lost_gaze_is_lost(unit, scale, mark):
    """(-1, -1) of the screen or px, numbers beyond any screen or eye, (0, 0) deg in a row: blinks, and no gaze."""
    samples = 0.5 * (unit == "1") + CLEAN * scale
    for at in (600, 1000, 1400):
        samples[at : at + 24] = mark
    last = in_deg(samples, FS_HZ, make, unit=unit)[-1]
    assert last.blink_count == 3
    assert last.valid_ratio == pytest.approx(1 - 72 / len(CLEAN), abs=0.01)


def test_a_single_look_straight_ahead_is_gaze():
    """(0, 0) deg twice in a row is gaze."""
    samples = CLEAN.copy()
    samples[600:602] = samples[900] = 0.0
    assert in_deg(samples, FS_HZ, make)[-1].valid_ratio == 1.0


@pytest.mark.parametrize("axis", [0, 1])
def test_one_axis_that_is_frozen_is_doubtful(axis):
    """One coordinate the same to the last digit while the other moves: half the quality, and a reason that names it."""
    stuck = CLEAN.copy()
    stuck[:, axis] = 3.27
    last, whole = (in_deg(samples, FS_HZ, make)[-1] for samples in (stuck, CLEAN))
    assert last.signal_quality < 0.6 * whole.signal_quality
    assert sum(f"gaze_{'xy'[axis]} stayed the same" in reason for reason in last.reasons) == len(last.reasons) == 1
    assert last.saccade_count > 0
    assert whole.reasons == ()


def test_a_coarse_resolution_is_no_frozen_axis(shared_data):
    """An EyeLink's gaze rounded to a degree: no reason, as to a tenth of a pixel."""
    gaze = eyelink(shared_data, "R").gaze
    rounded = np.round(gaze / EYELINK_PX_PER_DEG) * EYELINK_PX_PER_DEG
    updates = in_deg(rounded, EYELINK_HZ, make, unit="px")
    assert not any("stayed the same" in reason for update in updates for reason in update.reasons)


def test_frozen_gaze_is_no_fixation():
    """A tracker that hangs, whether from the start or later, leaves no fixation of the time in which it did."""
    hung = np.vstack([CLEAN[:1200], np.tile(CLEAN[1199], (480, 1)), CLEAN[1200:]])
    durations = [ms for update in in_deg(hung, FS_HZ, make) for ms in update.fixation_durations_ms]
    assert durations
    assert max(durations) < 700
    assert not any(u.fixation_timestamps for u in in_deg(np.full((1200, 2), 3.0), FS_HZ, make))


def test_what_ended_before_the_tracker_hung_is_told_with_the_problem():
    """At an update of 5 s that ends frozen: the saccades and fixations of its first seconds, as without the problem."""
    hung = np.vstack([CLEAN[:1500], np.tile(CLEAN[1499], (310, 1))])
    config = Config(update_interval_s=5.0)
    update = in_deg(hung, FS_HZ, lambda info: EyeStream(config, info))[-1]
    whole = in_deg(CLEAN[:1810], FS_HZ, lambda info: EyeStream(config, info))[-1]
    assert "frozen" in update.reasons[0]
    early = [at_ns for at_ns in whole.saccade_timestamps if at_ns < whole.device_ns - 3.5e9]
    assert early
    assert set(early) <= set(update.saccade_timestamps)
    assert update.fixation_timestamps
    assert np.isfinite(update.saccade_amplitudes_deg).all()
    assert len(extra_of(update, "fixation_x")) == len(update.fixation_timestamps)


ladder = played_once(in_deg)
# no mains: a camera measures; a head that moves has gaze that moves
LADDERS = {
    "noise": lambda x, t_s, k: x + np.random.default_rng(1).normal(0, 0.4 * k, x.shape),
    "drift": lambda x, t_s, k: x + 0.5 * k * t_s * (1, 0),
    "loss": lambda x, t_s, k: np.where((np.random.default_rng(2).random(len(x)) < 0.12 * k)[:, None], np.nan, x),
    "away": lambda x, t_s, k: np.where(1.2 * k > t_s % 6, np.nan, x),
    "held": lambda x, t_s, k: held(x, 1 / t_s[1, 0], 0.15 * k, 2.0),
}


@pytest.mark.parametrize(("unit", "fs_hz"), [("deg", FS_HZ), ("px", FS_HZ), ("deg", 500.0)])
@pytest.mark.parametrize("kind", LADDERS)
def test_quality_falls_step_by_step(kind, unit, fs_hz):
    """Each step of velocity noise, drift, lost samples, looks away and held gaze lowers the quality on average."""
    scale = 1.0 if unit == "deg" else 40.0
    clean, _ = looking(fs_hz, np.random.default_rng(7).uniform([-15, -10], [15, 10], (60, 2)), noise=0.05)
    t_s = np.arange(len(clean))[:, None] / fs_hz
    assert_falls(lambda k: ladder(scale * LADDERS[kind](clean, t_s, k), fs_hz, make, unit=unit)[5:])


@pytest.mark.parametrize("fs_hz", [60.0, 120.0, 1000.0])
def test_gaze_that_is_held_is_no_fixation(fs_hz):
    """0.7 s of one gaze in every 3 s: no fixation holds them, they are no blink, and no sample of them is valid."""
    clean, _ = looking(fs_hz, np.random.default_rng(7).uniform([-15, -10], [15, 10], (60, 2)), noise=0.05)
    updates = in_deg(held(clean, fs_hz, 0.7 / 3, 3.0), fs_hz, make)
    assert max(ms for update in updates for ms in update.fixation_durations_ms) < 500
    assert updates[-1].blink_count == 0
    assert updates[-1].valid_ratio < 0.85


@pytest.mark.parametrize(("fs_hz", "noise"), [(60.0, 0.01), (120.0, 0.005), (1000.0, 0.005)])
def test_gaze_of_a_coarse_tracker_is_not_held(fs_hz, noise):
    """Gaze of little noise, in steps of 0.1 px of which 40 are a degree: all is valid."""
    clean, _ = looking(fs_hz, np.random.default_rng(7).uniform([-15, -10], [15, 10], (60, 2)), noise=noise)
    updates = in_deg(np.round(400 * clean) / 10, fs_hz, make, unit="px")
    assert min(update.valid_ratio for update in updates) == 1.0


@pytest.mark.parametrize(("fs_hz", "sd"), [(30.0, 0.3), (120.0, 0.3), (1000.0, 0.05)])
def test_noise_is_no_saccade(fs_hz, sd):
    """Of a steady gaze with a noisy tracker no saccade is told in a minute: the threshold rises with the noise."""
    stare = np.random.default_rng(4).normal(0, sd, (round(60 * fs_hz), 2))
    assert sum(len(update.saccade_timestamps) for update in in_deg(stare, fs_hz, make)) == 0


def test_pixels_give_events_but_no_degrees():
    """Of an uncalibrated stream come events, counts and times; whatever would be in degrees is NaN and says why."""
    last, known = (in_deg(m * CLEAN, FS_HZ, make, unit=unit)[-1] for m, unit in ((40.0, "px"), (1.0, "deg")))
    assert (last.saccade_count, last.fixation_count) == (known.saccade_count, known.fixation_count)
    assert np.isnan([last.saccade_amplitude_deg, last.gaze_dispersion_deg]).all()
    assert np.isfinite([last.gaze_entropy_bits, last.gaze_x]).all()
    assert any("uncalibrated" in reason for reason in last.reasons)
    assert known.reasons == ()


def test_no_gaze_at_present_is_told():
    """Eyes closed for the last seconds: position NaN with its reason, counts of the window still there."""
    samples = CLEAN.copy()
    samples[-300:] = np.nan
    last = in_deg(samples, FS_HZ, make)[-1]
    assert np.isnan([last.gaze_x, last.gaze_y]).all()
    assert any("at present" in reason for reason in last.reasons)
    assert last.saccade_count > 20


@pytest.mark.parametrize("fs_hz", [10.0, 5000.0])
def test_a_rate_that_no_tracker_has_is_refused(fs_hz):
    """One sentence that names the rate and what it must be."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .* must be 0 or 25 to 2000 for eye tracking"):
        EyeStream(Config(), StreamInfo(StreamName("p1", "eye_tracking", "s1"), fs_hz, "deg", ("gaze_x", "gaze_y")))


def test_a_missing_channel_is_named():
    """Without gaze_y nothing can be done."""
    with pytest.raises(ValueError, match="gaze_x and gaze_y are needed"):
        EyeStream(Config(), StreamInfo(StreamName("p1", "eye_tracking", "s1"), 60.0, "deg", ("gaze_x", "x")))


@pytest.mark.parametrize("lost_s", [0.05, 0.1])
def test_a_tracker_that_loses_the_eyes_again_and_again_tells_no_blinks(lost_s):
    """For so long in every 0.3 s, as behind glasses: no number of blinks, no good quality, and why."""
    flickering = CLEAN.copy()
    flickering[lost_s > TIMES_S % 0.3] = np.nan
    updates = in_deg(flickering, FS_HZ, make)
    assert all(update.blink_count == -1 and np.isnan(update.blink_rate_per_min) for update in updates[11:])
    assert not any(update.blink_timestamps for update in updates[11:])
    assert max(update.signal_quality for update in updates[11:]) < 0.5
    assert all(any("as by no lid" in reason for reason in update.reasons) for update in updates[11:])


def test_eyes_that_blink_often_are_believed():
    """A blink of 0.15 s in every 0.9 s: all are counted, at a good quality, and no reason doubts them."""
    blinking = CLEAN.copy()
    blinking[TIMES_S % 0.9 < 0.15] = np.nan
    last = in_deg(blinking, FS_HZ, make)[-1]
    assert 60 < last.blink_rate_per_min < 70
    assert last.signal_quality > 0.7
    assert not any("as by no lid" in reason for reason in last.reasons)
