"""Bytes of a Zephyr BioHarness 3: messages in and out, and what a packet says; no I/O, no clock.

A message: 02, number, length, content, CRC-8 of the content, and 03 at its end (06 acknowledged, 15 refused). Numbers
are little endian. A packet's content begins with its sequence number and the date and time of its first sample.
"""

import datetime
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

START, END, ACCEPTED, REFUSED = 0x02, 0x03, 0x06, 0x15
LONGEST, FRAME = 128, 5  # bytes of a content, and around it
POLYNOMIAL = 0x8C
EPOCH = datetime.date(1970, 1, 1).toordinal()
UNSET = bytes(4)  # the date of a calendar that nobody has set
DAY_MS, MS_NS = 86_400_000, 1_000_000
BITS, MIDDLE = 10, 512
COUNTS_PER_G, STANDARD_GRAVITY = 20.75, 9.80665
NO_VALUE = 0xFFFF
Floats = NDArray[np.float64]


class Kind(IntEnum):
    """Numbers of messages: packets, and what the host sends."""

    SERIAL_NUMBER = 0x0B
    SET_BREATHING = 0x15
    SET_ECG = 0x16
    SET_RR = 0x19
    SET_ACCELEROMETER = 0x1E
    BREATHING = 0x21
    ECG = 0x22
    LIFESIGN = 0x23
    RR = 0x24
    ACCELEROMETER = 0x25
    SUMMARY = 0x2B
    SET_SUMMARY = 0xBD


class Shape(NamedTuple):
    """Of the samples of a packet: how many in each, channels, and their rate in Hz."""

    samples: int
    channels: int
    rate_hz: float


SHAPES = {
    Kind.BREATHING: Shape(18, 1, 1000 / 56),
    Kind.ECG: Shape(63, 1, 250.0),
    Kind.ACCELEROMETER: Shape(20, 3, 50.0),
}
RR_SAMPLES, HEAD = 18, 9
STATUS = 47  # of a summary, behind its time: what is unreliable, how well it is worn


class Message(NamedTuple):
    """One whole message; end: 03, 06 or 15."""

    kind: int
    content: bytes
    end: int = END


def crc8(octets: bytes) -> int:
    """Return the checksum of a content."""
    crc = 0
    for octet in octets:
        crc = _TABLE[crc ^ octet]
    return crc


def _shifted(crc: int) -> int:
    for _ in range(8):
        crc = crc >> 1 ^ (POLYNOMIAL if crc & 1 else 0)
    return crc


_TABLE = tuple(_shifted(octet) for octet in range(256))


def encode(kind: int, content: bytes = b"") -> bytes:
    """Return a message as the host sends it."""
    return bytes([START, kind, len(content)]) + content + bytes([crc8(content), END])


def take(buffer: bytearray) -> Iterator[Message | FrameError]:
    """Take every whole message out of the buffer; bytes that belong to none become the error that says so."""
    at = noise = 0
    while at < len(buffer):
        size = _size(buffer, at)
        if size is None:
            break
        if size and noise:
            yield FrameError(f"{noise} bytes that belong to no message ({bytes(buffer[at - noise : at][:8]).hex()})")
            noise = 0
        if size:
            yield Message(buffer[at + 1], bytes(buffer[at + 3 : at + size - 2]), buffer[at + size - 1])
        noise += not size
        at += size or 1
    if noise:
        yield FrameError(f"{noise} bytes that belong to no message ({bytes(buffer[at - noise : at][:8]).hex()})")
    del buffer[:at]


def _size(buffer: bytearray, at: int) -> int | None:
    """Return how long the message is that begins here, 0 where none does, None while that cannot be said."""
    if buffer[at] != START:
        return 0
    if at + 3 > len(buffer):
        return None
    size = buffer[at + 2] + FRAME
    if size > LONGEST + FRAME:
        return 0
    if at + size > len(buffer):
        return None
    whole = buffer[at + size - 1] in (END, ACCEPTED, REFUSED)
    return size if whole and crc8(bytes(buffer[at + 3 : at + size - 2])) == buffer[at + size - 2] else 0


class Packet(NamedTuple):
    """sequence: 0 to 255; first_ns: device time of the first sample, its own calendar as ns since 1970."""

    sequence: int
    first_ns: int
    octets: bytes


def decode_head(content: bytes) -> Packet:
    """Return number and time of a packet. Raises FrameError where the date cannot be.

    A calendar that was never set says 0-0-0: its time of day is then that of 1970-01-01.
    """
    year, month, day = int.from_bytes(content[1:3], "little"), content[3], content[4]
    of_day_ms = int.from_bytes(content[5:HEAD], "little")
    try:
        days = datetime.date(year, month, day).toordinal() - EPOCH if content[1:5] != UNSET else 0
    except ValueError as err:
        raise FrameError(f"packet of {year}-{month}-{day}: {err}") from err
    if of_day_ms >= DAY_MS:
        raise FrameError(f"packet at {of_day_ms} ms of the day")
    return Packet(content[0], (days * DAY_MS + of_day_ms) * MS_NS, content[HEAD:])


def decode_samples(kind: Kind, octets: bytes) -> Floats:
    """Return samples of 10 bits, shape (n, channels): acceleration in m/s^2, all else in counts as they are.

    Packed from the lowest bit of the first byte on. Raises FrameError for another number of bytes.
    """
    shape = SHAPES[kind]
    wanted = -(-shape.samples * shape.channels * BITS // 8)
    if len(octets) != wanted:
        raise FrameError(f"{kind.name} packet with {len(octets)} bytes of samples, must be {wanted}")
    bits = np.unpackbits(np.frombuffer(octets, np.uint8), bitorder="little")[: shape.samples * shape.channels * BITS]
    counts = (bits.reshape(-1, BITS) @ (1 << np.arange(BITS))).astype(np.float64).reshape(-1, shape.channels)
    return (counts - MIDDLE) / COUNTS_PER_G * STANDARD_GRAVITY if kind is Kind.ACCELEROMETER else counts


def decode_rr(octets: bytes) -> tuple[int, ...]:
    """Return the R-R interval every 56 ms, in ms with a sign that turns at each new beat. Raises FrameError."""
    if len(octets) != 2 * RR_SAMPLES:
        raise FrameError(f"R-R packet with {len(octets)} bytes of values, must be {2 * RR_SAMPLES}")
    return tuple(np.frombuffer(octets, "<i2").tolist())


class Summary(NamedTuple):
    """What the device has computed of the last second; None = it says that it knows none, or that it is unreliable.

    contact: 0 not worn .. 1 worn well, in thirds.
    """

    heart_rate_bpm: float | None
    respiration_rate_per_min: float | None
    skin_temperature_degc: float | None
    posture_deg: float | None
    activity_g: float | None
    peak_acceleration_g: float | None
    battery_percent: float | None
    contact: float


def decode_summary(octets: bytes) -> Summary:
    """Return the values of a summary; octets: its content behind the time. Raises FrameError where it is too short."""
    if len(octets) <= STATUS:
        raise FrameError(f"summary with {len(octets)} bytes")

    def word(at: int, scale: float, signed: bool = False) -> float:
        return int.from_bytes(octets[at : at + 2], "little", signed=signed) * scale

    status = octets[STATUS]
    known = [not status & bit for bit in (0x80, 0x40, 0x20, 0x10)]  # posture, skin, breathing, heart
    return Summary(
        word(1, 1.0) if known[3] and word(1, 1.0) not in (0, NO_VALUE) else None,
        word(3, 0.1) if known[2] and word(3, 1.0) != NO_VALUE else None,
        word(5, 0.1, True) if known[1] and word(5, 1.0, True) != -0x8000 else None,
        word(7, 1.0, True) if known[0] and word(7, 1.0, True) != -0x8000 else None,
        word(9, 0.01) if word(9, 1.0) != NO_VALUE else None,
        word(11, 0.01) if word(11, 1.0) != NO_VALUE else None,
        float(octets[15] & 0x7F) if octets[15] & 0x7F <= 100 else None,
        1 - (status & 3) / 3,
    )
