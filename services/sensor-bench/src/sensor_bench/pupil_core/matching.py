"""How Pupil Capture makes gaze of two eyes whose cameras run each on its own; behaviour of its `RealtimeMatcher`.

Each picture of an eye leads to one gaze: with the picture of the other eye next to it where both see a pupil, stamped
midway, else alone. So two cameras of 120 Hz give 240 gaze a second. While a lid is down the last good picture of one
eye waits for the other, so gaze comes up to ten pictures late, after newer gaze.
"""

from collections import deque
from collections.abc import Iterator
from typing import Any

Datum = dict[str, Any]
LEAST_CONFIDENCE = 0.6
LONGEST = 10  # pictures of one eye that wait for the other


class Matcher:
    """Pictures of both eyes in, one or two that make one gaze out."""

    def __init__(self, period_s: float) -> None:
        self._queues: tuple[deque[Datum], deque[Datum]] = (deque(), deque())
        self._apart_s = 2 * period_s

    def push(self, datum: Datum) -> Iterator[list[Datum]]:
        """Take a picture; yield what a gaze is made of."""
        self._queues[datum["id"]].append(datum)
        for queue in self._queues:
            if queue and queue[0]["confidence"] < LEAST_CONFIDENCE:
                yield [queue.popleft()]
                return
        if all(self._queues):
            older, other = sorted(self._queues, key=lambda queue: queue[0]["timestamp"])
            pair = sorted((older[0], other[0]), key=lambda each: each["id"])
            oldest = older.popleft()
            near = abs(pair[0]["timestamp"] - pair[1]["timestamp"]) < self._apart_s
            yield pair if near else [oldest]
            return
        for queue in self._queues:
            if len(queue) > LONGEST:
                yield [queue.popleft()]
                return
