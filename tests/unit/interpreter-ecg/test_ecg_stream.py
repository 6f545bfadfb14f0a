"""interpreter-ecg: the two laws, features against values known by construction, noise, odd signals, bad input."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interpreter_ecg.config import Config
from interpreter_ecg.detector import Detector
from interpreter_ecg.features import PeakFinder, parabolic_offset, signal_quality
from interpreter_ecg.stream import EcgStream
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

START_NS = 10**15
CHANNELS = ("ecg",)


def info(fs_hz, unit="uV", channel_names=CHANNELS):
    """What the kit knows of the stream."""
    return StreamInfo(StreamName("p1", "ecg", "s1"), fs_hz, unit, channel_names)


def heartbeat(t_s, qrs_s=0.012, t_wave=0.25):
    """One beat round its R peak at 0: Q, R, S and T, amplitude 1."""
    wave = np.exp(-0.5 * (t_s / qrs_s) ** 2)
    wave -= 0.15 * np.exp(-0.5 * ((t_s + 2.5 * qrs_s) / qrs_s) ** 2)
    wave -= 0.25 * np.exp(-0.5 * ((t_s - 2.5 * qrs_s) / qrs_s) ** 2)
    wave += 0.1 * np.exp(-0.5 * ((t_s + 0.16) / 0.02) ** 2)
    return wave + t_wave * np.exp(-0.5 * ((t_s - 0.28) / 0.05) ** 2)


def synthetic(beats_s, fs_hz, seconds, amplitude_uv=1000.0, noise_uv=5.0, seed=1):
    """An ECG with R peaks at exactly beats_s, shape (n,)."""
    t_s = np.arange(round(seconds * fs_hz)) / fs_hz
    ecg = np.random.default_rng(seed).normal(0, noise_uv, len(t_s))
    for beat in beats_s:
        near = np.abs(t_s - beat) < 0.6
        ecg[near] += amplitude_uv * heartbeat(t_s[near] - beat)
    return ecg


def regular(rr_s, seconds, first_s=0.5):
    """Beats with a constant interval."""
    return np.arange(first_s, seconds - 0.2, rr_s)


def resting(seconds, seed=2):
    """Beats of a resting person."""
    rng = np.random.default_rng(seed)
    intervals = 0.85 + 0.04 * np.sin(np.arange(2 * int(seconds)) * 1.3) + rng.normal(0, 0.01, 2 * int(seconds))
    beats = 0.5 + np.cumsum(intervals)
    return beats[beats < seconds - 0.2]


def play(ecg, fs_hz, sizes=(73,), config=None, holes=(), start_ns=START_NS, device_time=True, **stream):
    """All updates of a recording sent in frames of the given sizes in turn; frames that touch a hole are lost."""
    clock, step = SampleClock(fs_hz), EcgStream(config or Config(), info(fs_hz, **stream))
    updates, i, k = [], 0, 0
    while i < len(ecg):
        n = min(sizes[k % len(sizes)], len(ecg) - i)
        k, i = k + 1, i + n
        if any(first < i and last > i - n for first, last in holes):
            continue
        stamp = start_ns + round((i - 1) / fs_hz * 1e9)
        chunk = Chunk(CHANNELS, ecg[i - n : i, None], stamp if device_time else None, stamp + 5_000_000)
        updates += step.push(clock.place(chunk))
    return updates


def peaks_s(updates, start_ns=START_NS):
    return np.array([(t - start_ns) / 1e9 for update in updates for t in update.peak_timestamps])


def assert_same_beats(found_s, truth_s, tolerance_s=0.003):
    """Every beat found, none invented, but for those too near the ends to be decided on."""
    inner = truth_s[truth_s < found_s[-1] + 0.2]
    assert len(found_s) == len(inner)
    assert np.abs(found_s - inner).max() < tolerance_s


# -- the laws


@settings(max_examples=12)
@given(st.lists(st.integers(1, 400), min_size=1, max_size=9))
def test_chunking_does_not_matter(sizes: list[int]) -> None:
    """However the samples are cut, every update is the same to the last bit."""
    ecg = synthetic(resting(40), 130.0, 40, noise_uv=40)
    clock_free = play_placed(ecg, sizes)
    assert clock_free == play_placed(ecg, [len(ecg)])


def play_placed(ecg, sizes):
    """Updates of samples whose times are given, so that nothing but the cutting differs; as comparable text."""
    fs_hz = 130.0
    times_ns = START_NS + np.rint(np.arange(len(ecg)) / fs_hz * 1e9).astype(np.int64)
    whole = SampleClock(fs_hz).place(Chunk(CHANNELS, ecg[:, None], int(times_ns[-1]), int(times_ns[-1])))
    whole = type(whole)(CHANNELS, ecg[:, None], times_ns, int(times_ns[-1]), 0, whole.break_, 0)
    step, updates, i, k = EcgStream(Config(), info(fs_hz)), [], 0, 0
    while i < len(ecg):
        n = min(sizes[k % len(sizes)], len(ecg) - i)
        updates += step.push(whole.part(i, i + n))
        i, k = i + n, k + 1
    return [repr(update) for update in updates]


def test_gap_breaks_the_interval_and_nothing_more() -> None:
    """Lost frames cost one interval (NaN), not the beats before and after, not the variability window."""
    beats = regular(0.8, 60)
    updates = play(synthetic(beats, 130.0, 60), 130.0, holes=[(30 * 130, 30 * 130 + 73)])
    rr = np.array([rr for update in updates for rr in update.rr_intervals_ms])
    assert np.isnan(rr[0])
    assert np.isnan(rr[1:]).sum() == 1
    assert np.nanmax(np.abs(rr - 800)) < 2
    assert updates[-1].hrv.window_s > 55
    assert max((u.device_ns - t) / 1e9 for u in updates for t in u.peak_timestamps) <= 2.0


@pytest.mark.parametrize(("lost_s", "kept"), [(8, True), (12, False)])
def test_long_gap_starts_afresh(lost_s: int, kept: bool) -> None:
    """A gap of more than 10 s starts the variability window again."""
    n = lost_s * 130
    updates = play(synthetic(regular(0.8, 60), 130.0, 60), 130.0, sizes=(13,), holes=[(20 * 130, 20 * 130 + n)])
    assert (updates[-1].hrv.window_s > 50) is kept


@pytest.mark.parametrize("lost_s", [8, 12])
def test_a_beat_is_told_in_time_also_where_a_hole_follows_an_update_at_once(lost_s: int) -> None:
    """The sample at 20 s is that of an update and the last one before the hole: the beat at 19.7 s is told with it."""
    ecg, hole = synthetic(regular(0.8, 40), 130.0, 40), (20 * 130 + 1, (20 + lost_s) * 130)
    updates = play(ecg, 130.0, sizes=(1,), holes=[hole])
    found_s = peaks_s(updates)
    assert np.abs(found_s - 19.7).min() < 0.003
    assert max((update.device_ns - t) / 1e9 for update in updates for t in update.peak_timestamps) <= 2.0


@pytest.mark.parametrize("first", [5, 13, 14, 20, 25, 26])
def test_first_samples_may_be_few(first: int) -> None:
    """A stretch of which only some samples are there at first (an update soon after a hole) has the same beats."""
    fs_hz = 130.0
    ecg = synthetic(regular(0.8, 12, first_s=0.15), fs_hz, 12)
    times_ns = START_NS + np.rint(np.arange(len(ecg)) * 1e9 / fs_hz).astype(np.int64)
    whole, parted = Detector(fs_hz), Detector(fs_hz)
    expected = whole.push(ecg, times_ns)
    found = parted.push(ecg[:first], times_ns[:first]) + parted.push(ecg[first:], times_ns[first:])
    assert len(expected) == 14
    assert [(beat.time_ns, beat.energy) for beat in found] == [(beat.time_ns, beat.energy) for beat in expected]


def test_device_that_starts_afresh() -> None:
    """At a reset the last beats are told in the old clock; then all is in the new one, and the window starts again."""
    ecg = synthetic(regular(0.8, 30), 130.0, 30)
    clock, step, updates = SampleClock(130.0), EcgStream(Config(), info(130.0)), []
    for start_ns in (START_NS, START_NS // 2):
        updates.append([])
        for i in range(0, len(ecg) - 73, 73):
            stamp = start_ns + round((i + 72) / 130 * 1e9)
            updates[-1] += step.push(clock.place(Chunk(CHANNELS, ecg[i : i + 73, None], stamp, stamp)))
    ended, *after_updates = updates[1]
    assert 0 < min(ended.device_ns - t for t in ended.peak_timestamps) < 2e9
    after = peaks_s(after_updates, START_NS // 2)
    assert after.min() >= 0
    assert np.all(np.diff(after) > 0)
    assert after_updates[0].hrv.window_s < 2


def test_a_beat_is_told_also_where_the_device_starts_afresh_after_an_update_at_once() -> None:
    """The last beat, 0.7 s before the sample of an update, is told in the old clock."""
    ecg = synthetic(regular(0.8, 20), 130.0, 20)[: 10 * 130 + 1]
    clock, step, updates = SampleClock(130.0), EcgStream(Config(), info(130.0)), []
    for start_ns in (START_NS, START_NS // 2):
        for i in range(len(ecg)):
            stamp = start_ns + round(i / 130 * 1e9)
            updates += step.push(clock.place(Chunk(CHANNELS, ecg[i : i + 1, None], stamp, stamp)))
    assert np.abs(peaks_s(updates) - 9.3).min() < 0.003


def test_each_event_once_in_order_in_time() -> None:
    """Every beat is published once, in order, never after the newest sample and within 2 s of it."""
    beats = resting(120)
    updates = play(synthetic(beats, 250.0, 120, noise_uv=30), 250.0, sizes=(7, 250, 31))
    times = [t for update in updates for t in update.peak_timestamps]
    assert all(a < b for a, b in pairwise(times))
    assert all(0 <= (update.device_ns - t) / 1e9 <= 2.0 for update in updates for t in update.peak_timestamps)
    assert_same_beats(peaks_s(updates), beats)


# -- the numbers


@pytest.mark.parametrize("fs_hz", [100.0, 130.0, 250.0, 360.0, 512.0, 1000.0])
def test_any_rate(fs_hz: float) -> None:
    """Beats are found where they are, to a millisecond, at any rate."""
    beats = resting(30)
    assert_same_beats(peaks_s(play(synthetic(beats, fs_hz, 30), fs_hz)), beats, 0.001 if fs_hz > 120 else 0.002)


@pytest.mark.parametrize("amplitude_uv", [200.0, 1000.0, 5000.0, -200.0, -1500.0])
def test_any_amplitude_and_polarity(amplitude_uv: float) -> None:
    """0.2 to 5 mV, upright or inverted."""
    beats = resting(30)
    updates = play(synthetic(beats, 130.0, 30, amplitude_uv), 130.0)
    assert_same_beats(peaks_s(updates), beats)
    assert updates[-1].extra[0].values[0] == pytest.approx(abs(amplitude_uv), rel=0.15)


@pytest.mark.parametrize("rate", [35, 60, 100, 180, 220])
def test_heart_rate(rate: int) -> None:
    """Rate, interval and count of a regular rhythm, from 35 to 220 a minute."""
    updates = play(synthetic(regular(60 / rate, 40), 250.0, 40, noise_uv=10), 250.0)
    last = updates[-1]
    assert last.heart_rate_bpm == pytest.approx(rate, rel=0.003)
    assert last.rr_interval_ms == pytest.approx(6e4 / rate, rel=0.005)
    assert last.peak_count == pytest.approx(rate / 60 * 10, abs=0.1 * rate / 60 * 10 + 1.2)
    assert last.window_s == 10.0


def test_variability_of_a_long_stretch() -> None:
    """After five minutes every measure is there and is that of the intervals put in."""
    beats = resting(330)
    last = play(synthetic(beats, 130.0, 330), 130.0)[-1]
    rr = np.diff(beats[(beats > 30) & (beats < 328)]) * 1e3
    assert last.hrv.corrected_count == 0
    assert last.hrv.mean_nn_ms == pytest.approx(rr.mean(), abs=0.5)
    assert last.hrv.sdnn_ms == pytest.approx(rr.std(ddof=1), abs=0.5)
    assert last.hrv.rmssd_ms == pytest.approx(np.sqrt(np.mean(np.diff(rr) ** 2)), abs=0.5)
    assert np.isfinite(last.hrv.lf_hf_ratio)
    assert not any("hrv" in reason or "needs" in reason for reason in last.reasons)


def test_beginning_is_honest() -> None:
    """Before there is enough signal values are NaN and every one is explained."""
    first = play(synthetic(resting(30), 130.0, 30), 130.0)[0]
    assert np.isnan([first.heart_rate_bpm, first.rr_interval_ms, first.signal_quality, first.hrv.rmssd_ms]).all()
    for name in ("heart_rate_bpm", "rr_interval_ms", "signal_quality", "rmssd_ms", "sdnn_ms", "lf_power_ms2"):
        assert any(name in reason for reason in first.reasons), name


def test_difference_to_the_device() -> None:
    """Our rate is compared with the newest that the device reported 1 to 6 s before; zero is no rate."""
    fs_hz, ecg = 130.0, synthetic(regular(0.75, 30), 130.0, 30)
    clock, step, updates = SampleClock(fs_hz), EcgStream(Config(), info(fs_hz)), []
    for i in range(0, len(ecg) - 65, 65):
        stamp = START_NS + round((i + 64) / fs_hz * 1e9)
        if i == 20 * 130:
            step.device_reported("heart_rate", 78.0, stamp)
            step.device_reported("rr_interval", 750.0, stamp)
        if i == 23 * 130:
            step.device_reported("heart_rate", 0.0, stamp)
        updates += step.push(clock.place(Chunk(CHANNELS, ecg[i : i + 65, None], stamp, stamp)))
    by_second = {round((u.device_ns - START_NS) / 1e9): u.device_heart_rate_difference_bpm for u in updates}
    assert np.isnan(by_second[20])
    assert by_second[23] == pytest.approx(2.0, abs=0.3)
    assert np.isnan(by_second[28])


def test_without_device_time() -> None:
    """A device that gives no time has its events in ROS time."""
    beats = resting(30)
    updates = play(synthetic(beats, 130.0, 30), 130.0, device_time=False)
    assert {update.device_ns for update in updates} == {None}
    assert np.abs(np.diff(peaks_s(updates)) - np.diff(beats[: len(peaks_s(updates))])).max() < 0.003


def test_unknown_unit() -> None:
    """Where the unit is not uV beats are found all the same; only the amplitude is not given."""
    beats = resting(30)
    updates = play(synthetic(beats, 130.0, 30) * 7 + 32768, 130.0, unit="counts")
    assert_same_beats(peaks_s(updates), beats)
    assert np.isnan(updates[-1].extra[0].values[0])
    assert any(reason.startswith("uncalibrated") for reason in updates[-1].reasons)


# -- odd signals


@pytest.mark.parametrize("pause_s", [2.5, 6.0, 15.0])
def test_long_pause(pause_s: float) -> None:
    """In a pause no beat is invented, after it none is lost, and the pause is an interval as measured."""
    beats = np.concatenate((regular(0.8, 20), np.arange(20 + pause_s, 60, 0.8)))
    updates = play(synthetic(beats, 130.0, 62, noise_uv=15), 130.0)
    assert_same_beats(peaks_s(updates), beats)
    longest = max(rr for update in updates for rr in update.rr_intervals_ms if rr == rr)
    assert longest == pytest.approx(1e3 * np.diff(beats).max(), abs=5)


def test_ectopic_beats() -> None:
    """Wide premature beats are found, and their intervals are kept out of the variability."""
    beats, fs_hz = regular(0.8, 130), 130.0
    ectopic = np.arange(20, len(beats) - 5, 17)
    beats[ectopic] -= 0.3
    ecg = synthetic(np.delete(beats, ectopic), fs_hz, 130)
    t_s = np.arange(len(ecg)) / fs_hz
    for beat in beats[ectopic]:
        ecg += 1500 * np.exp(-0.5 * ((t_s - beat) / 0.035) ** 2) - 700 * np.exp(
            -0.5 * ((t_s - beat - 0.25) / 0.06) ** 2
        )
    updates = play(ecg, fs_hz)
    assert_same_beats(peaks_s(updates), beats, 0.04)
    assert updates[-1].hrv.corrected_count >= len(ectopic)
    assert updates[-1].hrv.rmssd_ms < 15


@pytest.mark.parametrize("factor", [0.1, 0.3, 3.0, 10.0])
def test_change_of_amplitude(factor: float) -> None:
    """When contact or gain changes, beats are found again within a few seconds."""
    beats = resting(60)
    ecg = synthetic(beats, 130.0, 60, noise_uv=2)
    ecg[30 * 130 :] *= factor
    found = peaks_s(play(ecg, 130.0))
    late = beats[(beats > 36) & (beats < 57)]
    assert len(found[(found > 35.9) & (found < 57)]) == len(late)


@pytest.mark.parametrize("signal", ["flat", "noise", "hum", "not a number"])
def test_no_heart_in_it(signal: str) -> None:
    """A loose electrode has no quality and no variability, and says so."""
    n, rng = 130 * 60, np.random.default_rng(4)
    ecg = {
        "flat": np.full(n, 123.0),
        "noise": rng.normal(0, 100, n),
        "hum": 500 * np.sin(2 * np.pi * 50 * np.arange(n) / 130) + rng.normal(0, 10, n),
        "not a number": np.full(n, np.nan),
    }[signal]
    last = play(ecg, 130.0)[-1]
    assert last.signal_quality < 0.3
    assert np.isnan(last.hrv.rmssd_ms)
    assert any("signal_quality" in reason for reason in last.reasons)


def test_missing_values_are_no_beats() -> None:
    """Single values that the device could not give do not disturb the beats."""
    beats = resting(30)
    ecg = synthetic(beats, 130.0, 30)
    ecg[::97] = np.nan
    assert_same_beats(peaks_s(play(ecg, 130.0)), beats, 0.02)


def test_bounded() -> None:
    """An hour in, the state is no larger than after five minutes."""
    step, clock, sizes = EcgStream(Config(), info(100.0)), SampleClock(100.0), []
    ecg = synthetic(regular(0.8, 60), 100.0, 60)
    for minute in range(20):
        stamp = START_NS + (minute + 1) * 60_000_000_000 - 10_000_000
        step.push(clock.place(Chunk(CHANNELS, ecg[:, None], stamp, stamp)))
        beats = step._hrv._end - step._hrv._first
        sizes.append(len(step._detector._ecg) + len(step._window) + beats + len(step._blocks._pieces))
    assert max(sizes[10:]) <= max(sizes[5:10]) + 5
    assert max(sizes) < 2000


# -- parts


def test_parabola() -> None:
    """The vertex of a parabola is found exactly; a flat one has its vertex in the middle."""
    assert parabolic_offset(*(-((x - 0.3) ** 2) for x in (-1.0, 0.0, 1.0))) == pytest.approx(0.3)
    assert parabolic_offset(1.0, 1.0, 1.0) == 0.0


@pytest.mark.parametrize("shift", [-0.4, 0.0, 0.25])
def test_peak_between_samples(shift: float) -> None:
    """A peak between two samples at 130 Hz is found to 0.1 ms."""
    finder = PeakFinder(130.0)
    t_s = np.arange(-finder.reach, finder.reach + 1) / 130.0
    peak = finder.find(np.exp(-0.5 * ((t_s - shift / 130.0) / 0.012) ** 2), 1.0)
    assert peak.offset_s == pytest.approx(shift / 130.0, abs=1e-4)


def test_peak_of_a_wide_beat_is_its_largest() -> None:
    """R or S as usual, unless one is twice the other, or the two are 130 ms apart, as in no usual beat."""
    finder = PeakFinder(130.0)
    t_s = np.arange(-finder.reach, finder.reach + 1) / 130.0
    for half_s, usual in ((0.02, -1), (0.065, 1)):
        up, down = (np.exp(-0.5 * ((t_s - at_s) / half_s * 2) ** 2) for at_s in (-half_s, half_s))
        assert np.sign(finder.find(up - 0.7 * down, -1.0).height) == usual


def test_quality_counts_like_beats() -> None:
    """Two kinds of beats in turn are as good as one; noise is not, nor is hum; two beats are too few to tell."""
    t_s = np.arange(-0.15, 0.26, 0.01)
    one, other = heartbeat(t_s), -heartbeat(t_s, qrs_s=0.03)
    rng = np.random.default_rng(0)
    shapes = np.array([one, other] * 6) + rng.normal(0, 0.01, (12, len(t_s)))
    usual = np.full(12, 0.4)
    assert signal_quality(shapes, usual)[0] > 0.95
    assert signal_quality(shapes, usual / 1000)[0] < 0.1
    assert signal_quality(rng.normal(0, 1, (12, len(t_s))), usual)[0] < 0.15
    assert np.isnan(signal_quality(shapes[:2], usual[:2])).all()


# -- bad input


@pytest.mark.parametrize(
    ("values", "names"),
    [
        ({"update_interval_s": 0.0}, "update_interval_s"),
        ({"window_s": -1.0}, "window_s"),
        ({"hrv_window_s": float("nan")}, "hrv_window_s"),
        ({"hrv_min_quality": 1.5}, "hrv_min_quality"),
    ],
)
def test_bad_parameter_is_named(values: dict[str, float], names: str) -> None:
    """A parameter that makes no sense is refused by name."""
    with pytest.raises(ValueError, match=names):
        Config(**values)


@pytest.mark.parametrize("fs_hz", [0.0, 10.0, float("nan"), 1e6])
def test_rate_that_no_ecg_has(fs_hz: float) -> None:
    """A stream without a rate, or with an impossible one, is refused."""
    with pytest.raises(ValueError, match="sampling_frequency_hz"):
        EcgStream(Config(), info(fs_hz))


def test_lead_that_is_not_there() -> None:
    """A lead that the stream does not have is refused, and those it has are named."""
    with pytest.raises(ValueError, match="V1"):
        EcgStream(Config(channel="II"), info(130.0, channel_names=("I", "V1")))
