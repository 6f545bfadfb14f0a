"""One optical channel of a PPG stream: its detector, and the quality of its pulses over the window."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from interpreter_ppg import features, jumps, lines, residual
from interpreter_ppg.detector import LOOKAHEAD_S, Pulse, PulseDetector

Floats = NDArray[np.float64]

MOST_PULSES_PER_S = 4
ALONE, CROWDED = 0.8, 0.5  # share of pulses without another wave where no heart beats again: quality 1 and 0 at most


class Channel:
    """One optical channel: its detector and the quality of its pulses over the window."""

    def __init__(self, name: str, column: int, polarity: int, window_s: float) -> None:
        self.name, self.column = name, column
        self.fresh: list[Pulse] = []
        self.quality = np.nan
        self._detector = PulseDetector(polarity)
        self._window_s = window_s
        self._ppg, self._times_s, self._fs_hz = np.empty(0), np.empty(0), np.nan  # as last looked at
        self._jumps = 0  # in them
        self._pulses: deque[Pulse] = deque(maxlen=int(MOST_PULSES_PER_S * window_s) + 8)

    @property
    def score(self) -> float:
        """What the choice of channel goes by: quality, or periodicity while there is none."""
        return self._detector.periodicity / 2 if np.isnan(self.quality) else self.quality

    @property
    def heights(self) -> Floats:
        """Heights of the pulses in the window, shape (n,)."""
        return np.array([pulse.height for pulse in self._pulses])

    def jumps_per_s(self) -> float:
        """Return how often the level jumps in what was looked at last; NaN where that was nothing."""
        return self._jumps * self._fs_hz / len(self._ppg) if len(self._ppg) else np.nan

    def unlink(self) -> None:
        """Take note of a hole after the last samples: no interval is measured across it."""
        self._detector.unlink()

    def look(self, ppg: Floats, times_s: Floats, fs_hz: float, lookahead_s: float) -> None:
        """Find the fresh pulses and the quality. ppg, times_s: shape (n,), evenly spaced and finite, as measured."""
        at = jumps.places(ppg, fs_hz)
        self._jumps, self._ppg = len(at), lines.without_hum(jumps.taken_out(ppg, at), fs_hz)
        self._times_s, self._fs_hz = times_s, fs_hz
        self.fresh = self._detector.look(self._ppg, times_s, fs_hz, lookahead_s)
        self._pulses.extend(self.fresh)
        while self._pulses and self._pulses[0].time_s < times_s[-1] - self._window_s:
            self._pulses.popleft()
        self.quality = self._quality(float(times_s[-1]))

    def jitters_s(self) -> list[float]:
        """Return the standard deviations in s that the noise in the samples gives the times of the fresh pulses."""
        if not self.fresh:
            return []
        noise, times_s = features.sample_noise(self._ppg, self._fs_hz), [pulse.time_s for pulse in self.fresh]
        return [features.jitter_s(noise, self._ppg, self._times_s, time_s, self._fs_hz) for time_s in times_s]

    def second_rhythm_hz(self, told_hz: float) -> float:
        """Return the frequency of another rhythm than the one told; NaN where there is none, or none is told."""
        return lines.second_rhythm_hz(self._ppg, self._fs_hz, told_hz) if np.isfinite(told_hz) else np.nan

    def another_rhythm(self) -> bool:
        """Return whether what is left without the pulses repeats at a rate of its own."""
        rises_s = self._rises_s()
        if not len(rises_s):
            return False
        wave = features.steady(features.slope(self._ppg, self._fs_hz), self._fs_hz)
        return residual.another_rhythm(wave, self._times_s, rises_s)

    def overtones(self) -> float:
        """Return the overtones of the mean pulse over its first harmonic; NaN for fewer than three intervals."""
        rises_s = self._rises_s()
        return features.overtones(self._ppg, self._times_s, rises_s) if len(rises_s) else np.nan

    def _rises_s(self) -> Floats:
        """Return the times of the pulses in what was looked at last, shape (m,)."""
        rises_s = np.array([pulse.time_s for pulse in self._pulses])
        return rises_s[rises_s >= self._times_s[0]] if len(rises_s) else rises_s

    def _quality(self, now_s: float) -> float:
        """Likeness of the pulses with their template, times the share of the window their intervals fill."""
        span_s = min(now_s, self._window_s) - LOOKAHEAD_S
        correlation = np.array([pulse.correlation for pulse in self._pulses])
        likeness = features.likeness(correlation[np.isfinite(correlation)])
        if len(likeness) < 2:
            return np.nan if span_s < 4.0 else 0.0
        rr_s = np.array([pulse.rr_s for pulse in self._pulses])
        regular = rr_s[features.plausible(rr_s)]
        alone = sum(pulse.alone for pulse in self._pulses) / len(self._pulses)
        filled = regular.sum() + regular.mean() if len(regular) else 0.0  # half an interval is open at either end
        uncrowded = min(max((alone - CROWDED) / (ALONE - CROWDED), 0.0), 1.0)
        return float(likeness.mean() * min(1.0, filled / span_s) * uncrowded)
