"""The ring of one stream's samples: lookup by time, columns, holes, clocks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sense4hri.chunk import Break, Chunk, TimedChunk
from sense4hri.sample_clock import SampleClock
from web_gui import history as module
from web_gui.history import Clock, History

S = 1_000_000_000
EPOCH = 1_700_000_000 * S


def timed(times_ns, samples, received_ns=None, break_=None, device=True):
    """A chunk of one or more channels at the given event times."""
    times_ns = np.asarray(times_ns, np.int64)
    samples = np.asarray(samples, float)
    samples = samples[:, None] if samples.ndim == 1 else samples
    last = int(times_ns[-1])
    channels = tuple(f"c{i}" for i in range(samples.shape[1]))
    received_ns = last if received_ns is None else received_ns
    return TimedChunk(channels, samples, times_ns, last if device else None, received_ns, break_, 0)


def filled(fs_hz, seconds, channels=1, chunk=20, start_ns=EPOCH):
    """A history without device time and the arrays it must hold."""
    n = int(fs_hz * seconds)
    times = start_ns + (np.arange(n) * S / fs_hz).astype(np.int64)
    samples = np.random.default_rng(3).standard_normal((n, channels))
    ring = History(tuple(f"c{i}" for i in range(channels)), 600.0, device_time=False)
    for a in range(0, n, chunk):
        break_ = Break.FIRST if a == 0 else None
        ring.push(timed(times[a : a + chunk], samples[a : a + chunk], break_=break_, device=False))
    return ring, times, samples


@pytest.mark.parametrize("column_ms", [10, 37, 250])
def test_columns_are_the_minimum_and_maximum_of_every_column(column_ms):
    """Decimation equals brute force: no peak is lost, none is invented, each is in its own column."""
    ring, times, samples = filled(1000.0, 12.0, channels=3)
    column = column_ms * 1_000_000
    start, end = (EPOCH + 2 * S) // column * column, EPOCH + 9 * S
    line = ring.columns(start, end, column, [0, 2])
    inside = (times >= start) & (times < end)
    number = times[inside] // column
    assert np.array_equal(line.times_ns, np.unique(number) * column + column // 2)
    for row, n in enumerate(np.unique(number)):
        block = samples[inside][number == n][:, [0, 2]].astype(np.float32)
        assert np.array_equal(line.low[row], block.min(0))
        assert np.array_equal(line.high[row], block.max(0))


def test_a_small_signal_on_a_huge_offset_keeps_its_shape():
    """Single precision would hold 1.7e9 ± 50 in steps of 128, a flat line."""
    times = EPOCH + np.arange(400) * S // 100
    ring = History(("c0",), 600.0, device_time=False)
    ring.push(timed(times[:10], np.zeros(10), break_=Break.FIRST, device=False))
    large = 1.7e9 + 50 * np.sin(np.arange(10, 400))
    ring.push(timed(times[10:], large, device=False))
    line = ring.columns(EPOCH, EPOCH + 5 * S, 9_000_000, [0])
    assert np.array_equal(line.low[:, 0], np.concatenate((np.zeros(10), large)))


def test_few_samples_per_column_are_sent_as_they_are():
    """A slow signal is drawn through its samples at their own times."""
    ring, times, samples = filled(130.0, 5.0)
    line = ring.columns(EPOCH, EPOCH + 5 * S, 9_000_000, [0])
    assert np.array_equal(line.times_ns, times)
    assert np.array_equal(line.low, samples.astype(np.float32))
    assert np.array_equal(line.low, line.high)


def test_a_hole_shorter_than_a_column_breaks_no_line():
    """What is narrower than a pixel is not drawn, wherever in its column it is."""
    ring = History(("c0",), 600.0, device_time=False)
    for k in range(50):
        times = EPOCH + k * 7 * 1_000_000 + np.arange(5, dtype=np.int64) * 1_000_000
        ring.push(timed(times, np.ones(5), break_=Break.GAP if k else Break.FIRST, device=False))
    line = ring.columns(EPOCH, EPOCH + S, 100_000_000, [0])
    assert len(line.times_ns) == 4
    assert not np.isnan(line.low).any()
    assert len(ring.columns(EPOCH + S, EPOCH + 2 * S, 100_000_000, [0]).times_ns) == 0


@given(st.lists(st.integers(1, 60), min_size=1, max_size=40), st.integers(1, 300))
def test_incremental_columns_equal_those_made_at_once(chunks, column_ms):
    """What a client collects frame by frame is what it would get in one piece."""
    n, column = sum(chunks), column_ms * 1_000_000
    times = EPOCH + np.arange(n, dtype=np.int64) * 2_000_000
    samples = np.sin(np.arange(n) * 0.7)
    ring = History(("c0",), 600.0, device_time=False)
    collected: list[tuple[int, float, float]] = []
    at, upto = 0, EPOCH // column * column
    for size in chunks:
        ring.push(
            timed(times[at : at + size], samples[at : at + size], break_=Break.FIRST if not at else None, device=False)
        )
        at += size
        line = ring.columns(upto, EPOCH + 10**12, column, [0])
        collected = [point for point in collected if point[0] < upto]
        collected += zip(line.times_ns.tolist(), line.low[:, 0].tolist(), line.high[:, 0].tolist(), strict=True)
        upto = ring.newest_ns // column * column
    found = np.array([point[0] for point in collected]) // column
    for number in np.unique(times // column):
        block = samples[times // column == number].astype(np.float32)
        own = [collected[i] for i in np.flatnonzero(found == number)]
        assert min(point[1] for point in own) == block.min()
        assert max(point[2] for point in own) == block.max()


def test_the_ring_forgets_what_is_older_than_its_span_and_stays_small():
    """An hour of 1 kHz leaves the last ten seconds and a buffer of bounded size."""
    ring = History(("c0",), 10.0, device_time=False)
    for k in range(3600):
        times = EPOCH + k * S + np.arange(1000, dtype=np.int64) * 1_000_000
        ring.push(timed(times, np.full(1000, float(k)), break_=Break.FIRST if k == 0 else None, device=False))
    assert ring.newest_ns == EPOCH + 3600 * S - 1_000_000
    line = ring.columns(EPOCH + 3592 * S, EPOCH + 3600 * S, 1_000_000, [0])
    assert len(line.times_ns) == 8000
    assert len(ring._values) < 60_000


def test_no_rate_makes_a_history_larger_than_its_limit(monkeypatch):
    """Memory per stream is bounded in values, not only in seconds."""
    monkeypatch.setattr(module, "MOST_BYTES", 10_000 * 8)
    ring = History(("a", "b"), 600.0, device_time=False)
    for k in range(200):
        times = EPOCH + k * S // 10 + np.arange(500, dtype=np.int64) * 200_000
        ring.push(timed(times, np.zeros((500, 2)), break_=Break.FIRST if k == 0 else None, device=False))
    assert ring._values.size < 6 * 10_000


def test_a_gap_lifts_the_pen_and_is_reported_with_both_its_ends():
    """A hole is a hole: no line across it, from the last sample before to the first after."""
    clock, ring = SampleClock(100.0), History(("c0",), 600.0, device_time=True)
    for k in [*range(20), *range(60, 80)]:
        last = 5 * S + (k + 1) * S // 10
        chunk = Chunk(("c0",), np.ones((10, 1)), last, EPOCH + last)
        ring.push(clock.place(chunk))
    gaps = ring.gaps(EPOCH, EPOCH + 20 * S)
    assert gaps == [(EPOCH + 7 * S, EPOCH + 11 * S + 10_000_000)]
    line = ring.columns(EPOCH, EPOCH + 20 * S, 5_000_000, [0])
    lifted = np.flatnonzero(np.isnan(line.low[:, 0]))
    assert len(lifted) == 1
    assert line.times_ns[lifted[0] - 1] == EPOCH + 7 * S
    wide = ring.columns(EPOCH, EPOCH + 20 * S, 100_000_000, [0])
    assert np.isnan(wide.low[:, 0]).sum() == 1


def test_without_a_model_samples_stand_by_the_fastest_delivery():
    """The least delayed message places all of them; a late one does not move the signal."""
    ring = History(("c0",), 600.0, device_time=True)
    for k, delay in enumerate([80, 40, 300, 90]):
        device = (k + 1) * S
        ring.push(timed([device], [0.0], EPOCH + device + delay * 1_000_000, Break.FIRST if not k else None))
    assert ring.provisional
    assert ring.newest_ns == EPOCH + 4 * S + 40_000_000


def test_a_clock_model_moves_what_is_stored_and_says_so():
    """The page is told to take everything again exactly when the shift is visible."""
    ring = History(("c0",), 600.0, device_time=True)
    ring.push(timed(np.arange(1, 101) * 10_000_000, np.arange(100.0), EPOCH + S + 50_000_000, Break.FIRST))
    version = ring.version
    ring.set_model(Clock(S, EPOCH, 0.0, 1))
    assert ring.newest_ns == EPOCH + S
    assert ring.version == version + 1
    assert not ring.provisional
    ring.set_model(Clock(S, EPOCH + 200_000, 0.0, 1))
    assert ring.version == version + 1


def test_a_number_of_a_segment_that_comes_again_is_believed_by_its_reference():
    """A clock-sync that was started anew after a reboot counts from 1 again; a late model of before is refused."""
    ring = History(("c0",), 60.0, device_time=True)
    ring.set_model(Clock(100 * S, EPOCH, 0.0, 1))
    ring.push(timed([100 * S], [1.0], EPOCH + 100 * S, Break.FIRST))
    ring.push(timed([97 * S], [1.0], EPOCH + 101 * S, Break.RESET))
    ring.set_model(Clock(100 * S, EPOCH, 0.0, 1))
    assert ring.provisional
    ring.set_model(Clock(97 * S, EPOCH + 4 * S, 0.0, 1))
    assert not ring.provisional
    assert ring.newest_ns == EPOCH + 101 * S


def test_a_reset_device_clock_starts_a_run_that_the_old_model_does_not_place():
    """After a reboot the samples are placed by arrival until a model of a new segment comes."""
    ring = History(("c0",), 600.0, device_time=True)
    ring.push(timed([100 * S], [0.0], EPOCH + 100 * S, Break.FIRST))
    ring.set_model(Clock(100 * S, EPOCH, 0.0, 1))
    ring.push(timed([2 * S], [1.0], EPOCH + 110 * S + 20_000_000, Break.RESET))
    assert ring.newest_ns == EPOCH + 110 * S + 20_000_000
    ring.set_model(Clock(100 * S, EPOCH, 0.0, 1))
    assert ring.newest_ns == EPOCH + 110 * S + 20_000_000
    ring.set_model(Clock(2 * S, EPOCH + 108 * S, 0.0, 2))
    assert ring.newest_ns == EPOCH + 110 * S
    placed = ring.axis_times(np.array([100 * S, 2 * S]))
    assert placed.tolist() == [EPOCH + 100 * S, EPOCH + 110 * S]


def test_a_device_clock_that_jumps_ahead_does_not_send_its_samples_into_the_future():
    """A sample is never placed far from its receipt, whatever its stamp says."""
    ring = History(("c0",), 600.0, device_time=True)
    ring.push(timed([100 * S], [0.0], EPOCH + 100 * S, Break.FIRST))
    ring.set_model(Clock(100 * S, EPOCH, 0.0, 1))
    ring.push(timed([10**9 * S], [1.0], EPOCH + 101 * S, Break.GAP))
    assert ring.newest_ns == EPOCH + 101 * S


def test_a_repeated_stamp_is_left_out():
    """A duplicate frame is not drawn twice."""
    ring, *_ = filled(100.0, 1.0)
    before = ring.samples_total
    ring.push(timed([EPOCH + S], [5.0], break_=Break.DUPLICATE, device=False))
    assert ring.samples_total == before


def test_what_is_older_than_the_samples_kept_is_there_as_minima_and_maxima(monkeypatch):
    """Ten minutes of 1 kHz in bounded memory: no peak is lost, and the newest samples are whole."""
    monkeypatch.setattr(module, "MOST_BYTES", 400_000)
    n, ring = 120_000, History(("a", "b"), 90.0, device_time=False)
    times = EPOCH + np.arange(n, dtype=np.int64) * 1_000_000
    samples = np.random.default_rng(5).standard_normal((n, 2)).astype(np.float32)
    kept = []
    for a in range(0, n, 50):
        break_ = Break.FIRST if a == 0 else None
        ring.push(timed(times[a : a + 50], samples[a : a + 50], break_=break_, device=False))
        kept.append(ring.kept_bytes)
    assert max(kept[len(kept) * 9 // 10 :]) < 1.1 * max(kept[: len(kept) * 9 // 10])
    assert times[-1] - 125 * S < ring.oldest_ns <= times[-1] - 89 * S
    start, end = EPOCH + 40 * S, EPOCH + 119 * S
    for column in (100_000_000, 5_000_000):
        line = ring.columns(start, end, column, [1])
        assert np.all(np.diff(line.times_ns) > 0)
        inside = (times >= start) & (times < end)
        assert line.high.max() == samples[inside, 1].max()
        assert line.low.min() == samples[inside, 1].min()
    line = ring.columns(start, end, 5_000_000, [1])
    old = line.times_ns < EPOCH + 60 * S
    for at_ns, low, high in zip(line.times_ns[old][:200:7], line.low[old][:200:7], line.high[old][:200:7], strict=True):
        bucket = samples[times // 20_000_000 == at_ns // 20_000_000, 1]
        assert bucket.min() <= low[0] <= high[0] <= bucket.max()


def test_a_gap_in_the_older_part_lifts_the_pen_and_is_told(monkeypatch):
    """Also where the hole lies between what was folded and what was not."""
    monkeypatch.setattr(module, "MOST_BYTES", 100_000)
    ring = History(("c0",), 600.0, device_time=False)
    at, holes = EPOCH, []
    for k in range(400):
        if k % 40 == 39:
            holes.append((at - 1_000_000, at + 3 * S))
            at += 3 * S
        times = at + np.arange(200, dtype=np.int64) * 1_000_000
        at += 200_000_000
        break_ = Break.FIRST if k == 0 else Break.GAP if k % 40 == 39 else None
        ring.push(timed(times, np.ones(200), break_=break_, device=False))
    assert ring._base > 0
    assert ring.gaps(EPOCH, at) == holes
    line = ring.columns(EPOCH, at, 5_000_000, [0])
    assert np.isnan(line.low[:, 0]).sum() == len(holes)
    drawn = line.times_ns[~np.isnan(line.low[:, 0])]
    for before, after in holes:
        assert not np.any((drawn > before + 20_000_000) & (drawn < after - 20_000_000))


@pytest.mark.parametrize("device", [True, False])
def test_what_was_to_come_is_forgotten_where_time_goes_back(device, monkeypatch):
    """A replay that is begun anew, or a host whose clock is set back an hour: what comes then is drawn where it is."""
    monkeypatch.setattr(module, "MOST_BYTES", 2000)
    ring = History(("c0",), 600.0, device_time=device)
    for begun_ns, seconds in (EPOCH, 200), (EPOCH - 3600 * S, 20):
        for k in range(seconds):
            first = Break.RESET if ring.samples_total else Break.FIRST
            times = (S if device else begun_ns) + k * S + np.arange(10) * S // 10
            ring.push(timed(times, np.full(10, k), begun_ns + k * S, first if k == 0 else None, device))
        version = ring.version
    line = ring.columns(begun_ns - S, EPOCH + 60 * S, 9_000_000, [0])
    assert np.array_equal(line.low[:, 0], np.repeat(np.arange(20.0), 10))
    assert np.all(np.diff(line.times_ns) > 0)
    assert (ring.oldest_ns, version) == (line.times_ns[0], 1)
    assert ring.gaps(0, 2 * EPOCH) == []


def test_a_step_of_seconds_forgets_nothing():
    """The little by which a clock is set right costs nobody what was recorded before."""
    ring, *_ = filled(100.0, 20.0)
    ring.push(timed(EPOCH + 16 * S + np.arange(20) * S // 100, np.ones(20), break_=Break.RESET, device=False))
    assert (ring.oldest_ns, ring.version) == (EPOCH, 0)


def test_a_model_places_what_is_played_once_more():
    """Sought back, a replay says the clock model of that place again: of the segment that has just ended."""
    ring, model = History(("c0",), 60.0, device_time=True), Clock(101 * S, EPOCH, 0.0, 1)
    for k in range(100, 120):
        ring.push(timed([k * S], [0.0], EPOCH + k * S + S // 5, Break.FIRST if k == 100 else None))
        ring.set_model(model)
    ring.push(timed([101 * S], [0.0], EPOCH + 101 * S + S // 5, Break.RESET))
    ring.set_model(model)
    assert not ring.provisional
    assert ring.newest_ns == EPOCH + 101 * S


def test_what_lasts_no_time_is_no_hole_in_the_older_part_either(monkeypatch):
    """A device that begins anew earlier than it ended misses nothing, before and after it is folded."""
    monkeypatch.setattr(module, "MOST_BYTES", 10_000)
    ring, *_ = filled(1000.0, 2.0)
    for k in range(3000):
        times = EPOCH + S + k * 20_000_000 + np.arange(20) * 1_000_000
        ring.push(timed(times, np.ones(20), break_=None if k else Break.RESET, device=False))
        assert ring.gaps(0, 2 * EPOCH) == []
    assert ring._base > 2000
