"""Finds the data packets in what a Shimmer3 sends; no I/O, no clock.

A packet is `00`, a time of 24 bits, and channels; it has neither length nor checksum. So a packet is believed only
where others follow it directly, at times that are whole numbers of sampling periods later: two of them, and within an
unbroken row the next, one period later, is enough, or the one after it, two periods later, so that a damaged neighbour
costs no good packet. In such a row no time goes back, whatever bit of it was flipped. What lies between is noise: bytes
that the serial link lost leave a hole of whole packets, which the device's clock counts. So whatever is cut out or put
in, each packet was sent, at its time, once and in order (but for a foreign head whose time fits by chance, at less than
one damaged place in ten million), and one that arrived whole is unchanged. Nobody sees a flipped bit in a sample, nor
exactly as many foreign bytes in the place of lost ones: of that packet the time and what came of it are right, the rest
is theirs.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from sense4hri.errors import FrameError

from driver_shimmer.protocol import ACK, CLOCK_BITS, HEAD, IN_STREAM, IN_STREAM_BYTES

NEXT, NEXT_BUT_ONE, LATER = range(1, 2), range(2, 3), range(1, 26)  # periods between packets that vouch for each other
SLACK, LEAST_SLACK = 1 / 32, 3  # periods, ticks: how far a time may be from a whole number of periods
LONGEST_NOISE = 4096  # bytes after which noise is told of


class Packet(NamedTuple):
    """One packet: when its last byte came, on the host's clock; its time, still wrapping; all its bytes."""

    received_ns: int
    ticks: int
    octets: bytes


class Answer(NamedTuple):
    """What the device says of itself between packets: 71 status, 94 battery."""

    received_ns: int
    code: int
    content: bytes


class Packets:
    """Takes bytes as they come, gives packets.

    length: bytes of a packet. period_ticks: sampling period in ticks of the device's clock.
    """

    def __init__(self, length: int, period_ticks: int) -> None:
        self._length, self._period = length, period_ticks
        self._buffer = bytearray()
        self._taken, self._fed = 0, 0  # bytes, since the beginning
        self._arrived: deque[tuple[int, int]] = deque()  # bytes until then, and when
        self._in_row, self._last_ticks = False, 0
        self._noise = bytearray()

    def missing(self, packets: int) -> int:
        """Return the bytes that must come until so many packets more are believed."""
        return max(1, packets * self._length + HEAD - len(self._buffer))

    def feed(self, octets: bytes, received_ns: int) -> Iterator[Packet | Answer | FrameError]:
        """Take what came at received_ns; yield every packet that is believed now."""
        self._buffer += octets
        self._fed += len(octets)
        self._arrived.append((self._fed, received_ns))
        at = 0
        while (size := self._size(at)) is not None:
            if size:
                yield from self._quiet()
                yield self._item(at, size)
            else:
                self._noise.append(self._buffer[at])
            self._in_row = size > 0
            at += size or 1
            if len(self._noise) >= LONGEST_NOISE:
                yield from self._quiet()
        del self._buffer[:at]
        self._taken += at

    def _quiet(self) -> Iterator[FrameError]:
        """Tell of the noise that has ended."""
        if self._noise:
            yield FrameError(f"{len(self._noise)} bytes that belong to no packet ({bytes(self._noise[:8]).hex()})")
            self._noise.clear()

    def _item(self, at: int, size: int) -> Packet | Answer:
        octets, received_ns = bytes(self._buffer[at : at + size]), self._when(at + size)
        if octets[0] == 0:
            self._last_ticks = self._ticks(at)
            return Packet(received_ns, self._last_ticks, octets)
        said = octets[octets.index(IN_STREAM) + 1 :]
        return Answer(received_ns, said[0], said[1:])

    def _when(self, end: int) -> int:
        """Return when the byte before `end` came."""
        while self._arrived[0][0] < self._taken + end:
            self._arrived.popleft()
        return self._arrived[0][1]

    def _size(self, at: int) -> int | None:
        """Return how long what begins here is, 0 where it is noise, None while that cannot be said."""
        if at >= len(self._buffer):
            return None
        if self._buffer[at] != 0:
            return self._answer(at) if self._in_row else 0
        after = self._after(at)
        if after is None:
            return None
        if self._in_row and self._follows(at, after, NEXT):
            return self._length
        second = self._after(after)
        if second is None:
            return None
        vouched = self._follows(at, after, LATER) and self._follows(after, second, LATER) and not self._goes_back(at)
        return self._length if vouched or (self._in_row and self._follows(at, second, NEXT_BUT_ONE)) else 0

    def _after(self, at: int) -> int | None:
        """Return where the packet after this one begins, answers passed over; None while its head is not there."""
        after = at + self._length
        while answer := self._answer(after):
            after += answer
        return None if answer is None or after + HEAD > len(self._buffer) else after

    def _answer(self, at: int) -> int | None:
        """Return how long the answer that begins here is, 0 where none does, None while that cannot be said."""
        head = self._buffer[at : at + 3]
        if head[:1] == bytes([ACK]):
            head = head[1:]
        elif head[:1] != bytes([IN_STREAM]):
            return None if not head else 0
        if len(head) < 2:
            return None if head in (b"", bytes([IN_STREAM])) else 0
        if head[0] != IN_STREAM or head[1] not in IN_STREAM_BYTES:
            return 0
        size = (self._buffer[at] == ACK) + 2 + IN_STREAM_BYTES[head[1]]
        return size if at + size <= len(self._buffer) else None

    def _follows(self, at: int, after: int, allowed: range) -> bool:
        """True where a head stands at `after`, later by an allowed number of periods."""
        if self._buffer[after] != 0:
            return False
        step = (self._ticks(after) - self._ticks(at)) % (1 << CLOCK_BITS)
        periods = round(step / self._period)
        return periods in allowed and abs(step - periods * self._period) <= max(LEAST_SLACK, SLACK * self._period)

    def _goes_back(self, at: int) -> bool:
        """True where the packet would be from before the one that it follows without a byte between."""
        step = (self._ticks(at) - self._last_ticks) % (1 << CLOCK_BITS)
        return self._in_row and not self._period // 2 < step < 1 << (CLOCK_BITS - 1)

    def _ticks(self, at: int) -> int:
        return int.from_bytes(self._buffer[at + 1 : at + HEAD], "little")
