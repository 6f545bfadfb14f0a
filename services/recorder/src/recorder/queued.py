"""The one queue between the ROS thread and the disk: messages, and between them where to write from there on."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from typing import NamedTuple

from sense4hri_recording.rosbag2 import Channel

from recorder.plan import Target
from recorder.split import Entry

QUEUE_BYTES, OTHERS_BYTES = 256 << 20, 64 << 20  # others find room only while so little waits
LATEST_NS = 2**63 - 1  # that a file can say


class Turn(NamedTuple):
    """From here on write this. dropped: what found the queue full before it, by channel."""

    target: Target
    at_ns: int
    dropped: Counter[Channel]


class Queue:
    """May be used from any thread and never waits for the disk; what finds it full is counted."""

    def __init__(self) -> None:
        self._items: deque[Entry | Turn] = deque()
        self._bytes = 0
        self._dropped: Counter[Channel] = Counter()
        self._lock = threading.Lock()

    def put(
        self,
        channel: Channel,
        data: bytes,
        log_ns: int,
        publish_ns: int,
        sequence: int,
        lost: int = 0,
        missed: int = 0,
        first: bool = True,
    ) -> None:
        """Queue one serialised message; lost, missed: see Entry.

        publish_ns: as the publisher says; 0 = it does not. first: it is the study's own, which finds room longest.
        """
        publish_ns = publish_ns if 0 < publish_ns <= LATEST_NS else log_ns
        with self._lock:
            if self._bytes + len(data) > (QUEUE_BYTES if first else OTHERS_BYTES):
                self._dropped[channel] += 1 + lost
                return
            self._bytes += len(data)
            dropped = self._dropped.pop(channel, 0) if self._dropped else 0
            self._items.append(Entry(channel, data, log_ns, publish_ns, sequence, lost, missed, dropped))

    def leave(self, channel: Channel, count: int) -> None:
        """Count messages that are not taken in any more."""
        with self._lock:
            self._dropped[channel] += count

    def turn_to(self, target: Target) -> None:
        """Have this written from here on."""
        with self._lock:
            self._items.append(Turn(target, time.time_ns(), self._dropped))
            self._dropped = Counter()

    def take(self) -> deque[Entry | Turn]:
        """Return everything that waits, in its order; nothing waits then."""
        with self._lock:
            items, self._items = self._items, deque()
            self._bytes = 0
        return items

    def __len__(self) -> int:
        return len(self._items)
