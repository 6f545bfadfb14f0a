"""Packets of a device's streams in the order of their receipt stamps, in whatever order the middleware hands them over.

Between two topics nothing keeps the order: a queue that is emptied late, or a fast replay, swaps them. Time comes in
with the packets, so what comes out is the same live and in a replay at any speed.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection
from typing import NamedTuple

LONGEST_NS = 2_000_000_000  # a stream silent for so long, by the other streams' stamps, is waited for no more
MOST_WAITING = 5000  # packets; the oldest come out, whatever their stamps


class Packet(NamedTuple):
    """Stamps of one raw message; sorts by receipt, then by stream."""

    received_ns: int
    stream: str
    number: int
    device_ns: int


class Merge:
    """A packet is released as soon as no earlier one can come: every other stream has shown one at least as late."""

    def __init__(self) -> None:
        self._waiting: list[Packet] = []
        self._newest_ns: dict[str, int] = {}
        self._first_ns = 0
        self._numbers = 0

    def push(self, stream: str, device_ns: int, received_ns: int, streams: Collection[str]) -> list[Packet]:
        """Take one packet; return those released by it, in order. streams: names of all streams of the device."""
        if not self._newest_ns:
            self._first_ns = received_ns
        self._numbers += 1
        before_ns = self._newest_ns.get(stream, received_ns)
        self._newest_ns[stream] = received_ns
        packet = Packet(received_ns, stream, self._numbers, device_ns)
        if received_ns < before_ns:  # the host's clock was stepped back: stamps no longer say what came first
            return [*self._release(len(self._waiting)), packet]
        heapq.heappush(self._waiting, packet)
        complete_ns = min(self._newest_ns.get(other, self._first_ns - 1) for other in {*streams, stream})
        complete_ns = max(complete_ns, max(self._newest_ns.values()) - LONGEST_NS)
        due = sum(packet.received_ns <= complete_ns for packet in self._waiting)
        return self._release(max(due, len(self._waiting) - MOST_WAITING))

    def _release(self, count: int) -> list[Packet]:
        return [heapq.heappop(self._waiting) for _ in range(count)]
