"""The board's firmware: commands and frames, as its published source (BITalino_v5.1) lays them out.

A frame is a little-endian number of eight bytes, of which the first are left out where fewer channels are acquired.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor_bench.bitalino.ports import Port
from sensor_bench.wired import Frames

VERSION = b"BITalino_v5.1\n"
SHIFTS = (42, 32, 22, 12, 6, 0)  # of each channel in the order acquired
SHORT = 4  # from this channel on only the upper six of ten bits are sent
DIGITAL, CRC, SEQUENCE = 52, 56, 60
STARTS = (5, 4, 2, 1, 0, 0)  # first byte that is sent, by number of channels
RATES_HZ = {0x03: 1, 0x43: 10, 0x83: 100, 0xC3: 1000}
POLYNOMIAL = 0b10011
I1, I2 = 8, 4
BATTERY_PER_V = 1023 / 3.3 / 2


@dataclass
class Panel:
    """What a hand may change: the button at I1 pulls it down; the battery."""

    pressed: bool = False
    battery_v: float = 3.9


def remainder(octets: bytes, bits: int) -> int:
    """The CRC-4 of the first so many bits, by long division."""
    rest = 0
    for number in range(bits + 4):
        bit = octets[number // 8] >> (7 - number % 8) & 1 if number < bits else 0
        rest = rest << 1 | bit
        rest ^= POLYNOMIAL * (rest >> 4)
    return rest


class Board:
    """One board; on_s: true time since the bench's start at which it was switched on. rate_factor: of its crystal."""

    def __init__(self, ports: Sequence[Port], panel: Panel, frames: Frames, on_s: float, rate_factor: float) -> None:
        self._ports, self._panel, self._frames = ports, panel, frames
        self._on_s, self._factor = on_s, rate_factor
        self._rate_hz, self._acquired = 1000, list[Port]()
        self._begun_s, self._sent, self._live = 0.0, 0, False
        self._threshold = 0

    def receive(self, octets: bytes, time_s: float) -> bytes:
        return b"".join(self._obey(command, time_s) for command in octets)

    def _obey(self, command: int, time_s: float) -> bytes:
        if self._live:
            self._live = command not in (0x00, 0xFF)
        elif command & 3 == 0:
            self._threshold = command >> 2
        elif command & 3 == 1:
            self._acquired = [port for number, port in enumerate(self._ports) if command >> (2 + number) & 1]
            self._begun_s, self._sent, self._live = time_s, 0, bool(self._acquired)
        elif command in RATES_HZ:
            self._rate_hz = RATES_HZ[command]
        elif command == 0x07:
            return VERSION
        elif command == 0x0B:
            return self._state(time_s)
        return b""

    def _state(self, time_s: float) -> bytes:
        first = round((self._on_s + time_s) * 1000)
        values = [int(port.counts(first, 1, 1000.0)[0]) for port in self._ports]
        words = np.array([*values, round(self._panel.battery_v * BATTERY_PER_V)], "<u2").tobytes()
        body = words + bytes([self._threshold, self._digital() << 4])
        return body[:-1] + bytes([body[-1] | remainder(body, 8 * len(body) - 4)])

    def _digital(self) -> int:
        return (0 if self._panel.pressed else I1) | I2

    def send(self, time_s: float) -> bytes:
        if not self._live:
            return b""
        rate_hz = self._rate_hz * self._factor
        due = int((time_s - self._begun_s) * rate_hz)
        first, count = self._sent, due - self._sent
        if count <= 0:
            return b""
        self._sent = due
        base = round((self._on_s + self._begun_s) * rate_hz)
        samples: dict[str, int] = {port.stream: 1 for port in self._acquired}
        frames = self._packed(first, [port.counts(base + first, count, rate_hz) for port in self._acquired])
        return b"".join(self._frames.carry(frame, **samples) for frame in frames)

    def _packed(self, first: int, channels: list[NDArray[np.int64]]) -> list[bytes]:
        count = len(channels[0])
        numbers = (np.arange(first, first + count, dtype=np.uint64) % np.uint64(16)) << np.uint64(SEQUENCE)
        numbers |= np.uint64(self._digital()) << np.uint64(DIGITAL)
        for position, counts in enumerate(channels):
            short = 4 if position >= SHORT else 0
            numbers |= (counts >> short).astype(np.uint64) << np.uint64(SHIFTS[position])
        begin = STARTS[len(channels) - 1]
        return [self._closed(octets[begin:]) for octets in _pieces(numbers)]

    @staticmethod
    def _closed(frame: bytes) -> bytes:
        """The frame with its CRC, which covers the number before it too."""
        nibbles = frame[:-1] + bytes([frame[-1] & 0xF0])
        return frame[:-1] + bytes([frame[-1] | remainder(nibbles, 8 * len(frame) - 4)])


def _pieces(numbers: NDArray[np.uint64]) -> list[bytes]:
    octets = numbers.astype("<u8").tobytes()
    return [octets[begin : begin + 8] for begin in range(0, len(octets), 8)]
