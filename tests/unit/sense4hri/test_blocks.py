"""What lies beside a block: which samples belong to it, how long it waits for them, and when it waits no more."""

import numpy as np
import pytest
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import Break, TimedChunk

SECOND_NS, PERIOD_NS = 10**9, 10**8
T0 = 10**15


def timed(first: int, n: int, *, start_ns: int = T0, period_ns: int = PERIOD_NS, break_: Break | None = None):
    """Samples with the numbers first to first + n - 1, each at its number of periods after start_ns."""
    numbers = np.arange(first, first + n)
    times_ns = start_ns + numbers * period_ns
    return TimedChunk(("x",), numbers[:, None].astype(float), times_ns, int(times_ns[-1]), 0, break_, 0)


def beside(block: Block) -> list[int]:
    """The numbers of the samples beside a block."""
    got = block.beside.get("accelerometer")
    return [] if got is None else got.samples[:, 0].astype(int).tolist()


@pytest.fixture
def blocks() -> Blocks:
    """Blocks of one second (10 samples, the first of 11) with acceleration beside them."""
    return Blocks(1.0, beside=["accelerometer"])


def test_blocks_that_wait_are_released_when_the_device_clock_restarts(blocks):
    """Samples before a restart never meet samples after it: what waits for its neighbours goes without them at once."""
    blocks.take(timed(0, 1, break_=Break.FIRST))
    assert blocks.take_beside("accelerometer", timed(0, 5)) == []
    assert blocks.take(timed(1, 14)) == []
    released = blocks.take(timed(0, 3, start_ns=5, break_=Break.RESET))
    assert [(block.hole, len(block.samples), beside(block)) for block in released] == [
        (None, 11, [0, 1, 2, 3, 4]),
        (Hole.CLOCK, 4, []),
    ]
    assert released[0].due


def test_a_gap_alone_releases_nothing(blocks):
    """Behind a hole of the same clock the neighbours are still to come, and are waited for."""
    blocks.take_beside("accelerometer", timed(0, 5))
    blocks.take(timed(0, 15, break_=Break.FIRST))
    assert blocks.take(timed(16, 2, break_=Break.GAP)) == []
    released = blocks.take_beside("accelerometer", timed(5, 10))
    assert [(block.hole, beside(block)) for block in released] == [
        (None, list(range(11))),
        (Hole.CHAIN, list(range(11, 15))),
    ]


def test_a_sample_beside_the_very_end_of_a_block_belongs_to_it_and_no_other_does(blocks):
    """At the time of a block's last sample it is the block's, a nanosecond later the next one's; each comes once."""
    blocks.take(timed(0, 21, break_=Break.FIRST))
    end_ns = T0 + SECOND_NS
    on, after = timed(0, 1, start_ns=end_ns), timed(1, 1, start_ns=end_ns, period_ns=1)
    (first,) = blocks.take_beside("accelerometer", on)
    assert (first.end_ns, beside(first)) == (end_ns, [0])
    assert blocks.take_beside("accelerometer", after) == []
    (second,) = blocks.take_beside("accelerometer", timed(2, 1, start_ns=end_ns, period_ns=SECOND_NS))
    assert beside(second) == [1]


def test_a_chunk_beside_two_blocks_is_parted_at_the_boundary(blocks):
    """However the neighbour's samples are cut, none is lost at a boundary and none comes twice."""
    blocks.take(timed(0, 31, break_=Break.FIRST))
    released = blocks.take_beside("accelerometer", timed(0, 70, period_ns=PERIOD_NS // 2))
    assert [beside(block) for block in released] == [list(range(21)), list(range(21, 41)), list(range(41, 61))]


def test_who_is_silent_too_long_is_waited_for_no_more(blocks):
    """After two seconds of its own samples a block goes without its neighbour, until that comes again."""
    blocks.take(timed(0, 1, break_=Break.FIRST))
    blocks.take_beside("accelerometer", timed(0, 1))
    assert blocks.take(timed(1, 30)) == []
    assert [beside(block) for block in blocks.take(timed(31, 1))] == [[0], [], []]
    blocks.take_beside("accelerometer", timed(31, 1))
    assert blocks.take(timed(32, 10)) == []
