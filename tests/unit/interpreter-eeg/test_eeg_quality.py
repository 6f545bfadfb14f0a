"""What is published when channels are poor, absent, or no EEG."""

import numpy as np
import pytest
from brain_signals import CAP, blink, brain, extra, play
from interpreter_eeg.config import Config
from quality_ladder import assert_falls, held, played_once
from slow_signals import T0_NS

FS_HZ, SECONDS = 128.0, 40
CLEAN = brain(SECONDS, FS_HZ, 1)
TIMES_S = np.arange(len(CLEAN)) / FS_HZ
RNG = np.random.default_rng(5)
WHITE = RNG.normal(size=(len(CLEAN), 1))


def nothing_is_claimed(update, word):
    """No number but qualities near 0, and why."""
    assert np.isnan([update.delta_uv2[0], update.alpha_uv2[0], update.gamma_uv2[0]]).all()
    assert np.isnan([update.engagement_index, update.theta_alpha_ratio, update.frontal_alpha_asymmetry]).all()
    assert update.signal_quality < 0.25
    assert any(word in reason for reason in update.reasons), update.reasons


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.full((5120, 1), 12.0), "flat"),
        (12.0 + 0.05 * WHITE, "flat"),
        (10.0 * WHITE, "noise"),
        (300.0 * WHITE, "noise"),
        (np.full((5120, 1), np.nan), "missing"),
        (CLEAN + (3000 * TIMES_S)[:, None], "drift"),
        (CLEAN + 2000 * np.sin(2 * np.pi * 50 * TIMES_S)[:, None], "mains"),
    ],
    ids=["constant", "quiet", "white", "loud", "nan", "drift", "mains"],
)
def test_what_is_no_eeg_is_told(samples, word):
    """A flat line, white noise of any size, no number, drift or mains alone: the reason, and nothing else."""
    updates = play(samples, FS_HZ, ["Cz"])
    nothing_is_claimed(updates[-1], word)
    assert len(updates) == SECONDS - 1


ladder = played_once(play)
LADDERS = {
    "noise": lambda x, t_s, k: x + 4 * k * np.random.default_rng(5).normal(size=x.shape),
    "drift": lambda x, t_s, k: x + 20 * k * t_s,
    "mains": lambda x, t_s, k: x + 60 * k * np.sin(2 * np.pi * 50 * t_s),
    "motion": lambda x, t_s, k: x + 40 * k * np.sin(2 * np.pi * 1.3 * t_s),
    "loss": lambda x, t_s, k: np.where(0.9 * k > t_s % 10, np.nan, x),
    "held": lambda x, t_s, k: held(x, 1 / t_s[1, 0], 0.09 * k, 10.0),
    "blinks": lambda x, t_s, k: x + blink(t_s, np.arange(1.0, SECONDS, 10.0 / k), 100.0) if k else x,
}


@pytest.mark.parametrize(("fs_hz", "names"), [(128.0, ("Cz",)), (250.0, ("Fp1", "Fp2", "Cz", "Oz"))])
@pytest.mark.parametrize("kind", LADDERS)
def test_quality_falls_step_by_step(kind, fs_hz, names):
    """Each step of noise, drift, mains, motion, loss, held values and blinks lowers the quality on average."""
    clean = brain(SECONDS, fs_hz, len(names))
    t_s = np.arange(len(clean))[:, None] / fs_hz
    assert_falls(lambda k: ladder(LADDERS[kind](clean, t_s, k), fs_hz, names)[20:])


def test_bad_channels_are_named_and_the_others_go_on():
    """A flat, a loose and a saturated electrode among twelve: named with the cause, NaN, and nothing else changes."""
    samples = brain(SECONDS, FS_HZ, len(CAP))
    before = play(samples, FS_HZ, CAP)[-1]
    samples[:, 1] = 3.0
    samples[:, 4] += 3000 * np.sin(2 * np.pi * 50 * TIMES_S)
    samples[:, 9] = 4000.0
    samples[::7, 9] -= 50
    last = play(samples, FS_HZ, CAP, range_min=-4000.0, range_max=4000.0)[-1]
    for cause, name in (("flat", "Fp2"), ("mains", "Fz"), ("saturated", "O1")):
        assert f"bad channels ({cause}): {name}" in last.reasons
    good = [column for column in range(len(CAP)) if column not in (1, 4, 9)]
    np.testing.assert_allclose(np.array(last.alpha_uv2)[good], np.array(before.alpha_uv2)[good])
    assert np.isnan(np.array(last.alpha_uv2)[[1, 4, 9]]).all()
    assert last.signal_quality == pytest.approx(0.75 * before.signal_quality, abs=0.02)


@pytest.mark.parametrize("one_sided", [False, True])
def test_a_channel_that_an_unknown_range_cuts_is_told(one_sided):
    """Cut at a quarter of its height the alpha of a channel is too small: bad, with the cause; the other is whole."""
    samples = brain(SECONDS, FS_HZ, 2)
    end = 0.5 * np.abs(samples[:, 0]).max()
    before = play(samples, FS_HZ, ["Cz", "Pz"])[-1]
    samples[:, 0] = np.clip(2 * samples[:, 0], -1e9 if one_sided else -end, end)
    last = play(samples, FS_HZ, ["Cz", "Pz"])[-1]
    assert "bad channels (saturated): Cz" in last.reasons
    assert np.isnan(last.alpha_uv2[0])
    assert last.alpha_uv2[1] == pytest.approx(before.alpha_uv2[1])


@pytest.mark.parametrize("step_uv", [0.5, 4.0, 10.0])
def test_a_coarse_converter_cuts_nothing(step_uv):
    """EEG in steps of 0.5 to 10 uV: never called saturated."""
    samples = step_uv * np.round(brain(SECONDS, FS_HZ, 4) / step_uv)
    updates = play(samples, FS_HZ, CAP[:4])
    assert not any("saturated" in reason for update in updates for reason in update.reasons)


def test_what_all_electrodes_show_alike_is_no_eeg():
    """Twelve electrodes in one bath: bad, with the reason; electrodes that share nine tenths of their power are not."""
    own = brain(SECONDS, FS_HZ, len(CAP))
    nothing_is_claimed(play(CLEAN + 0.05 * own, FS_HZ, CAP)[-1], "the same at all electrodes")
    assert play(CLEAN + own / 3, FS_HZ, CAP)[-1].signal_quality == pytest.approx(
        play(CLEAN, FS_HZ, CAP[:1])[-1].signal_quality, abs=0.05
    )


def test_counts_give_shares_and_indices_but_no_microvolts():
    """Of an uncalibrated channel come relative powers, peak and indices as in uV; band powers are NaN and say why."""
    scaled, calibrated = (play(k * CLEAN, FS_HZ, ["Cz"], unit=unit)[-1] for k, unit in ((37.0, "counts"), (1.0, "uV")))
    assert np.isnan(scaled.alpha_uv2).all()
    assert any("uncalibrated" in reason for reason in scaled.reasons)
    np.testing.assert_allclose(extra(scaled, "relative_alpha"), extra(calibrated, "relative_alpha"))
    assert scaled.engagement_index == pytest.approx(calibrated.engagement_index)
    assert extra(scaled, "alpha_peak")[0] == pytest.approx(10.0, abs=0.15)


@pytest.mark.parametrize("scale", [1e3, 1e6])
def test_what_is_far_too_large_for_eeg_is_told(scale):
    """Nanovolts or picovolts that are declared as uV: no band power of any electrode, and the unit is asked for."""
    last = play(scale * brain(SECONDS, FS_HZ, len(CAP)), FS_HZ, CAP)[-1]
    assert np.isnan([last.delta_uv2, last.alpha_uv2, last.gamma_uv2]).all()
    assert last.signal_quality == 0
    assert any("bad channels (too large for EEG: is the unit right?): Fp1" in reason for reason in last.reasons)


def test_a_size_that_no_unit_says_is_none_too_large():
    """Counts have no upper bound: shares and quality are those of uV, whatever a count is."""
    large, usual = (play(k * CLEAN, FS_HZ, ["Cz"], unit="counts")[-1] for k in (1e6, 1.0))
    assert large.signal_quality == pytest.approx(usual.signal_quality)
    np.testing.assert_allclose(extra(large, "relative_alpha"), extra(usual, "relative_alpha"))


def test_blinks_are_counted_and_left_out():
    """Six blinks at the forehead are counted once each at their times; what they reach is left out and named."""
    at_s = [21.2, 24.9, 28.0, 31.4, 35.5, 37.7]
    samples = brain(SECONDS, FS_HZ, len(CAP))
    before = play(samples, FS_HZ, CAP)[-1]
    reach = np.where(np.isin(CAP, ("Fp1", "Fp2")), 1.0, np.where(np.isin(CAP, ("F3", "F4", "Fz")), 0.4, 0.02))
    last = play(samples + blink(TIMES_S, at_s, 150.0)[:, None] * reach, FS_HZ, CAP)[-1]
    assert extra(last, "blink_count")[0] == len(at_s)
    np.testing.assert_allclose((last.device_ns - T0_NS) / 1e9 - extra(last, "blink_age"), at_s, atol=0.06)
    assert "parts left out (blinks): Fp1, Fp2, F3, F4, Fz" in last.reasons
    assert (np.array(last.delta_uv2) < 2 * np.array(before.delta_uv2)).all()
    assert extra(before, "blink_count")[0] == 0


def test_what_is_left_of_a_blink_is_no_delta():
    """Blinks of 250 uV every 3 s, also near an end of a segment, and the quarter of them that F3, F4 and Fz show."""
    samples = brain(SECONDS, FS_HZ, len(CAP), seed=1)
    reach = np.where(np.isin(CAP, ("Fp1", "Fp2")), 1.0, np.where(np.isin(CAP, ("F3", "F4", "Fz")), 0.28, 0.02))
    blinks = blink(TIMES_S, np.arange(2.3, SECONDS - 1, 3.0), 250.0)
    before, last = (play(samples + height * blinks[:, None] * reach, FS_HZ, CAP)[-1] for height in (0, 1))
    assert (np.array(last.delta_uv2) < 2 * np.array(before.delta_uv2)).all()
    assert (extra(last, "excluded")[CAP.index("Cz") :] == 0).all()


@pytest.mark.parametrize(
    ("names", "reach", "height_uv"),
    [
        (("Fz", "Cz"), (0.45, 0.2), 250.0),
        (("F3", "F4", "Cz", "O1"), (0.4, 0.4, 0.2, 0.0), 150.0),
    ],
)
@pytest.mark.parametrize("fs_hz", [128.0, 250.0])
def test_blinks_that_no_electrode_at_the_forehead_sees_are_left_out(names, reach, height_uv, fs_hz):
    """Every 3 s, so high at the forehead: named where they come to, no delta is doubled, and they are not counted."""
    samples = brain(SECONDS, fs_hz, len(names))
    blinks = blink(np.arange(len(samples)) / fs_hz, np.arange(2.3, SECONDS - 1, 3.0), height_uv)
    before, last = (play(samples + shown * blinks[:, None] * reach, fs_hz, names)[-1] for shown in (0, 1))
    assert (np.array(last.delta_uv2) < 2 * np.array(before.delta_uv2)).all()
    told = next(reason for reason in last.reasons if "(blinks)" in reason)
    assert all(name in told for name, share in zip(names, reach, strict=True) if share)
    assert not any("blinks)" in reason for reason in before.reasons)
    assert np.isnan(extra(last, "blink_count")[0])
    assert "blink_count: no electrode at the forehead; blinks may be in delta" in last.reasons
    assert not len(extra(last, "blink_age"))


@pytest.mark.parametrize(
    ("names", "reach", "height_uv", "most"),
    [
        (("ch1", "ch2", "ch3", "ch4"), (1.0, 1.0, 0.4, 0.0), 150.0, 2.0),
        (("Cz", "Oz"), (0.2, 0.0), 150.0, 2.5),
        (("Cz", "Oz"), (0.2, 0.0), 300.0, 2.5),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_where_the_forehead_is_not_known_each_electrode_tells_of_the_blinks_that_come_to_it(
    names, reach, height_uv, most, seed
):
    """Every 3 s, at electrodes without a name or far back: no delta of good quality is so many times as great."""
    samples = brain(SECONDS, FS_HZ, len(names), seed=seed)
    blinks = blink(TIMES_S, np.arange(2.3, SECONDS - 1, 3.0), height_uv)
    before, last = (play(samples + shown * blinks[:, None] * reach, FS_HZ, names)[-1] for shown in (0, 1))
    confident = np.array(last.channel_quality) >= 0.7
    assert (np.array(last.delta_uv2) < most * np.array(before.delta_uv2))[confident].all()
    assert names[0] in next(reason for reason in last.reasons if "(blinks)" in reason)
    assert min(before.channel_quality) > 0.95
    assert last.channel_quality[-1] > 0.95


def test_a_pop_of_one_electrode_is_no_blink():
    """A jump at Fp1 is counted there and left out; slow and even drift of both sides is neither."""
    samples = brain(SECONDS, FS_HZ, len(CAP))
    samples[3600:, 0] += 150.0 * np.exp(-np.arange(len(samples) - 3600) / FS_HZ / 0.2)
    last = play(samples, FS_HZ, CAP)[-1]
    assert extra(last, "pop_count")[0] == 1
    assert not extra(last, "pop_count")[1:].any()
    assert extra(last, "blink_count")[0] == 0
    assert "parts left out (electrode pops): Fp1" in last.reasons


@pytest.mark.parametrize(
    ("width_s", "sides"), [(0.085, (1.0, -1.0)), (0.085, (1.0, 0.1)), (0.35, (1.0, 1.0))], ids=["side", "one", "slow"]
)
def test_an_eye_movement_is_no_blink(width_s, sides):
    """Of opposite sign, on one side only, or longer than a blink: none is counted."""
    bump = 150.0 * np.exp(-0.5 * ((TIMES_S - 30.0) / width_s) ** 2)
    samples = brain(SECONDS, FS_HZ, 2) + bump[:, None] * sides
    last = play(samples, FS_HZ, ("AF7", "AF8"), config=Config(segment_s=4.0))[-1]
    assert extra(last, "blink_count")[0] == 0


@pytest.mark.parametrize(
    ("hz", "height_uv", "band"), [(1.8, 60.0, "delta"), (2.2, 60.0, "delta"), (16.7, 6.0, "beta"), (25.0, 6.0, "beta")]
)
def test_a_line_that_no_brain_makes_is_told(hz, height_uv, band):
    """Steps in a cable, a railway's current, a screen: the band is told at no good quality, with the line's place."""
    samples = brain(SECONDS, FS_HZ, 2)
    before, last = (
        play(samples + on * height_uv * np.sin(2 * np.pi * hz * TIMES_S)[:, None], FS_HZ, ("Fp1", "Fp2"))[-1]
        for on in (0, 1)
    )
    assert getattr(last, f"{band}_uv2")[0] > 3 * getattr(before, f"{band}_uv2")[0]
    assert last.alpha_uv2 == pytest.approx(before.alpha_uv2, rel=0.1)
    assert max(last.channel_quality) < 0.7 < 0.9 < min(before.channel_quality)
    told = [float(reason.split(" at ")[1].split(" Hz")[0]) for reason in last.reasons if reason.startswith("a line")]
    assert told == pytest.approx([hz] * len(told), abs=0.5)
    assert told
    assert not any(reason.startswith("a line") for reason in before.reasons)


def test_a_clench_is_left_out_and_the_rest_told():
    """Two seconds of muscle at one channel: marked there, and beta stays what it was."""
    samples = brain(SECONDS, FS_HZ, 2)
    before = play(samples, FS_HZ, ("Cz", "T8"))[-1]
    samples[3600:3856, 1] += 25 * RNG.normal(size=256)
    last = play(samples, FS_HZ, ("Cz", "T8"))[-1]
    assert extra(last, "muscle_segments")[0] == 0
    assert 2 <= extra(last, "muscle_segments")[1] <= 4
    np.testing.assert_allclose(last.beta_uv2, before.beta_uv2, rtol=0.3)


@pytest.mark.parametrize(("fs_hz", "mains_hz"), [(64.0, 50.0), (64.0, 60.0), (80.0, 50.0), (80.0, 60.0)])
@pytest.mark.parametrize("height_uv", [1.5, 3.0, 8.0])
def test_weak_mains_folded_into_a_band_double_none_and_are_said(fs_hz, mains_hz, height_uv):
    """Where sampling folds mains to 4, 14, 20 or 30 Hz no band is doubled by them, and it is said."""
    samples = brain(SECONDS, fs_hz, 1)
    hum = height_uv * np.sin(2 * np.pi * (mains_hz + 0.03) * np.arange(len(samples)) / fs_hz + 1)
    clean, last = play(samples, fs_hz, ["Cz"])[-1], play(samples + hum[:, None], fs_hz, ["Cz"])[-1]
    for band in ("delta", "theta", "alpha", "beta"):
        assert 0.7 < getattr(last, f"{band}_uv2")[0] / getattr(clean, f"{band}_uv2")[0] < 1.9, band
    assert any(f"{abs(fs_hz - mains_hz):g} Hz" in reason for reason in last.reasons if "mains would appear" in reason)


@pytest.mark.parametrize(
    ("fs_hz", "mains_hz"), [(64.0, 50.0), (64.0, 60.0), (80.0, 50.0), (80.0, 60.0), (100.0, 60.0), (250.0, 50.0)]
)
def test_mains_is_taken_out_also_where_sampling_folds_it(fs_hz, mains_hz):
    """Hum six times as strong as the EEG changes no band by more than a seventh, also where it lies inside one."""
    samples = brain(24, fs_hz, 1)
    hum = 60 * np.sin(2 * np.pi * (mains_hz + 0.03) * np.arange(len(samples)) / fs_hz + 1)
    clean, hummed = play(samples, fs_hz, ["Cz"])[-1], play(samples + hum[:, None], fs_hz, ["Cz"])[-1]
    for band in ("delta_uv2", "theta_uv2", "alpha_uv2", "beta_uv2"):
        assert getattr(hummed, band)[0] == pytest.approx(getattr(clean, band)[0], rel=0.15, abs=0.3), band
    assert hummed.signal_quality < clean.signal_quality


def test_a_rate_too_low_for_gamma():
    """At 64 Hz gamma is NaN with a reason, all else is told."""
    last = play(brain(24, 64.0, 1), 64.0, ["Cz"])[-1]
    assert np.isnan(last.gamma_uv2).all()
    assert np.isfinite([last.beta_uv2[0], last.engagement_index]).all()
    assert any(reason.startswith("gamma_uv2: above what the sampling rate shows") for reason in last.reasons)


@pytest.mark.parametrize("odd", [np.inf, -np.inf, 1e300, 1e15])
def test_what_no_sensor_measures_is_drawn_through(odd):
    """An infinite or absurd value is a sample that never came: no band power changes for it."""
    samples = CLEAN.copy()
    before = play(samples, FS_HZ, ["Cz"])[-1]
    samples[4000:4003] = odd
    last = play(samples, FS_HZ, ["Cz"])[-1]
    assert last.alpha_uv2[0] == pytest.approx(before.alpha_uv2[0], rel=0.1)
    assert last.signal_quality < before.signal_quality


@pytest.mark.parametrize(("window_s", "segment_s"), [(4.0, 2.0), (8.0, 4.0), (5.5, 2.0), (4.0, 1.0)])
def test_a_short_window_is_filled(window_s, segment_s):
    """Whatever its length and that of the segments, clean EEG fills it and has full quality at every update."""
    config = Config(window_s=window_s, segment_s=segment_s)
    updates = play(CLEAN[:1500], FS_HZ, ["Cz"], config=config)
    needed = round(2 * segment_s)
    assert all(update.signal_quality > 0.97 for update in updates[needed - 1 :])
    assert all("need" in update.reasons[0] for update in updates[: needed - 1])


def test_short_holes_are_drawn_through_and_long_ones_restart():
    """Single lost frames cost quality and no number; where no segment is whole there is none, and why."""
    samples = brain(SECONDS, FS_HZ, 1)
    every_4_s = [(at + 0.5, at + 0.54) for at in np.arange(0.0, SECONDS, 4.0)]
    short = play(samples, FS_HZ, ["Fp1"], sizes=[5] * 1024, lost=every_4_s)[-1]
    whole = play(samples, FS_HZ, ["Fp1"])[-1]
    assert short.alpha_uv2[0] == pytest.approx(whole.alpha_uv2[0], rel=0.15)
    assert 0.5 < short.signal_quality < whole.signal_quality
    each_s = [(at, at + 0.3) for at in np.arange(0.0, SECONDS, 1.0)]
    broken = play(samples, FS_HZ, ["Fp1"], sizes=[5] * 1024, lost=each_s)[-1]
    nothing_is_claimed(broken, "lost")


def test_jitter_of_single_samples_is_no_loss():
    """One sample a frame, stamps late by up to 0.8 of an interval: alpha and quality as with true stamps."""
    whole, jittered = (
        play(CLEAN, FS_HZ, ["Cz"], sizes=[1] * len(CLEAN), late_s=late_s)[-1] for late_s in (0.0, 0.8 / FS_HZ)
    )
    assert jittered.channel_quality[0] == pytest.approx(whole.channel_quality[0], abs=0.02)
    assert jittered.alpha_uv2[0] == pytest.approx(whole.alpha_uv2[0], rel=0.05)


@pytest.mark.parametrize("held_s", [0.3, 1.0, 1.5])
def test_values_that_are_held_are_no_signal(held_s):
    """A device that repeats its last value for part of every 2 s: its channel is bad, for missing samples."""
    samples = CLEAN.copy()
    for begin in range(0, len(samples), round(2 * FS_HZ)):
        samples[begin : begin + round(held_s * FS_HZ)] = samples[begin]
    nothing_is_claimed(play(samples, FS_HZ, ["Cz"])[-1], "missing")


def test_a_coarse_resolution_is_a_signal():
    """Rounded to 2 uV, a quarter of the neighbours being equal, nothing is missing."""
    fine, coarse = (play(samples, FS_HZ, ["Cz"])[-1] for samples in (CLEAN, 2 * np.round(CLEAN / 2)))
    assert coarse.alpha_uv2[0] == pytest.approx(fine.alpha_uv2[0], rel=0.05)
    assert coarse.signal_quality == pytest.approx(fine.signal_quality, abs=0.05)


def test_a_short_hole_keeps_its_place():
    """Samples that were lost count as missing of the segments they belong to, and the signal keeps its rate."""
    samples = brain(30, FS_HZ, 1)
    whole = play(samples, FS_HZ, ["Cz"], sizes=[10] * 750)
    holed = play(samples, FS_HZ, ["Cz"], sizes=[10] * 750, lost=[(k + 0.5, k + 0.54) for k in range(2, 29)])
    assert holed[-1].channel_quality[0] < whole[-1].channel_quality[0]
    np.testing.assert_allclose(extra(holed[-1], "alpha_peak"), extra(whole[-1], "alpha_peak"), atol=0.2)


@pytest.mark.parametrize("unit", ["uV", "counts"])
def test_electrodes_that_all_show_the_same_have_nothing_against_their_average(unit):
    """Eight electrodes bridged to one: against their average each is flat, where rounding errors had a quality."""
    updates = play(np.repeat(CLEAN, 8, axis=1), FS_HZ, CAP[:8], unit, Config(reference="average"))
    nothing_is_claimed(updates[-1], "flat")
