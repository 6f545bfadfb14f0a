"""Streaming R-peak detector: causal, bounded, free of scale and polarity. No time but that of the samples."""

from collections import deque
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.stamps import SECOND_NS

from interpreter_ecg.features import (
    MEAN_S,
    Floats,
    Peak,
    PeakFinder,
    baseline,
    beat_shape,
    edge,
    likeness_to_spike,
    middle_of_cut,
    qrs_energy,
    qrs_wavelet,
    sharp_wavelet,
    slow_wave,
    unrest,
)
from interpreter_ecg.jumps import Jumps
from interpreter_ecg.levels import Candidate, Follower, Levels, Wave
from interpreter_ecg.mains import mains

DECISION_S = 0.95  # a beat is decided on this long after it, so within 2 s with updates every second
NEAREST_S = 0.15  # a candidate is the largest energy within this reach
VALLEY_REACH_S = 0.5
STRAYS_REACH_S = 5.0  # before a beat; a longer interval is none (stream)
HUM_REACH_S = 2.0  # before a beat; after it DECISION_S
SPIKE_WIDTHS, SPIKE = 1.12, 0.95  # a spike is hardly wider than what is sharpest at this rate, and nothing besides
RESOLVED_HZ, BARE_SPIKE = 100.0, 0.98  # below, so is a narrow QRS complex (up to 0.975 in MIT-BIH), a bare sample not
LEAST_APART_NS = 150_000_000  # two R peaks; closer ones are one wide complex
SHARP_REACH_S = 0.05
EDGE_REACH_S = 0.1  # round the R peak
PULSE_REACH_S = 0.03  # the complex that a pulse of a pacemaker captures has its middle later
LIKE_ELSEWHERE = 2.0  # times larger or smaller than beats elsewhere what is at a pulse may be
P_WAVE_S = 0.28  # so long before a beat its P wave, seen through the wavelet of T waves, may begin
NEXT_BEAT = 0.4  # of the usual energy, from which a candidate may be the next beat (as just after a beat: levels)
T_WAVE_END_S = 0.5  # after a beat, of up to 60 /min; of more, with the root of the interval (Bazett 1920, Heart 7:353)
STRAYS = (0.2, 0.4)  # of the height of a beat: so far no P wave takes the baseline, and in any case no wander
WANDER, FEWEST_BASELINES = 1.5, 4  # times as far as from beat to beat; so many of these tell how far it wanders
UPNESS_RATE, FLIPPED = 0.2, 0.3  # the usual polarity changes when the other one is larger by e^0.3 for some beats


class _Hump(NamedTuple):
    """A hump of the QRS energy."""

    at: int
    energy: float
    sharpness: float  # energy of what is faster than a P wave


class Beat(NamedTuple):
    """One R peak."""

    time_ns: int  # clock of the samples
    height: float  # unit of the samples; negative for a downward peak
    energy: float  # of its QRS complex, unit of the samples (features.qrs_energy)
    complete: bool  # nothing between it and the beat before looked like a further beat
    shape: Floats
    edge: float  # features.edge
    valley: float  # energy between the beats round about, as a share of that of this one
    doubtful: bool  # what would have been a beat since the one before was taken for a T wave
    unrest: float  # features.unrest since the one before, over HUM_REACH_S at most
    jumped: bool  # the baseline has jumped since the one before, or gone as far as no heart's does
    jitter_s: float  # that the noise of the samples gives its time


class Detector:
    """R peaks of one lead.

    Candidates are the humps of the QRS energy (features.qrs_energy). Each is accepted or rejected in order, DECISION_S
    after it happened, against a threshold between the learned levels of noise and of beats, which falls as the next
    beat becomes due (Christov 2004, Biomed Eng Online 3:28); in the first part of the interval also against the learned
    level of T waves and against the beat just before. `restart` forgets the levels, `cut` ends a stretch of samples.
    """

    def __init__(self, fs_hz: float) -> None:
        self._fs_hz = fs_hz
        self._wavelet, self._sharp = qrs_wavelet(fs_hz), sharp_wavelet(fs_hz)
        self._half = len(self._wavelet) // 2
        self._near = round(NEAREST_S * fs_hz)
        self._hum_reach = round(HUM_REACH_S * fs_hz)
        self._strays_reach = round(STRAYS_REACH_S * fs_hz)
        self._valley_reach = round(VALLEY_REACH_S * fs_hz)
        self._finder = PeakFinder(fs_hz)
        self._spike = SPIKE if fs_hz >= RESOLVED_HZ else BARE_SPIKE
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._levels, self._jumps = Levels(), Jumps(self._fs_hz)
        self._sign, self._upness = 0.0, 0.0
        self._begin()

    def _begin(self) -> None:
        """Begin a stretch of contiguous samples."""
        self._ecg: Floats = np.empty(0)  # without jumps
        self._jumped = 0.0  # what is to be added to the samples that come, for the jumps that were taken out
        self._times_ns: NDArray[np.int64] = np.empty(0, np.int64)
        self._energy: Floats = np.empty(0)  # of the samples from 0 on
        self._scanned = self._half  # up to here candidates have been looked for; none where samples were made up
        self._candidates: deque[_Hump] = deque()
        self._pulses: deque[tuple[int, float]] = deque(maxlen=32)  # time and energy of those taken out
        self._jumps_ns: deque[int] = deque(maxlen=32)  # times of those taken out
        self._elsewhere: deque[float] = deque(maxlen=8)  # energies of the last beats at no pulse
        self._baselines: deque[float] = deque(maxlen=8)  # before the last beats
        self._last_ns = -(2**62)  # the last beat

    def push(self, ecg: Floats, times_ns: NDArray[np.int64]) -> list[Beat]:
        """Take contiguous samples, shape (n,); return the beats that are now decided on, in order."""
        self._times_ns = np.concatenate((self._times_ns, times_ns))
        self._extend(ecg)
        self._extend_energy(self._ecg[: -self._jumps.unsure])
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

    def _extend(self, ecg: Floats) -> None:
        known = max(len(self._ecg) - self._jumps.context, 0)
        clean = self._jumps.taken_out(np.concatenate((self._ecg[known:], ecg + self._jumped)))
        self._ecg = np.concatenate((self._ecg[:known], clean))
        gain = abs(self._wavelet[self._half])
        self._pulses += [(int(self._times_ns[known + i]), gain * height) for i, height in self._jumps.pulses]
        self._jumps_ns += [int(self._times_ns[known + i]) for i in self._jumps.jumps]
        if len(ecg):
            self._jumped = float(clean[-1] - ecg[-1])

    def _undo(self, count: int) -> None:
        """Forget the last samples, on which nothing has been decided yet."""
        n = len(self._ecg) - count
        self._ecg, self._times_ns = self._ecg[:n], self._times_ns[:n]
        self._energy = self._energy[: max(n - self._half, 0)]
        self._scanned = max(min(self._scanned, len(self._energy) - self._near), self._half)
        self._candidates = deque(candidate for candidate in self._candidates if candidate.at < self._scanned)

    def _extend_energy(self, ecg: Floats) -> None:
        if not len(ecg):
            return
        begin = len(self._energy) - self._half
        ecg = ecg[begin:] if begin >= 0 else np.pad(ecg, (-begin, 0), mode="edge")
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
                self._candidates.append(_Hump(int(i), float(energy[i]), self._sharpness(int(i))))

    def _sharpness(self, middle: int) -> float:
        reach = len(self._sharp) // 2 + round(SHARP_REACH_S * self._fs_hz)
        around = self._ecg.take(np.arange(middle - reach, middle + reach + 1), mode="clip")
        return float(qrs_energy(around, self._sharp).max())

    def _decide(self, stop: float) -> list[Beat]:
        beats = []
        while self._candidates and self._candidates[0].at < stop:
            at, energy, sharpness = self._candidates.popleft()
            pulse = self._pulse_at(at)
            if self._is_spike(at) or (energy < pulse and not self._is_usual(energy)):
                continue
            time_s = self._time_s(at)
            following = [
                Follower(self._time_s(later.at) - time_s, later.energy, later.sharpness / (sharpness + 1e-12))
                for later in self._candidates
            ]
            wave = self._slow_wave(at, energy, following)
            if self._levels.accept(Candidate(time_s, energy, sharpness, wave, following)):
                beat = self._beat(at, energy)
                if beat.time_ns > self._last_ns + LEAST_APART_NS:
                    beats.append(beat)
                    self._last_ns = beat.time_ns
                    self._elsewhere += [] if pulse else [energy]
        return beats

    def _slow_wave(self, middle: int, energy: float, following: list[Follower]) -> Wave:
        """features.slow_wave, as far as the P wave of the next candidate that has more energy, or a beat's."""
        usual = NEXT_BEAT * median(self._elsewhere) if self._elsewhere else energy
        next_s = min((later.after_s for later in following if later.energy > min(energy, usual)), default=np.inf)
        return Wave(*slow_wave(self._ecg, middle, self._fs_hz, next_s - P_WAVE_S))

    def _time_s(self, at: int) -> float:
        return int(self._times_ns[at]) / 1e9

    def _pulse_at(self, middle: int) -> float:
        """The energy of the pulse that was taken out there, 0 without one: what is smaller may be left of it."""
        near_ns = PULSE_REACH_S * SECOND_NS
        at_ns = self._times_ns[middle]
        return max((energy for time_ns, energy in self._pulses if abs(time_ns - at_ns) < near_ns), default=0.0)

    def _is_usual(self, energy: float) -> bool:
        """Whether beats that were at no pulse are as large."""
        return bool(self._elsewhere) and 1 / LIKE_ELSEWHERE < energy / median(self._elsewhere) < LIKE_ELSEWHERE

    def _is_spike(self, middle: int) -> bool:
        """Whether there is nothing but a single sample far off, or the pulse of a pacemaker; hum makes beats narrow."""
        around = self._near_beat(middle)
        return self._like_spike(self._ecg, middle) and self._like_spike(
            self._without_hum(around, middle), middle - around.start
        )

    def _like_spike(self, ecg: Floats, middle: int) -> bool:
        peak = self._find(ecg, middle, 0.0)
        if peak.width_s > SPIKE_WIDTHS * self._finder.sharpest_s:
            return False
        return likeness_to_spike(beat_shape(ecg, middle + peak.offset_s * self._fs_hz, self._fs_hz)) > self._spike

    def _find(self, ecg: Floats, middle: int, usual_sign: float) -> Peak:
        reach = self._finder.reach
        return self._finder.find(ecg.take(np.arange(middle - reach, middle + reach + 1), mode="clip"), usual_sign)

    def _near_beat(self, middle: int) -> slice:
        """The samples in which the hum at a beat is looked for."""
        return slice(max(middle - self._hum_reach, 0), middle + round(DECISION_S * self._fs_hz) + 1)

    def _without_hum(self, around: slice, middle: int) -> Floats:
        ecg = self._ecg[around]
        return ecg - mains(ecg, self._energy[around], middle - around.start, self._fs_hz)

    def _beat(self, middle: int, energy: float) -> Beat:
        around = self._near_beat(middle)
        first, ecg = around.start, self._without_hum(around, middle)
        peak = self._find(ecg, middle - first, self._sign)
        self._settle(peak.upness)
        at = min(max(middle - first + peak.offset_s * self._fs_hz, 0.0), len(ecg) - 1.0)
        cut = middle_of_cut(self._ecg[around], at, peak.height, self._fs_hz)
        at = at if np.isnan(cut) else cut
        shape = beat_shape(ecg, at, self._fs_hz)
        reach = round(EDGE_REACH_S * self._fs_hz)
        edge_ = edge(ecg.take(np.arange(round(at) - reach, round(at) + reach + 1), mode="clip"))
        valley = self._valley(middle) / energy
        time_ns, levels = self._time_ns(first + at), self._levels
        unrest_ = self._unrest(middle, first, around.stop, reach)
        jitter_s, complete, doubtful = self._finder.jitter_s(ecg, peak), levels.complete, levels.doubtful
        jumped = any(self._last_ns < jump_ns < time_ns for jump_ns in self._jumps_ns)
        jumped |= self._strays(middle, abs(peak.height))
        return Beat(time_ns, peak.height, energy, complete, shape, edge_, valley, doubtful, unrest_, jumped, jitter_s)

    def _strays(self, middle: int, height: float) -> bool:
        """Whether the baseline goes much further between T and P wave than from beat to beat, or too far.

        A heart that pauses leaves it where it was. An electrode that is off does not, nor does a wide beat passed over.
        """
        p_wave = max(middle - round(P_WAVE_S * self._fs_hz), 0)
        t_wave_end_ns = round(T_WAVE_END_S * min(self._levels.usual_s, 1.0) ** 0.5 * SECOND_NS)
        t_wave_end = int(np.searchsorted(self._times_ns, self._last_ns + t_wave_end_ns))
        between = baseline(self._ecg[t_wave_end:p_wave], self._fs_hz)
        known = len(self._baselines) >= FEWEST_BASELINES
        wander = max(self._baselines) - min(self._baselines) if known else np.inf
        self._baselines.append(self._baseline_before(p_wave))
        most = min(STRAYS[1] * height, max(STRAYS[0] * height, WANDER * wander))
        return float(np.ptp(between)) > most

    def _baseline_before(self, p_wave: int) -> float:
        return float(self._ecg[max(p_wave - round(MEAN_S * self._fs_hz), 0) : p_wave + 1].mean())

    def _unrest(self, middle: int, first: int, stop: int, reach: int) -> float:
        """Of the samples from `first` or the last beat on, against those to `reach` round a beat and until `stop`."""
        begin = max(first, int(np.searchsorted(self._times_ns, self._last_ns + LEAST_APART_NS)))
        between, after = self._ecg[begin : max(middle - self._near, 0)], self._ecg[middle + self._near : stop]
        return unrest(between, self._ecg[max(middle - reach, 0) : middle + reach + 1], after)

    def _settle(self, upness: float) -> None:
        """Follow the usual polarity."""
        self._upness += UPNESS_RATE * (min(max(upness, -2.0), 2.0) - self._upness)
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
        first = self._candidates[0].at if self._candidates else self._scanned
        drop = min(first, self._scanned) - self._near - self._strays_reach
        if drop > 0:
            self._ecg, self._times_ns, self._energy = self._ecg[drop:], self._times_ns[drop:], self._energy[drop:]
            self._scanned -= drop
            self._candidates = deque(c._replace(at=c.at - drop) for c in self._candidates)
