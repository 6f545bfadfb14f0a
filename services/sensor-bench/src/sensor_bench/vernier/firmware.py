"""What a Go Direct belt answers and sends, as bytes. Pure: time comes from outside."""

import struct
from collections.abc import Callable, Iterator, Sequence

INITIALISE = 0x1A
CHANNELS = {1: ("Force", "N"), 2: ("Respiration Rate", "bpm"), 4: ("Steps", "steps"), 5: ("Step Rate", "spm")}
PERIODS_US = (10_000, 3_600_000_000, 100_000, 1_000)
"""Fastest, slowest, usual, and the step between them."""
ORDER_CODE = b"GDX-RB"


def sealed(kind: int, number: int, content: bytes) -> bytes:
    """A frame with its length, its number of 8 bits and its checksum."""
    frame = bytes([kind, len(content) + 4, number & 0xFF, 0]) + content
    return frame[:3] + bytes([sum(frame) & 0xFF]) + frame[4:]


def measurement(number: int, mask: int, values: Sequence[Sequence[float]]) -> bytes:
    """Kind 6: mask of channels, number of samples, an unexplained byte, then a real32 of each, sample by sample."""
    content = struct.pack("<BHBB", 6, mask, len(values), 0xFC)
    return sealed(0x20, number, content + b"".join(struct.pack("<f", value) for row in values for value in row))


class Commands:
    """Takes what the host writes, chunk by chunk, and answers whole commands; what is running is in `mask`."""

    def __init__(self, serial_number: str, battery_percent: Callable[[], int]) -> None:
        self._serial, self._battery = serial_number, battery_percent
        self._written = b""
        self.mask, self.period_us, self._awake = 0, 100_000, False

    def reset(self) -> None:
        """The link is gone."""
        self._written, self.mask, self._awake = b"", 0, False

    def receive(self, octets: bytes) -> Iterator[bytes]:
        """The answers to the commands that these bytes complete, without their header."""
        self._written += octets
        while len(self._written) > 1 and len(self._written) >= self._written[1] >= 5:
            whole, self._written = self._written[: self._written[1]], self._written[self._written[1] :]
            genuine = whole[0] == 0x58 and (sum(whole) - whole[3]) % 256 == whole[3]
            if genuine and (self._awake or whole[4] == INITIALISE):
                yield whole[4:5] + whole[2:3] + self._answer(whole[4], whole[5:])

    def _answer(self, command: int, given: bytes) -> bytes:
        if command == INITIALISE:
            self._awake = given[:2] == b"\xa5\x4a" and len(given) == 20
            return b"\0"
        if command == 0x10:
            return bytes([0, 0, 1, 7, 0, 0, 2, 0, 0, 3, self._battery(), 0])
        if command == 0x55:
            return ORDER_CODE.ljust(16, b"\0") + self._serial.encode().ljust(16, b"\0") + b"GDX-RB".ljust(32, b"\0")
        if command == 0x51:
            return struct.pack("<I", sum(1 << each for each in CHANNELS))
        if command == 0x50:
            return self._channel(given[0])
        if command == 0x1B:
            self.period_us = int.from_bytes(given[2:10], "little")
        elif command == 0x18:
            self.mask = int.from_bytes(given[2:6], "little")
        elif command in (0x19, 0x54):
            self.mask = 0
        return b"\0"

    def _channel(self, number: int) -> bytes:
        name, unit = CHANNELS.get(number, ("", ""))
        head = struct.pack("<BBIBB", number, 0, number if name else 0, 0, 0)
        about = name.encode().ljust(60, b"\0") + unit.encode().ljust(32, b"\0")
        measurement_range = struct.pack("<ddd", 0.01, 0.0, 50.0)
        return head + about + measurement_range + struct.pack("<IQIII", *PERIODS_US, 0)
