"""What is published when a channel is poor, dead, or shows something that is no muscle."""

import numpy as np
import pytest
from emg_signals import heartbeats, muscle
from interpreter_emg.cleaning import at_rails
from interpreter_emg.config import Config
from interpreter_emg.features import NO_HEART, heart
from interpreter_emg.stream import EmgStream
from quality_ladder import assert_falls, held, played_once
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import event_times_s
from slow_signals import play as play_signal

FS_HZ, SECONDS = 1000.0, 20
BURSTS_S = [(5.0, 7.0), (10.0, 10.3), (13.0, 16.0)]
TIMES_S = np.arange(round(SECONDS * FS_HZ)) / FS_HZ
CLEAN = muscle(SECONDS, FS_HZ, BURSTS_S)
RNG = np.random.default_rng(5)


def play(samples, fs_hz=FS_HZ, unit="uV", names=("biceps",), **options):
    """Updates of electromyograms."""
    return play_signal(lambda info: EmgStream(Config(), info), samples, fs_hz, "emg", unit, names, **options)


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.full(8000, 3.0), "flat"),
        (np.full(8000, np.nan), "no number"),
        (np.where(CLEAN > 0, 50.0, -50.0), "saturated"),
    ],
    ids=["constant", "nan", "saturated"],
)
def test_a_dead_channel_is_named_and_the_others_go_on(samples, word):
    """No number, no change, an end of the range: that channel is NaN with a reason and quality 0; the otheis whole."""
    both = np.array([samples[:8000], CLEAN[:8000]]).T
    updates = play(
        both, names=("biceps", "triceps"), range_min=-50.0 if word == "saturated" else np.nan, range_max=50.0
    )
    last = updates[5]
    assert np.isnan([last.rms_uv[0], last.mav_uv[0], last.mean_frequency_hz[0]]).all()
    assert last.channel_quality[0] == 0
    assert any(f"biceps {end}" in reason for reason in last.reasons for end in (f"is {word}", f"holds {word}")), (
        last.reasons
    )
    assert updates[4].rms_uv[1] > 0
    assert "biceps" not in [name for update in updates for name in update.onset_channels]


@pytest.mark.parametrize("fs_hz", [250.0, 500.0, 1000.0, 2000.0])
def test_a_rectified_muscle_has_no_amplitude(fs_hz):
    """Magnitudes have half of the amplitude and other frequencies: NaN, quality 0 and the reason; activity is told."""
    muscles = muscle(SECONDS, fs_hz, BURSTS_S)
    updates = play(np.column_stack([np.abs(muscles), muscles + 1000.0]), fs_hz, names=("rectified", "offset"))
    for update in updates:
        assert np.isnan([update.rms_uv[0], update.mav_uv[0], update.mean_frequency_hz[0], update.mvc_percent[0]]).all()
        assert update.channel_quality[0] == 0
        assert any(reason.startswith("rectified is never below zero") for reason in update.reasons)
        assert update.rms_uv[1] > 0
    assert [name for update in updates for name in update.onset_channels].count("rectified") >= 2


@pytest.mark.parametrize("unit", ["uV", "counts"])
@pytest.mark.parametrize("smooth_s", [0.05, 0.2])
@pytest.mark.parametrize("fs_hz", [250.0, 1000.0])
def test_an_envelope_has_no_amplitude(fs_hz, smooth_s, unit):
    """What a sensor has rectified and smoothed itself: NaN, quality 0 and the reason from the first work on."""
    size = round(smooth_s * fs_hz)
    envelope = np.convolve(np.abs(muscle(SECONDS, fs_hz, BURSTS_S)), np.full(size, 1 / size), "same")
    for update in play(envelope, fs_hz, unit)[6:]:
        assert np.isnan([update.rms_uv[0], update.mean_frequency_hz[0], update.mvc_percent[0]]).all()
        assert update.signal_quality == 0
        assert any(reason.startswith("biceps is never below zero") for reason in update.reasons)


def test_an_amplifier_that_has_settled_is_no_rectifier():
    """Its level falls from 5 mV to 0 within 20 s: when numbers below zero come again there are amplitudes at once."""
    muscles = muscle(40, FS_HZ, [(30.0, 33.0)])
    updates = play(muscles + 5000 * np.exp(-np.arange(len(muscles)) / FS_HZ / 3.0))
    assert np.isfinite([update.rms_uv[0] for update in updates[26:]]).all()


@pytest.mark.parametrize("sd_uv", [30.0, 300.0, 3000.0])
def test_noise_is_no_work_and_has_no_frequency(sd_uv):
    """White noise of any strength: nothing active, frequencies NaN with the reason, quality below 0.2."""
    updates = play(RNG.normal(0, sd_uv, 10_000))
    assert not any(update.active[0] for update in updates)
    assert np.isnan([update.mean_frequency_hz[0] for update in updates]).all()
    assert max(update.signal_quality for update in updates[2:]) < 0.2
    assert "biceps: the spectrum is that of noise" in updates[-1].reasons[-1]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_drift_has_no_frequency(seed):
    """A random walk of the level falls from its lowest frequencies on: at most one update in twenty has a frequency."""
    updates = play(np.cumsum(np.random.default_rng(seed).normal(0, 2, 40_000)))
    told = [update for update in updates if np.isfinite(update.median_frequency_hz[0])]
    assert len(told) <= len(updates) / 20
    assert any("biceps: the spectrum is that of drift" in reason for reason in updates[-1].reasons)
    assert not any(update.active[0] for update in updates)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_between_pink_and_brown_has_no_confident_frequency(seed):
    """It falls with f^1.5 from its lowest frequencies on, where even a tired muscle's spectrum still rises."""
    n = 60_000
    white = np.fft.rfft(np.random.default_rng(seed).normal(size=n))
    noise = np.fft.irfft(white * np.maximum(np.fft.rfftfreq(n, 1 / FS_HZ), 0.5) ** -0.75, n)
    updates = play(30.0 * noise / noise.std())
    sure = [u for u in updates if np.isfinite(u.median_frequency_hz[0]) and u.channel_quality[0] >= 0.7]
    assert len(sure) <= len(updates) / 20


def test_what_is_quieter_than_any_amplifier_has_no_frequency():
    """The rounding of a ramp is no muscle."""
    last = play(np.round(np.arange(10_000) * 0.01, 3))[-1]
    assert np.isnan(last.median_frequency_hz[0])
    assert any(reason.startswith("biceps: below 0.5 uV") for reason in last.reasons)


@pytest.mark.parametrize(
    ("samples", "fs_hz"),
    [
        (1e-6 * CLEAN, FS_HZ),
        (1e-3 * CLEAN, FS_HZ),
        (RNG.normal(0, 0.045, 10_000), FS_HZ),
        (0.1 * RNG.random(9000), 250.0),
    ],
    ids=["volts", "millivolts", "shorted", "shorted at 250 Hz"],
)
def test_what_no_electrode_on_skin_can_be_is_dead(samples, fs_hz):
    """Volts or mV declared as uV, a shorted input: no amplitude, quality 0 and the reason, at every update."""
    updates = play(samples, fs_hz)
    assert np.isnan([(update.rms_uv[0], update.mav_uv[0]) for update in updates]).all()
    assert {update.signal_quality for update in updates} == {0.0}
    assert all(any(r.startswith("biceps: below 0.") for r in update.reasons) for update in updates)


def test_a_quiet_muscle_lives():
    """1 uV of noise at rest, of which 250 Hz see 0.5: amplitudes at every update."""
    for fs_hz in (250.0, FS_HZ):
        updates = play(np.random.default_rng(2).normal(0, np.sqrt(fs_hz / FS_HZ), 10_000), fs_hz)
        assert np.isfinite([update.rms_uv[0] for update in updates]).all()


@pytest.mark.parametrize("fs_hz", [500.0, 1000.0, 2148.0])
def test_a_tired_muscle_has_its_frequency(fs_hz):
    """A muscle whose spectrum has sunk by two fifths, over a level that drifts, is told at every moment of its work."""
    drift = np.cumsum(np.random.default_rng(4).normal(0, 0.3, round(40 * fs_hz)))
    updates = play(drift + muscle(40, fs_hz, [(5, 38)], sunk=0.6), fs_hz=fs_hz)
    works = [update.median_frequency_hz[0] for update in updates[8:36]]
    assert 58 < np.median(works) < 72
    assert all(45 < median_hz < 90 for median_hz in works), works


ladder = played_once(play)
LADDERS = {
    "noise": lambda x, t_s, k: x + np.random.default_rng(1).normal(0, 20 * k, len(x)),
    "drift": lambda x, t_s, k: x + 300 * k * np.sin(2 * np.pi * 0.4 * t_s),
    "mains": lambda x, t_s, k: x + 60 * k * np.sin(2 * np.pi * 50 * t_s) + 20 * k * np.sin(2 * np.pi * 150 * t_s),
    "motion": lambda x, t_s, k: x + 800 * k * np.exp(-(((t_s % 2.5 - 1) / 0.08) ** 2)),
    "loss": lambda x, t_s, k: np.where(0.5 * k > t_s % 5, np.nan, x),
    "held": lambda x, t_s, k: held(x, 1 / t_s[1], 0.1 * k, 1.0),
    "heart": lambda x, t_s, k: x + heartbeats(SECONDS, 1 / t_s[1], 70, 25.0 * k),
}


@pytest.mark.parametrize("fs_hz", [250.0, 1000.0, 2000.0])
@pytest.mark.parametrize("kind", LADDERS)
def test_quality_falls_step_by_step(kind, fs_hz):
    """Each step of noise, drift, mains, motion, loss, held values and heart lowers the quality on average."""
    t_s = np.arange(round(SECONDS * fs_hz)) / fs_hz
    clean = muscle(SECONDS, fs_hz, BURSTS_S)
    assert_falls(lambda k: ladder(LADDERS[kind](clean, t_s, k), fs_hz)[5:])


@pytest.mark.parametrize(("fs_hz", "mains_hz"), [(1000.0, 50.0), (1000.0, 60.0), (256.0, 60.0), (512.0, 50.0)])
def test_the_mains_and_their_harmonics_are_taken_away(fs_hz, mains_hz):
    """Hum of 70 uV with harmonics, also folded ones, leaves at rest less than 2 uV, and the bursts as they are."""
    times_s = np.arange(round(SECONDS * fs_hz)) / fs_hz
    hum = sum(70 / k * np.sin(2 * np.pi * k * mains_hz * 1.001 * times_s + k) for k in (1, 2, 3, 5))
    updates = play(muscle(SECONDS, fs_hz, BURSTS_S, rest_uv=1.0) + hum, fs_hz)
    rest = [update.rms_uv[0] for i, update in enumerate(updates) if i in (3, 8, 18)]
    assert max(rest) < 2.0
    np.testing.assert_allclose(event_times_s(updates, "onset_timestamps"), [b for b, _ in BURSTS_S], atol=0.05)


@pytest.mark.parametrize(
    "strength",
    [lambda s: 1 + 0.5 * np.sin(2 * np.pi * 0.3 * s), *(lambda s, at=at: s > at for at in (10.1, 10.3, 10.45))],
    ids=["sways", "on at .1", "on at .3", "on at .45"],
)
def test_mains_that_change_in_strength_are_no_work(strength):
    """20 uV of mains that sway by half every 3 s, and such that come half a second before an update: nobody works."""
    rest = muscle(SECONDS, FS_HZ, []) + 20 * strength(TIMES_S) * np.sin(2 * np.pi * 50 * TIMES_S)
    assert event_times_s(play(rest), "onset_timestamps").tolist() == []


@pytest.mark.parametrize(
    "samples",
    [
        RNG.normal(0, 2, 20_000) + 300 * np.sin(2 * np.pi * 50 * TIMES_S),
        RNG.normal(0, 30, 20_000),
        RNG.normal(0, 2, 20_000) + heartbeats(SECONDS, FS_HZ, 70, 100.0),
    ],
    ids=["hum", "noise", "heart"],
)
def test_one_huge_sample_makes_no_channel_better(samples):
    """20 mV in a single sample: the quality stays what it is without."""
    popped = samples.copy()
    popped[5500] += 20_000.0
    pairs = zip(play(samples)[7:], play(popped)[7:], strict=True)
    assert max(after.signal_quality - before.signal_quality for before, after in pairs) < 0.05


def test_pulses_of_a_stimulator_leave_numbers():
    """3 mV every 50 ms from the first sample on, over rest and over work: amplitudes and a quality at every update."""
    pulses = CLEAN + 3000.0 * (np.arange(len(CLEAN)) % 50 == 0)
    updates = play(pulses)
    assert np.isfinite([(update.rms_uv[0], update.signal_quality) for update in updates]).all()


@pytest.mark.parametrize("fs_hz", [500.0, 1000.0, 2000.0])
def test_a_cable_that_swings_is_no_work(fs_hz):
    """Swings of 200 uV at 6 Hz for a third of a second, at rest and at work: every burst of work, and no other."""
    bursts_s = [(at_s, at_s + 1.5) for at_s in range(7, 55, 8)]
    samples = muscle(60, fs_hz, bursts_s)
    after_s = np.arange(len(samples))[:, None] / fs_hz - np.arange(6.5, 58.0, 2.7)
    swings = (np.exp(-0.5 * (after_s / 0.15) ** 2) * np.sin(2 * np.pi * 6 * after_s)).sum(axis=1)
    updates = play(samples + 200.0 * swings, fs_hz)
    np.testing.assert_allclose(event_times_s(updates, "onset_timestamps"), [b for b, _ in bursts_s], atol=0.03)
    np.testing.assert_allclose(event_times_s(updates, "offset_timestamps"), [e for _, e in bursts_s], atol=0.08)


def test_the_heart_is_told_and_is_no_work():
    """QRS complexes in a trunk muscle: channel and rate are named, they start no activity, bursts are still found."""
    updates = play(np.array([CLEAN + heartbeats(SECONDS, FS_HZ, 72, 100.0), CLEAN]).T, names=("trapezius", "biceps"))
    told = [reason for update in updates[10:] for reason in update.reasons if "ECG contamination" in reason]
    assert told
    assert all(reason.startswith("trapezius: ") for reason in told)
    assert "7" in told[-1].partition(", ")[2][:1]
    onsets = [
        at
        for u in updates
        for at, name in zip(u.onset_timestamps, u.onset_channels, strict=True)
        if name == "trapezius"
    ]
    assert len(onsets) == len(BURSTS_S)


def test_bursts_in_the_rhythm_of_steps_are_no_heart():
    """A muscle that works once per second never has the same shape twice."""
    updates = play(muscle(SECONDS, FS_HZ, [(at, at + 0.4) for at in np.arange(2.0, 19.0)]))
    assert not any("ECG" in reason for update in updates for reason in update.reasons)
    assert sum(len(update.onset_timestamps) for update in updates) == 17


def test_counts_give_events_and_percent_but_no_microvolts():
    """Of an uncalibrated channel come activity and frequencies; what would be in uV is NaN and says why."""
    updates = play(7 * CLEAN + 2048, unit="counts")
    assert np.isnan([updates[5].rms_uv[0], updates[5].mav_uv[0]]).all()
    assert len(event_times_s(updates, "onset_timestamps")) == len(BURSTS_S)
    assert 90 < updates[5].mean_frequency_hz[0] < 140
    assert any("uncalibrated" in reason for reason in updates[-1].reasons)


def test_a_stream_may_begin_with_a_few_samples():
    """Less than 5 ms before the first update, or after a hole, says nothing of the heart and ends nothing."""
    assert heart(CLEAN[:4], FS_HZ) == heart(CLEAN[:0], FS_HZ) == NO_HEART


def test_a_hole_ends_what_is_active():
    """2 s never came: the activity ends with the last sample before them and begins anew with what comes after."""
    updates = play(muscle(SECONDS, FS_HZ, [(5, 12)]), lost=[(8.0, 10.0)])
    onsets, offsets = (event_times_s(updates, f"{name}_timestamps") for name in ("onset", "offset"))
    np.testing.assert_allclose(onsets, [5.0, 10.1], atol=0.3)
    np.testing.assert_allclose(offsets, [8.0, 12.0], atol=0.3)


def test_nanovolts_that_say_they_are_microvolts_are_no_muscle():
    """100 uV of a muscle, a thousand times as much by its unit: no amplitude, and the question whether it is right."""
    last = play(1e3 * CLEAN[:15_000])[-1]
    assert np.isnan(last.rms_uv[0])
    assert last.signal_quality == 0
    assert any("is the unit right?" in reason for reason in last.reasons), last.reasons


def test_what_is_active_ends_also_where_a_hole_follows_an_update_at_once():
    """The last sample before the hole is that of an update: the end of the activity is told all the same."""
    sizes = [1] + [10] * 2000
    updates = play(muscle(SECONDS, FS_HZ, [(5, 12)]), sizes=sizes, lost=[(8.005, 10.0)])
    np.testing.assert_allclose(event_times_s(updates, "offset_timestamps"), [8.0, 12.0], atol=0.3)


def test_a_frequency_that_samples_are_missing_for_says_so():
    """With 0.3 of every second lost the amplitude is told, and why the frequencies are not."""
    last = play(np.where((TIMES_S % 1 < 0.3) & (TIMES_S > 14), np.nan, CLEAN)[:16_000])[-1]
    assert last.rms_uv[0] > 50
    assert np.isnan(last.mean_frequency_hz[0])
    assert any(r.startswith("biceps: too many samples are no signal: mean_frequency_hz") for r in last.reasons)


def test_a_muscle_too_strong_for_its_range_is_saturated():
    """Of 100 uV rms cut at 150 uV every seventh sample is at the rail; that is the reason, not too little signal."""
    last = play(np.clip(CLEAN, -150, 150)[:15_000], range_min=-150.0, range_max=150.0)[-1]
    assert np.isnan(last.rms_uv[0])
    assert any(reason.startswith("biceps is saturated: 1") for reason in last.reasons), last.reasons


@pytest.mark.parametrize("fs_hz", [0.0, 100.0, 30_000.0])
def test_a_rate_no_emg_has_is_refused(fs_hz):
    """One sentence that names the parameter and the range."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .*must be 200 to 20000 for EMG"):
        EmgStream(Config(), StreamInfo(StreamName("p1", "emg", "s1"), fs_hz, "uV", ("biceps",)))


def test_thresholds_that_cannot_be_are_refused():
    """Hysteresis needs the offset below the onset."""
    with pytest.raises(ValueError, match="offset_ratio"):
        Config(onset_ratio=1.5, offset_ratio=1.5)


def test_a_window_that_skips_samples_is_refused():
    """Each sample is in a window."""
    with pytest.raises(ValueError, match=r"'window_s' must be no shorter than 'update_interval_s'"):
        Config(window_s=1.0, update_interval_s=2.0)
    assert Config(window_s=2.0, update_interval_s=2.0).window_s == 2.0


def test_values_that_are_held_are_no_signal():
    """A device that repeats its last value for 190 of every 400 ms: no amplitude that is too small, but none."""
    samples = muscle(12, 1000.0, [(3.0, 12.0)])
    for begin in range(0, len(samples), 400):
        samples[begin : begin + 190] = samples[begin]
    last = play(samples, 1000.0)[-1]
    assert np.isnan(last.rms_uv[0])
    assert last.signal_quality == 0
    assert any("does not change" in reason for reason in last.reasons)


def test_a_coarse_resolution_is_a_signal():
    """Rounded to 10 uV, in which rest hardly moves: the amplitude of work within 3 %, nothing missing in it."""
    samples = muscle(12, 1000.0, [(3.0, 12.0)])
    fine, coarse = play(samples, 1000.0)[-1], play(10 * np.round(samples / 10), 1000.0)[-1]
    assert coarse.rms_uv[0] == pytest.approx(fine.rms_uv[0], rel=0.03)
    assert coarse.signal_quality > 0.9 * fine.signal_quality


@pytest.mark.parametrize("fs_hz", [500.0, 1000.0, 2000.0])
@pytest.mark.parametrize("rest_uv", [1.5, 2.0, 3.0])
def test_rest_that_a_coarse_resolution_hides_is_no_work(rest_uv, fs_hz):
    """Rounded to 10 uV rest is a value that hardly changes: noise that lifts it a step now and then is no work."""
    muscles = np.round(muscle(25, fs_hz, [(5.0, 8.0), (14.0, 18.0)], rest_uv=rest_uv) / 10) * 10
    np.testing.assert_allclose(event_times_s(play(muscles, fs_hz), "onset_timestamps"), [5.0, 14.0], atol=0.15)


@pytest.mark.parametrize("fs_hz", [250.0, 1000.0, 4000.0])
@pytest.mark.parametrize("most_uv", [60.0, 120.0])
def test_an_end_of_a_range_that_nobody_declared_is_seen(most_uv, fs_hz):
    """A muscle of 100 uV cut at 60 or 120 uV seems to have less amplitude: none is told of it, and why."""
    updates = play(np.clip(muscle(SECONDS, fs_hz, [(5.0, 9.0)]), -most_uv, most_uv), fs_hz)
    assert np.isnan([update.rms_uv[0] for update in updates[5:8]]).all()
    assert any("saturated" in reason for update in updates[5:8] for reason in update.reasons)
    assert min(update.channel_quality[0] for update in updates[10:]) > 0.7


def test_ends_of_a_range_are_told_from_what_rests_there():
    """Only a muscle cut at both ends rests there: no swing in steps, signal of two values or of zeros at rest."""
    swing = np.round(20 * np.sin(2 * np.pi * TIMES_S[:1000]))
    two, zero = np.where(CLEAN[5000:6000] > 0, 1.0, -1.0), np.maximum(CLEAN[5000:6000], 0.0)
    samples = np.column_stack([np.clip(CLEAN[5000:6000], -100, 100), swing, two, zero])
    assert at_rails(samples, np.nan, np.nan).any(axis=0).tolist() == [True, False, False, False]


def test_the_tops_of_a_muscle_are_no_end_of_a_range():
    """Whole, in steps of 1 or 10 uV, also on a drift that turns: amplitudes at every update."""
    drift = 300 * np.sin(2 * np.pi * 0.1 * TIMES_S)
    for samples in (np.round(CLEAN), np.round(CLEAN / 10) * 10, np.round(CLEAN + drift)):
        assert np.isfinite([update.rms_uv[0] for update in play(samples)[5:7]]).all()
