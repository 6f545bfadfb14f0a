"""When each muscle of a stream is active: onsets and offsets with hysteresis, against the level of rest.

Two windows decide: the shorter the burst, the stronger it must be (docs/decisions/emg-onsets.md).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt
from sense4hri.stamps import SECOND_NS

from interpreter_emg.cleaning import BAND_HZ, BELOW_NYQUIST
from interpreter_emg.features import change

HIGHEST_HZ = 250.0  # above, a muscle at the skin has little and amplifiers have their noise
FINE_S = 0.005  # resolution of events
HOP_S, HOP_PERIODS = 0.05, 10.0  # a hop is as long as that, and as so many periods of the bandwidth
LONG, SHORT, RECENT = 10, 3, 5  # hops: of a weak activity (median), of a strong one (least), and since one ended
STRONG = 2.0  # times onset_ratio that a short burst has
REST_S, REST_LEAST_S, REST_EVERY = 20.0, 2.0, 20  # the span of rest, before anything is told, and hops between looks
REST_QUANTILE = 0.25
HOLD_S = 0.6  # that an event waits, because another channel may confirm an earlier one
LOOK_HOPS = 30  # in which the moment of an onset or offset is looked for

Floats = NDArray[np.float64]


class Event(NamedTuple):
    """The activity of a channel, by its number, begins or ends."""

    time_ns: int
    channel: int
    onset: bool


class Bursts:
    """Finds the activity in cleaned samples. least_rms: in their unit, below it nothing is active.

    active: shape (channels,), bool; rest_rms: shape (channels,), NaN until it is known. heart: shape (channels,),
    bool, set from outside where there are, or may be, heartbeats: they are no short bursts.
    """

    def __init__(self, fs_hz: float, channels: int, ratios: tuple[float, float], least_rms: float) -> None:
        self._channels, self._on, self._off = channels, ratios[0] ** 2, ratios[1] ** 2
        self._least_power = least_rms**2
        self._sos = butter(2, BAND_HZ[0], "highpass", fs=fs_hz, output="sos")
        if BELOW_NYQUIST * fs_hz / 2 > HIGHEST_HZ:
            self._sos = butter(2, (BAND_HZ[0], HIGHEST_HZ), "bandpass", fs=fs_hz, output="sos")
        bandwidth_hz = min(HIGHEST_HZ, BELOW_NYQUIST * fs_hz / 2) - BAND_HZ[0]
        self._fine = max(1, round(FINE_S * fs_hz))
        self._fines = max(1, round(max(HOP_S, HOP_PERIODS / bandwidth_hz) * fs_hz / self._fine))
        self._hop_s = self._fines * self._fine / fs_hz
        self._least = np.full(channels, self._least_power)
        self.restart()

    def restart(self) -> None:
        """Forget the level of rest."""
        self._rest = np.full(self._channels, np.nan)
        self.heart = np.ones(self._channels, bool)
        self._hops = 0
        self._held: list[Event] = []
        self._newest_told_ns = -(2**62)
        self._quiet = np.empty((0, self._channels))
        self.interrupted()

    def interrupted(self) -> None:
        """The next samples do not follow on those before; who was active is so no more."""
        empty = np.empty((0, self._channels))
        self.active = np.zeros(self._channels, bool)
        self._state = np.zeros((len(self._sos), 2, self._channels))
        self._left, self._left_ns = empty, np.empty(0, np.int64)
        self._squares, self._squares_ns, self._powers = empty, np.empty(0, np.int64), empty
        self._told_ns, self._lost = np.full(self._channels, -(2**62)), np.zeros(self._channels, int)

    @property
    def rest_rms(self) -> Floats:
        return np.asarray(np.sqrt(self._rest))

    def push(self, values: Floats, times_ns: NDArray[np.int64], hidden_rms: Floats) -> list[Event]:
        """Take the next samples, shape (n, channels), NaN where there is none; return the events up to HOLD_S ago.

        They are in order from push to push, each later than the one before, if by 1 ns only.

        hidden_rms: shape (channels,), of mains and rounding that may be in them still.
        """
        self._least = np.maximum(self._least_power, hidden_rms**2)
        band, self._state = sosfilt(self._sos, np.nan_to_num(values), axis=0, zi=self._state)
        self._left = np.concatenate([self._left, np.where(np.isfinite(values), band**2, np.nan)])
        self._left_ns = np.concatenate([self._left_ns, times_ns])
        size = self._fine * self._fines
        for _ in range(len(self._left) // size):
            fines = self._left[:size].reshape(self._fines, self._fine, self._channels).mean(axis=1)
            self._held += self._hop(fines, self._left_ns[: size : self._fine])
            self._left, self._left_ns = self._left[size:], self._left_ns[size:]
        return self._told(int(times_ns[-1]) - round(HOLD_S * SECOND_NS))

    def end(self, end_ns: int) -> list[Event]:
        """Samples are missing from here on: what is active ends, and nothing waits any longer."""
        self._held += [Event(end_ns, int(channel), False) for channel in np.flatnonzero(self.active)]
        self.interrupted()
        return self._told(end_ns)

    def _told(self, until_ns: int) -> list[Event]:
        """The held events up to a time, in order; two at once, and one that comes too late, are told 1 ns later."""
        told = []
        for event in sorted(event for event in self._held if event.time_ns <= until_ns):
            self._newest_told_ns = max(event.time_ns, self._newest_told_ns + 1)
            told.append(event._replace(time_ns=self._newest_told_ns))
        self._held = [event for event in self._held if event.time_ns > until_ns]
        return told

    def _hop(self, fines: Floats, times_ns: NDArray[np.int64]) -> list[Event]:
        """One more hop, by its finest steps, shape (k, channels)."""
        kept = LOOK_HOPS * self._fines
        self._squares = np.concatenate([self._squares, fines])[-kept:]
        self._squares_ns = np.concatenate([self._squares_ns, times_ns])[-kept:]
        self._powers = np.concatenate([self._powers, self._power(fines)[None]])[-LONG:]
        self._learn()
        if len(self._powers) < LONG:
            return []
        rest = np.maximum(self._rest, self._least)
        newest = self._powers[-RECENT:]
        long, short = np.median(self._powers, axis=0), self._powers[-SHORT:].min(axis=0)
        recent = np.nan_to_num(newest).sum(axis=0) / np.maximum(np.isfinite(newest).sum(axis=0), 1)
        strong = ~self.heart & (short > STRONG**2 * self._on * rest)
        begins = ~self.active & ((long > self._on * rest) | strong)
        ends = self.active & (np.isnan(newest[-1]) | ~(np.fmax(recent, long) > self._off * rest))
        self.active = (self.active | begins) & ~ends
        return [self._event(int(channel)) for channel in np.flatnonzero(begins | ends)]

    def _power(self, fines: Floats) -> Floats:
        """The power of a hop; where most of it is missing, that of the hop before, and NaN from LONG such hops on."""
        known = np.isfinite(fines)
        count = known.sum(axis=0)
        power = np.where(known, fines, 0.0).sum(axis=0) / np.maximum(count, 1)
        lost = 2 * count <= self._fines
        self._lost = np.where(lost, self._lost + 1, 0)
        before = self._powers[-1] if len(self._powers) else np.nan
        return np.where(lost, np.where(self._lost < LONG, before, np.nan), power)

    def _learn(self) -> None:
        """Take the newest hop into rest where nothing is active; now and then, tell the level of rest anew."""
        self._quiet = np.concatenate([self._quiet, np.where(self.active, np.nan, self._powers[-1])[None]])
        self._quiet = self._quiet[-round(REST_S / self._hop_s) :]
        self._hops += 1
        if self._hops % REST_EVERY and np.isfinite(self._rest).all():
            return
        ordered, count = np.sort(self._quiet, axis=0), np.isfinite(self._quiet).sum(axis=0)
        at = (REST_QUANTILE * np.maximum(count - 1, 0)).astype(int)
        enough = count * self._hop_s >= REST_LEAST_S
        self._rest = np.where(enough, ordered[at, np.arange(self._channels)], self._rest)

    def _event(self, channel: int) -> Event:
        """The onset or offset that has just become certain, at its moment."""
        rising = bool(self.active[channel])
        fresh = np.isfinite(self._squares[:, channel]) & (self._squares_ns > self._told_ns[channel])
        at = change(self._squares[fresh, channel], rising)
        self._told_ns[channel] = self._squares_ns[fresh][at]
        return Event(int(self._told_ns[channel]), channel, rising)
