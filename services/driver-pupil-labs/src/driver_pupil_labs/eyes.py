"""Rows of a raw stream out of single readings: their rate, and which pictures of two eyes belong together. Pure.

An eye tracker of two cameras that run each on its own has no common frame. `Pairing` puts a picture of the left eye
into the row of the right eye's picture next to it, at most half a frame away; every picture is in exactly one row.
"""

import math
from collections import deque
from collections.abc import Iterator
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
from sense4hri.stamps import SECOND_NS

from driver_pupil_labs.protocol import LEFT, RIGHT, Gaze, Pupil

USUAL_HZ = (30.0, 60.0, 66.0, 90.0, 120.0, 200.0, 240.0, 400.0)
NEAR = 0.07  # share by which a measured rate may differ from a usual one and still be it
STEADY = 0.8  # share of the steps between samples that must be one period long for them to have a rate
WAIT_FRAMES = 10  # for which a picture waits for that of the other eye
MOST_HELD = 200  # readings that wait for others; in WAIT_FRAMES there are 40


class Row(NamedTuple):
    """One sample of all channels.

    time_ns: device time; received_ns: when its newest part came; lost: missing before it, None where nobody counts.
    """

    time_ns: int
    received_ns: int
    values: tuple[float, ...]
    lost: int | None = None


def rate_hz(times_ns: list[int]) -> float:
    """Return the rate of samples with these times, a usual one where it is near; 0 where they have no rhythm."""
    steps = np.diff(np.asarray(times_ns, np.float64))
    period_ns = float(np.median(steps)) if len(steps) else 0.0
    if period_ns <= 0 or np.mean(np.abs(steps - period_ns) < period_ns / 2) < STEADY:
        return 0.0
    measured_hz = 1e9 / period_ns
    usual_hz = min(USUAL_HZ, key=lambda hz: abs(hz - measured_hz))
    return usual_hz if abs(usual_hz - measured_hz) < NEAR * usual_hz else float(round(measured_hz, 1))


class InOrder:
    """Gaze in the order in which it was seen, as rows of `gaze_x`, `gaze_y`, `confidence`.

    Capture lets a picture of one eye wait for the other eye for up to ten pictures, and sends what comes of it after
    newer gaze. Rows are held back for hold_ns of device time, MOST_HELD of them at the most; what comes later still is
    passed on as it comes. A row is stamped with the latest receipt up to it, so that stamps do not go back either,
    unless the host's clock was set back.
    """

    def __init__(self, hold_ns: float) -> None:
        self._hold_ns = hold_ns
        self._held: list[Row] = []
        self._newest_ns = self._received_ns = 0

    def push(self, gaze: Gaze, received_ns: int) -> Iterator[Row]:
        """Take gaze; yield the rows that nothing can come before."""
        if self._held and gaze.time_ns < self._newest_ns - SECOND_NS:  # Pupil time was set back
            yield from self.rest()
            self._newest_ns = gaze.time_ns
        heappush(self._held, Row(gaze.time_ns, received_ns, (gaze.x, gaze.y, gaze.confidence)))
        self._newest_ns = max(self._newest_ns, gaze.time_ns)
        while self._held and (self._held[0].time_ns <= self._newest_ns - self._hold_ns or len(self._held) > MOST_HELD):
            yield self._oldest()

    def rest(self) -> Iterator[Row]:
        """Yield the rows that are held back."""
        while self._held:
            yield self._oldest()

    def _oldest(self) -> Row:
        row = heappop(self._held)
        was_set_back = row.received_ns < self._received_ns - SECOND_NS
        self._received_ns = row.received_ns if was_set_back else max(self._received_ns, row.received_ns)
        return row._replace(received_ns=self._received_ns)


class Pairing:
    """Pictures of the eyes in, rows of `diameter_left`, `diameter_right`, `confidence` out, in order.

    eyes: those whose cameras run; of one eye there are rows of `diameter_...` and `confidence`. The row has the time of
    the right eye's picture, NaN for a picture that is missing, and the lower of the two confidences. Where the right
    one is missing it has the left one's time less what that was behind the last time: at its own it would jitter beside
    the others, which would hide rows that are missing.
    """

    def __init__(self, eyes: frozenset[int], period_ns: float) -> None:
        self.eyes, self._half_ns, self._wait_ns = eyes, period_ns / 2, WAIT_FRAMES * period_ns
        self._waiting: dict[int, deque[tuple[Pupil, int]]] = {eye: deque() for eye in sorted(eyes)}
        self._newest_ns = self._behind_ns = 0

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        names = {LEFT: "diameter_left", RIGHT: "diameter_right"}
        return (*(names[eye] for eye in (LEFT, RIGHT) if eye in self.eyes), "confidence")

    def push(self, pupil: Pupil, received_ns: int) -> Iterator[Row]:
        """Take a picture; yield the rows that are complete with it."""
        if pupil.time_ns < self._newest_ns - SECOND_NS:  # Pupil time was set back
            yield from self.rest()
            self._newest_ns = pupil.time_ns
        self._newest_ns = max(self._newest_ns, pupil.time_ns)
        self._waiting[pupil.eye].append((pupil, received_ns))
        while all(self._waiting.values()):
            yield self._next()
        queue = next((queue for queue in self._waiting.values() if queue), None)
        if queue and (queue[-1][0].time_ns - queue[0][0].time_ns > self._wait_ns or len(queue) > MOST_HELD):
            yield self._alone(queue)

    def rest(self) -> Iterator[Row]:
        """Yield the pictures that wait for that of the other eye."""
        for queue in self._waiting.values():
            while queue:
                yield self._alone(queue)

    def _next(self) -> Row:
        """Return the oldest row; pictures of both eyes wait, or there is but one eye."""
        queues = list(self._waiting.values())
        oldest = min(queues, key=lambda queue: queue[0][0].time_ns)
        if len(queues) == 1 or abs(queues[RIGHT][0][0].time_ns - queues[LEFT][0][0].time_ns) > self._half_ns:
            return self._alone(oldest)
        (right, right_ns), (left, left_ns) = queues[RIGHT].popleft(), queues[LEFT].popleft()
        self._behind_ns = left.time_ns - right.time_ns
        values = (left.diameter, right.diameter, min(left.confidence, right.confidence))
        return Row(right.time_ns, max(right_ns, left_ns), values)

    def _alone(self, queue: deque[tuple[Pupil, int]]) -> Row:
        pupil, received_ns = queue.popleft()
        sizes = [pupil.diameter if eye == pupil.eye else math.nan for eye in (LEFT, RIGHT) if eye in self.eyes]
        time_ns = pupil.time_ns - (self._behind_ns if pupil.eye == LEFT else 0)
        return Row(time_ns, received_ns, (*sizes, pupil.confidence))
