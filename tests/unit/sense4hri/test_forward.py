"""Stamps that go back: what is left out, what is counted, and what is a device that started afresh."""

import numpy as np
from sense4hri.chunk import Break, TimedChunk
from sense4hri.forward import Forward


def chunk(*times_s, break_=None):
    times_ns = np.array([round(at_s * 1e9) for at_s in times_s], np.int64)
    return TimedChunk(("x",), np.zeros((len(times_s), 1)), times_ns, int(times_ns[-1]), 0, break_, 0)


def test_late_samples_are_counted_and_left_out():
    """Of a frame that begins before the newest sample the rest passes without a break; late ones are counted."""
    forward = Forward(0.25)
    first = chunk(1.0, 1.1, break_=Break.FIRST)
    assert forward.take(first) is first
    assert forward.take(chunk(1.05, 1.1, break_=Break.DUPLICATE)) is None
    rest = forward.take(chunk(1.0, 1.1, 1.2, break_=Break.RESET))
    assert rest is not None
    assert rest.times_ns.tolist() == [1_200_000_000]
    assert rest.break_ is None
    assert (forward.late(), forward.late()) == (4, 0)


def test_of_samples_that_share_a_time_the_first_is_taken():
    """Nothing after it ever divides by a time of 0 between two samples; the rest are counted as late."""
    forward = Forward(0.25)
    taken = forward.take(chunk(1.0, 1.0, 1.1, 1.1, 1.1, break_=Break.FIRST))
    assert taken is not None
    assert taken.times_ns.tolist() == [1_000_000_000, 1_100_000_000]
    assert taken.samples.shape == (2, 1)
    assert forward.late() == 3


def test_far_back_is_a_clock_that_began_afresh():
    """Stamps that go back by more than a second pass as they are."""
    forward = Forward(0.25)
    forward.take(chunk(100.0, break_=Break.FIRST))
    again = chunk(40.0, break_=Break.RESET)
    assert forward.take(again) is again
    assert forward.late() == 0


def test_a_time_without_samples_is_a_gap():
    """Beyond away_s the samples after it do not continue those before; up to it they do."""
    forward = Forward(0.25)
    forward.take(chunk(1.0, break_=Break.FIRST))
    near, far = forward.take(chunk(1.2)), forward.take(chunk(1.5))
    assert near is not None
    assert far is not None
    assert (near.break_, far.break_) == (None, Break.GAP)
