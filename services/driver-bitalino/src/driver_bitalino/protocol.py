"""Bytes of a BITalino (r)evolution: commands, frames in and out of step, the state; no port, no clock.

A frame is read from its end: number of the frame 4 bits, CRC 4, I1 I2 O1 O2, then the acquired channels, most
significant bit first: 10 bits for each of the first four, 6 for the others.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

from driver_bitalino.sensors import bits_of

RATES = {1: 0, 10: 1, 100: 2, 1000: 3}  # Hz -> code
STOP, VERSION, STATE = b"\x00", b"\x07", b"\x0b"
STATE_BYTES = 16
ROUND = 16  # the number of a frame begins again
CONFIRM = 3  # frames in a row that show where frames begin
MISSED = 2  # frames that may be missing between those that show that none of their bytes were lost
HEADER_BITS, DIGITAL = 12, slice(8, 12)
Octets = NDArray[np.uint8]


def _crc_table() -> Octets:
    """Return what four bits of a CRC-4 (x^4 + x + 1) become when four zeros follow."""
    table = np.arange(16)
    for _ in range(4):
        table = (table << 1) ^ np.where(table & 8, 0x13, 0)
    return table.astype(np.uint8)


CRC = _crc_table()


class State(NamedTuple):
    """What an idle board says: six channels of 10 bits, the battery's voltage, the threshold of its LED (0 to 63)."""

    channels: tuple[int, ...]
    battery_v: float
    threshold: int


class Run(NamedTuple):
    """Frames in a row. lost: how many are missing before them. digital, counts: shape (n, 4) and (n, channels)."""

    lost: int
    digital: NDArray[np.int64]
    counts: NDArray[np.int64]


def start(ports: tuple[int, ...]) -> bytes:
    """Return the command that starts acquiring these ports, 1 to 6."""
    return bytes([sum(4 << (port - 1) for port in ports) | 1])


def set_rate(rate_hz: int) -> bytes:
    """Return the command that sets the rate, 1, 10, 100 or 1000 Hz."""
    return bytes([RATES[rate_hz] << 6 | 3])


def set_threshold(threshold: int) -> bytes:
    """Return the command that sets at which battery voltage the LED lights: 0 = 3.4 V, 63 = 3.8 V."""
    return bytes([threshold << 2])


def frame_bytes(channels: int) -> int:
    """Return the length of a frame of so many channels."""
    return -(-(HEADER_BITS + sum(bits_of(each) for each in range(channels))) // 8)


def crc_fits(frames: Octets) -> NDArray[np.bool_]:
    """Return of each frame, shape (n, bytes), whether its CRC is that of its bytes."""
    nibbles = np.stack([frames >> 4, frames & 15], axis=2).reshape(len(frames), -1).T
    crc = np.zeros_like(nibbles[0])
    for nibble in nibbles[:-1]:
        crc = CRC[crc] ^ nibble
    return CRC[crc] == nibbles[-1]


def decode_state(octets: bytes) -> State:
    """Return what a board's answer to STATE says. Raises FrameError."""
    if len(octets) != STATE_BYTES or not crc_fits(np.frombuffer(octets, np.uint8)[None])[0]:
        raise FrameError(f"state of {len(octets)} bytes, or with a wrong CRC ({octets.hex()})")
    *channels, battery = np.frombuffer(octets[:14], "<u2").tolist()
    return State(tuple(channels), battery * 2 * 3.3 / 1023, octets[14])


class Frames:
    """Takes the frames of so many channels out of what comes, and finds them again after bytes that are none."""

    def __init__(self, channels: int) -> None:
        self.size, self._channels = frame_bytes(channels), channels
        self._next: int | None = None  # number of the next frame
        self._lost = 0

    def take(self, buffer: bytearray) -> Iterator[Run | FrameError]:
        """Take every whole frame in step out of the buffer; bytes between them become the error that says how many."""
        while len(buffer) >= self.size:
            whole = len(buffer) // self.size * self.size
            frames = np.frombuffer(bytes(buffer[:whole]), np.uint8).reshape(-1, self.size)
            if count := self._in_step(frames):
                del buffer[: count * self.size]
                yield self._run(frames[:count])
                continue
            found, noise = self._search(buffer)
            if noise:
                error = FrameError(f"{noise} bytes that belong to no frame ({buffer[:8].hex()})")
                del buffer[:noise]
                yield error
            if not found:
                return

    def _in_step(self, frames: Octets) -> int:
        """Return how many frames from the first on are right and follow the one before."""
        if self._next is None:
            return 0
        wanted = (self._next + np.arange(len(frames))) % ROUND
        wrong = np.flatnonzero(~crc_fits(frames) | (frames[:, -1] >> 4 != wanted))
        return int(wrong[0]) if wrong.size else len(frames)

    def _search(self, buffer: bytearray) -> tuple[bool, int]:
        """Return whether frames in a row begin somewhere, and how many bytes before them belong to none."""
        octets = np.lib.stride_tricks.sliding_window_view(np.frombuffer(bytes(buffer), np.uint8), self.size)
        last = len(octets) - (CONFIRM - 1) * self.size  # where the first of them may begin
        if last <= 0:
            return False, 0
        right, numbers = crc_fits(octets), octets[:, -1] >> 4
        later = [slice(step * self.size, step * self.size + last) for step in range(1, CONFIRM)]
        ahead = [(numbers[each] - numbers[:last] - step) % ROUND for step, each in enumerate(later, 1)]
        in_a_row = np.all([right[each] & (by == 0) for each, by in zip(later, ahead, strict=True)], axis=0)
        near = np.any([right[each] & (by <= MISSED) for each, by in zip(later, ahead, strict=True)], axis=0)
        in_step = np.arange(last) % self.size == 0  # where the next frame begins if no byte was lost
        begins = right[:last] & (in_a_row | (in_step & near))
        if not begins.any():
            return False, last
        noise = int(np.argmax(begins))
        number = int(numbers[noise])
        self._lost = (number - self._next) % ROUND if self._next is not None else 0
        self._next = number
        return True, noise

    def _run(self, frames: Octets) -> Run:
        lost, self._lost = self._lost, 0
        self._next = (int(frames[-1, -1] >> 4) + 1) % ROUND
        bits = np.unpackbits(frames[:, ::-1], axis=1)
        counts, begin = [], HEADER_BITS
        for position in range(self._channels):
            end = begin + bits_of(position)
            counts.append(bits[:, begin:end] @ (1 << np.arange(end - begin)[::-1]))
            begin = end
        return Run(lost, bits[:, DIGITAL].astype(np.int64), np.stack(counts, axis=1))
