"""The header stamp in serialised bytes."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sense4hri.cdr import with_header_ns

ENDIANS = {"<": b"\x00\x01\x00\x00", ">": b"\x00\x00\x00\x00"}
LOG_NS = 1_795_224_864_735_770_223


@pytest.mark.parametrize("endian", ENDIANS)
@given(rest=st.binary(max_size=40))
def test_a_zero_stamp_becomes_the_log_time(endian, rest):
    """sec and nanosec are filled in the message's own byte order, and nothing else changes."""
    out = with_header_ns(ENDIANS[endian] + bytes(8) + rest, LOG_NS)
    assert struct.unpack(f"{endian}iI", out[4:12]) == (LOG_NS // 10**9, LOG_NS % 10**9)
    assert (out[:4], out[12:]) == (ENDIANS[endian], rest)


@given(sec=st.integers(-(2**31), 2**31 - 1), nanosec=st.integers(1, 2**32 - 1))
def test_a_stamp_that_is_there_stays(sec, nanosec):
    """A message with a stamp goes out byte for byte as it was recorded."""
    cdr = ENDIANS["<"] + struct.pack("<iI", sec, nanosec) + b"rest"
    assert with_header_ns(cdr, LOG_NS) == cdr


@pytest.mark.parametrize("cdr", [b"", b"\x00\x01\x00\x00", bytes(11), b"\x00\x07\x00\x00" + bytes(8), b"\x01" * 20])
def test_what_is_no_plain_cdr_stays(cdr):
    """Too short, or in another encoding: nothing is written into it."""
    assert with_header_ns(cdr, LOG_NS) == cdr


def test_a_log_time_that_no_stamp_can_hold_stays_out():
    """Log times beyond 2038 or before 1970 do not wrap around."""
    cdr = ENDIANS["<"] + bytes(8)
    assert with_header_ns(cdr, 1 << 62) == cdr
    assert with_header_ns(cdr, -1) == cdr
