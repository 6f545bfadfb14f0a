"""The true rate of a stream by its device's stamps. Imports no ROS."""

import math

import numpy as np

from sense4hri.stamps import SECOND_NS

MEMORY_S = 60.0  # of signal that the running rate remembers
RATE_TRUST = 0.25  # share by which a measured rate may differ from the declared one before it is not believed
STEADY_FRAMES = 8  # frames in a row that agree with each other, but not with the declared rate, correct it
STEADY = 0.05  # share within which they agree
AGREEING, JITTERING = 3, 32  # frames by which the rate is known, where they agree with each other and where not


class RunningRate:
    """Samples over time with a fading memory; starts from the declared rate."""

    def __init__(self, nominal_hz: float) -> None:
        self.nominal_hz = self.fs_hz = self._expected_hz = nominal_hz
        self._samples = self._seconds = 0.0
        self._frames, self._slowest_hz, self._fastest_hz = 0, math.inf, 0.0
        self._odd: list[tuple[int, int]] = []
        self._held: list[tuple[int, int]] = []

    def restart(self) -> None:
        self._samples = self._seconds = 0.0
        self._frames, self._slowest_hz, self._fastest_hz = 0, math.inf, 0.0
        self._odd.clear()
        self._held.clear()

    def add_odd(self, n: int, delta_ns: int) -> None:
        """Take a frame that does not fit the rate; many alike mean that the declared rate is wrong."""
        self._held.clear()
        self._odd = [*self._odd[1 - STEADY_FRAMES :], (n, delta_ns)]
        rates = np.array([n * SECOND_NS / delta_ns for n, delta_ns in self._odd])
        middle = float(np.median(rates))
        if len(rates) < STEADY_FRAMES or np.any(np.abs(rates / middle - 1) > STEADY):
            return
        if abs(middle / self.nominal_hz - 1) < RATE_TRUST:
            self.restart()
            self.fs_hz = self._expected_hz = middle

    def add(self, n: int, delta_ns: int, *, doubtful: bool = False) -> None:
        """Take a frame of n samples. doubtful: samples may be missing before it, which the next frames tell."""
        self._odd.clear()
        if doubtful:
            self._held.append((n, delta_ns))
            return
        for each in self._held:
            self._add(*each)
        self._held.clear()
        self._add(n, delta_ns)

    def _add(self, n: int, delta_ns: int) -> None:
        delta_s = delta_ns / SECOND_NS
        keep = max(0.0, 1.0 - delta_s / MEMORY_S)
        self._samples = keep * self._samples + n
        self._seconds = keep * self._seconds + delta_s
        measured_hz = self._samples / self._seconds
        if abs(measured_hz / self.nominal_hz - 1) < RATE_TRUST:
            self.fs_hz = measured_hz if self._sure(n / delta_s) else self._expected_hz

    def _sure(self, frame_hz: float) -> bool:
        """Whether the rate is known: soon where frames agree, else later."""
        self._frames += 1
        self._slowest_hz, self._fastest_hz = min(self._slowest_hz, frame_hz), max(self._fastest_hz, frame_hz)
        agree = self._fastest_hz < (1 + 2 * STEADY) * self._slowest_hz
        return self._frames >= (AGREEING if agree else JITTERING)
