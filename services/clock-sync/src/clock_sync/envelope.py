"""The lower envelope of the delays of a one-way link: a line below every packet, and how sure it is.

A packet gives one pair: `tau_s`, the device time of its newest sample, and `y_s`, receipt minus device time. `y` is the
clock offset plus a delay that is never negative, so the offset runs along the *lower* edge of the cloud; mean-type
filters keep the mean queue as bias.

Method. Minima of 2.5 s bins stand for the packets. Their delays above the line are taken as exponential with mean
`scale`, so the likelihood of a line below all points depends on the lower convex hull alone (Moon, Skelly & Towsley
1999: the hull's supporting line at the centroid is the most likely one). Three things are added to that: a Gaussian
prior of the skew, the *mean* of the posterior instead of its extreme (the extreme touches the points, the mean lies the
expected excess below) and the posterior's spread as the uncertainty. A long window (300 s) gives the skew, the prior
of a shorter one (30-125 s, the longer the noisier) that follows the wander of the crystal. Bins far above the line are
congestion: they are not used, the windows do not run out, the line is held. A minute of bins that stand, a little above
it and in line with each other, are no queue: packets that missed the link's polling by ever less, and now wait for the
next one. The line goes up to them, and by how much stays in the uncertainty.

Packets in step with the link's polling meet only some delays, and many packets meet the smallest of these: the excess
vanishes, and still the line lies anywhere in the gap below. So it keeps half the gap between neighbouring smallest
delays below the packets, as the offline fit of a recording does (`sense4hri_session.clock_fit`).
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from clock_sync.line import (
    FLOOR_S,
    GAP_SMALLEST,
    GATE_S,
    GATE_SCALES,
    Line,
    Point,
    columns,
    fit,
    half_gap,
    median_and_largest,
)

BIN_S = 2.5
# the short window has few bins where delays scatter little and all of them from NOISY_S on
SHORT_BINS, QUIET_BINS, NOISY_S = 50, 12, 2e-3
LONG_S, LONG_MIN_POINTS, LONG_BINS, LONG_FIT_BINS = 300.0, 25, 2, 4
OFTEN_BINS, FIT_BINS = 50, 2  # after so many bins the line is fitted at every second one only
OLDEST_S = 1200.0  # after a hold or a pause the windows reach back further, but not beyond this
SKEW_SIGMA = 60e-6  # a crystal out of the box
WANDER_SIGMA = 6e-6  # skew of the short window against that of the long one
# packets in step with the link's polling never meet some delays: this part of the usual delay stays unknown
LOCK_PHASE = 0.07
SLACK = 50e-6  # by so much per second of congestion its gate opens
GATED_FROM_BINS = 10
GAP_PACKETS = 500  # of the short window, the newest: half the gap between the smallest of their delays
GAP_BINS, GAP_ESTIMATES = 4, 15  # one at every fourth bin; the median of 15 counts
GAP_WIDTHS = 2.0  # of these half gaps: the shortest delay lies anywhere in the gap
YOUNG_BINS, YOUNG_JITTERS = 8, 2.5  # the first bins all touch the line, so their scatter says nothing: the jitter does
FEW_PACKETS = 8  # before so many nothing is usual
HOLD_S = 8.0  # without a usable bin for so long: holding; links that stall for a second every 10 s never are
FALL_S = 0.02  # and ten sigmas, or the gate: a packet so much too early makes the bins before it worthless
MAX_SKEW = 300e-6
# so many congested bins, no higher than a radio's polling interval and scattered by no more, are no queue
STAND_BINS, STAND_HEIGHT_S, STAND_SCALE_S = 24, 0.06, 1e-3


def _towards(median: float, value: float, part: float) -> float:
    """A running median: up by a part of itself where the value is above, down where it is below."""
    return median + part * (median + FLOOR_S) if value > median else median - part * median


class Envelope:
    """The line under one segment's packets, kept up to date packet by packet."""

    def __init__(self) -> None:
        self.line: Line | None = None
        self.usual_delay_s = 0.0  # median of the delays of the short window's packets
        self.jitter_s = 0.01  # running median of the change of y between packets
        self._short: deque[Point] = deque()
        self._long: deque[Point] = deque()
        self._recent: deque[Point] = deque(maxlen=GAP_PACKETS)  # the packets of the short window
        self._gaps: deque[float] = deque(maxlen=GAP_ESTIMATES)
        self._gap_s = 0.0  # how far, as these say, the shortest delay lies under the ones seen
        self._pending: list[Point] = []  # bins on their way into one point of the long window
        self._long_line: Line | None = None
        self._bin = self._used = 0
        self._congested = False
        self._above: deque[Point] = deque(maxlen=STAND_BINS)  # the newest bins, while all are congested
        self._risen_s = 0.0  # how far the line once went up to bins that stand, and has not come down since
        self._lowest: Point = (0.0, 0.0)
        self._first_s = 0.0
        self._good_s = 0.0  # newest tau of a bin that was used
        self._newest: Point = (0.0, 0.0)
        self._fallen_s = 0.0  # how far packets lately pushed the line down, fading

    def copy(self) -> Envelope:
        """An independent copy."""
        twin = Envelope.__new__(Envelope)
        twin.__dict__.update(self.__dict__)
        twin._recent, twin._gaps = self._recent.copy(), self._gaps.copy()
        twin._short, twin._long, twin._pending = self._short.copy(), self._long.copy(), list(self._pending)
        twin._above = self._above.copy()
        return twin

    @property
    def bins(self) -> int:
        """Bins in the short window."""
        return len(self._short)

    def held_s(self) -> float:
        """Seconds of device time since the last bin that was not congested."""
        return max(self._newest[0] - self._good_s - BIN_S, 0.0)

    @property
    def holding(self) -> bool:
        return self.held_s() > HOLD_S

    def age_s(self) -> float:
        """Device time since the segment's first packet, in s."""
        return self._newest[0] - self._first_s

    def uncertainty_s(self) -> float:
        """95 % half width at the newest packet, in s."""
        if self.line is None:
            return math.inf
        spread = 2.0 * self.line.sigma_s(self._newest[0])
        if self._used < YOUNG_BINS:
            spread = max(spread, YOUNG_JITTERS * self.jitter_s / max(self._used, 1))
        unseen = max(LOCK_PHASE * self.usual_delay_s, min(GAP_WIDTHS * self._gap_s, self.usual_delay_s / 2))
        return math.hypot(spread, unseen) + self._fallen_s + self._risen_s + FLOOR_S

    def gate_s(self, tau_s: float) -> float:
        """How far above the line the lowest packet of a bin lies at most where there is no congestion, in s."""
        line = self.line
        assert line is not None
        held = max(tau_s - self._good_s, 0.0)
        return GATE_SCALES * line.scale_s + GATE_S + 3 * line.sigma_s(tau_s) + SLACK * held

    def add(self, tau_s: float, y_s: float) -> float:
        """Take one packet in; returns its delay above the line so far, in s; negative: it came too early for it."""
        line = self.line
        if line is None:
            self.line = Line(tau_s, y_s, 0.0, 1.0, 0.0, SKEW_SIGMA**2, 1.0)
            self._bin, self._lowest, self._newest = int(tau_s // BIN_S), (tau_s, y_s), (tau_s, y_s)
            self._first_s = self._good_s = tau_s
            return 0.0
        number = int(tau_s // BIN_S)
        if tau_s - self._newest[0] > HOLD_S:
            self._good_s += tau_s - self._newest[0]  # a pause is no congestion
        if number > self._bin:
            line = self._close(self._lowest)
            self._bin, self._lowest = number, (tau_s, y_s)
            self._fallen_s *= 0.8
        elif number == self._bin and y_s - self._lowest[1] < line.skew * (tau_s - self._lowest[0]):
            self._lowest = (tau_s, y_s)
        delay = y_s - line.at(tau_s)
        change = abs(y_s - self._newest[1])
        self.jitter_s = _towards(self.jitter_s, change, 0.05)
        if not self._congested:
            self._recent.append((tau_s, y_s))
        self._newest = (max(tau_s, self._newest[0]), y_s)
        if delay < 0.0:
            if -delay > min(FALL_S + 10 * line.sigma_s(tau_s), self.gate_s(tau_s)):
                self._forget()
            self._fallen_s = min(self._fallen_s - delay, 10.0)
            self._risen_s = max(self._risen_s + delay, 0.0)
            self.line = line._replace(level_s=line.level_s + delay)
        return delay

    def _forget(self) -> None:
        """What was seen so far is far above the line: a queue from the start on, or a small step of the clock."""
        self._used = 0
        self._short.clear()
        self._recent.clear()
        self._gaps.clear()
        self._gap_s = 0.0
        self._long.clear()
        self._pending.clear()
        self._long_line = None

    def _look_at_delays(self, line: Line) -> None:
        """Learn anew which delay is usual, and how far the shortest one lies under the ones seen."""
        recent, begun = self._recent, self._short[0][0] - BIN_S
        while recent and recent[0][0] < begun:
            recent.popleft()
        if len(recent) < FEW_PACKETS:
            return
        tau, y = columns(recent)
        delays = y - line.level_s - line.skew * (tau - line.centre_s)
        self.usual_delay_s = max(median_and_largest(delays)[0], 0.0)
        if len(recent) >= GAP_SMALLEST:
            self._gaps.append(half_gap(delays))
            self._gap_s = median_and_largest(np.array(self._gaps))[0]

    def _close(self, point: Point) -> Line:
        """A bin has ended: use its minimum unless it is congested, and fit again."""
        line = self.line
        assert line is not None
        tau, y = point
        self._congested = self._used >= GATED_FROM_BINS and y - line.at(tau) > self.gate_s(tau)
        if self._congested:
            self._above.append(point)
            return self._raised(line)
        self._above.clear()
        self._good_s = tau
        self._used += 1
        short = self._short
        short.append(point)
        wanted = QUIET_BINS + (SHORT_BINS - QUIET_BINS) * min(line.scale_s / NOISY_S, 1.0)
        while len(short) > wanted or short[0][0] < tau - OLDEST_S:
            short.popleft()
        self._pending.append(point)
        if len(self._pending) == LONG_BINS:
            self._lengthen(tau, line.skew)
        often = self._used <= OFTEN_BINS
        if often or self._used % GAP_BINS == 0:
            self._look_at_delays(line)
        if often or self._used % FIT_BINS == 0:
            line = self.line = self._fitted()
        return line

    def _raised(self, line: Line) -> Line:
        """Return the line of the congested bins where they stand: polling slid past the packets, which wait longer."""
        above = self._above
        if len(above) < STAND_BINS or above[0][1] - line.at(above[0][0]) > STAND_HEIGHT_S:
            return line
        higher = fit(above, 0.0, SKEW_SIGMA, STAND_HEIGHT_S)
        if higher.scale_s > STAND_SCALE_S or abs(higher.skew) > MAX_SKEW:
            return line
        self._forget()
        self._risen_s = max(self._risen_s, higher.at(above[0][0]) - line.at(above[0][0]))
        self._short.extend(above)
        self._used, self._good_s, self._congested = len(above), above[-1][0], False
        above.clear()
        self.line = higher
        return higher

    def _lengthen(self, tau: float, skew: float) -> None:
        """Add the lower of the pending bins to the long window."""
        long = self._long
        long.append(min(self._pending, key=lambda p: p[1] - skew * p[0]))
        self._pending.clear()
        while long and long[0][0] < tau - (LONG_S if len(long) > LONG_MIN_POINTS else OLDEST_S):
            long.popleft()

    def _fitted(self) -> Line:
        """The line below the short window, its skew near that of the long one."""
        largest, unseen = max(2.0 * self.jitter_s, FLOOR_S), min(self._gap_s, LOCK_PHASE * self.usual_delay_s)
        if len(self._long) >= SHORT_BINS // LONG_BINS and self._used % LONG_FIT_BINS == 0:
            self._long_line = fit(self._long, 0.0, SKEW_SIGMA, largest)
        skew, sigma = 0.0, SKEW_SIGMA
        if self._long_line is not None:
            skew, sigma = self._long_line.skew, math.sqrt(WANDER_SIGMA**2 + self._long_line.var_skew)
        line = fit(self._short, skew, sigma, largest, unseen)
        return line._replace(skew=min(max(line.skew, -MAX_SKEW), MAX_SKEW))
