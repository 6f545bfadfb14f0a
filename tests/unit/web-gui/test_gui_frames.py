"""The binary frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from web_gui.columns import Columns
from web_gui.frames import Frame, LanePart, decode, encode
from web_gui.marks import MARK

BASE = 1_700_000_000 * 10**9
ONE = np.array([(BASE, BASE, 0, -1, np.nan, np.nan, False)], MARK)


@st.composite
def lanes(draw):
    """Any lane, with times in whole microseconds."""
    n, channels = draw(st.integers(0, 20)), draw(st.integers(1, 4))
    micros = st.integers(-(2**31) + 1, 2**31 - 1)
    times = BASE + np.array(draw(st.lists(micros, min_size=n, max_size=n)), np.int64) * 1000
    low = np.random.default_rng(n).standard_normal((n, channels)).astype(np.float32)
    marks = draw(st.booleans())
    gaps = [(BASE + 1000 * a, BASE + 1000 * b) for a, b in draw(st.lists(st.tuples(micros, micros), max_size=3))]
    found = draw(st.lists(st.tuples(micros, micros, st.integers(0, 9), st.integers(-1, 300)), max_size=3))
    rows = np.array([(BASE + 1000 * a, BASE + 1000 * b, kind, c, 0.5, np.nan, False) for a, b, kind, c in found], MARK)
    return LanePart(
        draw(st.integers(0, 65535)),
        draw(st.booleans()),
        BASE + 1000 * draw(micros),
        Columns(times, low, low + 1),
        gaps if marks else None,
        rows if marks else None,
    )


def test_a_small_signal_on_a_huge_offset_survives_the_wire():
    """1.7e9 ± 50 and, beside a hole and an outlier, -3.2e12 ± 1: each channel is sent around its own middle."""
    low = np.array([1.7e9, -3.2e12]) + np.outer(np.sin(np.arange(50)), [50.0, 1.0])
    low[7], low[9, 0] = np.nan, 0.0
    line = Columns(BASE + np.arange(50) * 1_000_000, low, low + 0.5)
    found = decode(encode(Frame(1, 2, BASE, BASE, [LanePart(0, True, BASE, line)]))).lanes[0].line
    assert found.low[9, 0] == pytest.approx(0.0, abs=128)
    found.low[9, 0] = found.high[9, 0] = np.nan
    low[9, 0] = np.nan
    assert np.allclose(found.low, low, rtol=0, atol=1e-3, equal_nan=True)
    assert np.allclose(found.high, low + 0.5, rtol=0, atol=1e-3, equal_nan=True)


def test_a_channel_without_a_number_leaves_the_others_their_shape():
    """One electrode is off and says NaN all the time: what lies around 1.7e9 beside it is no flat line."""
    low = np.column_stack((1.7e9 + 50 * np.sin(np.arange(50)), np.full(50, np.nan)))
    line = Columns(BASE + np.arange(50) * 1_000_000, low, low)
    found = decode(encode(Frame(1, 2, BASE, BASE, [LanePart(0, True, BASE, line)]))).lanes[0].line
    assert np.allclose(found.low, low, rtol=0, atol=1e-3, equal_nan=True)


@given(st.lists(lanes(), max_size=4), st.integers(0, 2**32 - 1))
def test_decode_gives_what_encode_was_given(parts, number):
    """Whole microseconds, minima, maxima, holes and marks survive the wire."""
    found = decode(encode(Frame(7, number, BASE + 5_000_000, BASE, parts)))
    assert (found.view, found.number, found.now_ns, found.base_ns) == (7, number, BASE + 5_000_000, BASE)
    for got, sent in zip(found.lanes, parts, strict=True):
        assert (got.index, got.full, got.from_ns) == (sent.index, sent.full, sent.from_ns)
        assert np.array_equal(got.line.times_ns, sent.line.times_ns)
        assert np.array_equal(got.line.low, sent.line.low)
        assert np.array_equal(got.line.high, sent.line.high)
        assert got.gaps_ns == sent.gaps_ns
        assert (got.marks is None) == (sent.marks is None)
        if sent.marks is not None:
            assert got.marks.tobytes() == sent.marks.tobytes()


def test_every_block_begins_at_a_multiple_of_four_bytes():
    """The page reads with typed arrays, which need that."""
    line = Columns(np.arange(3) * 1000 + BASE, np.zeros((3, 1), np.float32), np.zeros((3, 1), np.float32))
    data = encode(Frame(1, 1, BASE, BASE, [LanePart(0, True, BASE, line, [(BASE, BASE)], ONE)] * 2))
    assert len(data) == 32 + 2 * (16 + 12 + 12 + 12 + 8 + 20)


@given(st.binary(max_size=200))
def test_anything_that_is_no_frame_is_refused(data):
    """Other bytes raise ValueError and nothing else."""
    with pytest.raises(ValueError, match=r"frame|lane|bytes"):
        decode(data)


@given(st.integers(0, 90))
def test_a_frame_that_is_cut_off_is_refused(keep):
    """A truncated frame never decodes."""
    line = Columns(np.arange(3) * 1000 + BASE, np.zeros((3, 1), np.float32), np.zeros((3, 1), np.float32))
    data = encode(Frame(1, 1, BASE, BASE, [LanePart(0, True, BASE, line, [(BASE, BASE)], ONE)]))
    with pytest.raises(ValueError, match=r"frame|lane|bytes"):
        decode(data[:keep])
