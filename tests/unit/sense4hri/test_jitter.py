"""Device stamps that jitter by as much as half a frame: what is lost is counted, what comes back is not."""

import numpy as np
import pytest
from sense4hri.chunk import Break, Chunk
from sense4hri.holes import Holes
from sense4hri.sample_clock import SampleClock

BEGUN_NS = 10**15
SHAPES = {
    "exponential": lambda rng, size: rng.exponential(1.0, size),
    "uniform": lambda rng, size: rng.uniform(0.0, 2.0, size),
    "normal": lambda rng, size: rng.normal(0.0, 1.0, size),
}


def stamps_of(frames: int, frame_s: float, late_s: np.ndarray) -> np.ndarray:
    """Device times in ns of frames that are stamped so late; a device's stamps rise."""
    rising = np.maximum.accumulate((np.arange(frames) * frame_s + late_s) * 1e9).astype(np.int64)
    return BEGUN_NS + rising + np.arange(frames)


def listened(fs_hz: float, n: int, stamps: np.ndarray, lost: frozenset[int] = frozenset()) -> tuple[SampleClock, list]:
    """Place all frames but the lost ones."""
    clock = SampleClock(fs_hz)
    came = [int(stamp) for frame, stamp in enumerate(stamps) if frame not in lost]
    return clock, [clock.place(Chunk(("x",), np.zeros((n, 1)), stamp, stamp)) for stamp in came]


@pytest.mark.parametrize("share", [0.05, 0.1, 0.15])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("fs_hz", "n"), [(500.0, 10), (250.0, 1), (130.0, 36)])
def test_jitter_is_no_loss_and_losses_are_exact(fs_hz: float, n: int, shape: str, share: float) -> None:
    """Late by a seventh of a frame on average: nothing lost told where nothing is, every lost frame where some are."""
    frames, frame_s = 1200, n / fs_hz
    stamps = stamps_of(frames, frame_s, share * frame_s * SHAPES[shape](np.random.default_rng(3), frames))
    for lost in (frozenset(), frozenset({200, 400, 401, *range(600, 607), 900})):
        clock, placed = listened(fs_hz, n, stamps, lost)
        assert clock.lost_samples_total == n * len(lost)
        assert np.all(np.diff(np.concatenate([timed.times_ns for timed in placed])) >= 0)


@pytest.mark.parametrize("shape", SHAPES)
def test_jitter_of_a_fifth_of_a_frame_is_no_loss(shape: str) -> None:
    """Frames come early and late by more than half of one, and none is told as lost."""
    late_s = 0.004 * SHAPES[shape](np.random.default_rng(3), 3000)
    assert listened(500.0, 10, stamps_of(3000, 0.02, late_s))[0].lost_samples_total == 0


def test_the_jitter_that_was_taken_for_530_lost_samples() -> None:
    """500 Hz, frames of 10, late by 3 ms on average, a minute: no sample lost, no gap."""
    late_s = np.random.default_rng(1).exponential(0.003, 3000)
    clock, _ = listened(500.0, 10, stamps_of(3000, 0.02, late_s))
    assert (clock.lost_samples_total, clock.gaps_total) == (0, 0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("fs_hz", [100.0, 200.0, 250.0, 256.0])
def test_losses_are_exact_where_a_clock_has_coarse_ticks(fs_hz: float, seed: int) -> None:
    """`millis()` of a board whose samples jitter by 0.1 ms: a tick hides no sample, once it has been seen for 2 s."""
    rng = np.random.default_rng(seed)
    numbers, size = np.arange(round(60 * fs_hz)), round(fs_hz / 5)
    taken_s = numbers / fs_hz * (1 + 5e-5) + rng.normal(0.0, 1e-4, len(numbers))
    stamps = BEGUN_NS + (taken_s * 1e3).astype(np.int64) * 1_000_000
    for lost in (0, 100):
        kept = np.delete(numbers, rng.choice(numbers[10 * size : -1], lost, replace=False))
        clock, holes = SampleClock(fs_hz), Holes(fs_hz)
        for at in range(0, len(kept), size):
            part = stamps[kept[at : at + size]]
            whole = Chunk(("x",), np.zeros((len(part), 1)), int(part[-1]), int(part[-1]))
            for chunk in holes.cut(whole, part):
                clock.place(chunk)
        assert clock.lost_samples_total == lost


def test_a_lost_frame_is_told_within_half_a_second() -> None:
    """The same stream with one frame lost: its gap is told at most 25 frames later."""
    late_s = np.random.default_rng(1).exponential(0.003, 1200)
    _, placed = listened(500.0, 10, stamps_of(1200, 0.02, late_s), frozenset({1000}))
    (told,) = [frame for frame, timed in enumerate(placed) if timed.break_ is Break.GAP]
    assert 1000 <= told <= 1025
    assert placed[told].lost == 10


def test_a_long_hole_is_told_with_the_frame_after_it() -> None:
    """Seconds without a frame are told at once however stamps jitter, so that nobody draws a line across them."""
    late_s = np.random.default_rng(1).exponential(0.003, 1200)
    _, placed = listened(500.0, 10, stamps_of(1200, 0.02, late_s), frozenset(range(800, 1000)))
    assert placed[800].break_ is Break.GAP
    assert sum(timed.lost for timed in placed) == 2000
    assert placed[800].times_ns[0] - placed[799].times_ns[-1] > 3.9e9


def test_frames_that_were_held_up_have_lost_nothing() -> None:
    """A device that is late with three frames now and then and catches up is believed so from its second time on."""
    frames = 3000
    late = np.random.default_rng(1).uniform(0.0, 0.3, frames)
    for begun in range(300, frames, 200):
        late[begun : begun + 3] += [3.0, 2.0, 1.0]
    clock, placed = listened(500.0, 10, stamps_of(frames, 0.02, late * 0.02))
    assert sum(timed.lost for timed in placed[400:]) == 0
    assert clock.lost_samples_total <= 30


@pytest.mark.parametrize("share", [0.02, 0.1])
def test_a_device_that_stalls_and_catches_up_spoils_neither_the_rate_nor_later_counts(share: float) -> None:
    """60 frames late and then sent at once: what was told of the stall stays all that is wrong, for good."""
    late = np.random.default_rng(1).exponential(share, 3000)
    late[1000:1060] = np.arange(60, 0, -1)
    clock, placed = listened(500.0, 10, stamps_of(3000, 0.02, late * 0.02), frozenset({1400, *range(1800, 1803)}))
    assert sum(timed.lost for timed in placed[:1300]) == 600
    assert sum(timed.lost for timed in placed[1300:]) == 40
    assert clock.fs_hz == pytest.approx(500.0, rel=0.002)


def test_a_wrong_rate_that_makes_whole_samples_is_learnt() -> None:
    """Declared 130 Hz, truly 117: each frame of 36 takes 4 samples longer, which is no loss once eight have."""
    stamps = stamps_of(300, 36 / 117, np.zeros(300))
    clock, placed = listened(130.0, 36, stamps, frozenset({200}))
    assert [timed.lost for timed in placed[9:] if timed.lost] == [36]
    assert clock.fs_hz == pytest.approx(117.0, rel=1e-4)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_frame_lost_before_the_rate_is_known_is_counted(shape: str) -> None:
    """250 Hz declared, 259 true: one lost of the first seventy frames is counted 19 of 20 times, and no other is."""
    counted = []
    for seed in range(10):
        late_s = 0.1 * 10 / 259.0 * SHAPES[shape](np.random.default_rng(seed), 300)
        stamps = stamps_of(300, 10 / 259.0, late_s)
        assert listened(250.0, 10, stamps)[0].lost_samples_total == 0
        counted += [listened(250.0, 10, stamps, frozenset({k}))[0].lost_samples_total == 10 for k in (2, 9, 33, 70)]
    assert np.mean(counted) >= 0.95


@pytest.mark.parametrize("earliest", [4, 30])
def test_a_cut_link_is_one_hole_of_the_right_length(earliest: int) -> None:
    """Exact stamps, frames of 20 to 64 samples, 0.38 % off the declared rate: what a cut took is told once, exactly."""
    fs_hz = 52.0 * 0.9962
    for seed in range(150):
        rng = np.random.default_rng(seed)
        cut, missing = int(rng.integers(earliest, 2 * earliest)), int(rng.integers(200, 320))
        sizes = rng.integers(20, 65, cut + 30)
        ends = np.cumsum(sizes) + np.where(np.arange(len(sizes)) < cut, 0, missing)
        clock = SampleClock(52.0)
        stamps = BEGUN_NS + np.rint(ends / fs_hz * 1e9).astype(np.int64)
        chunks = [Chunk(("x",), np.zeros((n, 1)), int(at), int(at)) for n, at in zip(sizes, stamps, strict=True)]
        told = [(frame, lost) for frame, chunk in enumerate(chunks) if (lost := clock.place(chunk).lost)]
        assert (told, clock.gaps_total) == ([(cut, missing)], 1), seed


@pytest.mark.parametrize("at_frame", [31, 60, 120])
def test_from_the_thirtieth_frame_on_a_tenth_of_a_frame_is_missed(at_frame: int) -> None:
    """Exact stamps, 0.38 % off the declared rate: five samples of 64 that are missing are told where they are."""
    ends = np.cumsum(np.full(140, 64)) + np.where(np.arange(140) < at_frame, 0, 5)
    stamps = BEGUN_NS + np.rint(ends / (52.0 * 0.9962) * 1e9).astype(np.int64)
    _, placed = listened(52.0, 64, stamps)
    assert [(frame, timed.lost) for frame, timed in enumerate(placed) if timed.lost] == [(at_frame, 5)]
