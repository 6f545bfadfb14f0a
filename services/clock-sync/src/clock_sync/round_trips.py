"""One host's clock against another's, from round trips of probes (contract, section 9). Pure.

A probe's offset is wrong by at most half its round trip, and by half of what it waited for one way only. So the
smallest round trips decide: of every BIN_S the smallest, each weighed by how much longer it took than the smallest of
the window, with a straight line through them (Cristian 1989; NTP's clock filter, Mills 1991). What no round trip shows
is a path that is slower one way: `uncertainty_s` is at least half the round trips, as the line weighs them.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from typing import NamedTuple

from sense4hri.stamps import LATEST_NS, SECOND_NS

from clock_sync.model import State

BIN_S, WINDOW_S = 2.0, 60.0
LONGEST_S = 5.0  # a longer round trip tells nothing
SMALLEST_SIGMA_S = 20e-6  # of one offset, however short its round trip: reading and sending take their time
SKEW_SIGMA = 50e-6  # of two crystals against each other, before anything is known
SKEW_WALK = 1e-6  # the skew may have changed by so much while nothing was heard
STEP_S, STEP_TRIPS = 0.5e-3, 3  # an offset so far off, so many times in a row, is a step of a clock
LOCK_TRIPS, LOCK_S = 12, 5.0
RECENT, FEW_BINS = 50, 8
SILENT_S = 3.0


class RoundTrip(NamedTuple):
    """Sending and receipt of a question (t1, t2) and of its answer (t3, t4), ns; t1 and t4 on the reference's clock."""

    t1_ns: int
    t2_ns: int
    t3_ns: int
    t4_ns: int

    @property
    def at_ns(self) -> int:
        """The host's own clock in the middle of it."""
        return (self.t2_ns + self.t3_ns) // 2

    @property
    def offset_ns(self) -> int:
        """The reference's clock less the host's."""
        return ((self.t1_ns - self.t2_ns) + (self.t4_ns - self.t3_ns)) // 2

    @property
    def on_the_way_s(self) -> float:
        """How long question and answer were under way together."""
        return ((self.t4_ns - self.t1_ns) - (self.t3_ns - self.t2_ns)) * 1e-9

    @property
    def usable(self) -> bool:
        """False where a clock was set meanwhile, the answer came too late to tell anything, or no stamp carries it."""
        return 0 <= self.on_the_way_s <= LONGEST_S and 0 <= self.t2_ns <= self.t3_ns < LATEST_NS

    def apart_s(self, other: RoundTrip) -> float:
        """By how much this host's clock is another one than that of the other answer; 0 where it may be the same.

        Each offset is wrong by at most half its round trip, so what is more than both halves is of two clocks.
        """
        apart_s = abs(self.offset_ns - other.offset_ns) * 1e-9
        return apart_s if apart_s > (self.on_the_way_s + other.on_the_way_s) / 2 + STEP_S else 0.0


class HostOffset(NamedTuple):
    """As in HostClock: reference = host + offset_ns + skew_ppm * 1e-6 * (host - measured_at_ns)."""

    offset_ns: int
    skew_ppm: float
    uncertainty_s: float
    round_trip_s: float
    measured_at_ns: int
    state: State


class Line(NamedTuple):
    """A line through offsets, with the variances of its level, at the host time middle_ns, and of its slope.

    round_trip_s: mean of the round trips, weighed as their offsets are.
    """

    middle_ns: float
    level_s: float
    slope: float
    level_variance: float
    slope_variance: float
    round_trip_s: float

    def at(self, host_ns: int) -> float:
        """Offset in s, less the origin's."""
        return self.level_s + self.slope * (host_ns - self.middle_ns) * 1e-9

    def sigma_s(self, host_ns: int, silent_s: float = 0.0) -> float:
        """Spread of the offset there, after silent_s in which nothing was heard."""
        ahead_s = (host_ns - self.middle_ns) * 1e-9 + silent_s
        return math.sqrt(self.level_variance + self.slope_variance * ahead_s**2 + (SKEW_WALK * silent_s) ** 2)


class HostEstimator:
    """Keeps the offset of one host. A step of either clock begins it anew: nothing is blended across it."""

    def __init__(self) -> None:
        self._odd: list[RoundTrip] = []
        self._begin([])

    @property
    def known(self) -> bool:
        """True from the first usable round trip on."""
        return self._trips > 0

    def add(self, trip: RoundTrip) -> bool:
        """Take a round trip in; True where a clock was stepped, and what was known before holds no more."""
        if not trip.usable:
            return False
        if not self._is_odd(trip):
            self._odd.clear()
            self._keep(trip)
            return False
        self._odd.append(trip)
        if len(self._odd) < STEP_TRIPS:
            return False
        self._begin(self._odd)
        self._odd = []
        return True

    def offset(self, silent_s: float = 0.0) -> HostOffset:
        """Return what is known; silent_s: for how long nothing has been heard of the host."""
        line, newest_ns = self._line(), self._newest_ns
        shortest_s = self._shortest_s()
        return HostOffset(
            self._origin.offset_ns + round(line.at(newest_ns) * SECOND_NS),
            line.slope * 1e6,
            line.round_trip_s / 2 + 2 * line.sigma_s(newest_ns, silent_s),
            shortest_s,
            newest_ns,
            self._state(silent_s),
        )

    def _state(self, silent_s: float) -> State:
        if self._trips < LOCK_TRIPS or self._newest_ns - self._origin.at_ns < LOCK_S * SECOND_NS:
            return State.WARMUP
        return State.HOLDOVER if silent_s > SILENT_S else State.LOCKED

    def _begin(self, trips: list[RoundTrip]) -> None:
        self._bins: deque[RoundTrip] = deque()
        self._recent: deque[float] = deque(maxlen=RECENT)  # round trips, s
        self._trips = self._newest_ns = 0
        for trip in trips:
            self._keep(trip)

    def _keep(self, trip: RoundTrip) -> None:
        if not self._trips:
            self._origin = trip
        self._trips += 1
        self._recent.append(trip.on_the_way_s)
        self._newest_ns = max(self._newest_ns, trip.at_ns)
        if self._bins and self._bin(trip) <= self._bin(self._bins[-1]):
            self._bins[-1] = min(self._bins[-1], trip, key=lambda one: one.on_the_way_s)
            return
        self._bins.append(trip)
        while self._bins[-1].at_ns - self._bins[0].at_ns > WINDOW_S * SECOND_NS:
            self._bins.popleft()

    def _bin(self, trip: RoundTrip) -> int:
        return (trip.at_ns - self._origin.at_ns) // round(BIN_S * SECOND_NS)

    def _shortest_s(self) -> float:
        return min(trip.on_the_way_s for trip in self._bins)

    def _unseen_s(self, shortest_s: float) -> float:
        """Return how far off even the best offsets usually are: as the better bins are, or, of a few, all trips."""
        if len(self._bins) < FEW_BINS:
            return (statistics.median(self._recent) - shortest_s) / 2 / math.sqrt(self._trips)
        better = sorted(trip.on_the_way_s - shortest_s for trip in self._bins)
        return better[len(better) // 4] / 2

    def _is_odd(self, trip: RoundTrip) -> bool:
        """True where an offset lies further from the line than waiting can have moved it."""
        if not self._trips:
            return False
        line, shortest_s = self._line(), self._shortest_s()
        off_s = (trip.offset_ns - self._origin.offset_ns) * 1e-9 - line.at(trip.at_ns)
        silent_s = max(0.0, (trip.at_ns - self._newest_ns) * 1e-9)
        if self._trips < LOCK_TRIPS:  # what the smallest round trip waited is not known: only what no queue explains
            waited_s = (trip.on_the_way_s + shortest_s) / 2
        else:
            waited_s = abs(trip.on_the_way_s - shortest_s) / 2 + self._unseen_s(shortest_s)
        return abs(off_s) > waited_s + STEP_S + 3 * line.sigma_s(trip.at_ns, silent_s)

    def _line(self) -> Line:
        """Fit offsets by weighted least squares, the slope with a prior of 0 +- SKEW_SIGMA."""
        shortest_s = self._shortest_s()
        least = SMALLEST_SIGMA_S**2 + self._unseen_s(shortest_s) ** 2
        weights = [1 / (least + ((one.on_the_way_s - shortest_s) / 2) ** 2) for one in self._bins]
        x_s = [(one.at_ns - self._origin.at_ns) * 1e-9 for one in self._bins]
        y_s = [(one.offset_ns - self._origin.offset_ns) * 1e-9 for one in self._bins]
        total = sum(weights)
        x0 = sum(w * x for w, x in zip(weights, x_s, strict=True)) / total
        y0 = sum(w * y for w, y in zip(weights, y_s, strict=True)) / total
        xx = sum(w * (x - x0) ** 2 for w, x in zip(weights, x_s, strict=True)) + SKEW_SIGMA**-2
        xy = sum(w * (x - x0) * (y - y0) for w, x, y in zip(weights, x_s, y_s, strict=True))
        mean_s = sum(w * one.on_the_way_s for w, one in zip(weights, self._bins, strict=True)) / total
        return Line(self._origin.at_ns + x0 * SECOND_NS, y0, xy / xx, 1 / total, 1 / xx, mean_s)
