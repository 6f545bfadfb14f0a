"""Breathing with known truth, and what is published where there is none."""

import numpy as np
import pytest
from breathing_signals import belt
from interpreter_respiration.config import Config
from interpreter_respiration.features import autocorrelation, rmssd_ms
from interpreter_respiration.stream import RespirationStream
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import T0_NS, event_times_s, falling_noise
from slow_signals import play as play_signal

FS_HZ, SECONDS = 25.0, 120
TIMES_S = np.arange(round(SECONDS * FS_HZ)) / FS_HZ
NUMBERS = ("breaths_per_min", "period_s", "rrv_rmssd_ms", "amplitude", "inhale_exhale_ratio")


CLEAN = belt(TIMES_S)


def play(samples, fs_hz=FS_HZ, config=None, **options):
    """Updates of a belt."""
    return play_signal(
        lambda info: RespirationStream(config or Config(), info), samples, fs_hz, "respiration", "a.u.", **options
    )


def breaths_s(updates):
    """When the breaths that were told have their peaks."""
    return event_times_s(updates, "breath_timestamps")


def is_withheld(update):
    return all(np.isnan(getattr(update, name)) for name in NUMBERS)


@pytest.mark.parametrize(("per_min", "fs_hz"), [(6.0, 10.0), (12.0, 17.86), (20.0, 100.0), (40.0, 50.0)])
def test_rate_and_times_are_those_of_the_breaths(per_min, fs_hz):
    """From 6 to 40 breaths per min at any rate: times within 0.3 s, rate within 2 %, height and ratio as they are."""
    times_s = np.arange(round(90 * fs_hz)) / fs_hz
    updates = play(belt(times_s, per_min), fs_hz)
    last, told = updates[-1], breaths_s(updates)
    truth = (np.arange(200) + 0.4) * 60 / per_min
    truth = truth[(truth > told[0] - 1) & (truth < told[-1] + 1)]
    np.testing.assert_allclose(told, truth, atol=0.3)
    assert last.breaths_per_min == pytest.approx(per_min, rel=0.02)
    assert last.period_s == pytest.approx(60 / per_min, rel=0.02)
    assert last.rrv_rmssd_ms < 150
    if per_min <= 20:
        assert last.amplitude == pytest.approx(2.0, rel=0.15)
        assert last.inhale_exhale_ratio == pytest.approx(0.4 / 0.6, rel=0.35)
    assert last.signal_quality > 0.8


@pytest.mark.parametrize("rest", [0.0, 0.4])
@pytest.mark.parametrize("inhale", [0.25, 0.33, 0.5])
@pytest.mark.parametrize("per_min", [6.0, 15.0, 20.0])
def test_the_ratio_is_that_of_the_breath_however_it_is_shaped(per_min, inhale, rest):
    """Quick inspirations, slow expirations, pauses: inspirations last as they do, to 0.2 s and 2 % of the breath."""
    phase = TIMES_S * per_min / 60 % 1
    falling = np.cos(np.pi * np.minimum((phase - inhale) / (1 - inhale) / (1 - rest), 1))
    chest = np.where(phase < inhale, -np.cos(np.pi * phase / inhale), falling)
    ratio = play(chest + np.random.default_rng(2).normal(0, 0.01, len(chest)))[-1].inhale_exhale_ratio
    period_s = 60 / per_min
    assert ratio / (1 + ratio) * period_s == pytest.approx(inhale * period_s, abs=0.2 + 0.02 * period_s)


def test_a_held_breath_is_no_expiration():
    """Of 25 s without a breath nothing is told, so they are part of no expiration either."""
    breathing_s = np.where(TIMES_S < 49, np.minimum(TIMES_S, 24.0), TIMES_S - 25)
    held = belt(breathing_s) + np.random.default_rng(2).normal(0, 0.01, len(TIMES_S))
    sure = [update for update in play(held) if update.signal_quality >= 0.7 and update.window_s > 55]
    assert len(sure) > 20
    np.testing.assert_allclose([update.inhale_exhale_ratio for update in sure], 0.4 / 0.6, rtol=0.25)


@pytest.mark.parametrize("heights", [1.5, 3.0])
@pytest.mark.parametrize("per_min", [15.0, 22.0])
def test_a_shift_of_posture_that_hides_a_breath_changes_no_rate(per_min, heights):
    """The level of a belt moves by some breaths' height within 2 s, four times: every sure rate is within 1 /min."""
    shifts = sum(
        side * heights * (1 + np.tanh(2 * (TIMES_S - at_s)))
        for side, at_s in zip((1, -1, 1, -1), (35, 52, 71, 88), strict=True)
    )
    updates = play(belt(TIMES_S, per_min) + shifts)
    sure = [update.breaths_per_min for update in updates[15:] if update.signal_quality >= 0.7]
    assert len(breaths_s(updates)) < per_min / 60 * (SECONDS - 6)
    assert sure
    np.testing.assert_allclose(sure, per_min, atol=1.0)


def test_breaths_are_told_once_in_order_and_within_10_s():
    """No breath twice, none late, and the count of the window is theirs."""
    updates = play(CLEAN)
    told = breaths_s(updates)
    assert (np.diff(told) > 3).all()
    for update in updates:
        for time_ns in update.breath_timestamps:
            assert 0 < update.device_ns - time_ns <= 10e9
    end_s = (updates[-1].device_ns - T0_NS) / 1e9
    assert updates[-1].breath_count == np.count_nonzero(told > end_s - 60)


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One belt, with a hole, in frames of one, of 7 and of random sizes gives the same updates."""
    samples = CLEAN + np.random.default_rng(1).normal(0, 0.02, len(CLEAN))
    samples[1500:1600] = np.nan
    sizes = ([1] * 3000, [7] * 430, np.random.default_rng(2).integers(1, 40, 600).tolist())
    texts = [repr([update._replace(received_ns=0) for update in play(samples, sizes=cut)]) for cut in sizes]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 1000


def test_breaths_that_were_told_count_after_a_moment_of_which_nothing_is():
    """A belt that is still for 20 s, then breathes again: the breaths before count, no period is measured across."""
    phase_s = np.where(TIMES_S < 50, TIMES_S, np.maximum(50, TIMES_S - 20))
    still = belt(phase_s) + np.random.default_rng(0).normal(0, 0.02, len(TIMES_S))
    updates = play(still)
    told = breaths_s(updates)
    assert updates[68].breath_count == -1
    again = [update for update in updates[69:] if update.breath_count >= 0]
    assert len(again) >= 48
    for update in again:
        end_s = (update.device_ns - T0_NS) / 1e9
        so_far = told[told < end_s - 5.0]
        assert update.breath_count >= np.count_nonzero(so_far > end_s - 60)
        assert update.breaths_per_min == pytest.approx(15.0, rel=0.02)


@pytest.mark.parametrize(("begin_s", "end_s", "hidden_s"), [(69.0, 70.5, 69.6), (70.0, 73.9, 73.6), (63.0, 67.0, 65.6)])
def test_no_period_is_measured_across_what_is_no_number(begin_s, end_s, hidden_s):
    """NaN for more than a second hides a breath: those 2 s before it are told, and the rate is that of the others."""
    samples = CLEAN.copy()
    samples[round(begin_s * FS_HZ) : round(end_s * FS_HZ)] = np.nan
    updates = play(samples)
    truth_s = np.arange(5.6, 111.0, 4.0)
    told, clear = breaths_s(updates), np.abs(truth_s - hidden_s) > 0.1
    clear &= ~((truth_s > end_s) & (truth_s < end_s + 4.0)) & ~((truth_s > begin_s - 2.0) & (truth_s < begin_s))
    assert all(np.abs(told - at_s).min() < 0.3 for at_s in truth_s[clear])
    rates = [update.breaths_per_min for update in updates if np.isfinite(update.breaths_per_min)]
    np.testing.assert_allclose(rates, 15.0, rtol=0.02)
    assert len(rates) > 70
    assert max(update.rrv_rmssd_ms for update in updates if np.isfinite(update.rrv_rmssd_ms)) < 150


def test_autocorrelation_takes_the_shortest_period():
    """Of a wave that repeats every 4 s the period is 4 s, not 8; a constant has none."""
    period_s, likeness = autocorrelation(np.sin(np.arange(600) / 10 * 2 * np.pi / 4))
    assert period_s == pytest.approx(4.0, abs=0.1)
    assert likeness > 0.9
    assert np.isnan(autocorrelation(np.zeros(600))[0])


def test_variability_is_that_of_the_periods():
    """Periods of 4, 5, 4 s differ by 1 s; across a hole nothing is measured; two periods are too few."""
    assert rmssd_ms(np.array([4.0, 5.0, 4.0])) == pytest.approx(1000.0)
    assert np.isnan(rmssd_ms(np.array([4.0, np.nan, 5.0])))
    assert np.isnan(rmssd_ms(np.array([4.0, 5.0])))


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.full(3000, 512.0), "nothing but noise"),
        (512.0 + np.random.default_rng(0).normal(0, 2.0, 3000), "nothing but noise"),
        (np.full(3000, np.nan), "no number"),
        (np.where(TIMES_S < 60, 512 + 100 * CLEAN, 1020.0), "saturated"),
    ],
    ids=["constant", "lifted", "nan", "saturated"],
)
def test_what_is_no_breathing_is_told(samples, word):
    """A belt lifted, saturated, or without a number: NaN, quality 0, and the reason."""
    options = {"range_min": 0.0, "range_max": 1023.0} if word == "saturated" else {}
    last = play(samples, **options)[-1]
    assert is_withheld(last)
    assert (last.breath_count, last.signal_quality) == (-1, 0.0)
    assert any(word in reason for reason in last.reasons), last.reasons


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_noise_has_no_breathing_rate(seed):
    """White noise never has a rate; a random walk in at most one update of ten."""
    random = np.random.default_rng(seed)
    assert all(is_withheld(update) for update in play(random.normal(size=3000)))
    walk = play(np.cumsum(random.normal(size=3000)))
    assert np.mean([not is_withheld(update) for update in walk]) <= 0.1


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [2.0, 2.5, 3.0])
def test_what_wanders_is_no_sure_breathing(exponent):
    """Noise that falls with f^2 to f^3, 16 times 4 min: never a rate with a quality of 0.7; it is told."""
    updates = [update for seed in range(16) for update in play(falling_noise(exponent, 240 * 25, seed))]
    assert not [u for u in updates if u.signal_quality >= 0.7 and np.isfinite(u.breaths_per_min)]
    assert any("wanders from breath to breath" in reason for update in updates for reason in update.reasons)


def test_few_breaths_are_no_sure_rhythm():
    """Of 15 breaths a minute a quality of 0.7 needs three periods in the window, a full one four."""
    quality = [update.signal_quality for update in play(CLEAN)[:20]]
    assert 0.4 < quality[11] < 0.7
    assert quality[17] > 0.95


def test_a_belt_that_drifts_still_breathes():
    """Breaths on a level that drifts by two of their heights a minute, up and down, keep their quality."""
    drift = 2.0 * np.sin(2 * np.pi * TIMES_S / 60)
    assert play(CLEAN + drift)[-1].signal_quality > 0.9


@pytest.mark.parametrize("noise", [1.0, pytest.param(10.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("hold_s", [1.5, 2.0, 3.0, 4.0, 6.0])
def test_levels_that_change_at_random_are_no_breaths(hold_s, noise):
    """Ten minutes of steps as high and as slow as breaths: never a rate with a quality of 0.7, and the reason."""
    random, fs_hz = np.random.default_rng(7), 25.0
    levels = np.repeat(random.normal(0, 100, round(600 / hold_s)), int(hold_s * fs_hz))
    updates = play(levels + random.normal(0, noise, len(levels)), fs_hz)
    assert not [u for u in updates if u.signal_quality >= 0.7 and np.isfinite(u.breaths_per_min)]
    assert any("steps from level to level" in reason for reason in updates[-1].reasons)


def test_short_breaths_are_no_steps():
    """20 breaths a minute, in within 0.6 and out within 1 s, then nothing: told, with good quality."""
    times_s = np.arange(0, 120, 0.04)
    phase_s = times_s % 3.0
    rising, falling = 0.5 - 0.5 * np.cos(np.pi * phase_s / 0.6), 0.5 + 0.5 * np.cos(np.pi * (phase_s - 0.6))
    breathing = np.where(phase_s < 0.6, rising, np.where(phase_s < 1.6, falling, 0.0))
    last = play(100 * breathing + np.random.default_rng(3).normal(0, 1, len(times_s)), 25.0)[-1]
    assert last.breaths_per_min == pytest.approx(20, abs=0.2)
    assert last.signal_quality > 0.9


def test_a_hole_hides_what_is_in_it_and_nothing_else():
    """6 s that never came: breaths before and after are told, and no period is measured across."""
    updates = play(CLEAN, lost=[(60.0, 66.0)])
    told = breaths_s(updates)
    assert not ((told > 60.2) & (told < 66)).any()
    assert ((told > 50) & (told < 60)).sum() >= 2
    assert ((told > 66) & (told < 110)).sum() >= 9
    assert updates[-1].breaths_per_min == pytest.approx(15.0, rel=0.03)


def test_a_breath_is_told_also_where_a_hole_follows_an_update_at_once():
    """Of 4 s each, with 12 s that never came after the sample of an update: all before are told."""
    updates = play(CLEAN, sizes=[1] * len(CLEAN), lost=[(60.02, 72.0)])
    told = breaths_s(updates)
    np.testing.assert_allclose(told[(told > 30) & (told < 61)], np.arange(33.6, 58.0, 4.0), atol=0.3)


@pytest.mark.parametrize("fs_hz", [1.0, 20_000.0])
def test_a_rate_without_breaths_is_refused(fs_hz):
    """One sentence that names the rate and what it must be."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .* must be 0 or 5 to 8000 for breaths"):
        RespirationStream(Config(), StreamInfo(StreamName("p1", "respiration", "s1"), fs_hz, "a.u.", ("respiration",)))


@pytest.mark.parametrize("hz", [50.03, 59.97])
def test_mains_greater_than_the_breaths_are_told_as_such(hz):
    """Hum three times as high as the breaths: nothing is told, and the belt is not called lifted; one of noise is."""
    fs_hz = 100.0
    times_s = np.arange(round(90 * fs_hz)) / fs_hz
    updates = play(belt(times_s, 12.0) + 6 * np.sin(2 * np.pi * hz * times_s), fs_hz)
    assert all(is_withheld(update) and update.signal_quality == 0 for update in updates[15:])
    assert all("mains" in update.reasons[0] for update in updates[30:])
    noise = play(np.random.default_rng(1).normal(size=len(times_s)), fs_hz)
    assert all("not worn" in update.reasons[0] for update in noise[15:])


@pytest.mark.parametrize(("per_min", "rise", "fall"), [(4.0, 0.2, 0.3), (5.0, 0.2, 0.3), (6.0, 0.15, 0.25)])
def test_a_pause_after_slow_breaths_is_no_breath(per_min, rise, fall):
    """4 to 6 breaths of 100 a minute, then nothing for half of the time: every sure rate and height is theirs."""
    times_s = np.arange(round(240 * FS_HZ)) / FS_HZ
    phase = times_s * per_min / 60 % 1
    falling = 0.5 + 0.5 * np.cos(np.pi * np.clip((phase - rise) / fall, 0, 1))
    chest = 100 * np.where(phase < rise, 0.5 - 0.5 * np.cos(np.pi * phase / rise), falling)
    updates = play(chest + np.random.default_rng(3).normal(0, 0.5, len(chest)))
    assert len(breaths_s(updates)) == pytest.approx(240 * per_min / 60, abs=2)
    sure = [update for update in updates if update.signal_quality >= 0.7 and np.isfinite(update.breaths_per_min)]
    assert len(sure) > 100
    np.testing.assert_allclose([update.breaths_per_min for update in sure], per_min, atol=0.5)
    np.testing.assert_allclose([update.amplitude for update in sure], 100, atol=10)


@pytest.mark.parametrize(("rise", "fall"), [(0.15, 0.2), (0.2, 0.3), (0.15, 0.35)])
@pytest.mark.parametrize("per_min", [8.0, 12.0])
def test_a_pause_between_breaths_is_usual_breathing(per_min, rise, fall):
    """8 and 12 breaths a minute, the belt at rest for half of the time and more: all are sure, no movement is told."""
    updates = play(paused(per_min, rise, fall))[60:]
    assert min(update.signal_quality for update in updates) > 0.8
    np.testing.assert_allclose([update.breaths_per_min for update in updates], per_min, atol=0.3)
    assert not any("movements" in reason for update in updates for reason in update.reasons)


@pytest.mark.parametrize("per_min", [8.0, 12.0])
def test_movements_between_breaths_with_pauses_are_none(per_min):
    """Five times as high as such a breath, every 15 s: they are told, and no sure rate is wrong by 2 /min."""
    moved = sum(5 * np.exp(-0.5 * ((TIMES_S - at_s) / 0.7) ** 2) for at_s in np.arange(8.0, SECONDS, 15.3))
    updates = play(paused(per_min, 0.2, 0.3) + moved)[30:]
    assert any("movements" in reason for update in updates for reason in update.reasons)
    sure = [update.breaths_per_min for update in updates if update.signal_quality >= 0.7]
    np.testing.assert_allclose(sure, per_min, atol=2.0)


def paused(per_min, rise, fall):
    """Breaths 1 high that rise and fall for these shares of their time, then rest."""
    phase = TIMES_S * per_min / 60 % 1
    falling = 0.5 + 0.5 * np.cos(np.pi * np.clip((phase - rise) / fall, 0, 1))
    chest = np.where(phase < rise, 0.5 - 0.5 * np.cos(np.pi * phase / rise), falling)
    return chest + np.random.default_rng(3).normal(0, 0.005, len(chest))


@pytest.mark.parametrize("fs_hz", [8.0, 25.0, 100.0])
@pytest.mark.parametrize("held_s", [2.0, 4.0])
def test_values_that_are_held_are_no_breathing(held_s, fs_hz):
    """Twice in a minute the device repeats its last value and hides a breath: every sure rate is 15 all the same."""
    times_s = np.arange(round(SECONDS * fs_hz)) / fs_hz
    samples = belt(times_s) + np.random.default_rng(1).normal(0, 0.01, len(times_s))
    for begin_s in (32.6, 64.9, 93.2):
        samples[round(begin_s * fs_hz) : round((begin_s + held_s) * fs_hz)] = samples[round(begin_s * fs_hz)]
    sure = [update for update in play(samples, fs_hz)[20:] if update.signal_quality >= 0.7]
    assert len(sure) > 10
    np.testing.assert_allclose([update.breaths_per_min for update in sure], 15.0, atol=0.3)


def test_a_coarse_belt_that_is_held_still_holds_nothing():
    """In 20 steps, with pauses between breaths that are one value: all of 12 a minute are told."""
    chest = np.round(10 * np.maximum(belt(TIMES_S, 12.0, inhale=0.5), -0.5)) / 10
    updates = play(chest)
    assert len(breaths_s(updates)) == pytest.approx(23, abs=1)
    np.testing.assert_allclose([update.breaths_per_min for update in updates[30:]], 12.0, atol=0.3)


@pytest.mark.parametrize("fs_hz", [10.0, 25.0, 130.0])
def test_values_that_are_held_again_and_again_are_no_breathing(fs_hz):
    """Every 7 s the device repeats its last value for 2.1 s, also at the moment of an update: every rate is 14."""
    times_s = np.arange(round(SECONDS * fs_hz)) / fs_hz
    samples = np.sin(2 * np.pi * 14 / 60 * times_s) + np.random.default_rng(8).normal(0, 0.02, len(times_s))
    for begin_s in np.arange(5.0, SECONDS - 3, 7.0):
        samples[round(begin_s * fs_hz) : round((begin_s + 2.1) * fs_hz)] = samples[round(begin_s * fs_hz)]
    updates = play(samples, fs_hz)[30:]
    rates = np.array([update.breaths_per_min for update in updates])
    np.testing.assert_allclose(rates[np.isfinite(rates)], 14.0, atol=0.3)
    assert any("without a hole" in reason for update in updates for reason in update.reasons)


def test_short_losses_lower_the_quality():
    """Of the quarter seconds a tenth, then a fifth never came: the rate is as it was, quality falls with each step."""
    means = []
    for share in (0.0, 0.1, 0.2):
        lost = np.arange(0, SECONDS, 0.25)[np.random.default_rng(1).random(4 * SECONDS) < share]
        updates = play(CLEAN, lost=[(at_s, at_s + 0.25) for at_s in lost])[30:]
        assert np.nanmax(np.abs([update.breaths_per_min - 15.0 for update in updates])) < 0.3
        means.append(np.nanmean([update.signal_quality for update in updates]))
    assert means[0] - 0.05 > means[1] > means[2] + 0.05, means


def of_heights(heights, per_min=20.0):
    """Breaths at an even rate, one as high as each of these; two minutes and more."""
    times_s = np.arange(round(len(heights) * 60 / per_min * FS_HZ)) / FS_HZ
    breath = np.minimum((times_s * per_min / 60 + 1e-9).astype(int), len(heights) - 1)
    chest = np.asarray(heights)[breath] * (0.5 + 0.5 * belt(times_s, per_min))
    return chest + np.random.default_rng(3).normal(0, 0.005, len(chest))


def sure_rates(updates):
    return [update.breaths_per_min for update in updates[60:] if update.signal_quality >= 0.7]


@pytest.mark.parametrize("per_min", [12.0, 20.0, 28.0])
@pytest.mark.parametrize("falls", [True, False], ids=["and wanes", "begins anew"])
def test_breathing_that_waxes_and_wanes_keeps_its_rate(per_min, falls):
    """From a tenth to the whole of its height within 25 s, and back or at once: sure rates, all within 1.5 /min."""
    way = np.arange(round(3 * per_min)) * 60 / per_min / 25
    heights = 0.1 + 0.9 * (1 - np.abs(1 - way % 2) if falls else way % 1)
    rates = sure_rates(play(of_heights(heights, per_min)))
    np.testing.assert_allclose(rates, per_min, atol=1.5)
    assert len(rates) > 100 or (per_min, falls) == (28.0, False)


@pytest.mark.parametrize("per_min", [12.0, 20.0])
@pytest.mark.parametrize("shallow", [0.1, 0.2, 0.33])
def test_shallow_breaths_between_deep_ones_are_told(shallow, per_min):
    """Every second breath is a tenth to a third as high: no sure rate, and why."""
    updates = play(of_heights([1.0, shallow] * round(1.5 * per_min), per_min))
    assert not sure_rates(updates)
    told = ("come as evenly and may be breaths too", "by autocorrelation disagree")
    assert all(any(text in reason for reason in update.reasons for text in told) for update in updates[60:])


def test_bursts_of_breaths_have_no_sure_rate():
    """Cheyne-Stokes, 11 breaths of 22 a minute that wax and wane, then none for 20 s: the rate is not sure, and why."""
    cycle = [*np.sin(np.pi * np.arange(0.5, 11) / 11), *[0.0] * 7]
    updates = play(of_heights(cycle * 4, 22.0))[60:]
    rated = [update for update in updates if np.isfinite(update.breaths_per_min)]
    assert len(rated) > 50
    assert np.mean([update.signal_quality >= 0.7 for update in rated]) < 0.1
    assert any("no breath for" in reason for update in rated for reason in update.reasons)


@pytest.mark.parametrize(("pause_s", "cycle_s"), [(12, 45), (12, 60), (20, 60), (25, 75)])
@pytest.mark.parametrize("wanes", [True, False])
def test_a_pause_at_an_end_of_the_window_is_part_of_it(pause_s, cycle_s, wanes):
    """18 a minute, then none for 12 to 25 s, and so on: no sure rate is 3 /min above the breaths in its window."""
    bursts, pauses = round((cycle_s - pause_s) * 0.3), round(pause_s * 0.3)
    high = np.sin(np.pi * np.arange(0.5, bursts) / bursts) if wanes else np.ones(bursts)
    heights = np.array([*high, *[0.0] * pauses] * 4)
    at_s = 10 / 3 * (np.flatnonzero(heights) + 0.4)
    updates = [update for update in play(of_heights(heights, 18.0))[60:] if np.isfinite(update.breaths_per_min)]
    ends_s = [(update.device_ns - T0_NS) / 1e9 for update in updates]
    truth = [60 / 55 * np.count_nonzero((at_s > end_s - 60) & (at_s <= end_s - 5)) for end_s in ends_s]
    above = [update.breaths_per_min - true for update, true in zip(updates, truth, strict=True)]
    sure = [update.signal_quality >= 0.7 for update in updates]
    assert max(np.array(above)[sure], default=0.0) < 3.0
    assert pause_s > 12 or wanes or sum(sure) > 20
    assert any("no breath for" in reason for update in updates for reason in update.reasons)


@pytest.mark.parametrize("before", [0, 1, 3])
@pytest.mark.parametrize(("per_min", "paused"), [(12.0, 6), (18.0, 9), (25.0, 9), (25.0, 12)])
def test_noise_before_a_breath_is_known_is_no_breath(per_min, paused, before):
    """A slow belt, which shows no noise, begins in a pause or with few breaths: sure rates are those of breaths."""
    updates = play(of_heights([1.0] * before + [0.0] * paused + [1.0] * 30, per_min)[::3], FS_HZ / 3)
    sure = [u.breaths_per_min for u in updates if u.signal_quality >= 0.7 and np.isfinite(u.breaths_per_min)]
    assert len(sure) > 10
    np.testing.assert_allclose(sure, per_min, atol=0.5)


def test_no_period_is_measured_across_what_was_no_breath():
    """A deep breath, ten that grow from a fiftieth to the whole, ten deep ones: sure rates are those of the breaths."""
    updates = play(of_heights([1.0, *np.geomspace(0.02, 1.0, 10), *[1.0] * 10], 20.0))
    sure = [u.breaths_per_min for u in updates if u.signal_quality >= 0.7 and np.isfinite(u.breaths_per_min)]
    assert len(sure) > 10
    np.testing.assert_allclose(sure, 20.0, atol=0.5)


def speech(seed, seconds=SECONDS, rest_s=0.0):
    """(belt of a speaker, ends of inspirations in s): breaths of 1.7 to 5 s and any height, abrupt ones in.

    Each minute begins with rest_s of rest: 15 breaths a minute, even and high to a tenth.
    """
    dice, at_s, tops_s = np.random.default_rng(seed), 0.0, []
    times_s = np.arange(round(seconds * FS_HZ)) / FS_HZ
    chest = np.zeros(len(times_s))
    while at_s < seconds:
        period_s, height, inhale = 1 / dice.uniform(0.2, 0.6), dice.uniform(0.4, 1.6), 0.15
        if at_s % 60 < rest_s:
            period_s, height, inhale = 4 * dice.normal(1, 0.1), dice.normal(1, 0.1), 0.4
        inside = (times_s >= at_s) & (times_s < at_s + period_s)
        chest[inside] = height * (0.5 + 0.5 * belt(times_s[inside] - at_s, 60 / period_s, inhale))
        tops_s.append(at_s + inhale * period_s)
        at_s += period_s
    return chest + dice.normal(0, 0.01, len(chest)), np.array(tops_s)


def sure_and_true(updates, tops_s):
    """(rates of updates with a quality of 0.7, true rates in their windows); tops_s: ends of inspirations."""
    rates, truth = [], []
    for update in updates:
        end_s = (update.device_ns - T0_NS) / 1e9
        inside = tops_s[(tops_s > end_s - 60) & (tops_s <= end_s - 5)]
        if update.signal_quality >= 0.7 and np.isfinite(update.breaths_per_min):
            rates.append(update.breaths_per_min)
            truth.append(60 / np.diff(inside).mean())
    return np.array(rates), np.array(truth)


@pytest.mark.parametrize("seed", range(4))
def test_speech_has_no_sure_rate_that_lacks_its_small_breaths(seed):
    """Uneven breaths, of which the lowest are not told: of the updates with a quality of 0.7 none is 2 /min too low."""
    chest, tops_s = speech(seed)
    updates = play(chest)[60:]
    rates, truth = sure_and_true(updates, tops_s)
    assert (rates > truth - 2).all()
    assert any("0.3 of their height" in reason for update in updates for reason in update.reasons)


def test_one_wave_between_uneven_breaths_leaves_no_rate_sure():
    """Two who speak and rest in turn: of the updates with a quality of 0.7 at most one of ten is 2 /min off."""
    rates, truth = np.array([]), np.array([])
    for seed in (3, 7):
        chest, tops_s = speech(seed, 240, rest_s=30.0)
        seen = sure_and_true(play(chest)[60:], tops_s)
        rates, truth = np.append(rates, seen[0]), np.append(truth, seen[1])
    off = np.count_nonzero(np.abs(rates - truth) > 2)
    assert len(rates) > 50
    assert off <= len(rates) / 10, off


def test_coughs_among_the_breaths_leave_no_rate_sure():
    """Twelve breaths a minute and a cough in every fourth expiration: no sure rate is 2 /min too high, and why."""
    coughs = sum(3 * np.exp(-(((TIMES_S - at_s) / 0.15) ** 2)) for at_s in np.arange(3.5, SECONDS, 20.0))
    chest = belt(TIMES_S, 12.0) + coughs + np.random.default_rng(3).normal(0, 0.01, len(TIMES_S))
    updates = play(chest)[60:]
    sure = [u.breaths_per_min for u in updates if u.signal_quality >= 0.7 and np.isfinite(u.breaths_per_min)]
    assert max(sure, default=0.0) < 14.0
    assert any("as abrupt as coughs" in reason for update in updates for reason in update.reasons)


@pytest.mark.parametrize("per_min", [12.0, 15.0])
def test_a_pause_that_goes_on_is_half_of_what_it_will_be(per_min):
    """A minute of even breathing, then none: doubted when two breaths and a half are missing, not three or two."""
    breaths = round(1.2 * per_min)
    updates = play(of_heights([1.0] * breaths + [0.0] * 6, per_min))
    doubted_ns = [u.device_ns for u in updates if any("no breath for" in reason for reason in u.reasons)]
    missing = ((doubted_ns[0] - T0_NS) / 1e9 * per_min / 60) - (breaths - 0.5)
    assert 2.5 <= missing < 2.5 + 1.2 * per_min / 60


@pytest.mark.parametrize(("waves_s", "is_sure"), [((64.9,), True), ((64.9, 79.9), False)])
def test_one_wave_between_slow_breaths_leaves_their_rate_sure(waves_s, is_sure):
    """8 breaths a minute, in one expiration a wave half as high, or in two: they are then at most 1 /min more, or 2."""
    waves = sum(np.exp(-(((TIMES_S - at_s) / 0.5) ** 2)) for at_s in waves_s)
    chest = belt(TIMES_S, 8.0) + waves + np.random.default_rng(3).normal(0, 0.005, len(TIMES_S))
    updates = [update for update in play(chest) if 90 < (update.device_ns - T0_NS) / 1e9 < 105]
    assert len(updates) > 10
    assert all((update.signal_quality >= 0.7) == is_sure for update in updates)
    np.testing.assert_allclose([update.breaths_per_min for update in updates], 8.0, atol=0.3)
