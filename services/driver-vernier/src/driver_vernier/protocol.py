"""Bytes of Vernier's Go Direct protocol: commands out, frames in; no I/O, no clock. Layouts: README."""

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

INIT = bytes.fromhex("1A A5 4A 06 49 07 48 08 47 09 46 0A 45 0B 44 0C 43 0D 42 0E 41")
STATUS, SENSOR_INFO, AVAILABLE, DISCONNECT, DEVICE_INFO = b"\x10", b"\x50", b"\x51", b"\x54", b"\x55"
STOP = bytes.fromhex("19 FF 00 FF FF FF FF")
FORCE, RESPIRATION_RATE = 1, 2
"""Numbers of the belt's channels."""
COMMAND, MEASUREMENT, ANSWER = 0x58, 0x20, 0x98
BEGINNINGS = MEASUREMENT, ANSWER
HEADER = 4
"""Bytes: kind of frame, length of it all, counter, checksum."""
WRITE_BYTES = 20
REAL32 = {0x06: (struct.Struct("<HB"), 9), 0x07: (struct.Struct("<IB"), 11)}
"""Measurements of several channels: mask of channels and number of values of each, and where the values begin."""
SINGLE = {0x08: "<f4", 0x0A: "<f4", 0x09: "<i4", 0x0B: "<i4"}
"""Measurements of one channel, and how a value is written."""
NOTICES = (0x0C, 0x0D, 0x0E)
"""Start time, dropped, period: layouts not known; they are counted and otherwise let pass."""
MOST_AHEAD = 128
"""Steps of the counter that are a loss; a longer jump is as likely one back."""


class Response(NamedTuple):
    """The answer to a command with this number and counter."""

    command: int
    counter: int
    content: bytes


class Measured(NamedTuple):
    """Values by channel, shape (n,) each, oldest first; counter: of the frame, 8 bits."""

    counter: int
    values: dict[int, NDArray[np.float64]]


class Status(NamedTuple):
    """What the belt says of itself on request."""

    firmware: str
    battery_percent: float


class Channel(NamedTuple):
    """What the belt says of one of its channels; fastest_period_us: 0 where it does not say."""

    unit: str
    fastest_period_us: int


def command(payload: bytes, counter: int) -> bytes:
    """Return a command with its header; counter goes down by one with each, as the vendor's code does it."""
    frame = bytearray((COMMAND, HEADER + len(payload), counter & 0xFF, 0)) + payload
    frame[3] = checksum(frame)
    return bytes(frame)


def checksum(frame: bytes | bytearray) -> int:
    """Sum of all bytes but the checksum itself, modulo 256."""
    return (sum(frame) - frame[3]) & 0xFF


def set_period(period_us: int) -> bytes:
    """The command that sets how long after each other samples are taken."""
    return bytes((0x1B, 0xFF, 0x00)) + period_us.to_bytes(8, "little")


def start(*channels: int) -> bytes:
    """The command that starts these channels."""
    return bytes((0x18, 0xFF, 0x01)) + sum(1 << each for each in channels).to_bytes(4, "little") + bytes(8)


class Frames:
    """Puts frames together from notifications, by the length in their byte 1; finds the next one after odd bytes.

    The checksum alone is right by chance once in 256. So what stands behind a frame must begin as known frames do,
    which the middle of the next does not where a notification was lost. While it searches the frame itself must do so
    too, and a measurement make sense.
    """

    def __init__(self) -> None:
        self._waiting, self._odd, self._searching = bytearray(), bytearray(), False

    def take(self, notified: bytes) -> Iterator[bytes | FrameError]:
        """Give each whole frame; for a run of bytes that are in none, one error before the next frame."""
        self._waiting += notified
        while len(self._waiting) > 1:
            possible = self._begins()
            if possible and len(self._waiting) < self._waiting[1]:
                return
            if not (possible and self._is_frame()):
                self._odd.append(self._waiting.pop(0))
                self._searching = True
                continue
            if self._searching:
                yield FrameError(f"{len(self._odd)} bytes that are in no frame ({self._odd[:16].hex()})")
                self._odd.clear()
                self._searching = False
            yield self._taken(self._waiting[1])

    def _begins(self) -> bool:
        return self._waiting[1] > HEADER and (not self._searching or self._waiting[0] in BEGINNINGS)

    def _is_frame(self) -> bool:
        frame, behind = bytes(self._waiting[: self._waiting[1]]), self._waiting[self._waiting[1] :]
        if checksum(frame) != frame[3] or (behind and behind[0] not in BEGINNINGS):
            return False
        return not (self._searching and isinstance(_decoded(frame), FrameError))

    def _taken(self, length: int) -> bytes:
        frame = bytes(self._waiting[:length])
        del self._waiting[:length]
        return frame


def _decoded(frame: bytes) -> "Response | Measured | FrameError":
    try:
        return decode(frame)
    except FrameError as err:
        return err


def decode(frame: bytes) -> Response | Measured:
    """Return what a whole frame says. Raises FrameError."""
    if frame[0] != MEASUREMENT:
        if len(frame) < HEADER + 2:
            raise FrameError(f"answer of {len(frame)} bytes names no command ({frame.hex()})")
        return Response(frame[4], frame[5], frame[6:])
    kind = frame[4]
    if kind in NOTICES:
        return Measured(frame[2], {})
    if kind in REAL32:
        layout, begin = REAL32[kind]
        if len(frame) < begin:
            raise _misfit(frame)
        mask, count = layout.unpack_from(frame, 5)
        channels = [channel for channel in range(32) if mask >> channel & 1]
        return Measured(frame[2], _values(frame, begin, channels, count, "<f4"))
    if kind in SINGLE and len(frame) >= 8:
        return Measured(frame[2], _values(frame, 8, [frame[6]], frame[7], SINGLE[kind]))
    raise FrameError(f"measurement of unknown kind {kind} ({frame[:12].hex()}...)")


def _values(frame: bytes, begin: int, channels: list[int], count: int, written: str) -> dict[int, NDArray[np.float64]]:
    """Values stand sample by sample, in each the channels in their order."""
    if not channels or len(frame) - begin != 4 * count * len(channels):
        raise _misfit(frame)
    table = np.frombuffer(frame[begin:], written).reshape(count, len(channels)).astype(np.float64)
    return {channel: table[:, place] for place, channel in enumerate(channels)}


def decode_status(content: bytes) -> Status:
    """Return firmware and charge. Raises FrameError."""
    if len(content) < 12:
        raise FrameError(f"status of {len(content)} bytes ({content.hex()})")
    return Status(f"{content[2]}.{content[3]}", float(content[10]))


def decode_info(content: bytes) -> tuple[str, str]:
    """Return order code and serial number. Raises FrameError."""
    if len(content) < 32:
        raise FrameError(f"device information of {len(content)} bytes ({content.hex()})")
    return _text(content[:16]), _text(content[16:32])


def decode_available(content: bytes) -> int:
    """Return the mask of the channels that there are. Raises FrameError."""
    if len(content) < 4:
        raise FrameError(f"list of channels of {len(content)} bytes ({content.hex()})")
    return int.from_bytes(content[:4], "little")


def decode_channel(content: bytes) -> Channel:
    """Return unit and fastest period of a channel from its information. Raises FrameError."""
    if len(content) < 128:
        raise FrameError(f"channel information of {len(content)} bytes ({content[:16].hex()}...)")
    return Channel(_text(content[68:100]), int.from_bytes(content[124:128], "little"))


class Losses:
    """Frames missing by the counter of 8 bits, be it one that goes up or down: the first step of one says which.

    A counter that stays, or jumps by more than half its range, is repeated, late or begun anew, and no loss.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._step = self._untold = 0

    def before(self, counter: int, with_force: bool = True) -> int:
        """Return how many frames are missing since the last one with force; 0 where this one has none either.

        0 too while the direction is not known.
        """
        self._untold += self._missing(counter)
        if not with_force:
            return 0
        told, self._untold = self._untold, 0
        return told

    def _missing(self, counter: int) -> int:
        last, self._last = self._last, counter
        if last is None:
            return 0
        difference = (counter - last) & 0xFF
        if not self._step and difference in (1, 255):
            self._step = 1 if difference == 1 else -1
        ahead = (self._step * difference) & 0xFF
        return ahead - 1 if 0 < ahead <= MOST_AHEAD else 0


def _text(octets: bytes) -> str:
    return octets.replace(b"\0", b"").decode("utf-8", "replace").strip()


def _misfit(frame: bytes) -> FrameError:
    return FrameError(f"measurement of {len(frame)} bytes does not fit its number of values ({frame[:12].hex()}...)")
