"""Every pulse of a synthetic wearer is found, at its time, at any rate, polarity, level and heart rate."""

import numpy as np
import pytest
from interpreter_ppg.config import Config
from interpreter_ppg.stream import PpgStream, PpgUpdate
from sense4hri.chunk import Break, Chunk, TimedChunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

START_NS = 704_201_975_000_000_000


def info(fs_hz, names=("ppg_0",), **limits):
    """What the kit knows of the stream."""
    return StreamInfo(StreamName("p1", "ppg", "s1"), fs_hz, "counts", names, **limits)


def beats_s(duration_s, rate_bpm, variability_ms=25.0, seed=1):
    """Times of heart beats: breathing modulates the interval, the rest is chance."""
    random = np.random.default_rng(seed)
    times = [0.3]
    while times[-1] < duration_s:
        breath = variability_ms * np.sin(2 * np.pi * 0.25 * times[-1])
        times.append(times[-1] + 60 / rate_bpm + (breath + random.normal(0, variability_ms / 3)) / 1000)
    return np.array(times)


def pleth(times_s, beats, amplitude=3000.0, level=4e5, breathing=0.5, dicrotic=0.35, noise=0.0, seed=2):
    """Light absorbed: a systolic and a dicrotic wave per beat, on a level that moves with breathing."""
    random = np.random.default_rng(seed)
    x = np.zeros(len(times_s))
    for i, beat in enumerate(beats):
        stretch = min(1.0, (beats[i + 1] - beat if i + 1 < len(beats) else 1.0) / 0.8)
        after = times_s - beat
        x += np.exp(-0.5 * ((after - 0.20 * stretch) / (0.085 * stretch)) ** 2)
        x += dicrotic * np.exp(-0.5 * ((after - 0.47 * stretch) / (0.13 * stretch)) ** 2)
    x += breathing * np.sin(2 * np.pi * 0.23 * times_s) + noise * random.normal(size=len(times_s))
    return level + amplitude * x


def rises_s(beats):
    """When the systolic wave of each beat of `pleth` rises most steeply."""
    stretch = np.minimum(1.0, np.diff(beats, append=beats[-1] + 1.0) / 0.8)
    return beats + 0.115 * stretch


def play(samples, fs_hz, frames=(20,), config=None, names=("ppg_0", "ppg_1", "ppg_2"), skip=()) -> list[PpgUpdate]:
    """Every update of a recording cut into frames; the frames whose numbers are in skip are lost on the way."""
    samples = np.asarray(samples, float).reshape(len(samples), -1)
    names = tuple(names[: samples.shape[1]])
    clock, step = SampleClock(fs_hz), PpgStream(config or Config(), info(fs_hz, names))
    updates, start, number = [], 0, 0
    while start < len(samples):
        stop = min(start + frames[number % len(frames)], len(samples))
        stamp_ns = START_NS + round((stop - 1) / fs_hz * 1e9)
        chunk = Chunk(names, samples[start:stop], stamp_ns, stamp_ns + 10**18)
        if number not in skip:
            updates += step.push(clock.place(chunk))
        start, number = stop, number + 1
    return updates


def published_s(updates):
    return np.array([(t - START_NS) / 1e9 for update in updates for t in update.peak_timestamps])


def matches(found, truth, tolerance_s=0.08):
    """Indices (found, truth) of pulses within the tolerance, each once."""
    nearest = np.abs(found[:, None] - truth).argmin(axis=1)
    close = np.abs(found - truth[nearest]) < tolerance_s
    which, first = np.unique(nearest[close], return_index=True)
    return np.flatnonzero(close)[first], which


def cut(samples, fs_hz, edges, gap_after_s=None):
    """TimedChunks of one recording, cut at the given sample numbers; optionally with a hole in time."""
    times_ns = START_NS + np.rint(np.arange(len(samples)) / fs_hz * 1e9).astype(np.int64)
    if gap_after_s is not None:
        times_ns[int(gap_after_s * fs_hz) :] += 700_000_000
    names = tuple(f"ppg_{i}" for i in range(samples.shape[1]))
    starts = [0, *edges]
    for start, stop in zip(starts, [*edges, len(samples)], strict=True):
        break_ = Break.FIRST if start == 0 else None
        if gap_after_s is not None and start == int(gap_after_s * fs_hz):
            break_ = Break.GAP
        times = times_ns[start:stop]
        yield TimedChunk(names, samples[start:stop], times, int(times[-1]), int(times[-1]), break_, 0)


def same(one, other):
    """Two lists of updates, equal to the last bit, but for the receipt stamp of the message that brought them."""
    assert len(one) == len(other) > 0
    for a, b in zip(one, other, strict=True):
        assert repr(a._replace(received_ns=0)) == repr(b._replace(received_ns=0))


@pytest.mark.parametrize("fs_hz", [25, 54.75, 200])
@pytest.mark.parametrize("rate_bpm", [40, 75, 120, 180])
@pytest.mark.parametrize("sign", [1, -1])
def test_every_pulse_once(fs_hz, rate_bpm, sign):
    """Every pulse is published once, in order, within 2 s and at its time, at any rate, heart rate and polarity."""
    times_s = np.arange(0, 40, 1 / fs_hz)
    beats = beats_s(40, rate_bpm)
    updates = play(sign * pleth(times_s, beats), fs_hz)
    found, truth = published_s(updates), rises_s(beats)
    known, which = matches(found, truth)
    assert len(known) == len(found)
    assert set(np.flatnonzero((truth > 0.9) & (truth < 38))) <= set(which)
    assert np.all(np.diff(found) > 0)
    assert np.std(found[known] - truth[which]) < 0.0015
    assert max(update.device_ns - t for update in updates for t in update.peak_timestamps) <= 2_000_000_000
    last = updates[-1]
    assert last.heart_rate_bpm == pytest.approx(60 / np.diff(beats[(beats > 28.5) & (beats < 38.5)]).mean(), abs=1.0)
    assert last.signal_quality > 0.9
    assert last.pulse_amplitude == pytest.approx(3000, rel=0.45)


def test_intervals_belong_to_their_pulses():
    """rr_intervals_ms[i] is the time from the pulse before to peak_timestamps[i]; the first one is NaN."""
    times_s = np.arange(0, 30, 1 / 55)
    updates = play(pleth(times_s, beats_s(30, 70)), 55)
    rr_ms = np.array([rr for update in updates for rr in update.rr_intervals_ms])
    assert np.isnan(rr_ms[0])
    np.testing.assert_allclose(rr_ms[1:], np.diff(published_s(updates)) * 1000, atol=1e-3)


def test_small_pulses_on_a_large_level():
    """Pulses of 8 counts on a level of 1e6 counts, quantised to whole counts, are all found."""
    times_s = np.arange(0, 60, 1 / 55)
    beats = beats_s(60, 65)
    found = published_s(play(np.round(pleth(times_s, beats, amplitude=8, level=1e6)), 55))
    assert len(matches(found, rises_s(beats))[0]) == len(found) >= len(beats) - 4


def test_deep_breaths_and_dicrotic_waves():
    """Breathing three times the pulse and a large dicrotic wave add and hide no pulse."""
    times_s = np.arange(0, 60, 1 / 100)
    beats = beats_s(60, 65)
    for shape in ({"breathing": 3.0}, {"dicrotic": 0.7}, {"dicrotic": 0.0}):
        found = published_s(play(pleth(times_s, beats, **shape), 100))
        assert len(matches(found, rises_s(beats))[0]) == len(found) >= len(beats) - 4, shape


def test_irregular_rhythms():
    """Atrial fibrillation, bigeminy, a pause of 5 s and a rate that triples are followed pulse by pulse."""
    random = np.random.default_rng(3)
    ramp = [0.3]
    while ramp[-1] < 60:
        ramp.append(ramp[-1] + 60 / (60 + 2 * ramp[-1]))
    rhythms = {
        "fibrillation": np.cumsum(random.uniform(0.45, 1.15, 75)),
        "bigeminy": np.sort(np.concatenate([np.arange(0.3, 60, 1.6), np.arange(0.92, 60, 1.6)])),
        "pause": np.concatenate([np.arange(0.3, 30, 0.8), np.arange(35, 60, 0.8)]),
        "ramp": np.array(ramp),
    }
    for name, beats in rhythms.items():
        times_s = np.arange(0, beats[-1], 1 / 55)
        found, truth = published_s(play(pleth(times_s, beats), 55)), rises_s(beats)
        known, which = matches(found, truth)
        assert len(known) == len(found), name
        assert set(np.flatnonzero((truth > 1) & (truth < times_s[-1] - 2))) <= set(which), name


def test_pause_is_no_interval():
    """An interval of 5 s is no interval: the signal was lost or the heart paused."""
    beats = np.concatenate([np.arange(0.3, 30, 0.8), np.arange(35, 60, 0.8)])
    updates = play(pleth(np.arange(0, 60, 1 / 55), beats), 55)
    rr_ms = np.array([rr for update in updates for rr in update.rr_intervals_ms])
    assert np.isnan(rr_ms).sum() == 2
    assert np.nanmax(rr_ms) < 820


def test_variability_of_the_heart_is_found():
    """RMSSD and SDNN of the pulses are within 1 ms of those of the beats."""
    times_s = np.arange(0, 180, 1 / 55)
    beats = beats_s(180, 65, variability_ms=50)
    hrv = play(pleth(times_s, beats), 55)[-1].hrv
    nn = 1000 * np.diff(beats[(beats > 1) & (beats < 178)])
    assert hrv.rmssd_ms == pytest.approx(np.sqrt(np.mean(np.diff(nn) ** 2)), abs=1.0)
    assert hrv.sdnn_ms == pytest.approx(nn.std(ddof=1), abs=1.0)


@pytest.mark.parametrize("seed", range(4))
def test_chunking_does_not_matter(seed):
    """However the samples are cut into chunks, the updates are the same to the last bit."""
    fs_hz, random = 54.75, np.random.default_rng(seed)
    times_s = np.arange(0, 45, 1 / fs_hz)
    beats = beats_s(45, 72)
    samples = np.stack([-pleth(times_s, beats, noise=0.05), -pleth(times_s, beats, noise=0.3)], 1)
    step = [PpgStream(Config(), info(fs_hz, ("ppg_0", "ppg_1"))) for _ in range(2)]
    gap = int(20 * fs_hz)
    edges = sorted({gap, *random.integers(1, len(samples), 5 ** (seed + 1)).tolist()})
    whole = [update for timed in cut(samples, fs_hz, [gap], 20) for update in step[0].push(timed)]
    pieces = [update for timed in cut(samples, fs_hz, edges, 20) for update in step[1].push(timed)]
    same(whole, pieces)


def test_a_gap_breaks_only_what_it_breaks():
    """After lost frames the first pulse ends no interval, the others are unharmed and variability goes on."""
    times_s = np.arange(0, 120, 1 / 55)
    beats = beats_s(120, 70)
    updates = play(pleth(times_s, beats), 55, (36,), skip={60, 100})
    found, truth = published_s(updates), rises_s(beats)
    assert len(matches(found, truth)[0]) == len(found)
    rr_ms = np.array([rr for update in updates for rr in update.rr_intervals_ms])
    assert np.isnan(rr_ms).sum() == 3
    for lost in (60, 100):
        hole = (lost * 36 / 55, (lost + 1) * 36 / 55)
        after = np.flatnonzero(found > hole[0])[0]
        assert np.isnan(rr_ms[after])
        missing = [t for t in truth if hole[0] - 2 < t < hole[1] + 2 and np.abs(found - t).min() > 0.1]
        assert len(missing) <= 2
    assert updates[-1].hrv.window_s > 115
    assert updates[-1].hrv.rmssd_ms == pytest.approx(np.sqrt(np.mean(np.diff(1000 * np.diff(beats)) ** 2)), abs=2.0)


def test_a_long_gap_and_a_reset_begin_a_new_segment():
    """After 20 s without samples, or when the device clock starts afresh, window and variability begin anew."""
    fs_hz = 55
    samples = pleth(np.arange(0, 40, 1 / fs_hz), beats_s(40, 70))[:, None]
    for offset_ns, break_ in ((60_000_000_000, Break.GAP), (-500_000_000_000, Break.RESET)):
        step = PpgStream(Config(), info(fs_hz))
        (first,) = cut(samples, fs_hz, [])
        assert step.push(first)[-1].hrv.window_s > 38
        times_ns = first.times_ns + offset_ns
        last, *updates = step.push(TimedChunk(first.channels, samples, times_ns, int(times_ns[-1]), 0, break_, 0))
        assert last.peak_timestamps
        assert all(last.device_ns - 1.5e9 < t < last.device_ns for t in last.peak_timestamps)
        assert updates[0].window_s == updates[0].hrv.window_s < 1.1
        assert np.isnan(updates[0].heart_rate_bpm)
        assert all(times_ns[0] < t < times_ns[-1] for update in updates for t in update.peak_timestamps)


def test_the_last_pulses_before_a_hole_come_before_it():
    """The end of a stretch is told at once: all but 0.3 s of it has its pulses, stamped with its last sample.

    So it is before 24.02 and 25.02 s, where the last sample, of 24 and 25 s, has had its update.
    """
    fs_hz, beats = 55, beats_s(40, 70)
    samples = pleth(np.arange(0, 40, 1 / fs_hz), beats)[:, None]
    for seconds in (20.2, 20.6, 20.95, 24.02, 25.02):
        step = PpgStream(Config(), info(fs_hz))
        before, after = (step.push(timed) for timed in cut(samples, fs_hz, [int(seconds * fs_hz)], seconds))
        last = [update for update in after if update.device_ns < START_NS + seconds * 1e9]
        told, due = published_s(before + last), rises_s(beats)
        known, which = matches(told, due)
        assert len(known) == len(told)
        assert set(np.flatnonzero((due > 0.9) & (due < seconds - 0.35))) <= set(which)


def test_without_device_time_pulses_are_in_ros_time():
    """A stream without device time gives pulses on the receipt clock, free of arrival jitter."""
    fs_hz, random = 50, np.random.default_rng(4)
    beats = beats_s(60, 60)
    samples = pleth(np.arange(0, 60, 1 / fs_hz), beats)[:, None]
    clock, step, updates = SampleClock(fs_hz), PpgStream(Config(), info(fs_hz)), []
    for start in range(0, len(samples), 10):
        received_ns = START_NS + round((start + 9) / fs_hz * 1e9) + int(random.uniform(0, 0.03) * 1e9)
        updates += step.push(clock.place(Chunk(("ppg_0",), samples[start : start + 10], None, received_ns)))
    found, truth = published_s(updates), rises_s(beats)
    assert all(update.device_ns is None for update in updates)
    known, which = matches(found, truth)
    assert len(known) == len(found) >= len(beats) - 4
    late = found > 20
    assert np.std((found[known] - truth[which])[late]) < 0.004
