"""Bytes of a SkinBox, an imaginary box on a serial port that measures skin conductance; no I/O, no clock.

A frame is `A5 kind length content checksum`: length counts the content, the checksum is the sum of kind, length and
content modulo 256. Numbers are little endian. Times are 16 bits of milliseconds since power on: they wrap after 65.5 s.

| kind | content | when |
|---|---|---|
| `I` | rate u16 in Hz (0 = it samples nothing), serial number in ASCII | after the command `i` |
| `D` | per sample: time u16, conductance u16 in 0.01 uS | after the command `s` |
| `L` | mean conductance of the last second, u16 in 0.01 uS | after the command `s`, each second |
| `P` | time u16 at which the command `p` came | after the command `p` |
"""

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

START, BITS, TICKS_HZ = 0xA5, 16, 1000
MICROSIEMENS = 0.01


class Info(NamedTuple):
    """What the box says of itself."""

    rate_hz: int
    serial_number: str


class Data(NamedTuple):
    """Samples: times shape (n,), still wrapping, in ms; conductance shape (n, 1) in uS."""

    times_ms: NDArray[np.int64]
    conductance_us: NDArray[np.float64]


class Level(NamedTuple):
    """The box's own mean of the last second."""

    conductance_us: float


class Pong(NamedTuple):
    """The box's time, still wrapping, when it was asked."""

    time_ms: int


Message = Info | Data | Level | Pong


def take(buffer: bytearray) -> Iterator[Message | FrameError]:
    """Take every whole frame out of the buffer; what is no frame becomes the error that says why."""
    while START in buffer:
        if noise := buffer[: buffer.index(START)]:
            del buffer[: len(noise)]
            yield FrameError(f"{len(noise)} bytes that belong to no frame ({noise[:8].hex()})")
        if len(buffer) < 3 or len(buffer) < 4 + buffer[2]:
            return
        frame = bytes(buffer[: 4 + buffer[2]])
        if sum(frame[1:-1]) % 256 == frame[-1]:
            del buffer[: len(frame)]
            yield decode(chr(frame[1]), frame[3:-1])
        else:  # no frame begins here: the next start may lie inside what looked like one
            del buffer[0]
            yield FrameError(f"wrong checksum ({frame[:8].hex()})")


def decode(kind: str, content: bytes) -> Message | FrameError:
    """Return what a frame says, or the error where its content does not fit its kind."""
    if kind == "I" and len(content) > 2:
        return Info(int.from_bytes(content[:2], "little"), content[2:].decode("ascii", "replace"))
    if kind == "D" and content and len(content) % 4 == 0:
        times, values = np.frombuffer(content, "<u2").reshape(-1, 2).T.astype(np.int64)
        return Data(times, values[:, None].astype(np.float64) * MICROSIEMENS)
    if kind == "L" and len(content) == 2:
        return Level(struct.unpack("<H", content)[0] * MICROSIEMENS)
    if kind == "P" and len(content) == 2:
        return Pong(*struct.unpack("<H", content))
    return FrameError(f"frame {kind!r} of {len(content)} bytes")
