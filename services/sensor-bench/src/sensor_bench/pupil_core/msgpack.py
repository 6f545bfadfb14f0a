"""What Pupil Capture says, as MessagePack: the few kinds of values that occur in it (msgpack specification)."""

import struct
from collections.abc import Mapping
from typing import Any


class Packed(bytes):
    """A value that is packed already; taken as it is."""


def pack(value: Any) -> bytes:
    """Return the bytes of a value. Raises TypeError for a kind that Capture does not send."""
    if isinstance(value, Packed):
        return bytes(value)
    if value is None or isinstance(value, bool):
        return {None: b"\xc0", False: b"\xc2", True: b"\xc3"}[value]
    if isinstance(value, float):
        return b"\xcb" + struct.pack(">d", value)
    if isinstance(value, int):
        return bytes([value]) if 0 <= value < 0x80 else b"\xd3" + struct.pack(">q", value)
    if isinstance(value, str):
        octets = value.encode()
        return _head(len(octets), 0xA0, 32, b"\xd9" if len(octets) < 256 else b"\xda") + octets
    if isinstance(value, list | tuple):
        return _head(len(value), 0x90, 16, b"\xdc") + b"".join(map(pack, value))
    if isinstance(value, Mapping):
        return _head(len(value), 0x80, 16, b"\xde") + b"".join(pack(k) + pack(v) for k, v in value.items())
    raise TypeError(f"{type(value).__name__} is nothing that Pupil Capture sends")


def _head(length: int, short: int, below: int, longer: bytes) -> bytes:
    """Return the first bytes of something that has a length."""
    if length < below:
        return bytes([short | length])
    return longer + struct.pack(">B" if longer == b"\xd9" else ">H", length)
