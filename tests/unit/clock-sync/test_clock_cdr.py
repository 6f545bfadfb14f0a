"""Reading stamps from serialised messages."""

import struct

import pytest
from sense4hri.cdr import stamps_ns


@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd", "h10_1234567"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_both_stamps_are_found_behind_a_frame_id_of_any_length(frame_id, order):
    """The string between the stamps is padded to four bytes, in either byte order."""
    text = frame_id.encode() + b"\0"
    message = bytes([0, 1 if order == "<" else 0, 0, 0])
    message += struct.pack(f"{order}iII", 1_700_000_000, 123_456_789, len(text)) + text
    message += b"\0" * (-(len(message) - 4) % 4) + struct.pack(f"{order}iI", 42, 7) + b"\1\0\0\0"
    assert stamps_ns(message) == (1_700_000_000_123_456_789, 42_000_000_007)


def test_a_message_cut_short_is_refused():
    """What ends before the second stamp is an error, not a guess."""
    with pytest.raises(struct.error):
        stamps_ns(bytes([0, 1, 0, 0]) + struct.pack("<iII", 1, 2, 1) + b"\0\0")
