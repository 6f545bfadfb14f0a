"""No confident number that is wrong: hum, tremor and rhythms that are no heart; signals of tests/bench/ppg_trials."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from interpreter_ppg import features, jumps, lines, premature
from interpreter_ppg.doubts import JUMPS, SINE
from interpreter_ppg.stream import UNTOLD
from sense4hri.lasting import IN_DOUBT

TRIALS = Path(__file__).resolve().parents[2] / "bench" / "ppg_trials.py"
spec = importlib.util.spec_from_file_location("ppg_trials", TRIALS)
trials = importlib.util.module_from_spec(spec)
spec.loader.exec_module(trials)
LEVEL, PULSE = trials.LEVEL, trials.PULSE


def jitter_ms(updates, heart):
    return trials.jitter_ms(trials.seen_s(updates), heart)


def noise(t, counts=20):
    return counts * np.random.default_rng(0).normal(size=len(t))


@pytest.mark.parametrize("fs_hz", [28, 55])
@pytest.mark.parametrize("frequency_hz", [5, 8])
def test_a_sine_faster_than_hearts_has_no_rate(fs_hz, frequency_hz):
    """Waves nearer to each other than a heart can beat are none, whatever every second of them looks like."""
    t = np.arange(0, 60, 1 / fs_hz)
    assert not trials.confident(trials.play(LEVEL + PULSE * trials.sine(frequency_hz, t) + noise(t), fs_hz), 0.5)


def test_tremor_has_no_rate():
    """A 5 Hz tremor of wandering rate and strength has no rate; laid over pulses as large, none but the heart's."""
    t, heart = np.arange(0, 60, 1 / 55), trials.heart(60, 68)
    assert not trials.confident(trials.play(LEVEL + PULSE * trials.tremor(5, t), 55), 0.5)
    both = trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + trials.tremor(5, t)), 55)
    for update in trials.confident(both, 0.5):
        assert update.heart_rate_bpm == pytest.approx(heart.rate_bpm(trials.end_s(update) - 1), abs=5)


@pytest.mark.parametrize(("fs_hz", "frequency_hz"), [(25, 2.3), (55, 1.2), (64, 0.9), (130, 3.9)])
def test_a_flicker_as_fast_as_a_heart_has_no_sure_rate(fs_hz, frequency_hz):
    """A sensor off the skin sees lamps, folded to the rate of a heart: a wave without overtones is in doubt."""
    t = np.arange(0, 60, 1 / fs_hz)
    flicker = (1 + 0.5 * trials.sine(0.11, t)) * trials.sine(frequency_hz, t)
    updates = trials.play(LEVEL + PULSE * flicker + noise(t), fs_hz)
    assert not trials.confident(updates, 0.7)
    assert any("has no overtones" in reason for update in updates for reason in update.reasons)


def test_every_doubt_is_told_where_the_quality_is_low_anyway():
    """Where noise takes a flicker below 0.69, the reason stays: from the first doubt on every update tells it."""
    t = np.arange(0, 60, 1 / 55)
    updates = trials.play(LEVEL + PULSE * trials.sine(1.2, t) + noise(t, PULSE / 2), 55)
    told = [SINE in update.reasons for update in updates]
    after = updates[told.index(True) :]
    assert sum(update.signal_quality < IN_DOUBT for update in after) > len(after) / 2
    assert all(told[-len(after) :])


@pytest.mark.parametrize(("fs_hz", "frequency_hz"), [(25, 1.2), (64, 1.5), (130, 1.0)])
def test_a_lamp_that_jumps_each_time_has_no_sure_rate(fs_hz, frequency_hz):
    """Of a wave with a steep edge the level jumps with every one, as no pulse does: it is in doubt, and says why."""
    t = np.arange(0, 60, 1 / fs_hz)
    swell = 1 + 0.3 * trials.sine(0.11, t)
    updates = trials.play(LEVEL + PULSE * swell * (frequency_hz * t % 1) ** 2 + noise(t), fs_hz)
    assert not trials.confident(updates, 0.7)
    assert any(JUMPS in update.reasons for update in updates)


@pytest.mark.parametrize(("bpm", "second"), [(45, 0.6), (75, 0.0), (110, 0.0), (200, 0.0), (240, 0.35)])
def test_a_pulse_has_overtones(bpm, second):
    """The mean pulse of a heart has them, also where breathing moves level, height and intervals; a sine has none."""
    t, heart = np.arange(0, 9, 1 / 55), trials.heart(9, bpm, min(60, 3000 / bpm))
    breath = trials.sine(0.25, t)
    rises_s = heart.beats_s[(heart.beats_s > 0.5) & (heart.beats_s < 8.5)]
    ppg = (1 + 0.3 * breath) * trials.pulses(heart, t, (second, 0.47, 0.13)) + breath + noise(t, 0.05)
    assert features.overtones(ppg, t, rises_s) > 0.25
    assert features.overtones(trials.sine(bpm / 60, t) + noise(t, 0.05), t, np.arange(0.5, 8.5, 60 / bpm)) < 0.05
    assert np.isnan(features.overtones(ppg, t, rises_s[:2]))


@pytest.mark.parametrize("per_min", [25.8, 26.4])
def test_breathing_higher_than_the_pulse_is_no_heart(per_min):
    """A level that breathing moves by five times the pulse: slower than any heart, so never confident."""
    t, heart = np.arange(0, 90, 1 / 55), trials.heart(90, 52)
    breathing = 5 * trials.sine(per_min / 60, t)
    updates = trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + breathing), 55)
    assert all(update.heart_rate_bpm >= features.SLOWEST_BPM for update in trials.confident(updates, 0.7))
    assert any("breathing or movements" in reason for update in updates for reason in update.reasons)


@pytest.mark.parametrize("fs_hz", [55, 135])
def test_pops_of_one_sample_are_no_pulses(fs_hz):
    """Electrical pops at the rhythm of a heart give no pulse at all."""
    t = np.arange(0, 60, 1 / fs_hz)
    pops = np.diff(np.floor(1.2 * t), prepend=0.0)
    assert len(trials.seen_s(trials.play(LEVEL + PULSE * pops + noise(t), fs_hz))) <= 2


def jumping(t, counts, every_s=2.5):
    """Return levels that change by about so many counts within one sample, up and down, now and then."""
    random, levels, at_s = np.random.default_rng(6), np.zeros(len(t)), 3.0
    while at_s < t[-1]:
        levels[t >= at_s] += counts * random.choice([-1, 1]) * random.uniform(0.5, 1.5)
        at_s += every_s * random.uniform(0.3, 1.7)
    return levels


@pytest.mark.parametrize("fs_hz", [25, 64, 135])
def test_jumps_of_the_level_change_no_number(fs_hz):
    """A sensor that slips moves the level by several pulses within a sample: each pulse and number stays as without."""
    t, heart = np.arange(0, 60, 1 / fs_hz), trials.heart(60, 68)
    wave = LEVEL + PULSE * trials.pulses(heart, t) + noise(t, 5)
    level, jumped = trials.play(wave, fs_hz), trials.play(wave + jumping(t, 6 * PULSE), fs_hz)
    assert len(trials.seen_s(jumped)) == len(trials.seen_s(level))
    assert jumped[-1].hrv.rmssd_ms == pytest.approx(level[-1].hrv.rmssd_ms, abs=2)
    for with_jumps, without in zip(jumped, level, strict=True):
        if np.isfinite(without.heart_rate_bpm) and with_jumps.signal_quality >= 0.7:
            assert with_jumps.heart_rate_bpm == pytest.approx(without.heart_rate_bpm, abs=1)


@pytest.mark.parametrize("fs_hz", [20, 55, 176])
def test_levels_that_alternate_are_no_heart(fs_hz):
    """A contact that opens and closes every 1.1 s has no confident rate."""
    t = np.arange(0, 60, 1 / fs_hz)
    assert not trials.confident(trials.play(LEVEL + 50 * PULSE * ((0.9 * t).astype(int) % 2) + noise(t), fs_hz), 0.7)


def test_no_jump_is_taken_out_of_pulses():
    """Pulses of any rate stay as they are to the bit, also where they are only a few counts high."""
    for fs_hz in (20, 25, 55, 135, 176):
        t = np.arange(0, 9, 1 / fs_hz)
        for bpm, high in ((45, PULSE), (68, PULSE), (180, PULSE), (68, 3), (68, 12)):
            ppg = np.round(LEVEL + high * trials.pulses(trials.heart(9, bpm), t))
            assert jumps.taken_out(ppg, jumps.places(ppg, fs_hz)) is ppg


@pytest.mark.parametrize("bpm", [200, 240])
def test_a_fast_heart_keeps_its_rate(bpm):
    """What rejects tremor leaves hearts of 200 and 240 /min alone."""
    t, heart = np.arange(0, 60, 1 / 55), trials.heart(60, bpm, 8)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t), 55)
    near = [abs(u.heart_rate_bpm - heart.rate_bpm(trials.end_s(u) - 1)) < 10 for u in trials.confident(updates)]
    assert sum(near) > 0.9 * len(updates)


@pytest.mark.parametrize(
    ("mains_hz", "fs_hz", "off_hz"), [(60, 25, 0.05), (50, 28, 0), (50, 55, -0.05), (60, 64, 0.05)]
)
def test_hum_moves_no_number(mains_hz, fs_hz, off_hz):
    """Drifting mains of half the pulse's height, folded among the pulses, spoil no pulse from the first on."""
    t, heart = np.arange(0, 120, 1 / fs_hz), trials.heart(120, 68)
    pulses = trials.pulses(heart, t)
    clean = trials.play(LEVEL + PULSE * pulses, fs_hz)
    hum = trials.play(LEVEL + PULSE * (pulses + 0.5 * trials.mains(mains_hz, t, off_hz)), fs_hz)
    assert len(trials.seen_s(hum)) == len(trials.seen_s(clean))
    assert jitter_ms(hum, heart) < np.hypot(jitter_ms(clean, heart), 0.5)
    assert hum[-1].hrv.rmssd_ms == pytest.approx(clean[-1].hrv.rmssd_ms, abs=0.2)
    assert hum[-1].heart_rate_bpm == pytest.approx(clean[-1].heart_rate_bpm, abs=0.2)
    assert hum[-1].pulse_amplitude == pytest.approx(clean[-1].pulse_amplitude, rel=0.05)


@pytest.mark.parametrize("fs_hz", [64, 100, 135])
def test_hum_is_no_noise_of_the_samples(fs_hz):
    """Mains too fast to move a pulse cost no variability, even where they appear at half the sampling rate."""
    t, heart = np.arange(0, 60, 1 / fs_hz), trials.heart(60, 68)
    wave = trials.pulses(heart, t)
    clean, hum = (
        trials.play(LEVEL + PULSE * (wave + share * trials.mains(50, t, 0.05)), fs_hz)[-1] for share in (0.0, 0.5)
    )
    assert hum.hrv.rmssd_ms == pytest.approx(clean.hrv.rmssd_ms, abs=0.5)


def test_without_hum_nothing_is_taken_away():
    """Pulses alone, also where one of their overtones falls on a place of the mains, stay as they are to the bit."""
    t = np.arange(0, 9, 1 / 55)
    for bpm, rmssd_ms in ((60, 20), (75, 20), (68, 20), (72.3, 0.1), (75, 0.1)):
        ppg = PULSE * trials.pulses(trials.heart(9, bpm, rmssd_ms), t)
        assert lines.without_hum(ppg, 55.0) is ppg


@pytest.mark.parametrize(
    ("artefact", "share"),
    [("white", 0.1), ("white", 0.2), ("white", 0.4), ("bursts", 0.1), ("bursts", 0.2), ("bursts", 0.4)],
)
def test_noise_is_no_variability(artefact, share):
    """At quality 0.7 and more, noise up to two fifths of a pulse takes no rate by 5 /min and no RMSSD by 10 ms."""
    t, heart = np.arange(0, 90, 1 / 55), trials.heart(90, 68)
    updates = trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + share * getattr(trials, artefact)(t)), 55)
    for update in trials.confident(updates, 0.7):
        until_s = trials.end_s(update) - 1.2
        assert update.heart_rate_bpm == pytest.approx(heart.rate_bpm(until_s), abs=5)
        if np.isfinite(update.hrv.rmssd_ms):
            true_ms = trials.rmssd_ms(heart.beats_s[heart.beats_s <= until_s])
            assert update.hrv.rmssd_ms == pytest.approx(true_ms, abs=10)


@pytest.mark.parametrize(("fs_hz", "share"), [(28, 0.02), (55, 0.05), (135, 0.1)])
def test_the_noise_of_the_samples_says_how_surely_a_pulse_is_timed(fs_hz, share):
    """The jitter told of each pulse is the one it has, to a quarter; without noise there is none to speak of."""
    t, heart = np.arange(0, 40, 1 / fs_hz), trials.heart(40, 68)
    for noise_share, found_ms in ((share, None), (0.0, 0.5)):
        ppg = LEVEL + PULSE * (trials.pulses(heart, t) + noise_share * trials.white(t))
        found = trials.seen_s(trials.play(ppg, fs_hz))[5:]
        noise_rms = features.sample_noise(ppg, fs_hz)
        told_ms = 1e3 * np.median([features.jitter_s(noise_rms, ppg, t, time_s, fs_hz) for time_s in found])
        assert (
            told_ms == pytest.approx(trials.jitter_ms(found, heart), rel=0.25)
            if found_ms is None
            else told_ms < found_ms
        )


@pytest.mark.parametrize(("bpm", "hz"), [(55, 1.8), (68, 2.2), (90, 2.2), (120, 2.2)])
def test_steps_are_no_pulse(bpm, hz):
    """Steps as high as the pulse take no rate of quality 0.7 by 5 /min: with an accelerometer that sees them, never.

    Without one the first 9 s are left out: it takes that long to tell two rhythms apart.
    """
    t, heart = np.arange(0, 120, 1 / 55), trials.heart(120, bpm)
    ppg = LEVEL + PULSE * (trials.pulses(heart, t) + trials.walking(hz, t))
    for moved, from_s in ((None, 9.0), (trials.acceleration(hz, t), 0.0)):
        sure = [u for u in trials.confident(trials.play(ppg, 55, moved=moved), 0.7) if trials.end_s(u) > from_s]
        assert all(abs(u.heart_rate_bpm - heart.rate_bpm(trials.end_s(u) - 1.2)) < 5 for u in sure)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_heart_in_fibrillation_has_no_sure_rate_that_is_wrong(seed):
    """Early beats have low pulses, some too low to be seen: the rate is up to 19 /min too low, and in doubt."""
    rr_s = np.random.default_rng(seed).normal(0.55, 0.12, 200).clip(0.3, 1.0)
    beats_s = 0.3 + np.cumsum(rr_s)
    t, heart = np.arange(0, 100, 1 / 55), trials.Heart(beats_s)
    ppg = trials.pulses(heart, t, heights=(rr_s / np.median(rr_s)).clip(0.25, 1.3))
    updates = trials.play(LEVEL + PULSE * ppg + noise(t), 55)
    for update in trials.confident(updates, 0.7):
        assert update.heart_rate_bpm == pytest.approx(heart.rate_bpm(trials.end_s(update) - 1.2), abs=5)
    assert any("the intervals have no order" in reason for update in updates for reason in update.reasons)


def test_intervals_that_alternate_are_those_of_two_rhythms():
    """Two beats in the time of three steps leave long and short intervals in turn; a heart without order does not."""
    assert features.alternate(np.array([914, 1308, 490, 864, 515, 855, 503, 844, 508, 841, 520, 849, 524.0]))
    irregular = np.random.default_rng(0).normal(800, 160, 400)
    assert not any(features.alternate(irregular[start : start + 12]) for start in range(0, 388, 4))
    assert not features.alternate(np.array([np.nan, 800.0]))


def test_a_pulse_that_vanishes_is_doubted_where_others_are_unlike():
    """Two rhythms near each other cancel now and then; one low pulse among good ones is a deep breath."""
    heights, trusted = np.ones(20), np.ones(20, bool)
    heights[7] = 0.3
    assert not features.vanishes(heights, trusted)
    trusted[6:9] = False
    assert features.vanishes(heights, trusted)
    assert not features.vanishes(np.ones(20), trusted)


@pytest.mark.parametrize(("bpm", "hz"), [(90, 1.6), (120, 1.8), (55, 2.0)])
def test_what_looks_like_pulses_for_a_moment_has_no_sure_rate(bpm, hz):
    """Steps as high as the pulse are alike for an update or two, also in the first seconds, and 9 to 66 /min off."""
    t, heart = np.arange(0, 120, 1 / 55), trials.heart(120, bpm, 25 if bpm < 100 else 10)
    updates = trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + trials.walking(hz, t)), 55)
    for update in trials.confident(updates, 0.7):
        assert abs(update.heart_rate_bpm - heart.rate_bpm(trials.end_s(update) - 1.2)) < 5
    assert any("good for less than 2 s" in reason for update in updates for reason in update.reasons)


@pytest.mark.parametrize(("bpm", "times"), [(60, 2.2), (85, 1.725)])
def test_steps_from_the_first_second_on_are_no_pulse(bpm, times):
    """Four times as high as the pulse, and before the accelerometer has told its rhythm, they get no sure rate."""
    t, heart = np.arange(0, 15, 1 / 55), trials.heart(15, bpm)
    hz = times * bpm / 60
    ppg = LEVEL + PULSE * (trials.pulses(heart, t) + 4 * trials.walking(hz, t))
    assert not trials.confident(trials.play(ppg, 55, moved=trials.acceleration(hz, t)), 0.7)


def test_motion_beside_a_clean_pulse_costs_little():
    """An arm that swings at another rate than the heart's leaves clean pulses their quality; at the heart's, not."""
    t, heart = np.arange(0, 40, 1 / 55), trials.heart(40, 68)
    ppg = LEVEL + PULSE * trials.pulses(heart, t)
    other, same = (trials.play(ppg, 55, moved=trials.acceleration(hz, t))[10:] for hz in (1.9, 68 / 60))
    assert min(update.signal_quality for update in other) > 0.9
    assert max(update.signal_quality for update in same) < 0.7
    assert "signal_quality: the device moves at the rate of the pulses" in same[-1].reasons


def test_the_lowest_rate_is_a_rate():
    """At exactly 20 Hz pulses are found, and no reason speaks of the rate."""
    t, heart = np.arange(0, 40, 1 / 20), trials.heart(40, 68)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t), 20, frame=5)
    assert len(trials.confident(updates)) > 30
    assert not any("below 20 Hz" in reason for update in updates for reason in update.reasons)


def test_one_sample_that_is_no_number_says_nothing_of_the_signal():
    """A single NaN is drawn over: the signal is neither flat nor without rate."""
    t, heart = np.arange(0, 40, 1 / 55), trials.heart(40, 68)
    ppg = LEVEL + PULSE * trials.pulses(heart, t)
    ppg[1100] = np.nan
    updates = trials.play(ppg, 55)
    assert not any("flat" in reason for update in updates for reason in update.reasons)
    assert np.isfinite([update.heart_rate_bpm for update in updates[10:]]).all()


def surely_off(updates, heart):
    """Updates at quality 0.7 and more whose rate is more than 5 /min off, and those that speak of two rhythms.

    The first 9 s are left out: it takes that long to tell two rhythms apart.
    """
    sure = [update for update in trials.confident(updates, 0.7) if trials.end_s(update) > 9]
    off = [u for u in sure if abs(u.heart_rate_bpm - heart.rate_bpm(trials.end_s(u) - 1)) > 5]
    return off, [u for u in updates if "signal_quality: two rhythms, the pulse may be the other one" in u.reasons]


@pytest.mark.parametrize(("bpm", "height", "at_s"), [(75, 0.7, 0.6), (75, 1, 0.6), (75, 1.3, 0.6), (95, 1, 0.5)])
def test_a_second_wave_as_high_as_the_first_doubles_no_sure_rate(bpm, height, at_s):
    """Half a period after the first it is told from a heart twice as fast, even where the two are alike."""
    t, heart = np.arange(0, 40, 1 / 55), trials.heart(40, bpm, 20)
    wave = trials.pulses(heart, t, (height, at_s, 0.085))
    off, doubtful = surely_off(trials.play(LEVEL + PULSE * wave + noise(t), 55), heart)
    assert not off
    assert len(doubtful) > 25


@pytest.mark.parametrize(
    ("bpm", "seed", "wave"), [(84, 1, (0.9, 0.55, 0.1)), (78, 2, (0.9, 0.6, 0.1)), (72, 1, (0.8, 0.55, 0.085))]
)
def test_a_second_wave_nearly_as_high_takes_no_sure_rate_now_and_then(bpm, seed, wave):
    """What was seen of two waves holds while pulses from that time are told, also of single beats that are split."""
    t, heart = np.arange(0, 120, 1 / 55), trials.heart(120, bpm, 25, seed)
    off, _ = surely_off(trials.play(LEVEL + PULSE * trials.pulses(heart, t, wave) + noise(t), 55), heart)
    assert not off


def test_a_heart_that_turns_twice_as_fast_is_no_split_beat():
    """Equal intervals of half the usual length are a faster heart, unequal ones a beat of two waves."""
    usual_ms, trusted = [800.0] * 8, np.ones(12, bool)
    for rest_ms, doubled in (((400.0,) * 4, False), ((350.0, 450.0) * 2, True), ((350.0, np.nan, 450.0, 800.0), False)):
        assert features.doubled(np.array([*usual_ms, *rest_ms]), trusted) == doubled
    assert not features.doubled(np.array([*usual_ms, 350.0, 450.0, 350.0, 450.0]), ~trusted)


@pytest.mark.parametrize("times", [1.5, 2, 3])
@pytest.mark.parametrize("height", [0.6, 1, 2])
def test_a_faster_motion_is_no_sure_rate(times, height):
    """Without an accelerometer, what swings faster than the heart and as high as it is no rate of quality 0.7."""
    t, heart = np.arange(0, 40, 1 / 55), trials.heart(40, 75)
    for motion in (trials.sine(times * 1.25, t), 2 * trials.walking(times * 1.25, t)):
        off, _ = surely_off(trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + height * motion), 55), heart)
        assert not off


@pytest.mark.parametrize(("bpm", "times"), [(55, 1.25), (75, 1.25), (75, 0.7), (95, 0.7)])
@pytest.mark.parametrize("height", [1, 2])
def test_a_motion_nearly_as_fast_as_the_heart_is_no_sure_rate(bpm, times, height):
    """Too near for two lines, and told in the heart's place: what is left without its waves beats at another rate."""
    t, heart = np.arange(0, 40, 1 / 55), trials.heart(40, bpm)
    steps = 2 * height * trials.walking(times * bpm / 60, t)
    off, doubtful = surely_off(trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + steps), 55), heart)
    assert not off
    assert len(doubtful) > 20


def test_two_rhythms_leave_no_variability():
    """What was told while a motion hid the pulse is not among the intervals of the minute after it."""
    t, heart = np.arange(0, 120, 1 / 55), trials.heart(120, 75)
    motion = np.where((t > 30) & (t < 60), 2 * trials.sine(2.5, t), 0.0)
    last = trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + motion), 55)[-1]
    assert last.signal_quality > 0.9
    assert last.hrv.rmssd_ms == pytest.approx(heart.rmssd_ms, abs=10)


@pytest.mark.parametrize(("bpm", "rmssd_ms"), [(50, 100), (65, 90)])
def test_breathing_is_an_order_of_intervals(bpm, rmssd_ms):
    """A rested heart whose intervals breathing changes by a tenth from one to the next has a sure rate."""
    t, heart = np.arange(0, 60, 1 / 55), trials.heart(60, bpm, rmssd_ms)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t) + noise(t), 55)
    assert min(update.signal_quality for update in updates[10:]) > 0.7


def ramp(*parts):
    """Return a heart whose rate goes to each 1/min within so many s, straight, from the first one on."""
    lasts_s, rates_bpm = zip(*parts, strict=True)
    times_s, beats_s = np.cumsum(lasts_s), [0.3]
    while beats_s[-1] < times_s[-1] + 2:
        beats_s.append(beats_s[-1] + 60 / np.interp(beats_s[-1], times_s, rates_bpm))
    return trials.Heart(np.array(beats_s))


def variability_of(heart, until_s):
    """Return the updates of quality 0.7 and more that tell an RMSSD, and how far each of them is off, ms."""
    t = np.arange(0, until_s, 1 / 55)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t) + noise(t), 55)
    told = [update for update in trials.confident(updates, 0.7) if np.isfinite(update.hrv.rmssd_ms)]
    true_ms = [trials.rmssd_ms(heart.beats_s[heart.beats_s <= trials.end_s(update) - 1.2]) for update in told]
    return updates, np.array([update.hrv.rmssd_ms for update in told]) - true_ms


@pytest.mark.parametrize(
    "heart",
    [
        ramp((0, 120), (40, 120), (5, 45), (60, 45)),
        ramp((0, 70), (40, 70), (4, 150), (20, 150), (4, 70), (60, 70)),
    ],
    ids=["falls", "rises and falls"],
)
def test_a_rate_that_changes_fast_leaves_no_variability_too_small(heart):
    """Its pulses are not sure, so the differences would be missing: there is no RMSSD from then on, and a reason."""
    updates, off_ms = variability_of(heart, 105)
    assert (np.abs(off_ms) <= 10).all()
    assert any("the rate changed while no pulse was sure enough" in reason for reason in updates[-1].reasons)


def test_a_rate_that_changes_slowly_keeps_its_variability():
    """From 60 to 90 /min within 10 s every pulse is sure: RMSSD is told, and right."""
    updates, off_ms = variability_of(ramp((0, 60), (40, 60), (10, 90), (30, 90)), 80)
    assert (np.abs(off_ms) <= 10).all()
    assert np.isfinite(updates[-1].hrv.rmssd_ms)


@pytest.mark.parametrize(("early", "height"), [(0.8, 0.7), (0.75, 0.5), (0.55, 0.5), (0.65, 0.0)])
def test_premature_beats_are_no_variability(early, height):
    """One beat in ten comes early with a lower pulse, or none: RMSSD of what is told is that of the normal beats."""
    t, heart = np.arange(0, 70, 1 / 55), trials.premature(70, 78, 0.1, early, height)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t, heights=heart.heights) + noise(t), 55)
    told_ms = [update.hrv.rmssd_ms for update in updates if np.isfinite(update.hrv.rmssd_ms)]
    assert len(told_ms) > 10
    np.testing.assert_allclose(told_ms, heart.rmssd_ms, atol=10)


@pytest.mark.parametrize(("bpm", "early", "height"), [(78, 0.75, 1), (58, 0.75, 0.8), (58, 0.8, 1), (58, 0.85, 0.6)])
def test_premature_beats_with_pulses_as_high_are_no_variability(bpm, early, height):
    """Of a beat that comes early with a pulse hardly lower than the others the intervals tell: RMSSD is not theirs."""
    t, heart = np.arange(0, 70, 1 / 55), trials.premature(70, bpm, 0.1, early, height)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t, heights=heart.heights) + noise(t), 55)
    told_ms = [u.hrv.rmssd_ms for u in trials.confident(updates, 0.7) if np.isfinite(u.hrv.rmssd_ms)]
    assert len(told_ms) > 10
    np.testing.assert_allclose(told_ms, heart.rmssd_ms, atol=10)


@pytest.mark.parametrize(("bpm", "early", "height"), [(78, 0.75, 1), (58, 0.85, 0.6)])
def test_rmssd_does_not_hang_on_a_newest_beat_that_may_be_premature(bpm, early, height):
    """Until the next one is there RMSSD may be 6.6 and 8.4 ms off: it is withheld for that update, with the reason."""
    t, heart = np.arange(0, 70, 1 / 55), trials.premature(70, bpm, 0.1, early, height)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t, heights=heart.heights) + noise(t), 55)
    told_ms = [u.hrv.rmssd_ms for u in trials.confident(updates, 0.7) if np.isfinite(u.hrv.rmssd_ms)]
    np.testing.assert_allclose(told_ms, heart.rmssd_ms, atol=3)
    untold = [u for u in updates if f"hrv: {UNTOLD}" in u.reasons]
    assert untold
    assert not any(np.isfinite(u.hrv.rmssd_ms) for u in untold)


def test_a_breath_that_quickens_several_beats_makes_none_premature():
    """The trough of a deep breath of a real wearer (Verity Sense) has shoulders; a beat a fifth early has none."""
    steady = [1210.0, 1225, 1205, 1230, 1215, 1200, 1220, 1235] * 2
    for middle, early in (([1231, 1124, 956, 1124, 1268], False), ([1231, 1224, 980, 1440, 1228], True)):
        rr_ms = np.array([*steady, *middle, *steady])
        linked = np.arange(len(rr_ms)) > 0
        assert premature.by_timing(rr_ms, linked).any() == early
        assert premature.by_timing(rr_ms[:19], linked[:19]).any() == early


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_taps_on_the_sensor_are_no_variability(seed):
    """A tap as long as a pulse and three times as high is told by its height, though its shape is that of a pulse."""
    t, heart = np.arange(0, 120, 1 / 55), trials.heart(120, 75)
    taps_s = np.arange(5, 115, 7) + np.random.default_rng(seed).uniform(0, 2, 16)
    after = t[:, None] - taps_s
    taps = np.where(np.abs(after) < 0.2, np.cos(np.pi * after / 0.4) ** 2, 0.0).sum(1)
    updates = trials.play(LEVEL + PULSE * (trials.pulses(heart, t) + 3 * taps) + noise(t), 55)
    told = [update for update in trials.confident(updates, 0.7) if np.isfinite(update.hrv.rmssd_ms)]
    assert len(told) > 20
    np.testing.assert_allclose([update.hrv.rmssd_ms for update in told], heart.rmssd_ms, atol=10)


@pytest.mark.parametrize(("bpm", "per_s"), [(62, 0.17), (80, 0.25)])
def test_pulses_that_breathing_takes_away_are_no_variability(bpm, per_s):
    """Where every breath hides a pulse the interval without it is twice the usual one: RMSSD is that of the others."""
    t, heart = np.arange(0, 100, 1 / 55), trials.heart(100, bpm, 40)
    heights = 1 + 0.95 * trials.sine(per_s, heart.beats_s)
    updates = trials.play(LEVEL + PULSE * trials.pulses(heart, t, heights=heights) + noise(t), 55)
    told_ms = np.array([update.hrv.rmssd_ms for update in updates])
    assert (np.abs(told_ms[np.isfinite(told_ms)] - heart.rmssd_ms) <= 10).all()


def test_breathing_makes_no_beat_premature():
    """Deep breaths that shorten intervals and halve pulses at once keep their variability."""
    t, heart = np.arange(0, 90, 1 / 55), trials.heart(90, 65, 90)
    ppg = trials.pulses(heart, t) * (1 + 0.4 * trials.sine(0.25, t))
    last = trials.play(LEVEL + PULSE * ppg + noise(t), 55)[-1]
    assert last.hrv.corrected_count == 0
    assert last.hrv.rmssd_ms == pytest.approx(heart.rmssd_ms, abs=10)


@pytest.mark.parametrize("bpm", [45, 60, 75, 95, 130, 170])
def test_one_heart_is_one_rhythm(bpm):
    """Breathing in level, height and intervals, at any rate, makes no second rhythm."""
    t, heart = np.arange(0, 40, 1 / 55), trials.heart(40, bpm, min(60, 3000 / bpm))
    breath = trials.sine(0.25, t)
    for ppg in (trials.pulses(heart, t), trials.pulses(heart, t) * (1 + 0.3 * breath) + breath):
        assert not surely_off(trials.play(LEVEL + PULSE * ppg + noise(t), 55), heart)[1]
