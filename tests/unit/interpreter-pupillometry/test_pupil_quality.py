"""What is published when there is no pupil, and the two laws."""

import numpy as np
import pytest
from gaze import at_stamps, extra_of, pupils
from interpreter_pupillometry.config import Config
from interpreter_pupillometry.stream import PupilStream
from quality_ladder import assert_falls, held, played_once
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import play

FS_HZ = 125.0
NAMES = ("diameter_left", "diameter_right")
CLEAN = pupils(FS_HZ, 40, [(25.0, 30.0, 0.3)], [15.0, 27.0])
TIMES_S = np.arange(len(CLEAN)) / FS_HZ


def make(info):
    return PupilStream(Config(), info)


def in_mm(samples, names=NAMES, fs_hz=FS_HZ, **options):
    return play(make, samples, fs_hz, "pupillometry", options.pop("unit", "mm"), names, **options)


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.full((2000, 2), 3.0), "frozen"),
        (np.vstack([CLEAN[:1500], np.tile(CLEAN[1499], (1000, 1))]), "frozen"),
        (np.zeros((2000, 2)), "no pupil"),
        (np.full((2000, 2), np.nan), "no pupil"),
        (np.full((2000, 2), 40.0) + np.random.default_rng(1).normal(0, 0.1, (2000, 2)), "no pupil"),
        (np.random.default_rng(2).uniform(2, 8, (2000, 2)), "noise"),
        (4 + np.random.default_rng(3).normal(0, 0.5, (2000, 2)), "noise"),
    ],
    ids=["constant", "stuck", "zero", "nan", "too_large", "uniform", "gauss"],
)
def test_what_is_no_pupil_is_told(samples, word):
    """Frozen, lost, out of a pupil's range, nothing but noise: the reason, and no number."""
    last = in_mm(samples)[-1]
    assert np.isnan([last.diameter, last.diameter_left, last.change, last.baseline, last.dilation_speed_per_s]).all()
    assert np.isnan(extra_of(last, "lhipa")).all()
    assert last.signal_quality == 0
    assert word in last.reasons[0]


@pytest.mark.parametrize("eye", [0, 1])
def test_one_eye_that_is_stuck_does_not_halve_the_response(eye):
    """One eye that stands still to the last digit is NaN with its reason; the other one's dilation is told whole."""
    samples = pupils(FS_HZ, 40, [(25.0, 38.0, 0.3)], [])
    samples[TIMES_S >= 15, eye] = samples[round(15 * FS_HZ), eye]
    last = in_mm(samples)[35]
    assert last.diameter == pytest.approx(3.3, abs=0.03)
    assert np.isnan(last[5 + eye - 1])
    assert any(f"{NAMES[eye]}: frozen" in reason for reason in last.reasons)
    assert last.signal_quality > 0


def test_doubt_of_the_tracker_counts():
    """Samples of low confidence are missing."""
    doubted = np.column_stack([CLEAN, np.where(TIMES_S % 1 < 0.3, 0.2, 0.9)])
    last = in_mm(doubted, (*NAMES, "confidence"))[-1]
    assert last.missing_ratio >= 0.3
    assert last.diameter == pytest.approx(3.0, abs=0.02)


ladder = played_once(in_mm)
# no mains: a camera measures; a head that moves has a pupil of the same size
LADDERS = {
    "noise": lambda x, t_s, k: x + np.random.default_rng(1).normal(0, 0.05 * k, x.shape),
    "drift": lambda x, t_s, k: x + 0.6 * k * t_s / 60,
    "loss": lambda x, t_s, k: np.where((np.random.default_rng(2).random(len(x)) < 0.1 * k)[:, None], 0, x),
    "blinks": lambda x, t_s, k: np.where(0.25 * k > t_s % 3, 0, x),
    "spikes": lambda x, t_s, k: x + np.where(np.random.default_rng(3).random((len(x), 1)) < 0.05 * k, 2.0, 0.0),
    "held": lambda x, t_s, k: held(x, 1 / t_s[1, 0], 0.15 * k, 2.0),
}


@pytest.mark.parametrize("fs_hz", [60.0, FS_HZ, 500.0])
@pytest.mark.parametrize("kind", LADDERS)
def test_quality_falls_step_by_step(kind, fs_hz):
    """Each step of noise, drift, lost samples, blinks, spikes and held sizes lowers the quality on average."""
    clean = pupils(fs_hz, 40, [(25.0, 30.0, 0.3)], [15.0, 27.0])
    t_s = np.arange(len(clean))[:, None] / fs_hz
    assert_falls(lambda k: ladder(LADDERS[kind](clean, t_s, k), fs_hz=fs_hz)[5:])


@pytest.mark.parametrize("fs_hz", [60.0, FS_HZ, 1000.0])
def test_a_size_that_is_held_is_no_pupil(fs_hz):
    """Frozen for 3 s: no size of them from the first whole window on, and after them it is what it was."""
    sizes = pupils(fs_hz, 40, [(21.0, 35.0, 0.5)], [])
    sizes[round(20 * fs_hz) : round(23 * fs_hz)] = sizes[round(20 * fs_hz)]
    updates = in_mm(sizes, fs_hz=fs_hz)
    assert np.isnan([update.diameter for update in updates[21:22]]).all()
    assert updates[21].signal_quality == 0
    assert "held" in updates[21].reasons[0]
    assert updates[25].diameter == pytest.approx(3.5, abs=0.02)


@pytest.mark.parametrize(("fs_hz", "step_mm"), [(60.0, 0.1), (FS_HZ, 0.02), (1000.0, 0.05)])
def test_a_coarse_size_is_not_held(fs_hz, step_mm):
    """In steps as large as the noise or larger, as cheap trackers write it, hardly a sample is missing."""
    sizes = np.round(pupils(fs_hz, 40, [(25.0, 30.0, 0.3)], []) / step_mm) * step_mm
    assert np.mean([update.missing_ratio for update in in_mm(sizes, fs_hz=fs_hz)]) < 0.02


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One signal with blinks, a long gap and spikes in frames of 1, 7 and random sizes: the same updates."""
    sizes = CLEAN.copy()
    sizes[2000:2200], sizes[700] = 0, 7.0
    n = len(sizes)
    cuts = ([1] * n, [7] * n, np.random.default_rng(2).integers(1, 60, n).tolist())
    texts = [repr([update._replace(received_ns=0) for update in in_mm(sizes, sizes=cut)]) for cut in cuts]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 1000


def test_a_hole_is_not_drawn_through():
    """Of 3 s that never came nothing is told, and after them the sizes are as without."""
    updates = in_mm(CLEAN, lost=[(18.0, 21.0)])
    begin = [b for update in updates for b in extra_of(update, "interpolated_begin_s")]
    assert len(begin) == 2
    assert updates[-1].diameter == pytest.approx(in_mm(CLEAN)[-1].diameter, abs=0.01)
    assert updates[-1].baseline == pytest.approx(3.0, abs=0.02)


def test_a_gap_that_has_closed_is_told_also_where_a_hole_follows_an_update_at_once():
    """A blink that ends 0.15 s before the sample of an update, and 3 s behind it that never came: it is told."""
    sizes = pupils(FS_HZ, 30, [], [15.65])
    updates = in_mm(sizes, sizes=[1] * len(sizes), lost=[(16 + 0.5 / FS_HZ, 19.0)])
    assert len([begin_s for update in updates for begin_s in extra_of(update, "interpolated_begin_s")]) == 1


@pytest.mark.parametrize("lost_s", [3.0, 13.0])
def test_an_eye_that_is_lost_at_a_hole_does_not_move_the_mean(lost_s):
    """What is usual between the eyes holds behind what never came: the size of both goes on from one."""
    sizes = pupils(FS_HZ, 40, [], [])
    sizes[TIMES_S >= 20, 1] = 0
    updates = in_mm(sizes, lost=[(20.0, 20.0 + lost_s)])
    assert updates[-1].diameter == pytest.approx(3.0, abs=0.01)
    assert updates[25].diameter == pytest.approx(3.0, abs=0.01)


def test_samples_without_a_fixed_rate():
    """Stamps that jitter, and some that go back: the same sizes, late ones counted."""
    stamps_s = TIMES_S + np.random.default_rng(1).uniform(-0.002, 0.002, len(CLEAN))
    stamps_s[3000:3010:2] -= 0.02
    updates = at_stamps(CLEAN, stamps_s, make, "pupillometry", "mm", NAMES)
    assert updates[28].change == pytest.approx(0.3, abs=0.01)
    assert sum(extra_of(update, "backward_stamps")[0] for update in updates) >= 5


def test_sizes_without_a_scale_are_relative():
    """In a.u. sizes and changes come in that unit, the change in percent as in mm; that it is uncalibrated is told."""
    known, last = (in_mm(m * CLEAN, unit=unit)[28] for m, unit in ((1.0, "mm"), (300.0, "a.u.")))
    assert last.change_percent == pytest.approx(known.change_percent, rel=0.01)
    assert (known.unit, last.unit) == ("mm", "a.u.")
    assert any("uncalibrated" in reason for reason in last.reasons)
    assert known.reasons == ()


@pytest.mark.parametrize("fs_hz", [10.0, 5000.0])
def test_a_rate_that_no_tracker_has_is_refused(fs_hz):
    """One sentence that names the rate and what it must be."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .* must be 0 or 25 to 2000 for pupillometry"):
        PupilStream(Config(), StreamInfo(StreamName("p1", "pupillometry", "s1"), fs_hz, "mm", NAMES))


def test_a_missing_channel_is_named():
    """Without either eye nothing can be done; with one the other's size is NaN and says why."""
    with pytest.raises(ValueError, match="diameter_left or diameter_right is needed"):
        PupilStream(Config(), StreamInfo(StreamName("p1", "pupillometry", "s1"), 60.0, "mm", ("size",)))
    last = in_mm(CLEAN[:, :1], NAMES[:1])[-1]
    assert np.isnan(last.diameter_right)
    assert any("diameter_right" in reason for reason in last.reasons)
