"""interpreter-ecg: intervals that are not normal to normal though every beat looks normal (bench: ecg_arrhythmias)."""

import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from interpreter_ecg.foretold import doubt_ms, newest_ms, unforeseen
from sense4hri.early_beats import irregular, paused, premature

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))
import bench_ecg
import ecg_arrhythmias as arrhythmias


def unbroken(n):
    """Every interval follows the one before."""
    return np.append(False, np.ones(n - 1, bool))


def left_out(intervals_s):
    """The intervals that are not normal to normal, and the premature beats in percent."""
    found, early = irregular(1e3 * intervals_s, unbroken(len(intervals_s)))
    return found, 100 * early / len(intervals_s)


def rmssd_ms(intervals_ms, left):
    """Of the differences between intervals that are both kept."""
    return np.sqrt(np.mean(np.diff(intervals_ms)[~left[1:] & ~left[:-1]] ** 2))


UNTOLD = {(50, 0.06, 0.05), (50, 0.06, 0.1), (50, 0.06, 0.2)}
"""Rate, depth of breathing and share of premature beats of which more than a tenth are missed."""
BREATHING_AS_LARGE = pytest.mark.xfail(
    strict=True,
    reason="many premature beats in breathing hide each other from a comparison of extremes: hrv is withheld",
)


@pytest.mark.parametrize(
    ("rate_bpm", "depth", "share"),
    [
        pytest.param(*case, marks=BREATHING_AS_LARGE if case in UNTOLD else ())
        for case in product((50, 80, 110), (0.0, 0.03, 0.06), (0.01, 0.05, 0.1, 0.2))
    ],
)
def test_atrial_premature_beats_are_told_by_timing(rate_bpm: int, depth: float, share: float) -> None:
    """Beats 15 to 40 % early, with every kind of pause: all but a tenth are found, and hardly anything else."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(rate_bpm, depth=depth), share, rate_bpm)
    intervals_s = np.diff(arrhythmia.rhythm.beats_s)
    found, percent = left_out(intervals_s)
    truth = ~arrhythmia.normal_to_normal[1:]
    assert np.sum(found & ~truth) <= 2
    assert np.sum(truth & ~found) <= 0.1 * truth.sum()
    assert percent == pytest.approx(100 * share, abs=1.5)


@pytest.mark.parametrize(
    ("rate_bpm", "depth", "breaths_hz"), list(product((48, 60, 75), (0.1, 0.15, 0.2), (0.1, 0.15, 0.2, 0.25)))
)
def test_deep_breathing_is_not_cut(rate_bpm: int, depth: float, breaths_hz: float) -> None:
    """The sinus arrhythmia of deep and irregular breaths, RMSSD up to 250 ms, keeps its intervals."""
    found, _ = left_out(arrhythmias.sinus(rate_bpm, depth=depth, breaths_hz=breaths_hz))
    assert found.mean() < 0.02


@pytest.mark.parametrize(("first_bpm", "then_bpm"), [(60, 85), (85, 60), (60, 120), (120, 60)])
def test_change_of_rate_is_not_cut(first_bpm: int, then_bpm: int) -> None:
    """A rate that jumps from one beat to the next and stays leaves every interval where it is."""
    found, percent = left_out(np.concatenate((arrhythmias.sinus(first_bpm, 60), arrhythmias.sinus(then_bpm, 60))))
    assert (found.sum(), percent) == (0, 0)


@pytest.mark.parametrize(("rate_bpm", "share", "lost"), list(product((50, 80, 110), (0.01, 0.05), (0.05, 0.2))))
def test_premature_beats_are_told_beside_gaps(rate_bpm: int, share: float, lost: float) -> None:
    """Where one interval in twenty or in five is lost, what is left of a premature beat hardly changes RMSSD."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(rate_bpm), share, rate_bpm)
    intervals_ms, normal = 1e3 * np.diff(arrhythmia.rhythm.beats_s), arrhythmia.normal_to_normal[1:]
    kept = np.random.default_rng(rate_bpm).random(len(intervals_ms)) >= lost
    linked = np.append(False, kept[1:] & kept[:-1])[kept]
    found = irregular(intervals_ms[kept], linked).left_out
    chained = linked[1:] & ~found[1:] & ~found[:-1]
    told = np.diff(intervals_ms[kept])[chained]
    true = np.diff(intervals_ms)[normal[1:] & normal[:-1] & kept[1:] & kept[:-1]]
    assert np.sqrt(np.mean(told**2)) == pytest.approx(np.sqrt(np.mean(true**2)), abs=5)


@pytest.mark.parametrize("depth", [0.1, 0.2])
def test_deep_breathing_is_not_cut_beside_gaps(depth: float) -> None:
    """Where one interval in ten is lost, the sinus arrhythmia of deep breaths keeps the others."""
    intervals_s = arrhythmias.sinus(60, depth=depth, breaths_hz=0.2)
    kept = np.random.default_rng(1).random(len(intervals_s)) >= 0.1
    linked = np.append(False, kept[1:] & kept[:-1])[kept]
    found = irregular(1e3 * intervals_s[kept], linked).left_out
    assert found.mean() < 0.02


def test_early_beat_is_left_out_before_the_next_is_known() -> None:
    """The newest interval, much too short, takes no part until what follows it has told."""
    intervals_ms = np.append(np.full(30, 800.0), 560.0)
    assert premature(intervals_ms, unbroken(31)).tolist() == [False] * 30 + [True]
    faster = np.append(intervals_ms, 560.0)
    assert not premature(faster, unbroken(32)).any()


@pytest.mark.parametrize("beats", [1, 2, 12])
def test_pauses_and_blocks(beats: int) -> None:
    """Intervals twice as long, one or a dozen, are none between normal beats; at a gap one side is enough."""
    intervals_ms = np.concatenate((np.full(20, 800.0), np.full(beats, 1650.0), np.full(20, 800.0)))
    linked, truth = unbroken(len(intervals_ms)), intervals_ms > 1000
    assert np.array_equal(paused(intervals_ms, linked), truth)
    linked[20 + beats] = False
    assert np.array_equal(paused(intervals_ms, linked), truth)


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_rmssd_with_atrial_premature_beats(share: float) -> None:
    """No update gives an RMSSD that is off by 10 ms, and most give one; how many beats are ectopic is told."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(75, 90, depth=0.05), share)
    told = arrhythmias.told(arrhythmia, 130.0)
    assert told.wrong == 0
    assert told.given > 35
    assert told.last_ms < 2
    assert told.ectopic_percent == pytest.approx(100 * share, abs=2)


def test_too_many_atrial_premature_beats() -> None:
    """Of a fifth of premature beats no RMSSD is given, and the reason says so."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(75, 60, depth=0.05), 0.2)
    last = bench_ecg.play(arrhythmias.ecg_of(arrhythmia, 130.0), 130.0)[-1]
    assert np.isnan(last.hrv.rmssd_ms)
    assert any(reason.startswith("hrv withheld: ectopic ") for reason in last.reasons)


@pytest.mark.parametrize(("depth", "share"), [(0.05, 0.1), (0.05, 0.2), (0.1, 0.1)])
def test_premature_beats_that_breathing_hides(depth: float, share: float) -> None:
    """A slow heart whose breathing hides most of them gives no RMSSD that is off by 10 ms, and says why."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(50, depth=depth), share, 50)
    assert arrhythmias.told(arrhythmia, 250.0).wrong == 0
    last = bench_ecg.play(arrhythmias.ecg_of(arrhythmia, 250.0), 250.0)[-1]
    assert "hrv withheld: premature beats cannot be told from breathing" in last.reasons


@pytest.mark.parametrize(
    ("rate_bpm", "depth", "breaths_hz"), list(product((45, 60, 75), (0.05, 0.1, 0.15), (0.1, 0.25, 0.35)))
)
def test_breathing_is_foreseen(rate_bpm: int, depth: float, breaths_hz: float) -> None:
    """Without premature beats RMSSD hardly depends on what is unforeseen, at two beats per breath neither."""
    for seed in range(4):
        intervals_ms = 1e3 * arrhythmias.sinus(rate_bpm, depth=depth, breaths_hz=breaths_hz, seed=seed)
        found, _ = left_out(intervals_ms / 1e3)
        more = unforeseen(intervals_ms, unbroken(len(intervals_ms)), found)
        few, all_ms = (rmssd_ms(intervals_ms, left) for left in (more, found))
        assert few == pytest.approx(all_ms, abs=5)


def test_no_rmssd_of_the_first_beats_where_a_fifth_is_premature() -> None:
    """After half a minute of a slow heart with deep breathing premature beats hide each other: it was 159 ms off."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(50, 40, depth=0.1), 0.2, 50)
    assert arrhythmias.told(arrhythmia, 250.0).given == 0


@pytest.mark.parametrize(("rate_bpm", "seed"), [(44, 38), (48, 47)])
def test_premature_beats_that_show_by_their_pause(rate_bpm: int, seed: int) -> None:
    """What is early while deep breathing lengthens the intervals is no dip: 22 and 37 RMSSD were 10 to 23 ms off."""
    sinus = arrhythmias.sinus(rate_bpm, 90, depth=0.1, seed=seed)
    assert arrhythmias.told(arrhythmias.atrial_premature(sinus, 0.05, seed), 250.0).wrong == 0


def test_the_pause_after_a_premature_beat_is_no_late_beat_to_compare_it_with() -> None:
    """One beat in deep breathing, early without a dip, is unforeseen: kept, it made RMSSD 10 to 22 ms too large."""
    intervals_ms = 1e3 * arrhythmias.sinus(42, 60, depth=0.1, seed=7)
    intervals_ms[29:31] += (-235, 238)
    linked, known = unbroken(len(intervals_ms)), np.zeros(len(intervals_ms), bool)
    assert intervals_ms[29] > intervals_ms[28]
    assert np.flatnonzero(unforeseen(intervals_ms, linked, known)).tolist() == [29, 30]


def test_a_premature_beat_among_the_newest_is_not_foretold_from_both_sides() -> None:
    """The newest of 28 beats is early: nothing is unforeseen, but RMSSD hangs on it, as it does on no other."""
    intervals_ms, linked, known = 1e3 * arrhythmias.sinus(50, depth=0.1, seed=5)[:27], unbroken(27), np.zeros(27, bool)
    assert newest_ms(intervals_ms, linked, known) < 10
    intervals_ms[26] *= 0.7
    assert not unforeseen(intervals_ms, linked, known).any()
    assert newest_ms(intervals_ms, linked, known) > 10
    assert np.isnan(newest_ms(intervals_ms[:5], linked[:5], known[:5]))


@pytest.mark.parametrize(("rate_bpm", "share", "seed"), [(50, 0.05, 5), (58, 0.1, 6), (42, 0.2, 7)])
def test_premature_beats_of_the_first_minute(rate_bpm: int, share: float, seed: int) -> None:
    """Among the newest, or told and hidden again as beats come in: 9 RMSSD were 14 to 37 ms off."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(rate_bpm, depth=0.1, seed=seed), share, seed)
    assert arrhythmias.told(arrhythmias.until(arrhythmia, 62.0), 250.0).wrong == 0


@pytest.mark.parametrize("seed", [27, 29])
def test_where_few_beats_foretell_too_little_all_are_in_doubt(seed: int) -> None:
    """Of the first 24 intervals 8 are those round early beats, none is told; without these beats none is in doubt."""
    sinus = arrhythmias.sinus(48, depth=0.1, seed=seed)
    early = arrhythmias.atrial_premature(sinus, 0.2, seed)
    for intervals_s, all_doubtful in ((np.diff(early.rhythm.beats_s)[:24], True), (sinus[:24], False)):
        found, linked = left_out(intervals_s)[0], unbroken(24)
        assert not found.any()
        assert unforeseen(1e3 * intervals_s, linked, found).all() == all_doubtful


def test_doubt_is_not_less_than_what_is_unforeseen_changes() -> None:
    """Whatever is unforeseen, RMSSD without it changes by no more; where no step is large it cannot."""
    for rate_bpm, seed in product((45, 60, 80), range(5)):
        arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(rate_bpm, depth=0.1, seed=seed), 0.05, seed)
        intervals_ms = 1e3 * np.diff(arrhythmia.rhythm.beats_s)
        found, linked = left_out(intervals_ms / 1e3)[0], unbroken(len(intervals_ms))
        more = unforeseen(intervals_ms, linked, found)
        changed_ms = abs(rmssd_ms(intervals_ms, more) - rmssd_ms(intervals_ms, found))
        assert changed_ms <= doubt_ms(intervals_ms, linked, found)
    assert doubt_ms(np.linspace(800, 900, 40), unbroken(40), np.zeros(40, bool)) == 0


def test_premature_beats_that_hide_each_other_are_unforeseen() -> None:
    """Of many in deep breathing one or two are told, or none; most are unforeseen, and next to nothing of breathing."""
    told, more, early, of_breathing = 0, 0, 0, []
    for seed in range(20, 40):
        sinus = arrhythmias.sinus(50, 60, depth=0.1, seed=seed)
        arrhythmia = arrhythmias.atrial_premature(sinus, 0.2, seed)
        intervals_ms, not_normal = 1e3 * np.diff(arrhythmia.rhythm.beats_s), ~arrhythmia.normal_to_normal[1:]
        found, linked = left_out(intervals_ms / 1e3)[0], unbroken(len(intervals_ms))
        told += np.sum(found & not_normal)
        more += np.sum(unforeseen(intervals_ms, linked, found) & not_normal)
        early += np.sum(not_normal)
        of_breathing.append(unforeseen(1e3 * sinus, unbroken(len(sinus)), left_out(sinus)[0]).mean())
    assert told < early / 2 < 0.6 * early < more
    assert np.mean(of_breathing) < 0.02


@pytest.mark.parametrize("lost", [0.0, 0.05])
def test_premature_beats_are_unforeseen(lost: float) -> None:
    """In breathing of a tenth most of one beat in ten that is early sticks out, also where some intervals are lost."""
    arrhythmia = arrhythmias.atrial_premature(arrhythmias.sinus(50, 300, depth=0.1), 0.1, 50)
    intervals_ms, normal = 1e3 * np.diff(arrhythmia.rhythm.beats_s), arrhythmia.normal_to_normal[1:]
    kept = np.random.default_rng(1).random(len(intervals_ms)) >= lost
    linked = np.append(False, kept[1:] & kept[:-1])[kept]
    found = unforeseen(intervals_ms[kept], linked, np.zeros(len(linked), bool))
    assert np.sum(found & normal[kept]) <= 2
    assert np.sum(found & ~normal[kept]) > 0.4 * np.sum(~normal[kept])


def test_nothing_is_unforeseen_of_few_or_of_equal_intervals() -> None:
    """Fewer than 20 intervals foretell nothing; in a steady rhythm one early beat and the one after it stand out."""
    intervals_ms, known = np.full(40, 800.0), np.zeros(40, bool)
    assert not unforeseen(intervals_ms, unbroken(40), known).any()
    intervals_ms[20] = 560.0
    assert np.flatnonzero(unforeseen(intervals_ms, unbroken(40), known)).tolist() == [20, 21]
    assert not unforeseen(intervals_ms[11:30], unbroken(19), known[:19]).any()


@pytest.mark.parametrize("length", [3, 30])
def test_runs_of_ventricular_beats(length: int) -> None:
    """Beats of a tachycardia at 167 bpm are ectopic however long it lasts: RMSSD stays that of the normal ones."""
    told = arrhythmias.told(arrhythmias.ventricular_runs(arrhythmias.sinus(75, 90, depth=0.03), length, 40.0), 130.0)
    assert told.wrong == 0
    assert told.given > 10
    assert told.ectopic_percent > 0


def test_sinus_pauses() -> None:
    """Pauses of 2.5 s are no intervals between normal beats: RMSSD is that of the others."""
    told = arrhythmias.told(arrhythmias.pauses(arrhythmias.sinus(75, 90, depth=0.03), 2.5), 130.0)
    assert told.wrong == 0
    assert told.given > 35
