"""Streaming R-peak detector: causal, bounded, free of scale and polarity. No time but that of the samples."""

from collections import deque
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.hum import hum

from interpreter_ecg.features import Floats, PeakFinder, beat_shape, likeness_to_spike, qrs_energy, qrs_wavelet

DECISION_S = 0.95  # a beat is decided on this long after it, so within 2 s with updates every second
NEAREST_S = 0.15  # a candidate is the largest energy within this reach
REFRACTORY_S = 0.2
VALLEY_REACH_S = 0.5
HUM_REACH_S = 2.0  # before a beat; after it DECISION_S
SPIKE_WIDTHS, SPIKE = 1.12, 0.95  # a spike is hardly wider than what is sharpest at this rate, and nothing besides
LEAST_APART_NS = 150_000_000  # two R peaks; closer ones are one wide complex
T_WAVE_S = 0.36  # up to here, or 60 % of the usual interval, what follows a beat may be its T wave
LATEST_T_WAVE_S = 0.5
AFTERSHOCK_S = 0.4
LEARNING_S = 4.0
LOST_S, LOST_INTERVALS = 2.0, 2.2  # without a beat for so long the level of beats begins to be forgotten
FORGET_S = 3.0

# The threshold between the level of noise and that of beats, by the time since the last beat in usual intervals.
ELAPSED = (0.0, 0.4, 0.6, 1.0, 1.5, 2.2)
SHARE = (0.42, 0.3, 0.24, 0.24, 0.22, 0.18)
LEAST_SHARE = 0.12  # of the level of beats
ABOVE_NOISE = 1.3
ABOVE_T_WAVE = 1.7
ABOVE_AFTERSHOCK = 0.45  # of the beat just before
ABOVE_UNKNOWN = 5.0  # of the noise, once beats have been lost
FORERUNNER_S = (0.26, 0.36)  # a candidate followed so soon by a much larger one ...
FORERUNNER = (0.5, 0.35)  # ... than which it is smaller by these shares is a P wave or a first deflection of it
LOW_QUANTILE = 0.3  # of the energies of the last beats: small ones count, single ones do not
LOST_QUANTILE = 0.1  # of the noises, once beats may be among them
BEATS, NOISES = 8, 32
UPNESS_RATE, FLIPPED = 0.2, 0.3  # the usual polarity changes when the other one is larger by e^0.3 for some beats


class Beat(NamedTuple):
    """One R peak."""

    time_ns: int  # clock of the samples
    height: float  # unit of the samples; negative for a downward peak
    energy: float  # of its QRS complex, unit of the samples (features.qrs_energy)
    complete: bool  # nothing between it and the beat before looked like a further beat
    shape: Floats
    valley: float  # energy between the beats round about, as a share of that of this one


class Detector:
    """R peaks of one lead.

    Candidates are the humps of the QRS energy (features.qrs_energy). Each is accepted or rejected in order, DECISION_S
    after it happened, against a threshold between the learned levels of noise and of beats, which falls as the next
    beat becomes due (Christov 2004, Biomed Eng Online 3:28); in the first part of the interval also against the learned
    level of T waves and against the beat just before. `restart` forgets the levels, `cut` ends a stretch of samples.
    """

    def __init__(self, fs_hz: float) -> None:
        self._fs_hz = fs_hz
        self._wavelet = qrs_wavelet(fs_hz)
        self._half = len(self._wavelet) // 2
        self._near = round(NEAREST_S * fs_hz)
        self._hum_reach = round(HUM_REACH_S * fs_hz)
        self._valley_reach = round(VALLEY_REACH_S * fs_hz)
        self._finder = PeakFinder(fs_hz)
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._levels = _Levels()
        self._sign, self._upness = 0.0, 0.0
        self._begin()

    def _begin(self) -> None:
        """Begin a stretch of contiguous samples."""
        self._ecg: Floats = np.empty(0)
        self._times_ns: NDArray[np.int64] = np.empty(0, np.int64)
        self._energy: Floats = np.empty(0)  # of the samples from 0 on
        self._scanned = self._half  # up to here candidates have been looked for; none where samples were made up
        self._candidates: deque[tuple[int, float]] = deque()
        self._last_ns = -(2**62)  # the last beat

    def push(self, ecg: Floats, times_ns: NDArray[np.int64]) -> list[Beat]:
        """Take contiguous samples, shape (n,); return the beats that are now decided on, in order."""
        self._ecg = np.concatenate((self._ecg, ecg))
        self._times_ns = np.concatenate((self._times_ns, times_ns))
        self._extend_energy(self._ecg)
        self._scan(len(self._energy) - self._near)
        beats = self._decide(len(self._ecg) - DECISION_S * self._fs_hz)
        self._trim()
        return beats

    def cut(self, undone: int = 0) -> list[Beat]:
        """The samples end here, a gap follows: return the beats that were still undecided.

        undone: so many of the last samples were no signal, as `sense4hri.living` tells it.
        """
        self._undo(undone)
        if not len(self._ecg):
            return []
        self._extend_energy(np.pad(self._ecg, (0, self._half), mode="edge"))
        self._scan(len(self._energy) - self._half)
        beats = self._decide(len(self._ecg))
        self._levels.interrupted()
        self._begin()
        return beats

    def _undo(self, count: int) -> None:
        """Forget the last samples, on which nothing has been decided yet."""
        n = len(self._ecg) - count
        self._ecg, self._times_ns = self._ecg[:n], self._times_ns[:n]
        self._energy = self._energy[: max(n - self._half, 0)]
        self._scanned = max(min(self._scanned, len(self._energy) - self._near), self._half)
        self._candidates = deque(candidate for candidate in self._candidates if candidate[0] < self._scanned)

    def _extend_energy(self, ecg: Floats) -> None:
        done = len(self._energy)
        ecg = ecg[done - self._half :] if done else np.pad(ecg, (self._half, 0), mode="edge")
        if len(ecg) >= len(self._wavelet):
            self._energy = np.concatenate((self._energy, qrs_energy(ecg, self._wavelet)))

    def _scan(self, stop: int) -> None:
        """Look for candidates up to the sample `stop`, beyond which more energy may follow."""
        energy, start = self._energy, self._scanned
        if stop <= start:
            return
        self._scanned = stop
        middle, before, after = energy[start:stop], energy[start - 1 : stop - 1], energy[start + 1 : stop + 1]
        for i in np.flatnonzero((middle > before) & (middle >= after)) + start:
            if energy[i] >= energy[max(i - self._near, 0) : i + self._near + 1].max():
                self._candidates.append((int(i), float(energy[i])))

    def _decide(self, stop: float) -> list[Beat]:
        beats = []
        while self._candidates and self._candidates[0][0] < stop:
            at, energy = self._candidates.popleft()
            if self._is_spike(at):
                continue
            time_s = self._times_ns[at] / 1e9
            following = [(self._times_ns[i] / 1e9 - time_s, e) for i, e in self._candidates]
            if self._levels.accept(time_s, energy, following):
                beat = self._beat(at, energy)
                if beat.time_ns > self._last_ns + LEAST_APART_NS:
                    beats.append(beat)
                    self._last_ns = beat.time_ns
        return beats

    def _is_spike(self, middle: int) -> bool:
        """Whether there is nothing but a single sample far off, or the pulse of a pacemaker."""
        peak = self._finder.find(self._around(middle), 0.0)
        if peak.width_s > SPIKE_WIDTHS * self._finder.sharpest_s:
            return False
        return likeness_to_spike(beat_shape(self._ecg, middle + peak.offset_s * self._fs_hz, self._fs_hz)) > SPIKE

    def _around(self, middle: int) -> Floats:
        reach = self._finder.reach
        return self._ecg.take(np.arange(middle - reach, middle + reach + 1), mode="clip")

    def _beat(self, middle: int, energy: float) -> Beat:
        first, reach = max(middle - self._hum_reach, 0), self._finder.reach
        ecg = self._ecg[first : middle + round(DECISION_S * self._fs_hz) + 1]
        ecg = ecg - hum(ecg, self._fs_hz)
        peak = self._finder.find(ecg.take(np.arange(-reach, reach + 1) + middle - first, mode="clip"), self._sign)
        self._settle(peak.upness)
        at = min(max(middle - first + peak.offset_s * self._fs_hz, 0.0), len(ecg) - 1.0)
        shape = beat_shape(ecg, at, self._fs_hz)
        valley = self._valley(middle) / energy
        return Beat(self._time_ns(first + at), peak.height, energy, self._levels.complete, shape, valley)

    def _settle(self, upness: float) -> None:
        """Follow the usual polarity."""
        self._upness += UPNESS_RATE * (float(np.clip(upness, -2, 2)) - self._upness)
        if self._sign == 0 or self._sign * self._upness < -FLIPPED:
            self._sign = 1.0 if self._upness >= 0 else -1.0

    def _time_ns(self, at: float) -> int:
        """The time at a fractional index."""
        i = min(int(at), len(self._ecg) - 2) if len(self._ecg) > 1 else 0
        step_ns = int(self._times_ns[i + 1] - self._times_ns[i]) if len(self._ecg) > 1 else 0
        return int(self._times_ns[i]) + round((at - i) * step_ns)

    def _valley(self, middle: int) -> float:
        around = self._energy[max(middle - self._valley_reach, 0) : middle + self._valley_reach + 1]
        return float(np.partition(around, len(around) * 3 // 10)[len(around) * 3 // 10])

    def _trim(self) -> None:
        """Drop what no later step looks at."""
        first = self._candidates[0][0] if self._candidates else self._scanned
        drop = min(first, self._scanned) - self._near - self._hum_reach
        if drop > 0:
            self._ecg, self._times_ns, self._energy = self._ecg[drop:], self._times_ns[drop:], self._energy[drop:]
            self._scanned -= drop
            self._candidates = deque((i - drop, energy) for i, energy in self._candidates)


class _Levels:
    """What has been learned of the energies of beats, noise and T waves."""

    def __init__(self) -> None:
        self._beats: deque[float] = deque(maxlen=BEATS)
        self._noises: deque[float] = deque(maxlen=NOISES)
        self._t_waves: deque[float] = deque(maxlen=BEATS)
        self._intervals_s: deque[float] = deque(maxlen=BEATS)
        self._early: list[tuple[float, float]] = []  # candidates of the first seconds
        self._last_s: float | None = None  # the last beat, unless a gap came after it
        self._seen_s: float | None = None  # the last beat in any case
        self._last_energy = self._t_wave = self._largest_rejected = 0.0
        self.complete = False

    def interrupted(self) -> None:
        """Samples are missing: the last beat says nothing about the next one."""
        self._last_s = self._seen_s = None

    def accept(self, time_s: float, energy: float, following: list[tuple[float, float]]) -> bool:
        """Whether the candidate is a beat; following: (s after it, energy) of the candidates known so far."""
        level = self._level(time_s, energy, following)
        elapsed_s = np.inf if self._last_s is None else time_s - self._last_s
        if elapsed_s < REFRACTORY_S:
            return False
        usual_s = _quantile(self._intervals_s) if self._intervals_s else 0.8
        lost_s = self._lost_s(time_s, usual_s)
        share = float(np.interp(elapsed_s / usual_s, ELAPSED, SHARE))
        threshold = usual = self._threshold(level, share, 0.5)
        if lost_s:
            level *= float(np.exp(-lost_s / FORGET_S))
            threshold = self._threshold(level, share, LOST_QUANTILE)
            unknown = ABOVE_UNKNOWN * _quantile(self._noises or (0.1 * level,), LOST_QUANTILE)
            threshold = max(threshold, min(unknown, usual))
        t_wave = _quantile(self._t_waves or (0.1 * level,))
        early = elapsed_s < max(T_WAVE_S, min(0.6 * usual_s, LATEST_T_WAVE_S))
        if early:
            threshold = max(threshold, ABOVE_T_WAVE * t_wave)
            if elapsed_s < AFTERSHOCK_S:
                threshold = max(threshold, ABOVE_AFTERSHOCK * self._last_energy)
        forerunner = any(
            after_s < reach_s and energy < part * e
            for after_s, e in following
            for reach_s, part in zip(FORERUNNER_S, FORERUNNER, strict=True)
        )
        if energy > threshold and not forerunner:
            if energy <= usual:
                self._beats.extend([energy] * BEATS)
            self._take(time_s, energy, elapsed_s, level)
            return True
        if early:
            self._t_wave = max(self._t_wave, energy)
        else:
            self._largest_rejected = max(self._largest_rejected, energy)
            if energy < level and not lost_s:
                self._noises.append(energy)
        return False

    def _threshold(self, level: float, share: float, quantile: float) -> float:
        """That share of the way from the noise to the level of beats."""
        noise = _quantile(self._noises or (0.1 * level,), quantile)
        return max(ABOVE_NOISE * noise + share * max(level - noise, 0.0), LEAST_SHARE * level)

    def _lost_s(self, time_s: float, usual_s: float) -> float:
        """How long the next beat has been overdue: has the heart paused, or have the beats become smaller?"""
        if self._seen_s is None:
            self._seen_s = time_s
        return max(time_s - self._seen_s - max(LOST_S, LOST_INTERVALS * usual_s), 0.0)

    def _level(self, time_s: float, energy: float, following: list[tuple[float, float]]) -> float:
        """The energy of the smaller ones of the usual beats."""
        if not self._early or time_s - self._early[0][0] < LEARNING_S:
            self._early.append((time_s, energy))
            known = [*(e for _, e in self._early), *(e for _, e in following)]
            seconds = time_s - self._early[0][0] + (following[-1][0] if following else 0.0)
            learned = _quantile(sorted(known)[-max(1, round(seconds)) :])
            return _quantile([*self._beats, *[learned] * (4 - len(self._beats))], LOW_QUANTILE)
        if not self._beats:
            return energy
        return _quantile(self._beats, LOW_QUANTILE)

    def _take(self, time_s: float, energy: float, elapsed_s: float, level: float) -> None:
        if self._last_s is not None:
            self._intervals_s.append(min(max(elapsed_s, 0.3), 2.0))
            if self._t_wave:
                self._t_waves.append(min(self._t_wave, 0.6 * level))
        self.complete = self._last_s is not None and self._largest_rejected < LEAST_SHARE * level
        self._beats.append(energy)
        self._last_s = self._seen_s = time_s
        self._last_energy = energy
        self._t_wave = self._largest_rejected = 0.0


def _quantile(values: Collection[float], share: float = 0.5) -> float:
    """The value that `share` of the others are below; for a handful of values much faster than numpy."""
    return sorted(values)[round(share * (len(values) - 1))]
