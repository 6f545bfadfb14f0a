"""A skin that sweats: a level that drifts, and responses to whatever comes. Times are seconds of true time."""

import numpy as np

from sensor_bench.signals.waveforms import FloatArray

EVERY_S = 12.0  # one response in each span of so long
RISE_S, DECAY_S, LASTS_S = 0.75, 3.0, 30.0
SHAPE_PEAK = 0.4725  # of the difference of both exponentials


class Skin:
    """Conductance in uS as a function of time and seed alone."""

    def __init__(self, seed: int, level_us: float = 5.0) -> None:
        self._seed, self.level_us = seed, level_us

    def responses(self, from_s: float, to_s: float) -> list[tuple[float, float]]:
        """Onset in s and height in uS of the responses that begin within [from_s, to_s)."""
        spans = range(int(from_s // EVERY_S), int(to_s // EVERY_S) + 1)
        found = [self._response(span) for span in spans if span >= 0]
        return [(at_s, height_us) for at_s, height_us in found if from_s <= at_s < to_s]

    def at(self, times_s: FloatArray) -> FloatArray:
        """Conductance at these rising times, in uS."""
        conductance = self.level_us * (1 + 0.05 * np.sin(2 * np.pi * times_s / 180))
        for onset_s, height_us in self.responses(float(times_s[0]) - LASTS_S, float(times_s[-1])):
            after_s = np.maximum(times_s - onset_s, 0.0)
            conductance += height_us / SHAPE_PEAK * (np.exp(-after_s / DECAY_S) - np.exp(-after_s / RISE_S))
        return conductance

    def _response(self, span: int) -> tuple[float, float]:
        rng = np.random.default_rng((self._seed, span))
        return (span + rng.uniform(0.1, 0.6)) * EVERY_S, self.level_us * rng.uniform(0.05, 0.2)
