"""What the accelerometer of a device says of an update of another of its streams. Imports no ROS.

An update looks at what was received at least AGE_S before it: old enough to be there in every replay, so the numbers
are the same; what a pulse or a beat is made of is decided on about as much later.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sense4hri.chunk import TimedChunk
from sense4hri.stamps import SECOND_NS
from sense4hri.stream_info import StreamInfo

SENSOR_TYPE, UNIT = "accelerometer", "m/s^2"
AGE_S = 1.0
KEPT_S = 60.0
MOVING_M_S2 = (0.5, 1.5)  # rms without gravity: breath, the heart's own beat and a table stay below, walking is above
RHYTHM_HZ = (0.5, 6.0)  # where steps and arms have their power
NEAR_HZ, NEAR_SHARE = 0.15, 0.06  # how near to a frequency its power is sought: the window's resolution, and its wander
POSTURE_S = 10.0  # who leans back turns gravity once: in so long it is taken to rest
SHORTEST_S = 4.0  # of acceleration for a rhythm


class Motion:
    """The acceleration of one device in the past minute."""

    def __init__(self) -> None:
        self._chunks: deque[TimedChunk] = deque()

    def take(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take samples of the stream `info`; what is no acceleration in m/s^2 is left alone."""
        if info.name.sensor_type != SENSOR_TYPE or info.unit != UNIT:
            return
        self._chunks.append(timed)
        while timed.received_ns - self._chunks[0].received_ns > KEPT_S * SECOND_NS:
            self._chunks.popleft()

    def at(self, received_ns: int, window_s: float) -> "Moved":
        """Return the motion of the window of an update, by its receipt stamp."""
        last_ns = received_ns - round(AGE_S * SECOND_NS)
        first_ns = last_ns - round(window_s * SECOND_NS)
        chunks = [chunk for chunk in self._chunks if first_ns < chunk.received_ns <= last_ns]
        if not chunks or len({chunk.channels for chunk in chunks}) > 1:
            return Moved(np.empty((0, 0)), 0.0)
        samples = np.concatenate([chunk.samples for chunk in chunks])
        span_s = (int(chunks[-1].times_ns[-1]) - int(chunks[0].times_ns[0])) / SECOND_NS
        return Moved(samples, (len(samples) - 1) / span_s if span_s > 0 else 0.0)


class Moved:
    """The acceleration in one window, m/s^2, shape (n, axes), sampled at fs_hz; n is 0 where there is none."""

    def __init__(self, acceleration: NDArray[np.float64], fs_hz: float) -> None:
        acceleration = acceleration[np.isfinite(acceleration).all(axis=1)]
        pieces = np.array_split(acceleration, max(1, round(len(acceleration) / max(fs_hz * POSTURE_S, 1.0))))
        self._dynamic = (
            np.concatenate([each - each.mean(axis=0) for each in pieces]) if len(acceleration) else acceleration
        )
        self._fs_hz = fs_hz

    @property
    def rms_m_s2(self) -> float:
        """The acceleration without its mean of POSTURE_S, all axes together; 0 where there is none."""
        return float(np.sqrt(np.mean(np.sum(self._dynamic**2, axis=1)))) if len(self._dynamic) else 0.0

    @property
    def strength(self) -> float:
        """0 at rest or without an accelerometer, 1 from walking on."""
        return float(np.interp(self.rms_m_s2, MOVING_M_S2, (0.0, 1.0)))

    def rhythm(self, hz: float) -> float:
        """Return the share of the motion's power, 0..1, that has this frequency: steps at the rate of a pulse.

        0 at rest and without an accelerometer; NaN where the device moves and there is too little of it yet to tell.
        """
        if not np.isfinite(hz) or not self.strength:
            return 0.0
        if len(self._dynamic) < SHORTEST_S * self._fs_hz:
            return np.nan
        spectrum = np.fft.rfft(self._dynamic * np.hanning(len(self._dynamic))[:, None], axis=0)
        power, at_hz = (np.abs(spectrum) ** 2).sum(axis=1), np.fft.rfftfreq(len(self._dynamic), 1 / self._fs_hz)
        near = np.abs(at_hz - hz) <= max(NEAR_HZ, NEAR_SHARE * hz)
        within = (at_hz >= RHYTHM_HZ[0]) & (at_hz <= RHYTHM_HZ[1])
        return float(power[near & within].sum() / max(power[within].sum(), 1e-12))
