"""Where the beats come from: an endless simulated heart, one per participant.

Times here are seconds of true time since the bench's start.
"""

import bisect
import math
from typing import NamedTuple, Protocol

import numpy as np

from sensor_bench.signals.waveforms import FloatArray

KEEP_BEATS_S = 4 * 3600.0
"""Beats older than this are forgotten, so that a bench that runs for days stays small."""


class Beat(NamedTuple):
    """An R peak at `time_s`, `rr_s` after the previous one."""

    time_s: float
    rr_s: float


class Heart:
    """An endless heartbeat with respiratory and slow variability; made only as far ahead as is asked for."""

    def __init__(self, seed: int, heart_rate_bpm: float = 66.0, respiration_hz: float = 0.25) -> None:
        self._rng = np.random.default_rng(seed)
        self.heart_rate_bpm = heart_rate_bpm
        self.respiration_hz = respiration_hz
        self._phases = self._rng.uniform(0, 2 * math.pi, 2)
        self._times: list[float] = [-2.0]
        self._rrs: list[float] = [60.0 / heart_rate_bpm]

    def _next_rr_s(self, now_s: float) -> float:
        """RR interval with 3 % respiratory sinus arrhythmia, 2 % of 0.1 Hz waves, and 1 % beat-to-beat noise."""
        breath = 0.03 * math.sin(2 * math.pi * self.respiration_hz * now_s + self._phases[0])
        slow = 0.02 * math.sin(2 * math.pi * 0.1 * now_s + self._phases[1])
        noise = 0.01 * float(self._rng.standard_normal())
        return 60.0 / self.heart_rate_bpm * (1 + breath + slow + max(-0.03, min(0.03, noise)))

    def _extend(self, until_s: float) -> None:
        while self._times[-1] < until_s:
            rr_s = self._next_rr_s(self._times[-1])
            self._times.append(self._times[-1] + rr_s)
            self._rrs.append(rr_s)
        if self._times[0] < until_s - 2 * KEEP_BEATS_S:
            keep = bisect.bisect_left(self._times, until_s - KEEP_BEATS_S)
            del self._times[:keep], self._rrs[:keep]

    def beats(self, from_s: float, to_s: float) -> list[Beat]:
        """Beats with from_s <= time < to_s, in order."""
        self._extend(to_s)
        first, last = bisect.bisect_left(self._times, from_s), bisect.bisect_left(self._times, to_s)
        return [Beat(t, rr) for t, rr in zip(self._times[first:last], self._rrs[first:last], strict=True)]

    def breathing(self, times_s: FloatArray) -> FloatArray:
        """Chest movement, -1..1, in step with the respiratory arrhythmia."""
        return np.sin(2 * np.pi * self.respiration_hz * times_s + self._phases[0])


class Rhythm(Protocol):
    """Where the beats come from: a simulated heart or the one in a recording."""

    @property
    def heart_rate_bpm(self) -> float: ...

    def beats(self, from_s: float, to_s: float) -> list[Beat]: ...

    def breathing(self, times_s: FloatArray) -> FloatArray: ...
