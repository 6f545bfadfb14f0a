"""The codec by itself: short frames of known content, round trips, and everything that must be refused."""

import contextlib
import itertools
import struct

import numpy as np
import pytest
from driver_polar import control, protocol
from driver_polar.control import Op, Setting
from driver_polar.delta import decode_delta
from driver_polar.protocol import Frame, Intervals, Measurement
from hypothesis import given, settings
from hypothesis import strategies as st
from sense4hri.errors import FrameError
from sense4hri.gatt import decode_heart_rate

STAMP = 599_622_173_760_485_265


def framed(measurement: int, frame_type: int, content: bytes, stamp: int = STAMP) -> bytes:
    return struct.pack("<BQB", measurement, stamp, frame_type) + content


def decode(frame: bytes, factor: float = 1.0) -> Frame | Intervals:
    return protocol.decode(protocol.parse(frame), factor)


# Encoders of the test: they share nothing with the decoder.


def pack_bits(values: list[int], width: int) -> bytes:
    whole = 0
    for place, value in enumerate(values):
        whole |= (value & ((1 << width) - 1)) << (place * width)
    return whole.to_bytes(-(-width * len(values) // 8), "little")


def encode_delta(samples: list[list[int]], size: int, cuts: list[int], spare: int) -> bytes:
    """The reference, then blocks of at most cuts[i] samples, each `spare` bits wider than it must be."""
    content = b"".join((value & (1 << 8 * size) - 1).to_bytes(size, "little") for value in samples[0])
    at, turn = 1, 0
    while at < len(samples):
        block = samples[at - 1 : at + cuts[turn % len(cuts)]]
        steps = [
            (b - a + 2**31) % 2**32 - 2**31
            for old, new in itertools.pairwise(block)
            for a, b in zip(old, new, strict=True)
        ]
        width = max((step if step >= 0 else ~step).bit_length() for step in steps)
        width = min(32, width + 1 + spare) if any(steps) or spare else 0
        content += bytes([width, len(block) - 1]) + pack_bits(steps, width)
        at, turn = at + len(block) - 1, turn + 1
    return content


def int_samples(size: int):
    low, high = -(1 << 8 * size - 1), (1 << 8 * size - 1) - 1
    values = st.one_of(st.integers(low, high), st.integers(-2, 2))
    return st.integers(1, 5).flatmap(
        lambda channels: st.lists(st.lists(values, min_size=channels, max_size=channels), min_size=1, max_size=40)
    )


@settings(max_examples=300)
@given(st.sampled_from([1, 2, 3, 4]).flatmap(lambda size: st.tuples(st.just(size), int_samples(size))), st.data())
def test_any_delta_content_round_trips(sized: tuple[int, list[list[int]]], data: st.DataObject) -> None:
    """Whatever the width (0 and 1 included), number of channels and cut into blocks, every integer comes back."""
    size, samples = sized
    cuts = data.draw(st.lists(st.integers(1, 20), min_size=1, max_size=4))
    content = encode_delta(samples, size, cuts, data.draw(st.integers(0, 3)))
    assert decode_delta(content, len(samples[0]), size).tolist() == samples


@settings(max_examples=200)
@given(st.lists(st.integers(-(2**23), 2**23 - 1), min_size=1, max_size=80), st.integers(1, 2**64 - 1))
def test_any_ecg_round_trips(microvolts: list[int], stamp: int) -> None:
    """Microvolts in are microvolts out, and the stamp is the device's own."""
    content = b"".join((value & 0xFFFFFF).to_bytes(3, "little") for value in microvolts)
    frame = decode(framed(0, 0, content, stamp))
    assert isinstance(frame, Frame)
    assert frame.samples[:, 0].tolist() == microvolts
    assert (frame.device_ns, frame.channels, frame.unit) == (stamp, ("ecg",), "uV")


@pytest.mark.parametrize(("frame_type", "size"), [(0, 1), (1, 2), (2, 3)])
@settings(max_examples=60)
@given(st.data())
def test_any_raw_acceleration_keeps_its_milli_g(frame_type: int, size: int, data: st.DataObject) -> None:
    """The whole number of mG the device sent is recovered from the m/s^2."""
    values = st.integers(-(1 << 8 * size - 1), (1 << 8 * size - 1) - 1)
    sent = data.draw(st.lists(st.tuples(values, values, values), min_size=1, max_size=40))
    content = b"".join((v & (1 << 8 * size) - 1).to_bytes(size, "little") for row in sent for v in row)
    frame = decode(framed(2, frame_type, content))
    assert isinstance(frame, Frame)
    assert [tuple(row) for row in np.rint(frame.samples / 9.80665e-3).astype(int).tolist()] == sent


@given(st.binary(max_size=300))
@settings(max_examples=400)
def test_any_bytes_decode_or_raise_frame_error(frame: bytes) -> None:
    """Noise is a FrameError, never another exception."""
    with contextlib.suppress(FrameError):
        assert decode(frame)


@given(st.integers(0, 7), st.integers(0, 255), st.binary(max_size=240))
@settings(max_examples=600)
def test_any_content_decodes_or_raises_frame_error(measurement: int, frame_type: int, content: bytes) -> None:
    """A sound header with any content is a FrameError or whole samples."""
    try:
        result = decode(framed(measurement, frame_type, content))
    except FrameError:
        return
    assert isinstance(result, Intervals) or len(result.samples) > 0


@given(st.binary(max_size=60))
@settings(max_examples=400)
def test_any_control_bytes_parse_or_raise_frame_error(value: bytes) -> None:
    """Noise on the control point and the heart rate characteristic raises FrameError alone."""
    for parse in (
        control.parse_response,
        control.parse_features,
        control.parse_stopped,
        control.parse_settings,
        decode_heart_rate,
    ):
        with contextlib.suppress(FrameError):
            assert parse(value) is not None


def test_one_frame_by_hand() -> None:
    """The head of a real H10 ACC frame (printed in Polar's PMD document) decodes to the bytes' own numbers."""
    frame = decode(bytes.fromhex("02ea54a2428b4552080145ffe4ffb50345ffe4ffb803"))
    assert isinstance(frame, Frame)
    assert frame.device_ns == 599_618_164_814_402_794
    assert frame.samples == pytest.approx(np.array([[-187, -28, 949], [-187, -28, 952]]) * 9.80665e-3)


def test_delta_of_six_bits_by_hand() -> None:
    """A short compressed ACC frame (polar-ble-sdk, AccDataTest) decodes to two samples in mG."""
    frame = decode(bytes.fromhex("02650000000000000081f1ff1400f00306017b0f08"))
    assert isinstance(frame, Frame)
    assert np.rint(frame.samples / 9.80665e-3).tolist() == [[-15, 20, 1008], [-20, 17, 1008]]


def test_widths_zero_and_one() -> None:
    """Width 0 repeats the sample; width 1 is two's complement, so a set bit is -1."""
    assert decode_delta(bytes([7, 0, 0, 3]), 1, 2).ravel().tolist() == [7, 7, 7, 7]
    assert decode_delta(bytes([7, 0, 1, 3, 0b101]), 1, 2).ravel().tolist() == [7, 6, 6, 5]


def test_pp_intervals() -> None:
    """Rate, interval, error and the three flags of each interval are told apart."""
    rows = bytes([72, 0x3A, 0x03, 10, 0, 0b110]) + bytes([0, 0, 4, 0, 1, 0b101]) + bytes([60, 0xE8, 3, 0, 0, 0])
    intervals = decode(framed(3, 0, rows))
    assert intervals == Intervals(
        STAMP, (72, 0, 60), (826, 1024, 1000), (10, 256, 0), (False, True, False), (True, False, None)
    )


def test_a_sport_id() -> None:
    """PPG type 6 carries no samples, but a number of eight bytes."""
    frame = decode(framed(1, 6, bytes([1, 2, 0, 0, 0, 0, 0, 0])))
    assert isinstance(frame, Frame)
    assert (frame.channels, frame.samples.size) == ((), 0)
    assert [(status.name, status.values.tolist()) for status in frame.status] == [("sport_id", [513])]


def test_zero_device_time_is_no_time() -> None:
    """Older firmware stamps PPI frames with zero; that is passed on as 'no device time'."""
    intervals = decode(framed(3, 0, bytes(6), stamp=0))
    assert intervals.device_ns is None


def test_recording_bits_of_the_first_byte_are_ignored() -> None:
    """Only the lower six bits name the measurement."""
    assert decode(framed(0xC0, 0, bytes(3))).measurement is Measurement.ECG


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (b"", "PMD frame of 0 bytes"),
        (framed(0, 0, b""), "PMD frame of 10 bytes"),
        (framed(0, 0, bytes(4)), "ECG frame type 0 holds 4 bytes, not a whole number of 3-byte samples"),
        (framed(0, 4, bytes(3)), "ECG raw frame type 4 is not supported"),
        (framed(0, 0x80, bytes(3)), "ECG compressed frame type 0 is not supported"),
        (framed(4, 0, bytes(3)), "unknown measurement 4"),
        (framed(11, 0, bytes(3)), "PRESSURE raw frame type 0 is not supported"),
        (framed(3, 0, bytes(7)), "PP_INTERVAL frame type 0 holds 7 bytes"),
        (framed(3, 0x80, bytes(6)), "PP_INTERVAL compressed frame type 0"),
        (framed(2, 0x81, bytes(5)), "shorter than its 6-byte reference sample"),
        (framed(2, 0x81, bytes(6) + b"\x08"), "delta block 1 ends inside its two-byte head"),
        (framed(2, 0x81, bytes(6) + b"\x08\x02" + bytes(5)), "delta block 1 is cut: 6 values of 8 bits in 5 bytes"),
        (framed(2, 0x81, bytes(6) + b"\x08\x01" + bytes(3) + b"\x04\x09"), "delta block 2 is cut"),
        (framed(2, 0x81, bytes(6) + b"\x21\x01" + bytes(99)), "delta block 1 is 33 bits wide"),
    ],
)
def test_undecodable_frames_say_what_came(frame: bytes, message: str) -> None:
    """Every frame that is not whole or not known raises FrameError that names it."""
    with pytest.raises(FrameError, match=message):
        decode(frame)


def test_heart_rate_with_everything() -> None:
    """Wide rate, contact, energy and three unrounded RR intervals in one value."""
    measured = decode_heart_rate(bytes.fromhex("1f2c010a00400341030004"))
    assert (measured.bpm, measured.contact, measured.energy_kj) == (300, True, 10)
    assert measured.rr_ms == (812.5, 813.4765625, 1000.0)


@pytest.mark.parametrize("value", ["", "00", "0100", "0848", "104840", "00484003"])
def test_heart_rate_that_does_not_fit_its_flags(value: str) -> None:
    """Empty, short and odd values, and bytes no flag announces, are refused."""
    with pytest.raises(FrameError, match="does not fit its flags"):
        decode_heart_rate(bytes.fromhex(value))


def test_commands() -> None:
    """Start commands carry the settings in the order they are given (documented bytes)."""
    start = control.command(
        Op.START,
        Measurement.PPG,
        {Setting.SAMPLE_RATE: (55,), Setting.RESOLUTION: (22,), Setting.CHANNELS: (4,)},
    )
    assert start.hex() == "0201000137000101160004" + "0104"
    assert control.command(Op.STOP, Measurement.PP_INTERVAL) == b"\x03\x03"
    factor = control.command(Op.START, Measurement.ECG, {Setting.FACTOR: (0.5,)})
    assert control.parse_settings(factor[2:]) == {Setting.FACTOR: (0.5,)}


@pytest.mark.parametrize("value", ["", "f0", "f00100", "0f0500", "01"])
def test_what_is_no_response(value: str) -> None:
    """Anything short or of another kind is no response."""
    with pytest.raises(FrameError, match="no control point response"):
        control.parse_response(bytes.fromhex(value))


def test_statuses_no_document_names() -> None:
    """An unknown status keeps its number; the four-byte MTU answer is understood."""
    assert control.parse_response(bytes.fromhex("f0020063")).status_name == "status 99"
    assert control.parse_response(bytes.fromhex("f000010a")).status_name == "INVALID_MTU"


def test_unknown_setting_is_refused() -> None:
    """The size of an unknown setting is unknown, so the rest cannot be read."""
    with pytest.raises(FrameError, match="setting at byte 4"):
        control.parse_settings(bytes.fromhex("000182000701ff"))
    assert control.parse_settings(b"") == control.parse_settings(b"\x01") == {}


def test_features_of_later_firmware() -> None:
    """The second byte names SDK mode and its successors; measurement 4 and 8 do not exist."""
    assert control.parse_features(bytes.fromhex("0fff03")) == frozenset(
        {kind for kind in Measurement if kind < 8} | {Measurement.SDK_MODE}
    )
    with pytest.raises(FrameError, match="no list of features"):
        control.parse_features(b"\xf0\x05\x00")
