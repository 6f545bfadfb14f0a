"""What the IMU of a Neon sends, decoded: one protobuf message (proto3) in each packet; no socket, no clock.

    ImuPacket  1: tsNs uint64   2: accelData   3: gyroData   4: rotVecData
    accelData, gyroData  1: x  2: y  3: z  (float)      rotVecData  1: w  2: x  3: y  4: z  (float)

A number that is 0 is not sent, and fields may come in any order. Facts: pupil-labs-realtime-api 1.9 (its source, MIT).
"""

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

from sense4hri.errors import FrameError
from sense4hri.stamps import can_be

VARINT, EIGHT, TEXT, FOUR = 0, 1, 2, 5  # how a field is written
TIME, ACCELERATION, TURN, ROTATION = 1, 2, 3, 4
LONGEST_VARINT = 10
FLOAT = struct.Struct("<f")
STANDARD_GRAVITY, DEGREE_RAD = 9.80665, math.pi / 180
Field = tuple[int, int, bytes]
"""Number; of a varint its value, else 0; of the others their octets."""


class Motion(NamedTuple):
    """One sample, at the phone's UNIX time; m/s^2, rad/s, and the turn from the world to the glasses: w, x, y, z."""

    time_ns: int
    acceleration: tuple[float, ...]
    turn: tuple[float, ...]
    orientation: tuple[float, ...]


def decode_motion(octets: bytes) -> Motion:
    """Return what a packet of the IMU says. Raises FrameError."""
    time_ns, parts = 0, {ACCELERATION: b"", TURN: b"", ROTATION: b""}
    for number, value, content in _fields(octets):
        if number == TIME:
            time_ns = value
        elif number in parts:
            parts[number] = content
    if not time_ns or not can_be(time_ns):
        raise FrameError(f"a packet of the IMU at {time_ns} ns: {octets[:16].hex()}")
    acceleration = tuple(each * STANDARD_GRAVITY for each in _floats(parts[ACCELERATION], 3))
    turn = tuple(each * DEGREE_RAD for each in _floats(parts[TURN], 3))
    return Motion(time_ns, acceleration, turn, _floats(parts[ROTATION], 4))


def _floats(octets: bytes, count: int) -> tuple[float, ...]:
    """Return the first fields of a message as floats; one that is not there is 0."""
    found = [0.0] * count
    for number, _, content in _fields(octets):
        if number <= count and len(content) == FLOAT.size:
            found[number - 1] = FLOAT.unpack(content)[0]
    return tuple(found)


def _fields(octets: bytes) -> Iterator[Field]:
    """Yield the fields of a message. Raises FrameError where it ends within one, or has one of an unknown kind."""
    at = 0
    while at < len(octets):
        key, at = _varint(octets, at)
        number, kind = key >> 3, key & 7
        if kind == VARINT:
            value, at = _varint(octets, at)
            yield number, value, b""
            continue
        if kind == TEXT:
            length, at = _varint(octets, at)
        elif kind in (FOUR, EIGHT):
            length = 4 if kind == FOUR else 8
        else:
            raise FrameError(f"a field of kind {kind} in a packet of the IMU: {octets[:16].hex()}")
        if at + length > len(octets):
            raise FrameError(f"a packet of the IMU ends within a field: {octets[:16].hex()}")
        yield number, 0, octets[at : at + length]
        at += length


def _varint(octets: bytes, at: int) -> tuple[int, int]:
    """Return a number of seven bits in each octet, the lowest first, and where it ends."""
    value = 0
    for place, octet in enumerate(octets[at : at + LONGEST_VARINT]):
        value |= (octet & 0x7F) << 7 * place
        if octet < 0x80:
            return value, at + place + 1
    raise FrameError(f"a packet of the IMU ends within a number: {octets[:16].hex()}")
