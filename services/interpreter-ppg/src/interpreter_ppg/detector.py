"""Pulses of one channel: what has to be remembered from one look at the window to the next."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from interpreter_ppg import features

Floats = NDArray[np.float64]

CONTEXT_S = 8.0  # of signal that period, polarity and typical height are taken from
FIRST_LOOK_S = 1.9  # of signal before polarity and height are believed
RATE_LOOK_S = 3.0  # of signal before a known period is corrected
LOOKAHEAD_S = features.CREST_S + features.REACH * features.DETECTION_SCALE_S  # 0.7 s: what confirms a pulse
CUT_LOOKAHEAD_S = 0.3  # what must do where a hole follows
EDGE_S = 0.15  # nothing is timed this close to the first sample
USUAL_PERIOD_S = 0.8  # until the first periodic stretch
PERIODIC = 0.4  # autocorrelation from which the period is believed ...
CLEARLY_PERIODIC, SLOWER = 0.7, 1.5  # ... and if it got that much longer at once: overestimating it costs pulses
SHARE = 0.35  # of the height of its predecessors that a pulse must reach
EXPECTED = (0.7, 1.0)  # periods after the last pulse between which that share ...
LEAST_SHARE = 0.15  # ... sinks to this: amplitudes fall to a fifth within two pulses in a deep breath
MEMORY_S = 4.0  # how long predecessors count
LONGEST_INTERVAL_S = 2.5  # more is not an interval but a loss of the signal
EVIDENCE_CAP = 6.0  # of summed polarity evidence: what it takes to turn a settled polarity round
TEMPLATE_PULSES = 10


class Pulse(NamedTuple):
    """One confirmed pulse."""

    time_s: float  # steepest rise, s after the first sample of the segment
    rr_s: float  # since the pulse before on this channel; NaN after a gap
    height: float  # prominence of its maximum of the slope
    amplitude: float  # foot to crest, unit of the channel
    correlation: float  # of its shape with the template of its predecessors; NaN for the first ones
    alone: bool  # no wave as high is nearer than a heart can beat again


class PulseDetector:
    """Finds each pulse of one channel once, in order.

    polarity: 1 = rises are systolic, -1 = upside down, 0 = to be found out.
    """

    def __init__(self, polarity: int) -> None:
        self._given = self.polarity = polarity
        self._evidence = 0.0
        self._period_s = USUAL_PERIOD_S
        self._shapes: deque[Floats] = deque(maxlen=TEMPLATE_PULSES)
        self._heights: deque[tuple[float, float]] = deque(maxlen=2)
        self._last_s = self._decided_s = -np.inf
        self._linked = False
        self.periodicity = 0.0

    def unlink(self) -> None:
        """A hole in the signal follows: the next pulse ends no interval."""
        self._linked = False

    def look(self, ppg: Floats, times_s: Floats, fs_hz: float, lookahead_s: float = LOOKAHEAD_S) -> list[Pulse]:
        """Return the pulses confirmed since the last look, those up to lookahead_s before the last sample.

        ppg, times_s: shape (n,), evenly spaced and finite: all of the window, but nothing before the last hole.
        """
        rise = features.slope(ppg, fs_hz)
        context = rise[-int(CONTEXT_S * fs_hz) :]
        self._settle(ppg[-len(context) :], features.steady(context, fs_hz), fs_hz)
        if self.polarity == 0:
            return []
        ppg, rise, context = self.polarity * ppg, self.polarity * rise, self.polarity * context
        since_s, self._decided_s = max(self._decided_s, times_s[0] + EDGE_S), float(times_s[-1]) - lookahead_s
        typical = features.typical_rise(context, fs_hz, self._period_s)
        if not typical > features.ROUNDING * np.ptp(ppg):
            return []
        if len(context) < 2 * self._period_s * fs_hz and self._heights:
            typical = np.inf  # too short to tell: the predecessors know better
        return self._confirmed(ppg, rise, times_s, fs_hz, since_s, typical)

    def _confirmed(
        self, ppg: Floats, rise: Floats, times_s: Floats, fs_hz: float, since_s: float, typical: float
    ) -> list[Pulse]:
        """Return the pulses from since_s until what is decided now; typical: their height in the slope."""
        pulses = []
        for index in features.rises(rise, fs_hz, self._period_s).tolist():
            near_s = float(times_s[index])
            from_s = max(since_s, self._last_s + features.apart(self._period_s))
            if from_s < near_s <= self._decided_s:
                height = features.prominence(rise, index, fs_hz)
                if height >= self._threshold(near_s, typical) and not features.is_pop(ppg, index, fs_hz, height):
                    alone = not features.crowded(rise, index, fs_hz, height)
                    pulses.append(self._confirm(ppg, rise, times_s, fs_hz, near_s, height)._replace(alone=alone))
        return pulses

    def _threshold(self, time_s: float, typical: float) -> float:
        """Height a pulse must reach: a share of its last two predecessors, less the longer it is awaited."""
        recent = [height for at_s, height in self._heights if time_s - at_s < MEMORY_S or np.isinf(typical)]
        if not recent:
            return SHARE * typical
        due = (time_s - self._last_s) / self._period_s
        share = SHARE * (EXPECTED[1] - due) / (EXPECTED[1] - EXPECTED[0])
        share = min(SHARE, max(LEAST_SHARE, share))
        return share * min(typical, sum(recent) / len(recent))

    def _confirm(self, ppg: Floats, rise: Floats, times_s: Floats, fs_hz: float, near_s: float, height: float) -> Pulse:
        time_s = features.steepest(ppg, times_s, near_s, fs_hz)
        rr_s = time_s - self._last_s
        if not self._linked or rr_s > LONGEST_INTERVAL_S:
            rr_s = np.nan
        shape = features.shape(rise, times_s, time_s)
        correlation = np.nan
        if len(self._shapes) >= 2:
            template = np.add.reduce(self._shapes)
            length = float(np.sqrt(template @ template))
            correlation = float(template @ shape) / length if length > 0 else 0.0
        self._shapes.append(shape)
        self._heights.append((time_s, height))
        self._last_s, self._linked = time_s, True
        return Pulse(time_s, rr_s, height, features.amplitude(ppg, times_s, time_s), correlation, True)

    def _settle(self, ppg: Floats, context: Floats, fs_hz: float) -> None:
        """Follow period and polarity; both move slowly, so that an artefact does not turn them."""
        if len(context) < (FIRST_LOOK_S if self.polarity == 0 else RATE_LOOK_S) * fs_hz:
            return
        period_s, self.periodicity = features.period(context, fs_hz)
        if self.periodicity >= (PERIODIC if period_s < SLOWER * self._period_s else CLEARLY_PERIODIC):
            self._period_s = period_s
        if self._given:
            return
        seen = features.polarity_evidence(ppg, context, fs_hz)
        evidence = self._evidence + min(max(seen, -0.5), 0.5)
        self._evidence = min(max(evidence, -EVIDENCE_CAP), EVIDENCE_CAP)
        polarity = -1 if self._evidence < 0 else 1
        if self.polarity in (0, polarity) or abs(self._evidence) > 0.3:
            if self.polarity not in (0, polarity):
                self._shapes.clear()
                self._heights.clear()
                self._linked = False
            self.polarity = polarity
