"""Sample times after a session's common start: a replay from there gets those of the live run."""

import numpy as np
from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import SampleClock

N, PERIOD_NS = 50, 9_970_000  # declared 100 Hz, truly 100.3 Hz


def frame(number: int, device: bool = True) -> Chunk:
    end_ns = 10**15 + number * N * PERIOD_NS
    jitter_ns = (number * 7919) % 13 * 1_000_000
    return Chunk(("ecg",), np.zeros((N, 1)), end_ns if device else None, 10**18 + number * N * PERIOD_NS + jitter_ns)


def cut_after(history: list[Chunk]) -> SampleClock:
    clock = SampleClock(100.0)
    for chunk in history:
        clock.place(chunk)
    clock.begin_segment()
    return clock


def test_with_device_time_only_the_message_before_the_cut_matters():
    """A minute or one message of history: the same times after the cut, over a gap too, and no seam at the cut."""
    live, replayed = cut_after([frame(k) for k in range(1, 121)]), cut_after([frame(120)])
    for number in (121, 122, 123, 130, 131):
        one, other = live.place(frame(number)), replayed.place(frame(number))
        assert np.array_equal(one.times_ns, other.times_ns)
        assert one.break_ is other.break_ is (Break.GAP if number == 130 else None)
        assert one.lost == other.lost


def test_without_device_time_no_history_matters():
    """The line through the receipts starts afresh at the cut, so what was heard before it changes nothing."""
    live, replayed = cut_after([frame(k, device=False) for k in range(1, 121)]), cut_after([])
    for number in range(121, 180):
        one, other = live.place(frame(number, device=False)), replayed.place(frame(number, device=False))
        assert np.array_equal(one.times_ns, other.times_ns)
        assert one.break_ is other.break_
