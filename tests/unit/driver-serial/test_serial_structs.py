"""Structs without a checksum: where one begins, and when it came."""

import struct
from typing import Literal

import numpy as np
import pytest
from driver_serial.checksums import CHECKSUMS
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


@pytest.mark.parametrize("rate_hz", [5, 0])
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


@pytest.mark.parametrize("checksum", ["none", "sum8"])
@pytest.mark.parametrize("size", [1, 7, 1000])
def test_a_spoilt_struct_is_one_error(checksum: str, size: int) -> None:
    """However it is read, also with a beginning inside; two that follow each other are two."""
    sealed = CHECKSUMS[checksum]
    text = f"format: struct\nbegins: a5 5a\nchecksum: {checksum}\nfields: [gsr u16, ppg u32]\n" + STREAMS

    def frame(number: int, ppg: int = 7) -> bytes:
        content = struct.pack("<HI", number, ppg)
        return b"\xa5\x5a" + content + sealed.of(content).to_bytes(sealed.size, "little")

    def told(*spoilt: bytes) -> int:
        octets = b"".join([*map(frame, range(100, 110)), *spoilt, *map(frame, range(110, 122))])
        pieces = [(1.0, octets[at : at + size]) for at in range(0, len(octets), size)]
        items = played(text, pieces)
        values = np.concatenate([item.chunk.samples[:, 0] for item in of(items, "eda")])
        assert np.rint(values * 100).tolist()[:20] == [*range(100, 120)]
        return sum(isinstance(item, FrameError) for item in items)

    assert told() == 0
    assert told(frame(500)[:-1]) == 1
    assert told(frame(500, 0x5AA5)[:-1]) == 1
    assert told(frame(500)[:5]) == 1
    if sealed.size:
        assert told(frame(500)[:-1] + b"\xff", frame(501)[:-1] + b"\xff") == 2
        assert told(b"\x00" + frame(500)[1:]) == 1


@pytest.mark.parametrize("rest", [1, 7, 10])
def test_the_rest_of_a_struct_is_no_error(rest: int) -> None:
    """A driver that connects in the middle of a frame sees its end first; noise longer than that is told."""
    text = "format: struct\nbegins: a5 5a\nchecksum: sum8\nfields: [gsr u16, ppg u32]\n" + STREAMS
    frame = bytes.fromhex("a55a 6400 07000000 6b")
    items = played(text, [(1.0, (frame * 3)[-rest:] + frame * 20)])
    assert sum(len(item.chunk.samples) for item in of(items, "eda")) == 20 + (rest == 10)
    assert [str(item) for item in items if isinstance(item, FrameError)] == []
    (told, *_) = played(text, [(1.0, bytes(12) + frame * 20)])
    assert isinstance(told, FrameError)


def test_one_byte_is_no_beginning_of_a_struct_without_checksum() -> None:
    """Every 256th byte is that byte by chance: refused, with what to do."""
    with pytest.raises(ValueError, match="begins is 'a5': without a checksum one byte is too little"):
        parse("format: struct\nbegins: a5\nfields: [gsr u16, ppg u32]\n" + STREAMS)


@pytest.mark.parametrize("form", ["struct", "cobs"])
@pytest.mark.parametrize("order", ["little", "big"])
def test_numbers_of_three_bytes_are_numbers(form: str, order: Literal["little", "big"]) -> None:
    """As converters of 24 bits send them, with a sign or without; a time of three bytes wraps; `_` is nobody's."""
    begins = "begins: a5 5a\n" if form == "struct" else ""
    text = f"format: {form}\n{begins}byte_order: {order}\nchecksum: crc16\n" + (
        "fields: [t u24, _ u24, gsr i24, ppg u24]\ntime: {field: t, unit: us, bits: 24}\n" + STREAMS
    )
    values = [-(2**23), -1, 0, 1, 2**23 - 1] * 4
    frames = []
    for number, value in enumerate(values):
        time_us = (2**24 - 100_000 + number * 20_000) % 2**24
        content = b"".join((each % 2**24).to_bytes(3, order) for each in (time_us, 0xABCDEF, value, number * 800_000))
        sealed = content + CHECKSUMS["crc16"].of(content).to_bytes(2, order)
        frames.append(b"\xa5\x5a" + sealed if form == "struct" else stuffed(sealed))
    items = played(text, [(1.0 + at / 50, each) for at, each in enumerate(frames)])
    assert not [item for item in items if isinstance(item, FrameError)]
    gsr, ppg = (np.concatenate([item.chunk.samples[:, 0] for item in of(items, name)]) for name in ("eda", "ppg"))
    assert np.rint(gsr * 100).tolist() == values
    assert ppg.tolist() == [number * 800_000 for number in range(len(values))]
    times_ns = np.concatenate([item.times_ns for item in of(items, "eda") if item.times_ns is not None])
    assert np.diff(times_ns).tolist() == [20_000_000] * (len(values) - 1)


def stuffed(octets: bytes) -> bytes:
    """COBS, of fewer than 254 bytes, and the zero behind it."""
    return b"".join(bytes([len(part) + 1]) + part for part in octets.split(b"\0")) + b"\0"
