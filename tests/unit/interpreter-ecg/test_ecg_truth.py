"""interpreter-ecg: no confident number that is wrong, under holes, motion, hum and noise (bench: bench_ecg_truth)."""

import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from interpreter_ecg.features import middle_of_cut
from scipy.signal import resample_poly

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))
import bench_ecg
import bench_ecg_truth
import ecg_arrhythmias
import ecg_rhythms
import ecg_trials as trials

FS_HZ = 130.0
CONFIDENT = 0.7


def play(ecg, fs_hz=FS_HZ):
    """Every update of a recording."""
    return bench_ecg.play(ecg, fs_hz)


def confident_rates(updates):
    """Rates that are published at a quality of 0.7 or more."""
    rates = np.array([u.heart_rate_bpm for u in updates if u.signal_quality >= CONFIDENT])
    return rates[np.isfinite(rates)]


# -- holes


@pytest.mark.parametrize("value", [np.nan, 250.0, 8000.0])
def test_hole_without_signal_is_a_gap(value: float) -> None:
    """Three seconds of NaN, of one value, of a rail: no interval across, no beat invented, the rate stays right."""
    rhythm = trials.resting(60, rr_s=60 / 70)
    ecg = trials.ecg_of(rhythm, FS_HZ, 60)
    ecg[30 * 130 : 33 * 130] = value
    updates = play(ecg)
    rr_ms = np.array([rr for u in updates for rr in u.rr_intervals_ms])
    assert np.isnan(rr_ms).sum() == 2
    assert np.nanmax(rr_ms) < 1000
    assert np.abs(confident_rates(updates) - 70).max() < 7
    assert abs(updates[-1].hrv.rmssd_ms - np.sqrt(np.nanmean(np.diff(np.diff(rhythm.beats_s[:-3]) * 1e3) ** 2))) < 3


def test_hole_is_told_at_once() -> None:
    """While there is no signal the quality is 0, no rate is given, and the reason says since when."""
    ecg = trials.ecg_of(trials.resting(30), FS_HZ, 30)
    ecg[20 * 130 :] = ecg[20 * 130]
    last = play(ecg)[22]
    assert last.signal_quality == 0
    assert np.isnan([last.heart_rate_bpm, last.rr_interval_ms]).all()
    assert any(reason.startswith("no signal: the value has not changed for") for reason in last.reasons)


def test_electrodes_off_for_long() -> None:
    """After 20 s at a rail everything begins anew, and no rate is wrong."""
    ecg = trials.ecg_of(trials.resting(80, rr_s=60 / 70), FS_HZ, 80)
    ecg[30 * 130 : 50 * 130] = -9000
    updates = play(ecg)
    assert np.abs(confident_rates(updates) - 70).max() < 7
    assert updates[-1].hrv.window_s < 31
    assert updates[-1].signal_quality > 0.9


@pytest.mark.parametrize("shape", ["toggling", "falling", "noise at a rail"])
def test_electrodes_off_that_still_vary(shape: str) -> None:
    """Twenty seconds without a beat are no interval, though the samples vary: no confident rate is low."""
    n = 20 * 130
    off = {
        "toggling": 4000 + 5 * (np.arange(n) % 2),
        "falling": 5000 * np.exp(-np.arange(n) / FS_HZ / 3),
        "noise at a rail": 9000 + np.random.default_rng(5).normal(0, 3, n),
    }
    ecg = trials.ecg_of(trials.resting(80, rr_s=60 / 70), FS_HZ, 80)
    ecg[30 * 130 : 50 * 130] = off[shape]
    updates = play(ecg)
    assert np.abs(confident_rates(updates) - 70).max() < 5
    assert updates[-1].signal_quality > 0.9


@pytest.mark.parametrize(
    ("hz", "every_s", "amplitude_uv"), [(60.0, 20, 1000.0), (60.0, 10, 1000.0), (50.0, 20, 1000.0), (50.0, 10, 5000.0)]
)
@pytest.mark.parametrize("seed", [2, 5])
def test_electrode_off_that_picks_up_mains(hz: float, every_s: float, amplitude_uv: float, seed: int) -> None:
    """Three seconds of nothing but hum are no pause of the heart: no confident rate is low."""
    ecg, t_s = trials.ecg_of(trials.resting(90, seed), FS_HZ, 90), np.arange(90 * 130) / FS_HZ
    ecg = np.where(t_s % every_s < 3, hum_at(hz, t_s, amplitude_uv), ecg)
    assert np.all(np.abs(confident_rates(play(ecg)) - 78) < 5)


@pytest.mark.parametrize("fs_hz", [130.0, 250.0])
@pytest.mark.parametrize("level_uv", [5000.0, -9000.0])
def test_electrode_off_at_a_rail_for_two_beats(fs_hz: float, level_uv: float) -> None:
    """The signal jumps to a rail and back, with noise there: that is no pause, and no confident rate is low."""
    ecg, t_s = trials.ecg_of(trials.resting(90), fs_hz, 90), np.arange(round(90 * fs_hz)) / fs_hz
    rail = level_uv + np.random.default_rng(5).normal(0, 10, len(t_s))
    updates = play(np.where((t_s > 20) & (t_s % 20 < 1.6), rail, ecg), fs_hz)
    rates = confident_rates(updates)
    assert np.all(np.abs(rates - 78) < 5)
    assert len(rates) > 40


@pytest.mark.parametrize("shape", ["arch", "sway"])
@pytest.mark.parametrize(("hole_s", "drift_uv"), [(1.0, 500.0), (1.0, -1500.0), (2.0, 1000.0), (2.0, -1500.0)])
def test_electrode_off_that_glides_off_and_back(shape: str, hole_s: float, drift_uv: float) -> None:
    """The baseline goes away and comes back without a jump: that is no pause, and no confident rate is low."""
    ecg, t_s = trials.ecg_of(trials.resting(90), FS_HZ, 90), np.arange(round(90 * FS_HZ)) / FS_HZ
    at = t_s % 20 / hole_s
    drift = drift_uv * (np.sin(np.pi * at) if shape == "arch" else 0.5 * np.sin(2 * np.pi * at))
    off = drift + np.random.default_rng(5).normal(0, 8, len(t_s))
    rates = confident_rates(play(np.where((t_s > 20) & (at < 1), off, ecg)))
    assert np.all(np.abs(rates - 78) < 5)
    assert len(rates) > 40


@pytest.mark.parametrize("fs_hz", [130.0, 250.0])
@pytest.mark.parametrize("hole_s", [2.0, 3.0, 4.5])
@pytest.mark.parametrize("recovery_s", [0.0, 0.7])
def test_electrode_off_that_glides_by_less_or_comes_back_early(fs_hz: float, hole_s: float, recovery_s: float) -> None:
    """A drift of 0.3 of R, and one that has settled at 3 mV and fades after the hole, are no pause either."""
    ecg, t_s = trials.ecg_of(trials.resting(100), fs_hz, 100), np.arange(round(100 * fs_hz)) / fs_hz
    since_s, off = t_s % 25, (t_s > 25) & (t_s % 25 < hole_s)
    drift = 300 * since_s / hole_s
    if recovery_s:
        drift = 3000 * (1 - np.exp(-since_s / recovery_s))
        ecg = ecg + np.where(t_s > 25, drift[off][-1] * np.exp(-(since_s - hole_s) / recovery_s), 0.0)
    noise = np.random.default_rng(5).normal(0, 8, len(t_s))
    rates = confident_rates(play(np.where(off, drift + noise, ecg), fs_hz))
    assert np.all(np.abs(rates - 78) < 5)
    assert len(rates) > 40


@pytest.mark.parametrize(("every", "t_wave"), [(7, 0.3), (3, 0.15), (2, 0.5)])
@pytest.mark.parametrize("height", [0.5, 0.7])
@pytest.mark.parametrize("width_s", [0.04, 0.05])
def test_low_wide_beats_that_are_passed_over_lower_no_confident_rate(
    every: int, t_wave: float, height: float, width_s: float
) -> None:
    """Ventricular beats too low and too wide for the detector: what moves between T and P wave is no pause."""
    rhythm = trials.every(trials.resting(90), every)
    t_s = np.arange(round(90 * FS_HZ)) / FS_HZ
    sinus = trials.Rhythm(rhythm.beats_s[rhythm.normal], rhythm.normal[rhythm.normal])
    ecg = trials.ecg_of(sinus, FS_HZ, 90)
    for beat_s in rhythm.beats_s[~rhythm.normal]:
        own_t_wave = t_wave * np.exp(-0.5 * ((t_s - beat_s - 0.28) / 0.06) ** 2)
        ecg += 1000 * height * (np.exp(-0.5 * ((t_s - beat_s) / width_s) ** 2) - own_t_wave)
    assert bench_ecg_truth.rate_error(play(ecg), rhythm) < 5


def test_pause_is_one_though_breathing_moves_the_baseline() -> None:
    """A heart that pauses for 2.3 s, the baseline swinging by 0.3 mV with breath: the pause counts as an interval."""
    rhythm = trials.resting(60)
    beats_s = np.delete(rhythm.beats_s, [40, 41])
    ecg = trials.ecg_of(trials.Rhythm(beats_s, np.ones(len(beats_s), bool)), FS_HZ, 60)
    updates = play(ecg + 150 * np.sin(2 * np.pi * 0.25 * np.arange(len(ecg)) / FS_HZ))
    assert min(u.signal_quality for u in updates[10:]) > 0.9


@pytest.mark.parametrize("fs_hz", [130.0, 250.0, 1000.0])
def test_pause_is_one_whatever_hum_there_is_besides(fs_hz: float) -> None:
    """A heart that pauses for 2.3 s under steady hum of 0.2 mV: every interval counts, and quality stays high."""
    rhythm = trials.resting(60)
    beats_s = np.delete(rhythm.beats_s, [40, 41])
    ecg = trials.ecg_of(trials.Rhythm(beats_s, np.ones(len(beats_s), bool)), fs_hz, 60)
    updates = play(ecg + trials.hum(len(ecg), fs_hz, 50.0, 200.0), fs_hz)
    assert min(u.signal_quality for u in updates[10:]) > 0.9


@pytest.mark.parametrize("hole_s", [0.05, 0.1, 0.18])
def test_beat_hidden_by_missing_values(hole_s: float) -> None:
    """A short stretch of NaN over one beat in five: no interval of two beats is told, and no rate is low."""
    rhythm = trials.regular(75, 60)
    ecg = trials.ecg_of(rhythm, FS_HZ, 60)
    for beat in rhythm.beats_s[15:-5:5]:
        ecg[round((beat - hole_s / 2) * FS_HZ) : round((beat + hole_s / 2) * FS_HZ)] = np.nan
    updates = play(ecg)
    assert np.nanmax([rr for u in updates for rr in u.rr_intervals_ms]) < 1200
    assert np.abs(confident_rates(updates) - 75).max() < 5


# -- small beats


Small = tuple[tuple[float, float], ...]
"""How long after a usual beat, s, and how high, as a share of that."""


def with_small_beats(rate_bpm: float, small: Small, pause: bool = True, **shape: float):
    """Samples of a regular heart with such beats after every sixth, and when these are. pause: in place of the next."""
    beats_s = trials.regular(rate_bpm, 60).beats_s
    before_s = beats_s[14:-2:6]
    usual_s = np.setdiff1d(beats_s, beats_s[15:-1:6]) if pause else beats_s
    ecg = trials.ecg_of(trials.Rhythm(usual_s, np.ones(len(usual_s), bool)), FS_HZ, 60)
    added_s = [(beat + after_s, height) for beat in before_s for after_s, height in small]
    for beat, height in added_s:
        near = slice(round((beat - 0.3) * FS_HZ), round((beat + 0.5) * FS_HZ))
        ecg[near] += height * trials.R_UV * trials.heartbeat(np.arange(near.start, near.stop) / FS_HZ - beat, **shape)
    return ecg, np.array([beat for beat, _ in added_s])


@pytest.mark.parametrize(
    ("rate_bpm", "small"),
    [(70, ((0.36, 0.33),)), (35, ((0.53, 0.26),)), (40, ((0.5, 0.4), (0.9, 0.25)))],
    ids=["early", "early in a slow heart", "two in a row"],
)
def test_small_beats_that_come_early_are_found(rate_bpm: float, small: Small) -> None:
    """So much lower than usual beats, where T waves are known to be far less sharp; then a pause."""
    ecg, small_s = with_small_beats(rate_bpm, small)
    found_s = bench_ecg.peaks_s(play(ecg))
    assert all(np.abs(found_s - beat).min() < 0.1 for beat in small_s)


@pytest.mark.parametrize(
    ("rate_bpm", "small", "given"),
    [(35, ((0.53, 0.5),), {"qrs_s": 0.006}), (45, ((0.6, 0.24),), {"pause": False})],
    ids=["half as wide", "no pause after it"],
)
def test_what_is_as_small_and_no_beat(rate_bpm: float, small: Small, given: dict) -> None:
    """A muscle twitches, or an electrode moves, in a slow heart."""
    ecg, others_s = with_small_beats(rate_bpm, small, **given)
    found_s = bench_ecg.peaks_s(play(ecg))
    assert all(np.abs(found_s - other).min() > 0.1 for other in others_s)


@pytest.mark.parametrize("share", [0.03, 0.05, 0.2])
@pytest.mark.parametrize("seed", [2, 5])
def test_beats_that_become_small_are_no_pause(share: float, seed: int) -> None:
    """From one beat to the next all are a fraction as high: the time until they are found again is no interval."""
    ecg = trials.ecg_of(trials.resting(100, seed), FS_HZ, 100)
    ecg[60 * 130 :] *= share
    updates = play(ecg)
    assert np.all(np.abs(confident_rates(updates) - 78) < 5)
    assert updates[-1].signal_quality > 0.9


@pytest.mark.parametrize("seed", [2, 5, 7])
def test_amplitude_that_breathing_halves(seed: int) -> None:
    """A clean signal a third as high breathed in as out: after some seconds no beat is missed, and quality is high."""
    rhythm = trials.resting(60, seed)
    t_s = np.arange(60 * 130) / FS_HZ
    updates = play(trials.ecg_of(rhythm, FS_HZ, 60) * (1 + 0.5 * np.sin(2 * np.pi * 0.25 * t_s)))
    truth_s, found_s = (times[(times > 4) & (times < 57)] for times in (rhythm.beats_s, bench_ecg.peaks_s(updates)))
    _, missed, invented = bench_ecg.compare(truth_s, found_s)
    assert (missed, invented) == (0, 0)
    assert min(u.signal_quality for u in updates[14:]) > 0.9


# -- what is no heart


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_number_from_noise(seed: int) -> None:
    """White noise has no heart rate, nor an interval."""
    updates = play(np.random.default_rng(seed).normal(0, 100, 130 * 60))
    assert np.isnan([(u.heart_rate_bpm, u.rr_interval_ms) for u in updates]).all()
    assert any(reason.startswith("heart_rate_bpm, rr_interval_ms withheld") for reason in updates[-1].reasons)


def without_a_confident_number(updates):
    """Neither a rate nor variability at a quality of 0.7 or more."""
    given = [u for u in updates if np.isfinite(u.heart_rate_bpm) or np.isfinite(u.hrv.rmssd_ms)]
    return all(u.signal_quality < CONFIDENT for u in given)


@pytest.mark.parametrize("hz", [3.0, 5.0, 8.0, 12.0])
def test_sine_is_no_heart(hz: float) -> None:
    """What is as strong between its beats as in them is no heart, however regular."""
    assert without_a_confident_number(play(trials.sine(130 * 60, FS_HZ, hz)))


@pytest.mark.parametrize("fs_hz", [130.0, 250.0])
def test_spikes_are_no_beats(fs_hz: float) -> None:
    """Single samples far off, and a pacemaker that captures nothing, at the pace of a heart.

    What is told of the first is what is told of the noise round them; what the second leaves is nearly nothing.
    """
    n = round(60 * fs_hz)
    pops, noise, pacing = (
        play(ecg, fs_hz)
        for ecg in (trials.pops(n, fs_hz), trials.pops(n, fs_hz, amplitude_uv=0.0), trials.pacing_spikes(n, fs_hz))
    )
    assert without_a_confident_number(pops)
    assert without_a_confident_number(pacing)
    assert len(bench_ecg.peaks_s(pops)) == pytest.approx(len(bench_ecg.peaks_s(noise)), abs=5)
    assert len(bench_ecg.peaks_s(pacing)) < 10


@pytest.mark.parametrize("fs_hz", [125.0, 130.0, 250.0, 1000.0])
def test_pops_of_some_samples_are_no_heart(fs_hz: float) -> None:
    """Rectangles of two samples up to 64 ms, at the pace of a heart: whatever is told of them, it is in doubt."""
    for wide in {2, 3, 4, round(0.032 * fs_hz), round(0.064 * fs_hz)}:
        assert without_a_confident_number(play(trials.pops(round(40 * fs_hz), fs_hz, wide=wide), fs_hz)), wide


@pytest.mark.parametrize(("seed", "count"), [(2, 10), (5, 10), (2, 20), (5, 20)])
def test_excursions_of_some_samples_are_no_kind_of_beat(seed: int, count: int) -> None:
    """A few rectangles of 15 ms among the beats: however much alike they are, no confident rate is wrong."""
    ecg = trials.ecg_of(trials.resting(150, seed), FS_HZ, 150)
    at = np.random.default_rng(count).choice(len(ecg) - 5, count)
    ecg[at] = ecg[at + 1] = 3 * trials.R_UV
    assert np.all(np.abs(confident_rates(play(ecg)) - 78) < 5)


@pytest.mark.parametrize("fs_hz", [100.0, 130.0, 250.0, 1000.0])
@pytest.mark.parametrize("qrs_s", [0.007, 0.012])
def test_narrow_beats_are_a_heart(fs_hz: float, qrs_s: float) -> None:
    """As narrow as an infant's, fast and slow: not taken for pops."""
    for bpm in (60, 180):
        updates = play(trials.ecg_of(trials.regular(bpm, 40), fs_hz, 40, qrs_s=qrs_s), fs_hz)
        assert not any("as pops do" in reason for update in updates for reason in update.reasons)
        assert updates[-1].signal_quality > CONFIDENT


def narrow(rhythm, fs_hz, seconds):
    """An ECG of narrow R peaks of 1 mV and flat T waves, as that of MIT-BIH record 100."""
    t_s = np.arange(round(seconds * fs_hz)) / fs_hz
    beats = sum(trials.heartbeat(t_s - beat_s, qrs_s=0.009, t_wave=0.03) for beat_s in rhythm.beats_s)
    return trials.R_UV * beats + np.random.default_rng(1).normal(0, 10, len(t_s))


@pytest.mark.parametrize("fs_hz", [50.0, 64.0])
def test_narrow_beats_sampled_slowly_are_a_heart(fs_hz: float) -> None:
    """As narrow as a single sample at this rate, yet with Q, S and T waves beside: every beat is told."""
    rhythm = trials.resting(60)
    updates = play(resample_poly(narrow(rhythm, 1000.0, 60), int(fs_hz), 1000), fs_hz)
    found_s = bench_ecg.peaks_s(updates)
    assert len(found_s) > 70
    assert np.abs(found_s - rhythm.beats_s[: len(found_s)]).max() < 0.01


@pytest.mark.parametrize("fs_hz", [50.0, 64.0, 80.0])
def test_single_samples_far_off_are_no_beats_sampled_slowly(fs_hz: float) -> None:
    """Where a beat may be as narrow as a sample, a sample with nothing beside it is none all the same."""
    assert without_a_confident_number(play(trials.pops(round(60 * fs_hz), fs_hz), fs_hz))


@pytest.mark.parametrize("fs_hz", [130.0, 250.0])
@pytest.mark.parametrize("hz", [50.0, 60.0])
def test_hum_makes_no_beat_a_spike(fs_hz: float, hz: float) -> None:
    """A crest of hum of 0.6 mV on a narrow R peak of 1 mV is as narrow as a single sample: every beat is told."""
    rhythm = trials.resting(60)
    ecg = narrow(rhythm, fs_hz, 60)
    updates = play(ecg + hum_at(hz, np.arange(len(ecg)) / fs_hz, 600.0), fs_hz)
    found_s = bench_ecg.peaks_s(updates)
    assert len(found_s) > 70
    assert np.abs(found_s - rhythm.beats_s[: len(found_s)]).max() < 0.01


def with_pulses(ecg, fs_hz, at_s, height_uv):
    """The pulses of a pacemaker, one sample each."""
    pulsed = ecg.copy()
    pulsed[np.rint(at_s * fs_hz).astype(int)] += height_uv
    return pulsed


@pytest.mark.parametrize(("fs_hz", "height_uv"), [(130.0, 2000.0), (130.0, 8000.0), (250.0, 8000.0)])
def test_pacing_beside_the_heart_s_own_rhythm(fs_hz: float, height_uv: float) -> None:
    """Pulses at their own pace, and such as capture nothing beside escape beats, change neither rate nor RMSSD."""
    at_s = np.arange(0.3, 49, 1.1)
    for rhythm in (trials.resting(50, 7), trials.regular(35, 50)):
        ecg = trials.ecg_of(rhythm, fs_hz, 50)
        updates = play(with_pulses(ecg, fs_hz, at_s, height_uv), fs_hz)
        assert bench_ecg_truth.rate_error(updates, rhythm) < 2
        assert confident_rates(updates).size > 30
        assert updates[-1].hrv.rmssd_ms == pytest.approx(ecg_rhythms.rmssd_ms(*rhythm.until(48)), abs=2)


def test_pacing_of_both_chambers() -> None:
    """Pulses of 8 mV before atrium and ventricle: the beats are the complexes they capture, not the pulses."""
    rhythm = trials.regular(70, 50)
    wide = trials.ecg_of(rhythm._replace(beats_s=rhythm.beats_s + 0.06, normal=~rhythm.normal), FS_HZ, 50)
    ecg = with_pulses(wide, FS_HZ, np.concatenate((rhythm.beats_s, rhythm.beats_s - 0.16)), 8000)
    updates = play(ecg)
    _, missed, invented = bench_ecg.compare(rhythm.beats_s[:-3] + 0.06, bench_ecg.peaks_s(updates)[:-1], 0.04)
    assert (missed, invented) == (0, 0)
    assert updates[-1].hrv.rmssd_ms < 5


def test_tremor_is_no_heart() -> None:
    """A trembling hand, alone and over an ECG that is no larger, gives no rate that is confident and wrong."""
    shaking = trials.tremor(130 * 60, FS_HZ)
    assert without_a_confident_number(play(shaking))
    rhythm = trials.resting(60)
    rates = confident_rates(play(trials.ecg_of(rhythm, FS_HZ, 60) + shaking))
    assert np.all(np.abs(rates - 78) < 5)


@pytest.mark.parametrize("rate", [200, 240])
def test_fast_heart_is_one(rate: int) -> None:
    """A heart at the limit of hearts keeps its quality."""
    updates = play(trials.ecg_of(trials.regular(rate, 40), FS_HZ, 40))
    assert np.abs(confident_rates(updates[10:]) - rate).max() < 1
    assert min(u.signal_quality for u in updates[10:]) > 0.9


@pytest.mark.parametrize("p_wave", [0.6, 0.9, 1.1])
def test_tall_p_wave_is_no_beat(p_wave: float) -> None:
    """Low inverted QRS complexes after P waves as tall: one beat each, once three of these have been seen."""
    rhythm = trials.resting(60, rr_s=0.95)
    found = bench_ecg.peaks_s(play(trials.low_inverted(rhythm, FS_HZ, 60, p_wave)))
    errors, missed, invented = bench_ecg.compare(rhythm.beats_s[:-3], found[found < rhythm.beats_s[-4] + 0.1])
    assert len(errors) > 50
    assert missed <= 1
    assert invented <= 3


@pytest.mark.parametrize("height", [1.5, 2.0])
def test_tall_narrow_t_wave_is_no_beat(height: float) -> None:
    """T waves taller than the R wave and 66 ms wide at half their height: one beat each, once three have been seen.

    Ventricular beats as early look the same, so no rate is confident.
    """
    rhythm = trials.resting(40)
    ecg, t_s = trials.ecg_of(rhythm, FS_HZ, 40), np.arange(round(40 * FS_HZ)) / FS_HZ
    for beat in rhythm.beats_s:
        ecg += height * trials.R_UV * np.exp(-0.5 * ((t_s - beat - 0.24) / 0.028) ** 2)
    updates = play(ecg)
    assert bench_ecg_truth.rate_error(updates, rhythm) < 5
    assert updates[-1].heart_rate_bpm == pytest.approx(78, abs=3)
    assert not confident_rates(updates[15:]).size
    assert any(reason.startswith("signal_quality: what follows the beats") for reason in updates[-1].reasons)
    assert len(bench_ecg.peaks_s(updates)) <= len(rhythm.beats_s) + 3


def with_t_waves(height, at_s, sigma_s, rate_bpm, fs_hz, wander=0.0, qrs_s=0.012, seconds=45):
    """A breathing heart with T waves so tall (of R), so long after R, so wide; their height wanders by that share."""
    intervals_s = ecg_arrhythmias.sinus(rate_bpm, seconds, depth=0.06, seed=rate_bpm)
    beats_s = 0.5 + np.append(0.0, np.cumsum(intervals_s))
    t_s = np.arange(round(seconds * fs_hz)) / fs_hz
    ecg = np.random.default_rng(1).normal(0, 20, len(t_s))
    for beat, interval_s in zip(beats_s, np.append(60 / rate_bpm, intervals_s), strict=True):
        own = height * (1 + wander * np.sin(2 * np.pi * 0.13 * beat))
        top_s = beat + at_s + 0.02 * (interval_s - 60 / rate_bpm)
        ecg += trials.R_UV * trials.heartbeat(t_s - beat, qrs_s, t_wave=0.0)
        ecg += trials.R_UV * own * np.exp(-0.5 * ((t_s - top_s) / sigma_s) ** 2)
    return ecg, trials.Rhythm(beats_s, np.ones(len(beats_s), bool))


@pytest.mark.parametrize(
    ("height", "at_s", "sigma_s", "rate_bpm", "fs_hz", "wander"),
    [
        (0.5, 0.44, 0.02, 38, 130.0, 0.25),
        (1.0, 0.44, 0.03, 50, 500.0, 0.0),
        (2.0, 0.32, 0.04, 60, 130.0, 0.0),
        (2.0, 0.44, 0.06, 60, 250.0, 0.25),
        (1.5, 0.40, 0.02, 75, 500.0, 0.0),
        (2.5, 0.40, 0.02, 75, 500.0, 0.25),
        (-2.5, 0.44, 0.03, 38, 130.0, 0.25),
    ],
)
def test_late_tall_t_wave_is_no_beat(height, at_s, sigma_s, rate_bpm, fs_hz, wander) -> None:
    """T waves of half to 2.5 times R, up to 0.44 s after it, are no beats in slow hearts: every rate is right."""
    ecg, rhythm = with_t_waves(height, at_s, sigma_s, rate_bpm, fs_hz, wander)
    updates = play(ecg, fs_hz)
    assert bench_ecg_truth.rate_error(updates, rhythm) < 5
    rates = [u.heart_rate_bpm for u in updates[20:]]
    assert rates == pytest.approx([rate_bpm] * len(rates), abs=7)
    assert len(bench_ecg.peaks_s(updates)) <= len(rhythm.beats_s) + 5


@pytest.mark.parametrize(("height", "at_s", "rate_bpm"), [(1.5, 0.32, 60), (1.5, 0.4, 75)])
def test_t_wave_nearly_as_sharp_as_the_qrs_complex_is_no_confident_beat(height, at_s, rate_bpm) -> None:
    """T waves of 47 ms after QRS complexes of 38 ms, at half their height, count as beats, with a doubt."""
    ecg, _ = with_t_waves(height, at_s, 0.02, rate_bpm, 250.0, qrs_s=0.016)
    updates = play(ecg, 250.0)
    assert not confident_rates(updates[12:]).size
    assert any(reason.startswith("signal_quality: what follows the beats") for reason in updates[-1].reasons)


@pytest.mark.parametrize("qrs_s", [0.016, 0.02, 0.025])
@pytest.mark.parametrize(("height", "at_s", "rate_bpm"), [(0.7, 0.32, 75), (1.5, 0.38, 60), (-1.5, 0.44, 50)])
def test_t_wave_as_sharp_as_a_wide_qrs_complex_is_no_confident_beat(qrs_s, height, at_s, rate_bpm) -> None:
    """T waves of 47 ms after QRS complexes as wide: they come sooner than the beat after, and no T wave follows."""
    ecg, _ = with_t_waves(height, at_s, 0.02, rate_bpm, 250.0, qrs_s=qrs_s, seconds=30)
    updates = play(ecg, 250.0)
    assert not confident_rates(updates[12:]).size
    assert any(reason.startswith("signal_quality: what follows the beats") for reason in updates[-1].reasons)


def early_narrow(coupling_s, t_wave, seconds=45):
    """Every other beat is an atrial one, at that time after the sinus node's: as narrow, with a T wave of its own."""
    sinus_s = 0.5 + np.append(0.0, np.cumsum(ecg_arrhythmias.sinus(85, seconds, depth=0.04)))[::2]
    beats_s, t_s = np.sort(np.append(sinus_s, sinus_s + coupling_s)), np.arange(round(seconds * FS_HZ)) / FS_HZ
    ecg = np.random.default_rng(1).normal(0, 10, len(t_s))
    for beat in beats_s:
        ecg += trials.R_UV * trials.heartbeat(t_s - beat, t_wave=t_wave)
    return ecg, trials.Rhythm(beats_s, np.ones(len(beats_s), bool))


@pytest.mark.parametrize("coupling_s", [0.4, 0.46])
@pytest.mark.parametrize("t_wave", [0.12, 0.25])
def test_atrial_bigeminy_is_no_tall_t_wave(coupling_s: float, t_wave: float) -> None:
    """Narrow beats that come early, in turn with others, have T waves: the rate is told, and with confidence."""
    ecg, rhythm = early_narrow(coupling_s, t_wave)
    updates = play(ecg)
    assert bench_ecg_truth.rate_error(updates, rhythm) < 5
    assert len(confident_rates(updates[12:])) == len(updates[12:])


def alternans(rate_bpm, share, fs_hz=FS_HZ, seconds=30):
    """A fast heart of which every other beat has that share of the height of the others."""
    rhythm, t_s = trials.regular(rate_bpm, seconds), np.arange(round(seconds * fs_hz)) / fs_hz
    ecg = np.random.default_rng(1).normal(0, 10, len(t_s))
    for i, beat in enumerate(rhythm.beats_s):
        beat_uv = trials.R_UV * (share if i % 2 else 1.0)
        ecg += beat_uv * trials.heartbeat(t_s - beat, t_wave=0.0, p_wave=0.0)
        ecg += 0.15 * beat_uv * np.exp(-0.5 * ((t_s - beat - 36 / rate_bpm) / 0.03) ** 2)
    return ecg, rhythm


@pytest.mark.parametrize("rate_bpm", [180, 200, 220, 240])
@pytest.mark.parametrize("share", [0.35, 0.5, 0.6])
def test_every_other_beat_of_a_fast_heart_lower_is_no_confident_half(rate_bpm: int, share: float) -> None:
    """Low beats are as sharp as the others, as no T wave is: counted, or the rate is in doubt."""
    for fs_hz in (FS_HZ, 250.0):
        ecg, rhythm = alternans(rate_bpm, share, fs_hz)
        assert bench_ecg_truth.rate_error(play(ecg, fs_hz), rhythm) < 5


def pairs_at(rate_bpm, coupling_s, t_wave, seconds=45):
    """A breathing heart in which a ventricular beat follows every sinus beat, and stops the next one."""
    sinus_s = 0.5 + np.append(0.0, np.cumsum(ecg_arrhythmias.sinus(rate_bpm, seconds, depth=0.04)))[::2]
    t_s = np.arange(round(seconds * FS_HZ)) / FS_HZ
    ecg = trials.ecg_of(trials.Rhythm(sinus_s, np.ones(len(sinus_s), bool)), FS_HZ, seconds)
    for at_s in sinus_s + coupling_s:
        ecg += 1.5 * trials.R_UV * np.exp(-0.5 * ((t_s - at_s) / 0.035) ** 2)
        ecg += 1.5 * trials.R_UV * t_wave * np.exp(-0.5 * ((t_s - at_s - 0.27) / 0.06) ** 2)
    return ecg, trials.Rhythm(np.sort(np.append(sinus_s, sinus_s + coupling_s)), np.ones(2 * len(sinus_s), bool))


@pytest.mark.parametrize("coupling_s", [0.4, 0.44, 0.48])
def test_bigeminy_with_t_waves_of_its_own_is_no_tall_t_wave(coupling_s: float) -> None:
    """Ventricular beats may follow at one distance, as T waves do, but have T waves: they are counted."""
    ecg, rhythm = pairs_at(85, coupling_s, -0.4)
    updates = play(ecg)
    assert bench_ecg_truth.rate_error(updates, rhythm) < 5
    assert len(confident_rates(updates[12:])) == len(updates[12:])


@pytest.mark.parametrize("coupling_s", [0.38, 0.42, 0.48])
def test_bigeminy_without_t_waves_is_no_confident_half(coupling_s: float) -> None:
    """Without a T wave nothing tells ventricular beats from tall T waves: no rate is sure."""
    updates = play(pairs_at(85, coupling_s, 0.0)[0])
    assert not confident_rates(updates[12:]).size


@pytest.mark.parametrize("coupling_s", [0.3, 0.33])
def test_early_bigeminy_gives_no_confident_rate_that_is_wrong(coupling_s: float) -> None:
    """Ventricular beats that come as early as a T wave are not passed over in silence."""
    normal_s = np.arange(0.5, 49, 2 * 0.77)
    beats_s = np.sort(np.concatenate((normal_s, normal_s + coupling_s)))
    rhythm = trials.Rhythm(beats_s, np.arange(len(beats_s)) % 2 == 0)
    rates = confident_rates(play(trials.ecg_of(rhythm, FS_HZ, 50)))
    assert np.all(rates > 60)


def bigeminy(coupling_s, seconds=40, height=0.6, sigma_s=0.032, dip=-0.45, t_wave=-0.4, sinus_s=0.0):
    """Pairs of a normal and a wide beat at 48 /min, after a sinus rhythm: the ECG and its beats."""
    sinus_beats_s = np.arange(0.5, sinus_s, 0.77)
    normal_s = np.append(sinus_beats_s, np.arange(sinus_beats_s[-1] + 0.77 if sinus_s else 0.5, seconds - 2, 1.24))
    wide_s, t_s = normal_s[len(sinus_beats_s) :] + coupling_s, np.arange(round(seconds * FS_HZ)) / FS_HZ
    rhythm = trials.Rhythm(normal_s, np.ones(len(normal_s), bool))
    ecg = trials.ecg_of(rhythm, FS_HZ, seconds, qrs_s=0.01)
    for share, at_s, wide in ((1, 0, sigma_s), (dip, 0.07, 0.035), (t_wave, 0.3, 0.06)):
        waves = np.exp(-0.5 * ((t_s[:, None] - wide_s - at_s) / wide) ** 2)
        ecg += share * height * trials.R_UV * waves.sum(axis=1)
    return ecg, np.sort(np.concatenate((normal_s, wide_s)))


@pytest.mark.parametrize("coupling_s", [0.34, 0.36, 0.38])
def test_bigeminy_of_wide_beats_no_taller_than_the_others_is_no_confident_half(coupling_s: float) -> None:
    """Ventricular beats of 0.2 s and 0.6 of R have a third of the QRS energy, T waves less: there is doubt."""
    ecg, _ = bigeminy(coupling_s)
    assert np.all(confident_rates(play(ecg)[12:]) > 90)


@pytest.mark.parametrize("coupling_s", [0.34, 0.4, 0.5])
@pytest.mark.parametrize("t_wave", [-0.25, -0.45])
def test_bigeminy_of_wide_beats_with_little_qrs_energy_is_no_confident_half(coupling_s: float, t_wave: float) -> None:
    """They have a fifth of the QRS energy, as tall T waves have, but a T wave of their own, against them."""
    ecg, _ = bigeminy(coupling_s, sigma_s=0.038, dip=-0.2, height=0.7, t_wave=t_wave)
    updates = play(ecg)
    assert not confident_rates(updates[12:]).size
    assert any(reason.startswith("signal_quality: what follows the beats") for reason in updates[-1].reasons)


def test_bigeminy_that_sets_in_is_soon_in_doubt() -> None:
    """Three wide beats passed over are enough: of the rates after a sinus rhythm three are confident and too low."""
    ecg, beats_s = bigeminy(0.36, 50, sinus_s=20.0, sigma_s=0.038, dip=0.0, height=0.7)
    updates = play(ecg)
    rates = [ecg_rhythms.rate_bpm(beats_s, i - 9, i - 0.5) for i in range(len(updates))]
    wrong = [u.heart_rate_bpm < rate - 5 for u, rate in zip(updates, rates, strict=True) if u.signal_quality >= 0.7]
    assert sum(wrong) <= 3


@pytest.mark.parametrize("rr_s", [0.77, 1.0])
@pytest.mark.parametrize("t_wave", [-0.8, -0.5, 0.8])
def test_tall_t_waves_before_tall_p_waves_are_no_ventricular_beats(t_wave: float, rr_s: float) -> None:
    """T waves of up to 0.8 of R, 80 ms wide, and P waves of a quarter of it, in a heart at rest: no doubt."""
    rhythm, t_s = trials.resting(40, rr_s=rr_s), np.arange(round(40 * FS_HZ)) / FS_HZ
    ecg = trials.ecg_of(rhythm, FS_HZ, 40, p_wave=0.25)
    for beat in rhythm.beats_s:
        ecg += (t_wave - 0.25) * trials.R_UV * np.exp(-0.5 * ((t_s - beat - 0.3) / 0.035) ** 2)
    assert confident_rates(play(ecg)[10:]) == pytest.approx(60 / rr_s, abs=3)
    assert min(u.signal_quality for u in play(ecg)[10:]) > 0.9


# -- electrodes that move


def test_electrode_motion() -> None:
    """From 24 to 0 dB quality falls; no confident rate is off by 5 bpm, no RMSSD by 10 ms."""
    qualities = []
    for snr_db in (24, 18, 12, 6, 0):
        rhythm = trials.resting(80)
        noise = trials.at_snr(trials.electrode_motion(80 * 130, FS_HZ, 2), snr_db)
        updates = play(trials.ecg_of(rhythm, FS_HZ, 80) + noise)[8:]
        rates = confident_rates(updates)
        assert not len(rates) or np.abs(rates - 78).max() < 5
        given = np.array([u.hrv.rmssd_ms for u in updates if np.isfinite(u.hrv.rmssd_ms)])
        assert not len(given) or np.abs(given - ecg_rhythms.rmssd_ms(*rhythm.until(78))).max() < 10
        qualities.append(np.mean([u.signal_quality for u in updates]))
    assert np.all(np.diff(qualities) < 0)
    assert qualities[0] > 0.9


@pytest.mark.parametrize(("seed", "snr_db"), [(2, 12), (7, 12), (8, 6)])
def test_beats_invented_by_motion(seed: int, snr_db: float) -> None:
    """A beat that splits an interval like the others puts the rate in doubt: no confident one is off by 5 bpm."""
    rhythm = trials.resting(90)
    noise = trials.at_snr(trials.electrode_motion(bench_ecg_truth.N, FS_HZ, seed), snr_db)[: 90 * 130]
    assert bench_ecg_truth.rate_error(play(trials.ecg_of(rhythm, FS_HZ, 90) + noise), rhythm) < 5


def test_onset_of_motion() -> None:
    """Five seconds after motion sets in the quality is as low as it stays."""
    ecg = trials.ecg_of(trials.resting(50), FS_HZ, 50)
    noise = trials.at_snr(trials.electrode_motion(bench_ecg_truth.N, FS_HZ, 3), 6)
    ecg[30 * 130 :] += noise[: 20 * 130]
    qualities = [update.signal_quality for update in play(ecg)]
    assert qualities[29] > 0.95
    assert max(qualities[34:]) < 0.7


def test_motion_of_the_device_is_evidence() -> None:
    """Where the device moves, doubts count twice: poor quality is lower, clean beats keep theirs."""
    rhythm = trials.resting(40)
    noise = trials.at_snr(trials.electrode_motion(40 * 130, FS_HZ, 2), 18)
    t_s = np.arange(40 * 130) / FS_HZ
    walking = np.stack([3 * np.sin(2 * np.pi * 1.9 * t_s), 0 * t_s, 0 * t_s + 9.81], axis=1)
    for ecg, least in ((trials.ecg_of(rhythm, FS_HZ, 40), 0.95), (trials.ecg_of(rhythm, FS_HZ, 40) + noise, 0.0)):
        still, moved = (bench_ecg.play(ecg, FS_HZ, moved=moved)[8:] for moved in (0 * walking, walking))
        qualities = [(one.signal_quality, other.signal_quality) for one, other in zip(still, moved, strict=True)]
        assert all(other == pytest.approx(one**2) and other >= least for one, other in qualities)


# -- white noise


def test_steady_white_noise_locks_nothing_out() -> None:
    """In 0.3 mV of it beats of 1 mV are still found, no confident rate is wrong, and once it ends none is missed."""
    rhythm = trials.resting(60)
    ecg = trials.ecg_of(rhythm, FS_HZ, 60)
    ecg[: 45 * 130] += np.random.default_rng(2).normal(0, 300, 45 * 130)
    updates = play(ecg)
    found_s = bench_ecg.peaks_s(updates)
    noisy, quiet = ((5, 45), (50, 58))
    (hits, missed, invented), (_, lost, _) = (
        bench_ecg.compare(*(times[(times > a) & (times < b)] for times in (rhythm.beats_s, found_s)))
        for a, b in (noisy, quiet)
    )
    assert len(hits) / (len(hits) + missed) > 0.7
    assert len(hits) / (len(hits) + invented) > 0.91
    assert lost == 0
    assert np.all(np.abs(confident_rates(updates) - 78) < 5)


def rmssds_ms(updates):
    """RMSSD at a quality of 0.7 or more."""
    values = np.array([u.hrv.rmssd_ms for u in updates if u.signal_quality >= CONFIDENT])
    return values[np.isfinite(values)]


@pytest.mark.parametrize("noise_uv", [60.0, 100.0, 140.0])
def test_noise_that_moves_r_peaks_is_no_variability(noise_uv: float) -> None:
    """A wide R peak is moved far by noise that hides no beat: RMSSD is within 10 ms or not given, with the reason."""
    rhythm = trials.regular(95, 90)
    updates = play(trials.ecg_of(rhythm, 250.0, 90, noise_uv=noise_uv, qrs_s=0.03), 250.0)
    assert np.all(rmssds_ms(updates) < 10)
    withheld = [u for u in updates[40:] if u.signal_quality >= CONFIDENT and np.isnan(u.hrv.rmssd_ms)]
    assert all("hrv withheld: noise moves the R peaks" in u.reasons[-1] for u in withheld)


def test_noise_beside_a_variability_of_its_own_withholds_nothing() -> None:
    """The squares add: noise that moves each peak by 1 ms is nothing beside an RMSSD of 27 ms."""
    updates = play(trials.ecg_of(trials.resting(90), FS_HZ, 90, noise_uv=60))
    clean = play(trials.ecg_of(trials.resting(90), FS_HZ, 90))
    assert len(rmssds_ms(updates)) == len(rmssds_ms(clean)) > 50
    assert updates[-1].hrv.rmssd_ms == pytest.approx(clean[-1].hrv.rmssd_ms, abs=1.0)


# -- mains


def timing_ms(updates, rhythm):
    """Standard deviation of the errors of the R peaks."""
    found_s = bench_ecg.peaks_s(updates)
    errors, missed, invented = bench_ecg.compare(rhythm.beats_s[rhythm.beats_s < found_s[-1] + 0.2], found_s)
    assert (missed, invented) == (0, 0)
    return 1e3 * float(errors.std())


@pytest.mark.parametrize(("fs_hz", "hz"), [(250.0, 50.0), (130.0, 50.0), (130.0, 60.0), (100.0, 60.0)])
def test_hum_moves_no_peak(fs_hz: float, hz: float) -> None:
    """Hum of half an R wave leaves R peaks where they are, to 0.5 ms, and RMSSD, to 0.2 ms."""
    rhythm = trials.resting(60)
    ecg = trials.ecg_of(rhythm, fs_hz, 60)
    clean, hummed = play(ecg, fs_hz), play(ecg + trials.hum(len(ecg), fs_hz, hz), fs_hz)
    assert timing_ms(hummed, rhythm) < 0.5
    assert hummed[-1].hrv.rmssd_ms == pytest.approx(clean[-1].hrv.rmssd_ms, abs=0.2)


def hum_at(hz, t_s, amplitude_uv=400.0):
    """Mains of any amplitude."""
    return amplitude_uv * np.sin(2 * np.pi * hz * t_s)


def hum_that_swings(hz, t_s, _beats_s):
    """Its amplitude goes up and down by 90 % within 3 s."""
    return hum_at(hz, t_s, 300 * (1 + 0.9 * np.sin(2 * np.pi * t_s / 3)))


def hum_that_steps(hz, t_s, beats_s):
    """Every ninth interval it jumps between 50 and 600 uV."""
    steps = np.searchsorted((beats_s[:-1] + np.diff(beats_s) / 2)[::9], t_s)
    return hum_at(hz, t_s, np.where(steps % 2, 600, 50))


def hum_with_harmonics(hz, t_s, _beats_s):
    """Its second and third harmonic as well."""
    return hum_at(hz, t_s) + hum_at(2 * hz, t_s, 100) + hum_at(3 * hz, t_s + 0.01, 150)


@pytest.mark.parametrize(
    ("hum", "fs_hz", "hz"),
    [
        *product((hum_that_swings, hum_that_steps), (130.0, 250.0), (50.0, 60.2)),
        *((hum_with_harmonics, *where) for where in product((130.0, 250.0), (49.8, 60.2))),
        (hum_with_harmonics, 130.0, 50.0),
    ],
)
def test_hum_that_changes_or_has_harmonics_moves_no_peak(hum, fs_hz: float, hz: float) -> None:
    """Nor does hum whose amplitude swings or jumps, or that has harmonics, wherever sampling folds them."""
    rhythm = trials.resting(40)
    ecg = trials.ecg_of(rhythm, fs_hz, 40)
    hummed = play(ecg + hum(hz, np.arange(len(ecg)) / fs_hz, rhythm.beats_s), fs_hz)
    assert timing_ms(hummed, rhythm) < 0.5


def test_a_turn_of_the_mains_is_no_jump() -> None:
    """Harmonics make one difference of a turn much steeper than its neighbours; no R peak is moved by it."""
    rhythm, t_s = trials.resting(60, 250), np.arange(15000) / 250
    hum = hum_at(49.8, t_s) + hum_at(99.6, t_s, 100) + 150 * np.sin(2 * np.pi * 149.4 * t_s + 1)
    ecg = trials.ecg_of(rhythm, 250.0, 60) + hum
    assert timing_ms(play(ecg, 250.0), rhythm) < 0.5


# -- R peaks cut off by a limit


@pytest.mark.parametrize("fs_hz", [130.0, 250.0])
@pytest.mark.parametrize("polarity", [1, -1])
def test_beats_cut_off_by_a_limit_are_timed_by_the_middle_of_their_top(fs_hz: float, polarity: int) -> None:
    """An amplifier that gives out at half of R: no peak moves to one end of its flat top, now to this, now to that."""
    rhythm, t_s = trials.resting(50), np.arange(round(50 * fs_hz)) / fs_hz
    ecg = np.random.default_rng(1).normal(0, 8, len(t_s)) + 40 * np.sin(1.6 * t_s)
    for beat_s in rhythm.beats_s:
        for height, at_s, sigma_s in ((1, 0, 0.014), (-0.15, -0.035, 0.014), (-0.15, 0.035, 0.014), (0.25, 0.28, 0.05)):
            ecg += height * trials.R_UV * np.exp(-0.5 * ((t_s - beat_s - at_s) / sigma_s) ** 2)
    updates = play(polarity * np.minimum(ecg, trials.R_UV / 2), fs_hz)
    assert timing_ms(updates, rhythm) < 1
    assert updates[-1].hrv.rmssd_ms == pytest.approx(ecg_rhythms.rmssd_ms(*rhythm), abs=0.5)


def test_middle_of_a_top_that_is_cut_off() -> None:
    """Where the slopes beside the flat top would reach the limit; from 5 ms on, and no step of the resolution."""
    cut = np.array([0.0, 0.0, 2.0, 4.0, 5.0, 5.0, 5.0, 1.0, -3.0, -3.0])
    assert middle_of_cut(cut, 5.3, 5.0, 250.0) == pytest.approx((3.5 + 6.0) / 2)
    assert middle_of_cut(-cut, 4.2, -5.0, 250.0) == pytest.approx((3.5 + 6.0) / 2)
    assert np.isnan(middle_of_cut(cut, 5.0, 5.0, 500.0))
    assert np.isnan(middle_of_cut(cut, 5.0, -5.0, 250.0))
    assert np.isnan(middle_of_cut(cut, 5.0, 200.0, 250.0))
    assert np.isnan(middle_of_cut(np.ones(20), 5.0, 0.0, 250.0))
    assert np.isnan(middle_of_cut(np.sin(np.arange(20.0)), 1.0, 1.0, 250.0))


# -- jumps


def with_jumps(ecg, fs_hz, seed, per_s=0.3):
    """The baseline goes to another level, as when an electrode slips, by up to several mV."""
    random = np.random.default_rng(seed)
    at = random.integers(10, len(ecg), round(per_s * len(ecg) / fs_hz))
    return ecg + np.cumsum(np.bincount(at, random.normal(0, 2500, len(at)), len(ecg)))


@pytest.mark.parametrize("fs_hz", [130.0, 250.0])
def test_jumps_of_the_baseline_are_no_beats(fs_hz: float) -> None:
    """Steps of several mV, one in three seconds, invent no beat, hide none, and move no number."""
    rhythm = trials.resting(90, 11)
    updates = play(with_jumps(trials.ecg_of(rhythm, fs_hz, 90), fs_hz, 1), fs_hz)
    assert bench_ecg_truth.rate_error(updates, rhythm) < 2
    assert len(bench_ecg.peaks_s(updates)) == pytest.approx(np.sum(rhythm.beats_s < 89), abs=2)
    assert updates[-1].hrv.rmssd_ms == pytest.approx(ecg_rhythms.rmssd_ms(*rhythm), abs=2)


def test_jumps_do_not_depend_on_the_cut_into_chunks() -> None:
    """A step at the end of a chunk, or of a look, is taken out as any other."""
    ecg = with_jumps(trials.ecg_of(trials.resting(30, 11), 250.0, 30), 250.0, 3, per_s=2.0)
    whole, single = (bench_ecg.play(ecg, 250.0, frame_s=frame_s) for frame_s in (1.0, 0.012))
    assert bench_ecg.peaks_s(whole)[:25] == pytest.approx(bench_ecg.peaks_s(single)[:25], abs=1e-6)
