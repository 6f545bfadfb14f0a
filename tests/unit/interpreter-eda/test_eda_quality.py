"""What is published when the signal is poor, absent, or no skin conductance."""

import numpy as np
import pytest
from interpreter_eda.config import Config
from interpreter_eda.stream import EdaStream
from quality_ladder import assert_falls, held, played_once
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import event_times_s, skin
from slow_signals import play as play_signal

FS_HZ, SECONDS = 50.0, 90
TIMES_S = np.arange(round(SECONDS * FS_HZ)) / FS_HZ
CLEAN = skin(SECONDS, FS_HZ, [15.0, 40.0, 62.0, 75.0], [0.5, 0.8, 0.4, 0.6])


def play(samples, fs_hz, unit="uS", config=None, **options):
    """Updates of conductances."""
    return play_signal(lambda info: EdaStream(config or Config(), info), samples, fs_hz, "eda", unit, **options)


def peaks_s(updates):
    """When the responses that were told have their peaks."""
    return event_times_s(updates, "scr_peak_timestamps")


def nothing_is_claimed(update, word):
    assert update.scr_count == -1
    assert np.isnan(
        [update.tonic_us, update.scr_rate_per_min, update.phasic_auc_us_s, update.tonic_slope_us_per_min]
    ).all()
    assert update.signal_quality == 0
    assert any(word in reason for reason in update.reasons), update.reasons


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.full(4500, 5.0), "flat"),
        (5.0 + np.random.default_rng(0).normal(0, 0.01, 4500), "flat"),
        (np.full(4500, 0.01), "loose electrode"),
        (np.full(4500, -3.0), "loose electrode"),
        (CLEAN * 40, "loose electrode"),
        (np.full(4500, np.nan), "no number"),
        (5.0 + 0.3 * np.exp(-(((TIMES_S % 0.83 - 0.3) / 0.1) ** 2)), "heart's pulse"),
    ],
    ids=["constant", "noise", "open", "negative", "shorted", "nan", "pulse"],
)
def test_what_is_no_skin_is_told(samples, word):
    """A flat line, bare noise, a loose or shorted electrode, no number, a pulse: the reason, and nothing else."""
    updates = play(samples, FS_HZ)
    nothing_is_claimed(updates[-1], word)
    assert len(peaks_s(updates)) == 0
    assert len(updates) == 89


def test_a_saturated_channel_says_so():
    """At the end of the range that the driver told nothing is computed."""
    nothing_is_claimed(play(np.minimum(CLEAN, 5.05), FS_HZ, range_min=0.0, range_max=5.05)[-1], "saturated")


def test_an_electrode_that_comes_loose_and_is_put_back():
    """While it hangs loose that is said; the way back is no response, and afterwards everything is there again."""
    samples = CLEAN.copy()
    samples[(TIMES_S > 20) & (TIMES_S < 30)] = 0.0
    updates = play(samples, FS_HZ)
    nothing_is_claimed(updates[27], "loose electrode")
    told = peaks_s(updates)
    assert not ((told > 18) & (told < 36)).any()
    assert updates[-1].scr_count >= 2
    assert updates[-1].tonic_us == pytest.approx(5.1, abs=0.3)


@pytest.mark.parametrize("glitch", [1599, 1600])
def test_one_sample_without_contact_takes_nothing_away(glitch):
    """One sample of 0 uS, wherever its block ends, changes neither count, rate nor quality of a wearer's window."""
    onsets_s = np.arange(5.0, 175.0, 12.0)
    samples = skin(180, 16.0, onsets_s, np.full(15, 0.5)) + np.random.default_rng(1).normal(0, 0.002, 2880)
    samples[glitch] = 0.0
    updates = play(samples, 16.0)[75:]
    assert {update.scr_count for update in updates} == {5}
    assert min(update.signal_quality for update in updates) > 0.9
    np.testing.assert_allclose([update.scr_rate_per_min for update in updates], 5.0)


def test_an_electrode_that_hung_loose_hides_no_response_and_no_rate():
    """After 10 s of no contact those told before still count, and the rate is that of the time with contact."""
    onsets_s = np.append(np.arange(5.0, 95.0, 12.0), np.arange(113.0, 175.0, 12.0))
    samples = skin(180, 16.0, onsets_s, np.full(len(onsets_s), 0.5))
    samples[16 * 100 : 16 * 110] = 0.0
    updates = play(samples, 16.0)
    for update in updates[112:150]:
        assert update.scr_rate_per_min == pytest.approx(5.0, abs=1.3)
        assert update.signal_quality < 0.9
    assert updates[-1].scr_rate_per_min == pytest.approx(5.0)
    assert updates[-1].signal_quality > 0.9


def test_time_that_was_withheld_counts_for_no_rate():
    """After half a minute at the end of the range those told before count; the rate is that of the other time."""
    onsets_s = np.arange(5.0, 175.0, 12.0)
    samples = skin(180, 16.0, onsets_s, np.full(15, 0.5))
    times_s = np.arange(len(samples)) / 16
    samples = np.where((times_s > 80) & (times_s < 110), 10.0, samples)
    updates = play(samples, 16.0, range_min=0.0, range_max=10.0)
    nothing_is_claimed(updates[105], "saturated")
    after = updates[115]
    assert after.scr_count == 3
    assert after.scr_rate_per_min == pytest.approx(5.0, abs=1.5)
    assert after.signal_quality < 0.6


ladder = played_once(play)
# mains that sampling folds to less than a cycle in 10 s, as 50 Hz by 50 Hz, are a level that drifts: not told
LADDERS = {
    "noise": lambda x, t_s, k: x + 0.05 * k * np.random.default_rng(1).normal(size=len(x)),
    "drift": lambda x, t_s, k: x + 1.5 * k * t_s / 60,
    "mains": lambda x, t_s, k: x + 0.02 * k * np.sin(2 * np.pi * (58.7 if t_s[1] > 0.01 else 50.03) * t_s),
    "motion": lambda x, t_s, k: x + np.where(1.5 * k > t_s % 20, 3.0, 0.0),
    "loss": lambda x, t_s, k: np.where(1.4 * k > t_s % 10, np.nan, x),
    "held": lambda x, t_s, k: held(x, 1 / t_s[1], 0.15 * k, 10.0),
    "shortly held": lambda x, t_s, k: held(x, 1 / t_s[1], 0.15 * k, 4.0),
}


@pytest.mark.parametrize("fs_hz", [15.0, 128.0])
@pytest.mark.parametrize("kind", LADDERS)
def test_quality_falls_step_by_step(kind, fs_hz):
    """Each step of noise, drift, mains, motion, loss and held values lowers the quality on average."""
    t_s = np.arange(round(SECONDS * fs_hz)) / fs_hz
    clean = skin(SECONDS, fs_hz, [15.0, 40.0, 62.0, 75.0], [0.5, 0.8, 0.4, 0.6])
    clean += np.random.default_rng(9).normal(0, 0.002, len(clean))
    assert_falls(lambda k: ladder(LADDERS[kind](clean, t_s, k), fs_hz)[20:])


@pytest.mark.parametrize("per_min", [8.0, 12.0, 18.0])
def test_a_chest_is_no_skin(per_min):
    """A belt on the EDA input, in for 0.4 of a breath and out: from 40 s on no quality of 0.7, and the reason."""
    phase = TIMES_S * per_min / 60 % 1
    chest = np.where(phase < 0.4, -np.cos(np.pi * phase / 0.4), np.cos(np.pi * (phase - 0.4) / 0.6))
    for update in play(6 + 0.4 * chest + np.random.default_rng(1).normal(0, 0.002, len(chest)), FS_HZ)[40:]:
        assert update.signal_quality < 0.7
        assert any("as evenly as breaths" in reason for reason in update.reasons)


@pytest.mark.parametrize("period_s", [10.0, 15.0, 20.0])
def test_a_level_that_sways_is_no_skin(period_s):
    """By 2.5 uS up and down, as pressure or a cable does it: from 60 s on no quality of 0.7, and the reason."""
    t_s = np.arange(round(100 * FS_HZ)) / FS_HZ
    swing = 8 + 2.5 * np.sin(2 * np.pi * t_s / period_s) + np.random.default_rng(1).normal(0, 0.002, len(t_s))
    for update in play(swing, FS_HZ)[60:]:
        assert update.signal_quality < 0.7
        assert any("as evenly as breaths" in reason for reason in update.reasons)


@pytest.mark.parametrize("every_s", [4.0, 6.0, 10.0, 15.0])
def test_responses_as_even_as_breaths_are_skin(every_s):
    """Skin that answers a picture every few seconds is in no doubt: it rises faster than it falls."""
    onsets_s = np.arange(5.0, 85.0, every_s)
    samples = skin(SECONDS, FS_HZ, onsets_s, np.full(len(onsets_s), 0.4))
    updates = play(samples + np.random.default_rng(1).normal(0, 0.002, len(samples)), FS_HZ)[20:]
    assert min(update.signal_quality for update in updates) > 0.9


@pytest.mark.parametrize("fs_hz", [8.0, 128.0])
@pytest.mark.parametrize("kind", ["frames", "held"])
def test_short_losses_lower_the_quality(kind, fs_hz):
    """A tenth and a third of the quarter seconds that never came; a value held for 0.2 of the time, then 0.4."""
    n = round(120 * fs_hz)
    clean = skin(120, fs_hz, np.arange(8.0, 110.0, 13.0), np.full(8, 0.5)) + np.random.default_rng(2).normal(
        0, 0.002, n
    )
    means = []
    for share in (0.0, 0.2, 0.4):
        samples, frames = clean.copy(), np.arange(0, 120, 0.25)
        for begin_s in np.arange(4.0, 110.0, 8.0) if kind == "held" and share else ():
            samples[round(begin_s * fs_hz) : round((begin_s + 8 * share) * fs_hz)] = samples[round(begin_s * fs_hz)]
        lost = frames[np.random.default_rng(1).random(480) < share] if kind == "frames" else ()
        updates = play(samples, fs_hz, lost=[(at_s, at_s + 0.25) for at_s in lost])[60:]
        means.append(np.mean([update.signal_quality for update in updates]))
    assert means[0] > 0.95
    assert means[0] - 0.1 > means[1] > means[2] + 0.1, means


@pytest.mark.parametrize("sd_us", [0.02, 0.2, 2.0])
def test_noise_is_no_response(sd_us):
    """White noise on a steady level gives no response, however strong."""
    noise = 5.0 + np.cumsum(np.full(4500, 2e-5)) + np.random.default_rng(3).normal(0, sd_us, 4500)
    assert len(peaks_s(play(noise, FS_HZ))) == 0


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("fs_hz", [2.0, 3.0])
def test_noise_of_a_sensor_slower_than_the_grid_is_no_response(fs_hz, seed):
    """Three minutes of white noise of 1 % of the level: no response; under a tenth of it a wearer's ten are found."""
    dice = np.random.default_rng(seed)
    samples = round(180 * fs_hz)
    assert len(peaks_s(play(5.0 + dice.normal(0, 0.05, samples), fs_hz))) == 0
    wearer = skin(180, fs_hz, np.arange(20.0, 170.0, 15.0), [0.3] * 10)
    assert len(peaks_s(play(wearer + dice.normal(0, 0.005, samples), fs_hz))) == 10


@pytest.mark.parametrize("step_us", [0.02, 0.2])
@pytest.mark.parametrize("fs_hz", [4.0, 15.0, 32.0, 128.0])
def test_what_rises_in_a_random_walk_is_no_good_response(fs_hz, step_us):
    """Four minutes that wander by this much per root of a second: after 15 s nearly no response at quality 0.7."""
    dice = np.random.default_rng(7)
    walk = np.cumsum(dice.normal(0, step_us / np.sqrt(fs_hz), round(240 * fs_hz)))
    updates = play(walk - walk.min() + 5.0, fs_hz)[15:]
    good = [update for update in updates if update.signal_quality >= 0.7 and update.scr_peak_timestamps]
    assert len(peaks_s(updates)) >= 5
    assert len(peaks_s(good)) <= 2
    assert any("falls are as steep as rises" in reason for reason in updates[-1].reasons)


@pytest.mark.parametrize("fs_hz", [4.0, 15.0])
@pytest.mark.parametrize("height_us", [0.1, -0.4])
def test_skin_that_wanders_a_little_is_still_skin(fs_hz, height_us):
    """Responses every 12 s, also upside down, on noise and a level that wanders less: quality above 0.7."""
    dice = np.random.default_rng(8)
    onsets_s = np.arange(8.0, 170.0, 12.0)
    clean = skin(180, fs_hz, onsets_s, np.full(len(onsets_s), height_us))
    walk = np.cumsum(dice.normal(0, 0.003 / np.sqrt(fs_hz), len(clean)))
    updates = play(clean + walk + dice.normal(0, 0.003, len(clean)), fs_hz)[15:]
    assert min(update.signal_quality for update in updates) > 0.7


@pytest.mark.parametrize(
    ("fs_hz", "drift_us_per_min", "noise_us"),
    [(4.0, 0.3, 0.001), (4.0, 0.6, 0.003), (32.0, 0.3, 0.003)],
)
def test_a_slow_rise_with_a_little_noise_is_no_response(fs_hz, drift_us_per_min, noise_us):
    """Five minutes of a level that only creeps up, as skin that warms, have no response."""
    ramp = skin(300, fs_hz, [], [], drift_us_per_min=drift_us_per_min)
    ramp += np.random.default_rng(1).normal(0, noise_us, len(ramp))
    assert len(peaks_s(play(ramp, fs_hz))) == 0


@pytest.mark.parametrize("drift_us_per_min", [0.0, 0.1, 0.3, 0.6])
def test_small_responses_on_a_slow_rise_are_found(drift_us_per_min):
    """18 responses of 0.1 uS on a level that creeps up: each is told, and at most two that are none."""
    onsets_s = np.arange(20.0, 290.0, 15.0)
    wearer = skin(300, 16.0, onsets_s, np.full(18, 0.1), drift_us_per_min=drift_us_per_min)
    found = peaks_s(play(wearer + np.random.default_rng(1).normal(0, 0.001, len(wearer)), 16.0))
    assert len(found) <= 20
    assert all(((found > onset_s + 0.9) & (found < onset_s + 4.0)).any() for onset_s in onsets_s)


def test_a_pop_and_a_dip_are_no_responses():
    """One sample far off, a step, and a contact lost for half a second do not count."""
    samples = skin(SECONDS, FS_HZ, [], [], drift_us_per_min=0.3)
    samples[1000] += 4.0
    samples[2000:] += 0.5
    samples[(TIMES_S > 60) & (TIMES_S < 61)] -= 0.4
    assert len(peaks_s(play(samples, FS_HZ))) == 0


@pytest.mark.parametrize("held_s", [0.5, 5.0])
@pytest.mark.parametrize("height_us", [0.1, 1.0])
@pytest.mark.parametrize("takes_s", [0.5, 1.0])
def test_a_hand_that_presses_an_electrode_is_no_good_response(takes_s, height_us, held_s):
    """Up within takes_s and down again as fast, every 27 s: the reasons say so, and none has a good quality."""
    times_s = np.arange(180 * 50) / 50
    pressed = sum(
        np.interp(times_s, at_s + np.cumsum([0, takes_s, held_s, takes_s]), [0, height_us, height_us, 0])
        for at_s in np.arange(20.0, 170.0, 27.0)
    )
    noise = 0.002 * np.random.default_rng(5).standard_normal(len(times_s))
    late = play(5.0 + pressed + noise, 50.0)[40:]
    assert all(update.scr_count > 0 for update in late)
    assert not any(update.signal_quality >= 0.7 for update in late)
    assert all("as steep" in " ".join(update.reasons) for update in late)


def test_counts_give_events_but_no_microsiemens():
    """Of an uncalibrated channel come counts, rates and times; whatever would be in uS is NaN and says why."""
    last = play(400 * CLEAN, FS_HZ, unit="counts")[-1]
    assert last.scr_count == 3
    assert last.scr_rate_per_min == pytest.approx(3.0)
    assert np.isnan([last.tonic_us, last.scr_amplitude_us, last.phasic_auc_us_s]).all()
    assert any("uncalibrated" in reason for reason in last.reasons)


@pytest.mark.parametrize("late_s", [0.3, 0.4, 0.5])
@pytest.mark.parametrize("begins_s", [0.0, 60.0])
def test_what_had_begun_before_the_first_sample_is_no_response(begins_s, late_s):
    """A response of 1 uS whose first moments nobody saw, at the start or after a hole, is not told; the next one is."""
    onset_s = begins_s + 4.0
    samples = skin(begins_s + 40, FS_HZ, [onset_s, onset_s + 15], [1.0, 0.5])
    told = peaks_s(play(samples, FS_HZ, lost=[(begins_s - 1, onset_s + late_s)]))
    assert told == pytest.approx([onset_s + 15 + 1.45], abs=0.3)


def test_what_begins_soon_after_the_first_sample_is_a_response():
    """A response of 1 uS that begins half a second after the first sample is told, as high as it is."""
    updates = play(skin(40, FS_HZ, [0.5], [1.0], drift_us_per_min=0.3), FS_HZ)
    assert peaks_s(updates) == pytest.approx([1.95], abs=0.3)
    assert max(update.scr_amplitude_us for update in updates[20:]) == pytest.approx(1.0, rel=0.1)


def test_a_hole_hides_what_is_in_it_and_nothing_else():
    """Of 8 s that never came the response in them is missing; a response just before is told at once."""
    updates = play(CLEAN, FS_HZ, lost=[(42.0, 50.0)])
    np.testing.assert_allclose(peaks_s(updates), np.array([15.0, 40.0, 62.0, 75.0]) + 1.45, atol=0.7)


def test_a_response_is_told_also_where_a_hole_follows_an_update_at_once():
    """Its peak at 41.75 s, the last sample before 8 s that never came at 42 s, that of an update: it is told."""
    samples = skin(60, FS_HZ, [40.3], [0.5])
    updates = play(samples, FS_HZ, sizes=[1] * len(samples), lost=[(42.0 + 0.5 / FS_HZ, 50.0)])
    np.testing.assert_allclose(peaks_s(updates), [41.75], atol=0.3)


@pytest.mark.parametrize("fs_hz", [0.5, 10_000.0])
def test_a_rate_that_no_eda_has_is_refused(fs_hz):
    """One sentence that names the rate and what it must be."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .* must be 0 or 2 to 8000 for EDA"):
        EdaStream(Config(), StreamInfo(StreamName("p1", "eda", "s1"), fs_hz, "uS", ("eda",)))


@pytest.mark.parametrize("unit", ["kOhm", "Ohm", "MOhm", "k\u2126", "\u03a9"])
def test_a_resistance_is_refused(unit):
    """Resistance falls where skin responds, so it would have no responses: one sentence that says what is needed."""
    with pytest.raises(ValueError, match=r"unit is .*, a resistance: it falls where skin responds"):
        EdaStream(Config(), StreamInfo(StreamName("p1", "eda", "s1"), FS_HZ, unit, ("eda",)))


@pytest.mark.parametrize("fs_hz", [10.0, 100.0])
@pytest.mark.parametrize("step_us", [0.02, 0.05, 0.1])
def test_the_steps_of_a_coarse_converter_are_no_responses(step_us, fs_hz):
    """Three minutes of a level that only creeps up, in steps of the converter: no response; a high one is found."""
    ramp = skin(180, fs_hz, [], [], drift_us_per_min=0.5)
    ramp += np.random.default_rng(1).normal(0, 0.002, len(ramp))
    updates = play(np.round(ramp / step_us) * step_us, fs_hz)
    assert len(peaks_s(updates)) == 0
    assert any("are not told from it" in reason for reason in updates[-1].reasons)
    wearer = skin(180, fs_hz, np.arange(20.0, 170.0, 15.0), [10 * step_us] * 10, drift_us_per_min=0.1)
    assert len(peaks_s(play(np.round(wearer / step_us) * step_us, fs_hz))) == 10


@pytest.mark.parametrize("fs_hz", [4.0, 15.0, 100.0])
def test_of_a_response_that_leaves_the_range_the_height_is_not_told(fs_hz):
    """Cut at 0.6 and 0.75 of its height it is counted, its amplitude NaN, and those beside it are what they are."""
    samples = skin(100, fs_hz, [20.0, 40.0, 60.0, 80.0], [0.5, 1.0, 0.8, 0.5], drift_us_per_min=0.0)
    updates = play(np.minimum(samples, 5.6), fs_hz, range_min=0.0, range_max=5.6)
    amplitudes = np.array([a for update in updates for a in update.scr_amplitudes_us])
    np.testing.assert_allclose(amplitudes, [0.5, np.nan, np.nan, 0.5], atol=0.06)
    assert updates[-1].scr_amplitude_us == pytest.approx(0.5, abs=0.06)
    assert any("end of its range" in reason for reason in updates[-1].reasons)
