"""The meaning of the HRV message: reference series, honest windows, artefacts, gaps."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sense4hri.hrv import MEASURES, Hrv, HrvWindow, withheld

MINUTE_S = 60.0


def look(intervals_ms, at_s=None, window_s=300.0, complete=False):
    """The window after the given intervals, the first of which starts with the segment."""
    window = HrvWindow(window_s)
    window.restart(0)
    end_ms = np.cumsum(np.nan_to_num(intervals_ms, nan=800.0))
    for end, rr in zip(end_ms, intervals_ms, strict=True):
        window.add(round(end * 1e6), rr, complete)
    return window.at(round((end_ms[-1] / 1e3 if at_s is None else at_s) * 1e9))


def breathing(n, mean_ms=850.0, depth_ms=40.0, seed=3):
    """Intervals of a resting person: respiratory modulation and a little noise."""
    rng = np.random.default_rng(seed)
    return mean_ms + depth_ms * np.sin(2 * np.pi * np.arange(n) / 4.7) + rng.normal(0, 8, n)


@pytest.mark.parametrize(
    ("file", "sdnn", "rmssd", "pnn50"),
    [
        ("rr/nsrdb_kubios/dev_16265_1500_1800.csv", 41.8239, 21.6573, 2.3529),
        ("rr/pyhrv/SampleNNISeriesShort.npy", 95.6904, 101.3006, 48.5119),
    ],
)
def test_reference_series(shared_data: Path, file: str, sdnn: float, rmssd: float, pnn50: float) -> None:
    """On clean published series nothing is corrected and every measure is that of the reference to four digits."""
    path = shared_data / file
    series = np.load(path).ravel() if path.suffix == ".npy" else np.genfromtxt(path, delimiter=",")[:, 0]
    series = series[np.isfinite(series)].astype(float)
    hrv, _ = look(series, window_s=400.0)
    assert (hrv.nn_count, hrv.corrected_count) == (len(series), 0)
    assert (hrv.sdnn_ms, hrv.rmssd_ms, hrv.pnn50_percent) == pytest.approx((sdnn, rmssd, pnn50), rel=1e-4)
    assert hrv.mean_nn_ms == pytest.approx(series.mean())


@pytest.mark.parametrize(
    ("seconds", "given"),
    [
        (29.0, {"mean_nn_ms"}),
        (31.0, {"mean_nn_ms", "rmssd_ms", "pnn50_percent"}),
        (119.0, {"mean_nn_ms", "rmssd_ms", "pnn50_percent"}),
        (121.0, {"mean_nn_ms", "rmssd_ms", "pnn50_percent", "sdnn_ms"}),
        (299.0, {"mean_nn_ms", "rmssd_ms", "pnn50_percent", "sdnn_ms"}),
        (301.0, set(MEASURES)),
    ],
)
def test_every_measure_waits_for_its_window(seconds: float, given: set[str]) -> None:
    """RMSSD needs 30 s, SDNN 120 s, the spectrum 300 s; what is missing is NaN and named in a reason."""
    hrv, reasons = look(breathing(int(seconds / 0.85)), at_s=seconds)
    assert {name for name in MEASURES if np.isfinite(getattr(hrv, name))} == given
    assert all(name in " ".join(reasons) for name in set(MEASURES) - given)
    assert hrv.window_s == pytest.approx(min(seconds, 300.0))


def test_window_stops_growing() -> None:
    """After ten minutes only the last five count."""
    intervals = np.concatenate((breathing(400, mean_ms=600.0), breathing(600, mean_ms=900.0)))
    hrv, _ = look(intervals)
    assert hrv.window_s == 300.0
    assert hrv.mean_nn_ms == pytest.approx(900.0, abs=5)
    assert hrv.nn_count == pytest.approx(333, abs=2)


def test_restart_forgets() -> None:
    """A new segment starts with nothing."""
    window = HrvWindow(300.0)
    window.restart(0)
    for i, rr in enumerate(breathing(100)):
        window.add(i * 850_000_000, rr)
    window.restart(100_000_000_000)
    hrv, _ = window.at(101_000_000_000)
    assert (hrv.nn_count, hrv.window_s) == (0, 1.0)
    assert np.isnan(hrv.mean_nn_ms)


def test_a_long_stream_leaves_the_window_what_a_short_one_does() -> None:
    """After ten hours the window says the same as one that heard only its last beats, and takes no more memory."""
    rr_ms = breathing(45_000)
    end_ns = np.round(np.cumsum(rr_ms) * 1e6).astype(np.int64)
    long, short = HrvWindow(300.0), HrvWindow(300.0)
    long.restart(0)
    short.restart(0)
    for i, (now_ns, rr) in enumerate(zip(end_ns.tolist(), rr_ms.tolist(), strict=True)):
        long.add(now_ns, rr)
        if i >= len(rr_ms) - 1000:
            short.add(now_ns, rr)
    assert long.at(int(end_ns[-1])) == short.at(int(end_ns[-1]))
    assert len(long._ns) == len(HrvWindow(300.0)._ns)


def test_break_takes_no_difference() -> None:
    """Across a missing interval no successive difference is taken: a step of the rate there leaves RMSSD small."""
    intervals = np.concatenate((np.full(60, 700.0), [np.nan], np.full(60, 900.0)))
    intervals += np.random.default_rng(0).normal(0, 2, len(intervals))
    hrv, _ = look(intervals)
    assert hrv.rmssd_ms < 5
    assert hrv.nn_count == 120


def test_one_percent_of_frames_lost_still_gives_sdnn() -> None:
    """A link that loses a frame a minute breaks the chain but not the measures."""
    intervals = breathing(350)
    intervals[60::65] = np.nan
    hrv, reasons = look(intervals, at_s=297.0)
    assert hrv.sdnn_ms == pytest.approx(np.nanstd(intervals, ddof=1), rel=0.02)
    assert not any("sdnn" in reason for reason in reasons)


def test_mostly_missing_is_withheld() -> None:
    """A window with few valid intervals in it does not pass for a full one."""
    intervals = breathing(200)
    intervals[20:150] = np.nan
    hrv, reasons = look(intervals)
    assert np.isnan(hrv.sdnn_ms)
    assert any("valid intervals fill" in reason for reason in reasons)


def test_extra_beat_is_merged() -> None:
    """A beat invented inside an interval is taken back, and counted."""
    clean = breathing(200)
    wrong = np.insert(clean, 100, 0.45 * clean[100])
    wrong[101] = 0.55 * clean[100]
    hrv, _ = look(wrong)
    truth, _ = look(clean)
    assert hrv.corrected_count == 1
    assert hrv.rmssd_ms == pytest.approx(truth.rmssd_ms, rel=1e-6)


def test_the_interval_that_begins_with_an_invented_beat_is_no_nn_interval() -> None:
    """Noise that hides one beat and invents two leaves nothing behind, though the last interval of it looks usual."""
    before, after = breathing(140, 1000.0, 20.0), breathing(140, 1000.0, 20.0, seed=4)
    hrv, _ = look([*before, 260.0, 420.0, 1200.0, *after])
    without, _ = look([*before, np.nan, *after])
    assert (hrv.corrected_count, hrv.nn_count) == (3, without.nn_count)
    assert hrv.rmssd_ms == pytest.approx(without.rmssd_ms, rel=0.005)
    assert hrv.sdnn_ms == pytest.approx(without.sdnn_ms, rel=0.02)


def test_the_interval_after_a_late_beat_stays() -> None:
    """A beat found too late makes a long and a short interval; the beat that ends the short one is right again."""
    hrv, _ = look([*breathing(100), 1150.0, 500.0, *breathing(100, seed=4)])
    assert (hrv.corrected_count, hrv.nn_count) == (1, 201)


def test_missed_beat_is_left_out_unless_surely_complete() -> None:
    """An interval twice as long is a missed beat, but a pause where the source is sure that it saw everything."""
    clean = breathing(200)
    wrong = np.delete(clean, 100)
    wrong[100] = clean[100] + clean[101]
    hrv, _ = look(wrong)
    assert hrv.corrected_count == 1
    assert hrv.sdnn_ms == pytest.approx(look(clean)[0].sdnn_ms, rel=0.02)
    paused, _ = look(wrong, complete=True)
    assert paused.corrected_count == 0
    assert paused.sdnn_ms == pytest.approx(wrong.std(ddof=1))


def test_ectopic_beats_are_left_out() -> None:
    """Premature beats with their compensatory pauses do not enter the variability."""
    intervals = breathing(300)
    for i in (50, 120, 200, 260):
        intervals[i], intervals[i + 1] = 0.6 * intervals[i], 1.4 * intervals[i + 1]
    hrv, _ = look(intervals)
    assert hrv.corrected_count == 8
    assert hrv.rmssd_ms == pytest.approx(look(breathing(300))[0].rmssd_ms, rel=0.03)


@pytest.mark.parametrize(("f_hz", "band"), [(0.1, "lf_power_ms2"), (0.25, "hf_power_ms2")])
def test_power_of_a_sine(f_hz: float, band: str) -> None:
    """A modulation of amplitude A is A^2/2 in its band and next to nothing in the other."""
    end_s, intervals = 0.0, []
    while end_s < 310:
        intervals.append(800 + 30 * np.sin(2 * np.pi * f_hz * end_s))
        end_s += intervals[-1] / 1e3
    hrv, _ = look(np.array(intervals))
    other = ({"lf_power_ms2", "hf_power_ms2"} - {band}).pop()
    assert getattr(hrv, band) == pytest.approx(450, rel=0.05)
    assert getattr(hrv, other) < 10


@settings(max_examples=60)
@given(st.lists(st.one_of(st.floats(200, 3000), st.just(np.nan)), max_size=120))
def test_never_raises_and_never_zero(intervals: list[float]) -> None:
    """Whatever comes: measures are NaN with a reason or finite, counts add up, memory is bounded."""
    window = HrvWindow(60.0)
    window.restart(0)
    now_ns = 1_000_000_000
    for rr in intervals:
        now_ns += round(np.nan_to_num(rr, nan=500.0) * 1e6)
        window.add(now_ns, rr)
    hrv, reasons = window.at(now_ns)
    assert isinstance(hrv, Hrv)
    assert reasons
    assert 0 <= hrv.nn_count <= len(intervals)


def test_withheld_keeps_the_window() -> None:
    """Withholding takes every measure away and leaves window and counts."""
    hrv, _ = look(breathing(400))
    bare = withheld(hrv)
    assert (bare.window_s, bare.nn_count) == (hrv.window_s, hrv.nn_count)
    assert all(np.isnan(getattr(bare, name)) for name in MEASURES)


def test_no_window_is_refused() -> None:
    """A window of no length cannot be."""
    with pytest.raises(ValueError, match="window_s"):
        HrvWindow(0.0)


def test_intervals_between_beats_of_different_shapes() -> None:
    """They are left out, count as corrected, and break the chain; the others are what they were."""
    intervals_ms = breathing(200)
    unlike = np.arange(200) % 40 == 7
    window = HrvWindow(300.0)
    window.restart(0)
    moved_ms = intervals_ms + 70 * unlike
    for end_ms, rr_ms, between in zip(np.cumsum(moved_ms), moved_ms, unlike, strict=True):
        window.add(round(end_ms * 1e6), rr_ms, unlike=bool(between))
    hrv, _ = window.at(round(moved_ms.sum() * 1e6))
    pairs = ~unlike[1:] & ~unlike[:-1]
    assert hrv.rmssd_ms == pytest.approx(np.sqrt(np.mean(np.diff(intervals_ms)[pairs] ** 2)))
    assert (hrv.nn_count, hrv.corrected_count) == (195, 5)
