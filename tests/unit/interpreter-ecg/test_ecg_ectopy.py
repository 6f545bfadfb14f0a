"""interpreter-ecg: beats that are not the sinus node's, and what they leave of variability (bench: bench_ecg_truth)."""

import sys
from pathlib import Path

import numpy as np
import pytest
from interpreter_ecg.morphology import Label, Morphology

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))
import ecg_rhythms
import ecg_trials as trials
from bench_ecg import play as play_at

FS_HZ = 130.0
CONFIDENT = 0.7


def play(ecg):
    """Every update of a recording."""
    return play_at(ecg, FS_HZ)


def extra(update, name):
    """One value of `extra`."""
    return next(feature.values[0] for feature in update.extra if feature.name == name)


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_variability_with_ectopic_beats(share: float) -> None:
    """With up to a tenth of ectopic beats RMSSD is that of the normal ones, to 2 ms; how many there are is told."""
    rhythm = trials.with_premature(trials.resting(120), share)
    updates = play(trials.ecg_of(rhythm, FS_HZ, 120))
    assert updates[-1].hrv.rmssd_ms == pytest.approx(ecg_rhythms.rmssd_ms(*rhythm.until(118)), abs=2)
    assert extra(updates[-1], "ectopic_percent") == pytest.approx(100 * np.mean(~rhythm.normal), abs=4)


@pytest.mark.parametrize("n", [2, 3])
def test_rhythm_with_too_many_ectopic_beats(n: int) -> None:
    """In bigeminy and trigeminy there is a rate but no variability, and the reason says how many are ectopic."""
    last = play(trials.ecg_of(trials.every(trials.resting(90), n), FS_HZ, 90))[-1]
    assert last.heart_rate_bpm == pytest.approx(78, abs=5)
    assert np.isnan(last.hrv.rmssd_ms)
    assert extra(last, "ectopic_percent") == pytest.approx(100 / n, abs=4)
    assert any(reason.startswith("hrv withheld: ectopic ") for reason in last.reasons)


def test_kind_that_comes_hardly_early() -> None:
    """A kind of beats followed by an interval 8 % longer than the one they end is ectopic once there are many."""
    morphology, t_s = Morphology(), np.linspace(-0.15, 0.25, 41)
    shapes = {True: trials.ventricular(t_s), False: trials.heartbeat(t_s)}
    lengths_ms = {0: 770.0, 1: 832.0}
    told = [morphology.label(shapes[i % 6 == 0], lengths_ms.get(i % 6, 800.0), clean=True) for i in range(300)]
    assert told[-6:].count(Label.ECTOPIC) == 1
    assert told[294] is Label.ECTOPIC


def test_conduction_is_no_ectopy() -> None:
    """Wide beats that come neither early nor before a pause, as in bundle branch block, are normal ones."""
    rhythm = trials.resting(90)
    narrow = rhythm._replace(normal=(rhythm.beats_s < 30) | (rhythm.beats_s > 60))
    last = play(trials.ecg_of(narrow, FS_HZ, 90))[-1]
    assert extra(last, "ectopic_percent") == 0
    assert last.hrv.rmssd_ms == pytest.approx(ecg_rhythms.rmssd_ms(*rhythm.until(88)), abs=2)


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_fusion_beats_in_time_are_no_part_of_variability(share: float) -> None:
    """Wide beats in time, their peak 20 to 50 ms later: RMSSD is that between beats of one shape, to 2 ms."""
    random = np.random.default_rng(4)
    rhythm = trials.resting(120)
    rhythm = rhythm._replace(normal=random.random(len(rhythm.beats_s)) >= share)
    moved_s = np.where(rhythm.normal, 0.0, random.uniform(0.02, 0.05, len(rhythm.normal)))
    peaks = rhythm._replace(beats_s=rhythm.beats_s + moved_s)
    last = play(trials.ecg_of(peaks, FS_HZ, 120))[-1]
    assert last.hrv.rmssd_ms == pytest.approx(ecg_rhythms.rmssd_ms(*rhythm.until(118)), abs=2)
    assert last.signal_quality >= CONFIDENT


@pytest.mark.parametrize("share", [0.1, 0.2])
def test_beats_that_fuse_in_the_shape_of_their_kind_are_no_part_of_variability(share: float) -> None:
    """A ventricular beat half as large begins in the normal one and moves its peak; the kinds are the same."""
    random = np.random.default_rng(4)
    rhythm = trials.regular(75, 120)
    ecg = trials.ecg_of(rhythm, FS_HZ, 120, qrs_s=0.025)
    alone = play(ecg)[-1].hrv
    t_s = np.arange(len(ecg)) / FS_HZ
    for beat_s in rhythm.beats_s[random.random(len(rhythm.beats_s)) < share]:
        ecg += 0.5 * trials.R_UV * trials.ventricular(t_s - beat_s - 0.03)
    fused = play(ecg)[-1].hrv
    assert alone.corrected_count == 0
    assert fused.corrected_count > 0
    assert fused.rmssd_ms == pytest.approx(alone.rmssd_ms, abs=1.5)


def test_a_long_interval_after_the_first_is_no_ectopic_kind() -> None:
    """A kind of which one interval is known has no pause yet: the second beat after an early one is normal."""
    morphology, shape = Morphology(), trials.heartbeat(np.linspace(-0.15, 0.25, 41))
    told = [morphology.label(shape, rr_ms, clean=True) for rr_ms in (np.nan, 440.0, 625.0, 545.0, 550.0)]
    assert told == [Label.NORMAL] * 5


def test_beats_that_are_the_same_but_for_rounding_leave_their_kind_known() -> None:
    """They differ by nothing from their mean, never by less, and one of another size among them is seen."""
    random, t_s = np.random.default_rng(3), np.linspace(-0.15, 0.25, 41)
    for height in random.uniform(100, 2000, 20):
        shape, morphology, unlike = height * trials.heartbeat(t_s, qrs_s=0.025), Morphology(), []
        for size in (*[1.0] * 20, 0.65, 1.0, 1.0):
            rounded = 1 + 1e-16 * random.integers(-3, 4, size=len(shape))
            morphology.label(size * shape * rounded, 800.0, clean=True)
            unlike.append(morphology.unlike)
        assert unlike[1:] == [False] * 19 + [True, True, False]


@pytest.mark.parametrize(("qrs_s", "expected"), [(0.025, Label.NORMAL), (0.03, Label.UNCERTAIN)])
def test_an_electrode_that_lets_go_makes_no_beat_strange(qrs_s: float, expected: Label) -> None:
    """A quarter of the height while the heart speeds up: beats of the same shape are normal, a fifth wider strange."""
    morphology, t_s = Morphology(), np.linspace(-0.15, 0.25, 41)
    usual, small = trials.heartbeat(t_s, qrs_s=0.025), 0.25 * trials.heartbeat(t_s, qrs_s=qrs_s)
    before = [morphology.label(usual, 900.0, clean=True) for _ in range(30)]
    assert before == [Label.NORMAL] * 30
    assert [morphology.label(small, 690.0, clean=True) for _ in range(2)] == [expected] * 2
    assert morphology.label(usual, 690.0, clean=True) is Label.NORMAL


def test_fibrillation_has_no_variability() -> None:
    """Normal complexes at intervals without order: a rate, no variability, a reason."""
    last = play(trials.ecg_of(trials.fibrillation(90), FS_HZ, 90))[-1]
    assert last.heart_rate_bpm == pytest.approx(86, abs=15)
    assert np.isnan([last.hrv.rmssd_ms, last.hrv.mean_nn_ms]).all()
    assert "hrv withheld: the intervals have no order, so none is normal to normal" in last.reasons


def test_deep_breathing_is_no_fibrillation() -> None:
    """A respiratory sinus arrhythmia of 150 ms keeps its variability."""
    beats_s = [0.5]
    while beats_s[-1] < 88:
        beats_s.append(beats_s[-1] + 0.95 + 0.15 * np.sin(2 * np.pi * 0.2 * beats_s[-1]))
    rhythm = trials.Rhythm(np.array(beats_s), np.ones(len(beats_s), bool))
    last = play(trials.ecg_of(rhythm, FS_HZ, 90))[-1]
    assert last.hrv.rmssd_ms == pytest.approx(ecg_rhythms.rmssd_ms(*rhythm.until(88)), abs=2)
