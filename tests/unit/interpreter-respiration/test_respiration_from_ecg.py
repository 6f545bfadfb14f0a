"""Breathing from an ECG alone: the rate where beats show it clearly, and why there is none elsewhere."""

import numpy as np
import pytest
from breathing_signals import ecg
from interpreter_respiration import fusion
from interpreter_respiration.beats import Beat
from interpreter_respiration.config import Config
from interpreter_respiration.heart import HeartStream
from interpreter_respiration.lead import Lead
from interpreter_respiration.stream import RespirationStream
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo
from slow_signals import T0_NS, event_times_s
from slow_signals import play as play_signal

FS_HZ, SECONDS = 130.0, 90
DEFAULTS = Config()
NEVER = ("rrv_rmssd_ms", "amplitude", "inhale_exhale_ratio")


def play(samples, fs_hz=FS_HZ, config=DEFAULTS, **options):
    """Updates of an ECG."""
    return play_signal(lambda info: HeartStream(config, info), samples, fs_hz, "ecg", "uV", **options)


def rates(updates):
    return np.array([update.breaths_per_min for update in updates])


@pytest.mark.parametrize(("per_min", "fs_hz"), [(9.0, 130.0), (15.0, 250.0), (20.0, 1000.0)])
def test_rate_and_times_are_those_of_the_breaths(per_min, fs_hz):
    """From 9 to 20 breaths per min, from 40 s on: the rate within 1 /min, ends of inspiration within 0.7 s."""
    updates = play(ecg(SECONDS, fs_hz, per_min), fs_hz)
    late = rates(updates)[45:]
    assert np.isfinite(late).mean() > 0.8
    np.testing.assert_allclose(late[np.isfinite(late)], per_min, atol=1.0)
    assert np.isnan(rates(updates)[:39]).all()
    assert "needs 40 s" in updates[20].reasons[0]
    told = event_times_s(updates, "breath_timestamps")
    phase = (told * per_min / 60 - 0.25 + 0.5) % 1 - 0.5
    assert len(told) >= 0.8 * per_min / 60 * 40
    assert np.abs(phase * 60 / per_min).max() < 0.7
    assert all(np.isnan(getattr(updates[-1], name)) for name in NEVER)
    assert any("rrv_rmssd_ms" in reason for reason in updates[-1].reasons)


@pytest.mark.parametrize(("per_min", "pause"), [(4.5, 0.4), (5.0, 0.4), (5.0, 0.5), (5.5, 0.5), (6.0, 0.5)])
def test_no_overtone_of_slow_breathing_is_told(per_min, pause):
    """4.5 to 6 breaths per min with a pause after each: the rate within 1 /min, or none and what is slower."""
    updates = play(ecg(120, FS_HZ, per_min, pause=pause))
    told = rates(updates)
    np.testing.assert_allclose(told[np.isfinite(told)], per_min, atol=1.0)
    slower = [reason for update in updates for reason in update.reasons if "may be an overtone of" in reason]
    assert slower or np.isfinite(told).any()


@pytest.mark.parametrize("first", ["flat", "off", "noise"])
def test_of_several_leads_the_first_with_heart_beats_is_taken(first):
    """Lead I flat, off or noise, II good: the rate of II, and it is said; both good: I, and nothing is said."""
    good = ecg(60, FS_HZ)
    bad = {"flat": 0 * good, "off": np.nan * good, "noise": np.random.default_rng(0).normal(0, 100, len(good))}[first]
    last = play(np.column_stack([bad, good]), names=("I", "II"))[-1]
    assert last.breaths_per_min == pytest.approx(15.0, abs=0.5)
    assert any(reason.startswith("from lead II: ") for reason in last.reasons)
    both = play(np.column_stack([good, bad]), names=("I", "II"))[-1]
    assert both.breaths_per_min == pytest.approx(15.0, abs=0.5)
    assert not any("lead" in reason for reason in both.reasons)


@pytest.mark.parametrize("upside", [1, -1], ids=["upright", "inverted"])
def test_the_polarity_of_the_lead_does_not_matter(upside):
    """Ends of inspiration come from the heart rate, so an inverted lead gives the same rate."""
    late = rates(play(upside * ecg(70, FS_HZ)))[50:]
    assert np.nanmedian(late) == pytest.approx(15.0, abs=0.5)


@pytest.mark.parametrize(
    ("samples", "word"),
    [
        (np.zeros(11_700), "heart beats"),
        (np.full(11_700, np.nan), "heart beats"),
        (np.random.default_rng(0).normal(0, 100, 11_700), "irregular"),
        (ecg(SECONDS, FS_HZ, arrhythmia_s=0.0, amplitude=0.0, jitter=0.03), "disagree"),
    ],
    ids=["flat", "nan", "noise", "no breathing"],
)
def test_without_evidence_there_is_no_rate(samples, word):
    """A flat line, noise, beats that do not breathe, intervals that say something else: no rate, and the reason."""
    updates = play(samples)
    assert np.isnan(rates(updates)).all()
    assert updates[-1].breath_count == -1
    assert updates[-1].signal_quality < 0.5
    assert any(word in reason for update in updates[45:] for reason in update.reasons), updates[-1].reasons


def test_amplitude_alone_tells_the_rate_of_even_breathing_but_not_when_lungs_are_full():
    """A ventilated patient without sinus arrhythmia: the rate within 0.5 /min, no times, and why there are none."""
    updates = play(ecg(SECONDS, FS_HZ, arrhythmia_s=0.0, jitter=0.03))
    late = rates(updates)[60:]
    assert np.isfinite(late).mean() > 0.5
    np.testing.assert_allclose(late[np.isfinite(late)], 15.0, atol=0.5)
    assert not len(event_times_s(updates, "breath_timestamps"))
    assert "without sinus arrhythmia" in " ".join(updates[np.flatnonzero(np.isfinite(rates(updates)))[-1]].reasons)


@pytest.mark.parametrize(("per_min", "swing_uv"), [(10.0, 300.0), (10.0, 1000.0), (15.0, 1000.0)])
def test_a_baseline_that_swings_is_no_breathing(per_min, swing_uv):
    """A cable swings 10 or 15 times a minute, the heart shows no breathing: no rate, and that is the reason."""
    samples = ecg(80, 250.0, arrhythmia_s=0.0, amplitude=0.0)
    samples += swing_uv * np.sin(2 * np.pi * per_min / 60 * np.arange(len(samples)) / 250.0)
    updates = play(samples, 250.0)
    assert np.isnan(rates(updates)).all()
    assert any("baseline of the ECG swings" in reason for update in updates for reason in update.reasons)


def moved(seed):
    """ECG of somebody who breathes 15 times a minute and moves four times, for 2 to 8 s each, by 0.6 mV."""
    dice, samples = np.random.default_rng(seed), ecg(SECONDS, FS_HZ)
    times_s = np.arange(len(samples)) / FS_HZ
    for _ in range(4):
        inside = np.abs(times_s - dice.uniform(5, SECONDS - 5)) < dice.uniform(1, 4)
        way = np.cumsum(dice.normal(0, 1, np.count_nonzero(inside)))
        samples[inside] += 600 * way / np.abs(way).max() + dice.normal(0, 120, len(way))
    return samples


@pytest.mark.parametrize(("seed", "is_told"), [(5, False), (3, True)])
def test_a_rate_that_hangs_on_beats_unlike_the_others_is_withheld(seed, is_told):
    """Movements look like beats and make 16.1 of 15 breaths: no such rate, and why; where they add none, the rate."""
    updates = play(moved(seed))[60:]
    told = rates(updates)
    np.testing.assert_allclose(told[np.isfinite(told)], 15.0, atol=1.0)
    assert not is_told or np.isfinite(told).all()
    assert is_told or any("look unlike the others" in update.reasons[0] for update in updates)


def test_a_baseline_that_breathes_with_the_chest_hides_nothing():
    """0.1 mV of it, 0.1 mV of QRS complexes and sinus arrhythmia, as recordings have them: the rate in each update."""
    samples = ecg(80, 250.0)
    samples += 100 * np.sin(2 * np.pi * np.arange(len(samples)) / 250.0 / 4)
    np.testing.assert_allclose(rates(play(samples, 250.0))[50:], 15.0, atol=1.0)


def test_sinus_arrhythmia_alone_tells_the_rate_of_even_breathing():
    """QRS complexes that only jitter do not hide it: the rate within 0.5 /min."""
    late = rates(play(ecg(SECONDS, FS_HZ, amplitude=0.0)))[60:]
    assert np.isfinite(late).mean() > 0.5
    np.testing.assert_allclose(late[np.isfinite(late)], 15.0, atol=0.5)


@pytest.mark.parametrize("seed", range(6))
def test_what_changes_from_beat_to_beat_by_chance_is_no_breathing(seed):
    """Beats whose interval, height and area are by chance: a rate in no more than one of fifty windows."""
    dice = np.random.default_rng(seed)
    intervals_s = dice.normal(0.8, 0.05, 150)
    ends_ns = np.cumsum(intervals_s * 1e9).astype(np.int64)
    qrs = dice.normal(1.0, 0.1, 150)  # height and area of one beat go together, whatever the reason
    beats = [
        Beat(int(t), i, q, q + 0.05 * dice.normal(), 0.0, np.empty(0))
        for t, i, q in zip(ends_ns, intervals_s, qrs, strict=True)
    ]
    seen = [fusion.fused(beats[k : k + 75], beats[k].time_ns, beats[k + 74].time_ns) for k in range(0, 75)]
    assert np.isfinite([fusion.told_per_min(each) for each in seen]).mean() <= 1 / 50


@pytest.mark.parametrize("update_interval_s", [1.0, 5.0, 6.0, 10.0])
def test_however_seldom_updates_come_each_breath_is_told(update_interval_s):
    """From 60 s on there is a rate, 15 /min, and no breath is missing among those that are told."""
    updates = play(ecg(180, FS_HZ), config=Config(update_interval_s=update_interval_s))
    late = np.array([update.breaths_per_min for update in updates if update.window_s >= 59.9])
    np.testing.assert_allclose(late, 15.0, atol=1.0)
    told = event_times_s(updates, "breath_timestamps")
    assert told[0] < 70
    assert told[-1] > 155
    np.testing.assert_allclose(np.diff(told), 4.0, atol=0.8)


def test_a_short_window_needs_less_than_40_s_and_says_so():
    """Of 30 s: beats of 27 s are needed, and a flat line is one after 27 s, of quality 0."""
    config = Config(window_s=30.0)
    updates = play(ecg(60, FS_HZ), config=config)
    assert updates[20].reasons == ("needs 27 s of heart beats without a pause",)
    assert np.isfinite(rates(updates)[35:]).any()
    flat = play(np.zeros(5200), config=config)[-1]
    assert flat.reasons == ("no heart beats are found",)
    assert flat.signal_quality == 0.0


def test_fewer_than_three_breaths_are_named_as_that():
    """6 breaths per min in a window of 20 s: no rate, and no reason with a number that is none."""
    updates = play(ecg(60, FS_HZ, 6.0), config=Config(window_s=20.0))
    reasons = {reason for update in updates for reason in update.reasons}
    assert "beats do not show three breaths clearly" in reasons
    assert not any("nan" in reason for reason in reasons)


def test_a_rate_withheld_for_counts_that_differ_names_the_lowest_and_the_highest():
    """Three counts of 20.3 /min and one of 22.2: both are in the reason."""
    seen = fusion.Fused(np.empty(0, np.int64), np.empty(0), [], (20.3, 20.3, 20.3), 22.2, 0.35, 0.31, weighed=False)
    assert fusion.unclear(seen).endswith(": 20.3 to 22.2 /min")


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One ECG, with missing samples, in frames of one, of 7 and of random sizes gives the same updates."""
    samples = ecg(60, 100.0)
    samples[1000:1100] = np.nan
    sizes = ([1] * 6000, [7] * 860, np.random.default_rng(2).integers(1, 60, 500).tolist())
    texts = [repr([update._replace(received_ns=0) for update in play(samples, 100.0, sizes=cut)]) for cut in sizes]
    assert texts[0] == texts[1] == texts[2]
    assert np.isfinite(rates(play(samples, 100.0))).any()


def test_a_hole_leaves_no_interval_across_it():
    """4 s that never came: no rate until there are 40 s of beats again, then the right one."""
    told = rates(play(ecg(120, FS_HZ), lost=[(60.0, 64.0)]))
    assert np.isnan(told[64:95]).all()
    np.testing.assert_allclose(told[np.isfinite(told)], 15.0, atol=1.0)
    assert np.isfinite(told[110:]).any()


@pytest.mark.parametrize("at_s", [60.0, 60.25, 60.5, 60.75])
def test_one_lost_frame_costs_the_intervals_across_it(at_s):
    """A quarter of a second that never came: the rate in every update, of a lower quality than without the loss."""
    samples = ecg(80, FS_HZ)
    whole, updates = play(samples)[45:], play(samples, lost=[(at_s, at_s + 0.25)])[45:]
    np.testing.assert_allclose(rates(updates), 15.0, atol=1.0)
    quality, before = (np.mean([update.signal_quality for update in each[20:]]) for each in (updates, whole))
    assert 0.8 < quality < before


@pytest.mark.parametrize("lost_s", [0.05, 0.25, 0.5, 1.0, 4.0])
def test_no_interval_is_measured_across_a_loss(lost_s):
    """However long it is, where a beat may be hidden: intervals are those of neighbours, the others unknown."""
    samples = ecg(40, FS_HZ)
    times_ns = T0_NS + np.round(np.arange(len(samples)) / FS_HZ * 1e9).astype(np.int64)
    truth_ns = [beat.time_ns for beat in found(samples, times_ns)]
    for begin_s in np.arange(5.0, 35.0, 5.0 + lost_s + 0.13):
        samples[round(begin_s * FS_HZ) : round((begin_s + lost_s) * FS_HZ)] = np.nan
    beats = found(samples, times_ns)
    assert len(beats) >= 20
    known = [beat for beat in beats if np.isfinite(beat.interval_s)]
    assert max(beat.interval_s for beat in known) < 1.0
    assert all(np.abs(np.array(truth_ns) - beat.time_ns).min() < 1e6 for beat in beats)


def found(samples, times_ns):
    """All beats of one lead, in blocks of a second."""
    lead = Lead(FS_HZ, 60)
    for at in range(0, len(samples), round(FS_HZ)):
        lead.take(samples[at : at + round(FS_HZ)], times_ns[at : at + round(FS_HZ)], 0)
    return lead.beats


def test_a_longer_loss_is_told_as_what_it_is_and_ends_after_40_s_of_beats():
    """4 s that never came: every reason is that beats are needed, how long there were some; a rate again 44 s later."""
    updates = play(ecg(120, FS_HZ), lost=[(60.0, 64.0)])
    silent = [update for update in updates[60:] if np.isnan(update.breaths_per_min)]
    needs = "needs 40 s of heart beats without a pause, there are "
    assert all(update.reasons[0].startswith(needs) for update in silent)
    assert np.isnan([update.signal_quality for update in silent]).all()
    assert (silent[-1].device_ns - T0_NS) / 1e9 < 64 + 44


def test_intervals_that_losses_spoil_are_named_as_that():
    """A quarter of a second lost in every 1.7 s: no rate, and the reason is the losses, not a heart that is missing."""
    lost = [(at_s, at_s + 0.25) for at_s in np.arange(5.0, 90.0, 1.75)]
    last = play(ecg(90, FS_HZ), lost=lost)[-1]
    assert np.isnan(last.breaths_per_min)
    assert last.reasons[0].startswith("losses leave ")


def test_a_lead_that_falls_off_has_no_beats():
    """After a minute the ECG is flat: within 7 s the reason is that, and for how long, with quality 0."""
    samples = ecg(90, FS_HZ)
    samples[round(60 * FS_HZ) :] = 0.0
    updates = play(samples)
    assert all(update.signal_quality == 0 for update in updates[67:])
    assert updates[-1].reasons == ("no heart beats are found in the last 29 s",)


def test_a_pause_that_may_hide_a_breath_is_named():
    """Of 23 breaths per min, a second lost between two of them: the rate, or that a breath may be hidden."""
    updates = play(ecg(80, FS_HZ, 23.0), lost=[(60.5, 61.5)])[62:]
    assert all("may hide one of" in update.reasons[0] for update in updates if np.isnan(update.breaths_per_min))
    assert np.isnan(rates(updates)).any()


def test_five_minutes_of_rest(shared_data):
    """Two of five windows of a minute get a rate, and 93 of 100 of these are the belt's within 1 /min."""
    path = shared_data / "multimodal" / "neurokit" / "bio_resting_5min_100hz.csv"
    columns = np.genfromtxt(path, delimiter=",", names=True)
    updates = play(columns["ECG"], 100.0)
    belt_s = event_times_s(
        play_signal(lambda info: RespirationStream(Config(), info), columns["RSP"], 100.0, "respiration", "a.u."),
        "breath_timestamps",
    )
    off = np.array([update.breaths_per_min - belt_per_min(belt_s, update) for update in updates[60:]])
    told = np.isfinite(off)
    assert told.mean() >= 0.4
    assert np.mean(np.abs(off[told]) <= 1) >= 0.93


def belt_per_min(belt_s, update):
    """The rate of the breaths that a belt showed within the minute before an update."""
    end_s = (update.device_ns - T0_NS) / 1e9
    inside = belt_s[(belt_s > end_s - 60) & (belt_s <= end_s)]
    return 60 / np.diff(inside).mean()


@pytest.mark.parametrize("fs_hz", [20.0, 20_000.0])
def test_a_rate_without_beats_is_refused(fs_hz):
    """One sentence that names the rate and what it must be."""
    with pytest.raises(ValueError, match=r"sampling_frequency_hz is .* must be 50 to 8000 for breaths from an ECG"):
        HeartStream(Config(), StreamInfo(StreamName("p1", "ecg", "s1"), fs_hz, "uV", ("ecg",)))
