"""Bytes of a BITalino (r)evolution: commands, frames in and out of step, the state; no port, no clock.

A frame is read from its end: number of the frame 4 bits, CRC 4, I1 I2 O1 O2, then the acquired channels, most
significant bit first: 10 bits for each of the first four, 6 for the others.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

from driver_bitalino.sensors import bits_of

RATES = {1: 0, 10: 1, 100: 2, 1000: 3}  # Hz -> code
STOP, VERSION, STATE = b"\x00", b"\x07", b"\x0b"
STATE_BYTES = 16
REVOLUTION = 5  # the first firmware that answers STATE
ROUND = 16  # the number of a frame begins again
CONFIRM = 3  # frames in a row that show where frames begin
MISSED = 2  # frames that may be missing between those that show that none of their bytes were lost
AT_ONCE = 64  # frames that are looked at together: bad air costs a search for every other one, through all of them
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


def tells_state(version: str) -> bool:
    """True where a board of this version, as in BITalino_v5.1, answers STATE."""
    found = re.search(r"_v(\d+)", version)
    return found is not None and int(found[1]) >= REVOLUTION


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
        self._last = b""  # the frame before it
        self._passed_over = 0  # bytes since then
        self._lost = 0

    def take(self, buffer: bytearray) -> Iterator[Run | FrameError]:
        """Take every whole frame in step out of the buffer; bytes between them become the error that says how many."""
        while True:
            if len(frames := self._continued(buffer)):
                yield self._run(frames)
            found, noise = self._search(bytes(buffer[: AT_ONCE * self.size]))
            if noise:
                error = FrameError(f"{noise} bytes that belong to no frame ({buffer[:8].hex()})")
                del buffer[:noise]
                self._passed_over += noise
                yield error
            elif not found:
                return

    def _continued(self, buffer: bytearray) -> Octets:
        """Take the frames out of the buffer that continue those before, shape (n, bytes)."""
        taken = [np.empty((0, self.size), np.uint8)]
        while count := self._in_step(frames := self._ahead(buffer)):
            del buffer[: count * self.size]
            taken.append(frames[:count])
            self._next, self._last = (int(frames[count - 1, -1] >> 4) + 1) % ROUND, frames[count - 1].tobytes()
            self._passed_over = 0
        return np.concatenate(taken)

    def _ahead(self, buffer: bytearray) -> Octets:
        whole = min(len(buffer) // self.size, AT_ONCE) * self.size
        return np.frombuffer(bytes(buffer[:whole]), np.uint8).reshape(-1, self.size)

    def _in_step(self, frames: Octets) -> int:
        """Return how many frames from the first on are right and follow the one before."""
        if self._next is None or not len(frames):
            return 0
        wanted = (self._next + np.arange(len(frames))) % ROUND
        wrong = np.flatnonzero(~crc_fits(frames) | (frames[:, -1] >> 4 != wanted))
        return int(wrong[0]) if wrong.size else len(frames)

    def _search(self, octets: bytes) -> tuple[bool, int]:
        """Return whether frames in a row begin somewhere, and how many bytes before them belong to none."""
        last = len(octets) + 1 - CONFIRM * self.size  # where the first of them may begin
        if last <= 0:
            return False, 0
        if self._last and octets.startswith(self._last):
            return False, self.size  # it came twice: no round of frames is missing
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(octets, np.uint8), self.size)
        right, numbers = crc_fits(windows), windows[:, -1] >> 4
        later = [slice(step * self.size, step * self.size + last) for step in range(1, CONFIRM)]
        ahead = [(numbers[each] - numbers[:last] - step) % ROUND for step, each in enumerate(later, 1)]
        in_a_row = np.all([right[each] & (by == 0) for each, by in zip(later, ahead, strict=True)], axis=0)
        near = np.any([right[each] & (by <= MISSED) for each, by in zip(later, ahead, strict=True)], axis=0)
        begins = right[:last] & (in_a_row | (near & self._may_follow(numbers[:last])))
        if not begins.any():
            return False, last
        noise = int(np.argmax(begins))
        number = int(numbers[noise])
        self._lost = (number - self._next) % ROUND if self._next is not None else 0
        self._next = number
        return True, noise

    def _may_follow(self, numbers: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return where the next frame may begin if no byte was lost, by the number it then has.

        Among the first few frames others may be missing whole; later any other number is taken for noise.
        """
        passed, rest = np.divmod(self._passed_over + np.arange(len(numbers)), self.size)
        counts_on = (numbers - passed) % ROUND == self._next if self._next is not None else False
        return (rest == 0) & ((passed < CONFIRM) | counts_on)

    def _run(self, frames: Octets) -> Run:
        lost, self._lost = self._lost, 0
        bits = np.unpackbits(frames[:, ::-1], axis=1)
        counts, begin = [], HEADER_BITS
        for position in range(self._channels):
            end = begin + bits_of(position)
            counts.append(bits[:, begin:end] @ (1 << np.arange(end - begin)[::-1]))
            begin = end
        return Run(lost, bits[:, DIGITAL].astype(np.int64), np.stack(counts, axis=1))
