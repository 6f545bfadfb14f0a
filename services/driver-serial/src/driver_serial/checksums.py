"""The check that ends a frame: number of bits, and the value of some bytes."""

import binascii
from collections.abc import Callable
from typing import NamedTuple


class Checksum(NamedTuple):
    """size: in bytes; of: its value over the frame's bytes before it, without those that mark its beginning."""

    size: int
    of: Callable[[bytes], int]


def _xor(octets: bytes) -> int:
    value = 0
    for octet in octets:
        value ^= octet
    return value


def _crc8(octets: bytes) -> int:
    """x^8 + x^2 + x + 1, from 0."""
    value = 0
    for octet in octets:
        value ^= octet
        for _ in range(8):
            value = (value << 1 ^ 0x107) if value & 0x80 else value << 1
    return value


CHECKSUMS = {
    "none": Checksum(0, lambda octets: 0),
    "sum8": Checksum(1, lambda octets: sum(octets) & 0xFF),
    "xor8": Checksum(1, _xor),
    "nmea": Checksum(1, lambda octets: _xor(octets[octets[:1] in (b"$", b"!") :])),  # NMEA 0183
    "crc8": Checksum(1, _crc8),
    "crc16": Checksum(2, lambda octets: binascii.crc_hqx(octets, 0xFFFF)),  # CCITT-FALSE
}
