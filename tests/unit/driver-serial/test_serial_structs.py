"""Structs without a checksum: where one begins, and when it came."""

import struct

import numpy as np
import pytest
from driver_serial.description import parse
from sense4hri.errors import FrameError
from sense4hri.stamps import SECOND_NS
from serial_board import BEGUN_NS, STREAMS, of, played


@pytest.mark.parametrize("cut", range(1, 7))
def test_a_struct_without_checksum_is_believed_where_the_next_one_begins_behind_it(cut: int) -> None:
    """Bytes missing from one frame cost that frame; nothing of the next is taken for its values."""
    text = "format: struct\nbegins: a5 5a\nfields: [gsr u16, ppg u32]\n" + STREAMS
    frames = [bytes.fromhex("a55a") + struct.pack("<HI", each, 7) for each in range(100, 112)]
    frames[5] = frames[5][:-cut]
    items = played(text, [(1.0, b"".join(frames))])
    values = np.concatenate([item.chunk.samples[:, 0] for item in of(items, "eda")])
    assert np.rint(values * 100).tolist() == [*range(100, 105), *range(106, 111)]
    assert any(isinstance(item, FrameError) for item in items)


@pytest.mark.parametrize("rate_hz", [10, 0])
def test_a_struct_that_waited_for_the_next_one_has_its_own_receipt(rate_hz: int) -> None:
    """A frame every 100 ms, believed with the one behind it: stamped when it came, not 100 ms later; one at a time."""
    streams = STREAMS.replace("rate_hz: 50", f"rate_hz: {rate_hz}")
    text = "format: struct\nbegins: a5 5a\nfields: [gsr u16, ppg u32]\n" + streams
    frames = [bytes.fromhex("a55a") + struct.pack("<HI", each, 7) for each in range(30)]
    pieces = [(1.0 + at / 10, b"".join(frames[3 * at : 3 * at + 3])) for at in range(3)]
    pieces += [(1.3 + at / 10, frames[9 + at]) for at in range(20)]
    chunks = [item.chunk for item in of(played(text, pieces), "eda")]
    late_s = {round(float(each.samples[-1, 0]) * 100): (each.received_ns - BEGUN_NS) / SECOND_NS for each in chunks}
    assert [late_s[number] for number in range(10, 28)] == pytest.approx(
        [1.3 + (each - 9) / 10 for each in range(10, 28)]
    )
    assert np.all(np.diff([each.received_ns for each in chunks]) > 0)


def test_one_byte_is_no_beginning_of_a_struct_without_checksum() -> None:
    """Every 256th byte is that byte by chance: refused, with what to do."""
    with pytest.raises(ValueError, match="begins is 'a5': without a checksum one byte is too little"):
        parse("format: struct\nbegins: a5\nfields: [gsr u16, ppg u32]\n" + STREAMS)
