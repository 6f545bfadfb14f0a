"""Dilations of known size, blinks at known times, and a recording of a tracker."""

import numpy as np
import pytest
import pywt
from gaze import EYELINK_HZ, at_stamps, extra_of, eyelink, pupils
from interpreter_pupillometry.baseline import Baseline
from interpreter_pupillometry.config import Config
from interpreter_pupillometry.features import lhipa_per_s, valid_sizes
from interpreter_pupillometry.stream import PupilStream
from sense4hri.step import Marker
from slow_signals import T0_NS, play

BLINKS_S = (12.0, 20.0, 33.0, 41.5, 52.0)


def make(info):
    return PupilStream(Config(), info)


def in_mm(sizes, fs_hz, **options):
    """Updates of sizes of both eyes, shape (n, 2)."""
    step = options.pop("make", make)
    names = ("diameter_left", "diameter_right")
    return play(step, sizes, fs_hz, "pupillometry", options.pop("unit", "mm"), names, **options)


@pytest.mark.parametrize("fs_hz", [30.0, 60.0, 250.0, 2000.0])
@pytest.mark.parametrize("size", [0.2, -0.4])
def test_a_dilation_is_recovered_within_3_percent(fs_hz, size):
    """With noise, unequal eyes and blinks, one in the midst: change over the plateau, speed of the rise."""
    updates = in_mm(pupils(fs_hz, 50, [(40.0, 46.0, size)], BLINKS_S), fs_hz)
    plateau = np.array([update.change for update in updates[41:45]])
    np.testing.assert_allclose(plateau, size, rtol=0.03, atol=0.003)
    assert updates[44].change_percent == pytest.approx(100 * size / 3.0, rel=0.04)
    assert updates[40].dilation_speed_per_s == pytest.approx(size, rel=0.1)
    assert updates[38].change == pytest.approx(0.0, abs=0.01)
    assert updates[44].diameter_left - updates[44].diameter_right == pytest.approx(0.1, abs=0.01)


def test_a_short_response_has_its_peak_in_extra():
    """A response of 1.2 s: the mean of a second is less, `change_most` is within 3 % of its peak."""
    fs_hz, at_s = 250.0, np.arange(40 * 250) / 250.0
    shape = np.clip((at_s - 30) / 0.93, 0, None)
    response = 0.3 * shape**10.1 * np.exp(10.1 * (1 - shape))
    noise = np.random.default_rng(1).normal(0, 0.02, (len(at_s), 2))
    updates = in_mm(3 + response[:, None] + noise, fs_hz)
    assert max(extra_of(update, "change_most")[0] for update in updates[20:]) == pytest.approx(0.3, rel=0.03)


def test_blinks_are_drawn_through_and_told_once():
    """Each blink once, from its last pupil before to its first after, margins included, soon after it has ended."""
    updates = in_mm(pupils(250.0, 60, [], BLINKS_S), 250.0)
    told = []
    for update in updates:
        at_s = (update.device_ns - T0_NS) / 1e9
        begin_s, end_s = extra_of(update, "interpolated_begin_s"), extra_of(update, "interpolated_end_s")
        told += [(at_s - b, at_s - e, e) for b, e in zip(begin_s, end_s, strict=True) if b - e > 0.1]
    np.testing.assert_allclose([begin for begin, _, _ in told], np.array(BLINKS_S) - 0.05, atol=0.02)
    np.testing.assert_allclose([end for _, end, _ in told], np.array(BLINKS_S) + 0.25, atol=0.02)
    assert all(0.1 <= late_s <= 1.2 for _, _, late_s in told)
    assert extra_of(updates[-1], "blink_gaps") == (5.0,)
    assert max(update.missing_ratio for update in updates) == pytest.approx(0.3, abs=0.03)


def test_eyes_closed_for_long_are_no_blink():
    """A gap of 2 s is not drawn through; while it lasts there is no size, and that is told."""
    sizes = pupils(120.0, 40, [], [])
    sizes[2400:2640] = 0
    updates = in_mm(sizes, 120.0)
    assert not any(extra_of(update, "interpolated_begin_s") for update in updates)
    assert np.isnan(updates[21].diameter)
    assert "no pupil" in updates[21].reasons[0]
    assert updates[-1].diameter == pytest.approx(3.0, abs=0.02)


def test_an_eye_that_is_lost_does_not_move_the_mean():
    """Where only one of two unequal eyes is seen the mean of both goes on."""
    sizes = pupils(120.0, 40, [], [])
    sizes[3000:, 1] = 0
    updates = in_mm(sizes, 120.0)
    assert [update.diameter for update in updates[30:]] == pytest.approx([3.0] * len(updates[30:]), abs=0.01)
    assert np.isnan(updates[-1].diameter_right)


def marked(begin_s, end_s):
    """A step that is told of a baseline between these times."""

    class Marked(PupilStream):
        def push(self, timed):
            for name, at_s in (("baseline_start", begin_s), ("baseline_end", end_s)):
                at_ns = T0_NS + round(at_s * 1e9)
                if self._newest_ns is not None and self._newest_ns < at_ns <= timed.times_ns[-1]:
                    self.marker(Marker(at_ns, None, 0.0, "", "p1", name, "", "test"))
            return super().push(timed)

    return lambda info: Marked(Config(), info)


def test_a_baseline_between_markers_holds():
    """The mean of the time between the markers, not that of before or after, from the second marker on."""
    sizes = pupils(120.0, 60, [(20.0, 30.0, 0.5), (45.0, 60.0, 0.2)], [])
    updates = in_mm(sizes, 120.0, make=marked(22.0, 28.0))
    assert updates[25].baseline == pytest.approx(3.0, abs=0.01)
    assert extra_of(updates[25], "baseline_by_marker") == (0.0,)
    for update in updates[30:]:
        assert update.baseline == pytest.approx(3.5, abs=0.01)
        assert extra_of(update, "baseline_by_marker") == (1.0,)
    assert updates[-1].change == pytest.approx(-0.3, abs=0.01)


@pytest.mark.parametrize(("lost_s", "held"), [(2.0, True), (4.0, False)])
def test_a_marked_baseline_of_which_most_is_lost_is_told_and_not_used(lost_s, held):
    """Of 6 s between markers 2 s without pupils do not matter; of 4 s the reason is told and the rolling one stays."""
    sizes = pupils(120.0, 40, [(20.0, 30.0, 0.5)], [])
    sizes[round(22.2 * 120) : round((22.2 + lost_s) * 120)] = 0
    updates = in_mm(sizes, 120.0, make=marked(22.0, 28.0))
    assert extra_of(updates[33], "baseline_by_marker") == (float(held),)
    assert held != any("baseline_start" in reason and "50 %" in reason for reason in updates[33].reasons)


@pytest.mark.parametrize("fs_hz", [120.0, 0.0])
@pytest.mark.parametrize(("lost_s", "held"), [((22.2, 24.2), True), ((22.2, 26.2), False), ((23.0, 32.0), False)])
def test_samples_that_never_came_between_markers_are_lost(fs_hz, lost_s, held):
    """Of 6 s between markers 2 s that never came do not matter; of 4 s, and to the end, the rolling one stays."""
    sizes = pupils(120.0, 40, [(20.0, 30.0, 0.5)], [])
    updates = in_mm(sizes, fs_hz, make=marked(22.0, 28.0), lost=[lost_s], true_hz=120.0)
    assert extra_of(updates[-1], "baseline_by_marker") == (float(held),)
    assert held != any("baseline_start" in reason and "50 %" in reason for reason in updates[-1].reasons)


@pytest.mark.parametrize("first_hz", [10.0, 400.0])
def test_a_tracker_without_a_fixed_rate_is_not_judged_by_its_first_second(first_hz):
    """A second of few samples, or of a burst, then 60 per s: sizes of a good quality, of which nothing is missing."""
    stamps_s = np.concatenate([np.arange(first_hz) / first_hz, 1 + np.arange(29 * 60) / 60])
    sizes = pupils(1000.0, 30, [], [])[np.round(stamps_s * 1000).astype(int)]
    last = at_stamps(sizes, stamps_s, make, "pupillometry", "mm", ("diameter_left", "diameter_right"))[-1]
    assert last.signal_quality > 0.9
    assert last.missing_ratio == 0


@pytest.mark.parametrize("again_s", [0.0, 0.05, 0.4])
def test_a_baseline_counts_also_where_the_next_one_starts_at_once(again_s):
    """A start right after an end takes nothing from the time that has just ended: it is the baseline until then."""
    baseline, step = Baseline(60.0), round(1e9 / 120)
    times_ns = np.arange(120 * 12) * step
    sizes, seen = np.where(times_ns <= 5 * 10**9, 3.0, 4.0), np.ones(len(times_ns), bool)
    baseline.start(0, 0)
    baseline.take(times_ns[:588], sizes[:588], seen[:588], 600 * step)
    baseline.end(600 * step, 600 * step, 120.0)
    again_ns = (600 + round(again_s * 120)) * step
    baseline.start(again_ns, again_ns)
    baseline.take(times_ns[588:800], sizes[588:800], seen[588:800], 812 * step)
    assert (baseline.value(7.0), baseline.failed) == (pytest.approx(3.0), "")
    baseline.end(1000 * step, 1000 * step, 120.0)
    baseline.take(times_ns[800:1200], sizes[800:1200], seen[800:1200], 1212 * step)
    assert baseline.value(10.0) == pytest.approx(4.0)


def test_an_end_without_a_start_is_told_and_ends_nothing():
    """A second end takes nothing into the time that has ended; one that no start came before says so."""
    baseline, step = Baseline(60.0), round(1e9 / 120)
    times_ns = np.arange(240) * step
    sizes, seen = np.where(times_ns <= 10**9, 3.0, 4.0), np.ones(240, bool)
    baseline.end(0, 0, 120.0)
    assert baseline.failed == "baseline: baseline_end came without a baseline_start; the rolling one stays"
    baseline.start(0, 0)
    baseline.end(120 * step, 120 * step, 120.0)
    baseline.end(200 * step, 200 * step, 120.0)
    baseline.take(times_ns, sizes, seen, 239 * step)
    assert (baseline.value(2.0), baseline.failed) == (pytest.approx(3.0), "")


def test_a_baseline_that_ends_before_any_sample_is_told():
    """Both markers before the first sample: nothing is open any more, and the reason says that nothing came."""
    baseline = Baseline(60.0)
    baseline.start(None, 0)
    baseline.end(None, 0, 120.0)
    assert baseline.failed.startswith("baseline: 0 %")
    baseline.take(np.arange(5), np.full(5, 3.0), np.ones(5, bool), 5)
    assert not baseline.marked


@pytest.mark.parametrize("eye", ["L", "R"])
def test_of_an_eyelink_no_lost_sample_is_a_size(shared_data, eye):
    """Its zeros (561 of the left eye) and what is beside them never enter; every blink is drawn through, once."""
    truth = eyelink(shared_data, eye)
    times_ns = np.arange(len(truth.pupil)) * 2_000_000
    valid = valid_sizes(truth.pupil, times_ns, mm=False)
    assert not valid[truth.pupil == 0].any()
    assert 0.9 < valid.mean() < 1 - (truth.pupil == 0).mean()
    names = ("diameter_left",) if eye == "L" else ("diameter_right",)
    updates = play(make, truth.pupil, EYELINK_HZ, "pupillometry", "a.u.", names)
    assert min(extra_of(update, "change_least")[0] + update.baseline for update in updates[10:]) > 750
    told = [
        ((u.device_ns - T0_NS) / 1e9 - b, (u.device_ns - T0_NS) / 1e9 - e)
        for u in updates
        for b, e in zip(extra_of(u, "interpolated_begin_s"), extra_of(u, "interpolated_end_s"), strict=True)
    ]
    for begin_s, end_s in truth.blinks[truth.blinks[:, 1] < 40.5]:
        assert sum(begin < begin_s and end > end_s for begin, end in told) == 1
    assert updates[-1].unit == "a.u."
    assert any("uncalibrated" in reason for reason in updates[-1].reasons)


def published_lhipa(sizes, seconds):
    """The listing of Duchowski et al. 2020, sample by sample."""
    low = pywt.dwt_max_level(len(sizes), pywt.Wavelet("sym16").dec_len) // 2
    high_part = pywt.downcoef("d", sizes, "sym16", "periodization", level=1) / np.sqrt(2)
    low_part = pywt.downcoef("d", sizes, "sym16", "periodization", level=low) / np.sqrt(2**low)
    ratio = np.array([value / high_part[2 ** (low - 1) * k] for k, value in enumerate(low_part)])
    size, found = np.abs(ratio), np.zeros(len(ratio))
    for k in range(len(size)):
        before, after = size[max(0, k - 1)], size[min(len(size) - 1, k + 1)]
        if before <= size[k] >= after and (before < size[k] or size[k] > after):
            found[k] = size[k]
    kept = pywt.threshold(found, np.std(found) * np.sqrt(2 * np.log2(len(found))), mode="less")
    return np.count_nonzero(np.abs(kept) > 0) / seconds


@pytest.mark.parametrize("fs_hz", [60, 500])
def test_the_index_of_activity_is_that_of_its_authors(fs_hz):
    """The same number as by the published listing; too few samples give none."""
    rng = np.random.default_rng(1)
    walk = 3 + np.cumsum(rng.normal(0, 0.004, 64 * fs_hz)) + rng.normal(0, 0.005, 64 * fs_hz)
    assert lhipa_per_s(walk, 64.0) == pytest.approx(published_lhipa(walk, 64.0), abs=1.5 / 64)
    assert np.isnan(lhipa_per_s(np.full(40, 3.0), 0.2))
