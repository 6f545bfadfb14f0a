"""What has been learned of the energies of beats, noise, T and P waves, and so which candidate is a beat. Pure."""

from collections import deque
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

REFRACTORY_S = 0.2
T_WAVE_S = 0.36  # up to here, or 60 % of the usual interval, what follows a beat may be its T wave
SOONEST_T_WAVE_S, LATEST_T_WAVE_S = 0.25, 0.5  # its top, after a beat
LESS_SHARP = 1.2  # times than the beat before: what follows may be a T wave. 19 of 20 beats reach 1.12 (101, 123)
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
PREMATURE_S = 0.3  # so long after a beat one with a fifth of the usual energy is one that came early ...
PREMATURE, USUAL_BEAT = 0.2, (0.8, 1.5)  # ... unless that beat was larger than usual, whose T wave is so too, ...
KNOWN_T_WAVES, HIGH_QUANTILE, BEYOND_T_WAVES = 6, 0.8, 2.5  # ... where T waves are small, or far less sharp, ...
BLUNT, AS_SHARP, BEYOND_NOISE = 0.4, (0.85, 1.5), 3.0  # ... by these parts of the usual sharpness, noise is small, ...
PAUSE = 0.65  # ... no usual beat comes before this part of the usual interval after it, ...
BURST, BURST_S = 0.5, 0.5  # ... and nothing of half its energy, no beat either, comes so soon after it
ABOVE_AFTERSHOCK = 0.45  # of the beat just before
ABOVE_UNKNOWN = 5.0  # of the noise, once beats have been lost
FORERUNNER_S = (0.26, 0.36)  # a candidate followed so soon by a much larger one ...
FORERUNNER = (0.5, 0.35)  # ... than which it is smaller by these shares is a P wave or a first deflection of it
P_WAVE_S, P_WAVE = 0.34, (0.2, 1.4)  # one followed so soon by one of which it has a share between these ...
SHARPER = 1.8  # ... and so many times sharper is a P wave, however tall, ...
P_WAVES, P_WAVES_S, P_AGREE_S = 3, 8.0, 0.03  # ... as the third at that distance in so long
T_WAVES_SHARE = 0.45  # of the beats in so long have one, if what follows a beat, as much less sharp, is its T wave
LARGE_T_WAVE = 0.29  # of the energy of the beat before: nine MIT-BIH records have 0.28 at most, a wide beat 0.32
WIDE_BEAT, OWN_T_WAVE = 0.14, 0.12  # of that energy, if a wave in the other direction follows, which is so large
SMALL, SMALL_ELAPSED = 0.25, 0.6  # of the level of beats, and of the usual interval: what may be a small beat ...
SMALL_AS_SHARP = (0.85, 1.2)  # ... if it is as sharp as these parts of the usual sharpness
LOW_QUANTILE = 0.3  # of the energies of the last beats: small ones count, single ones do not
LOST_QUANTILE = 0.1  # of the noises, once beats may be among them
BEATS, NOISES = 8, 32


class Follower(NamedTuple):
    """A candidate as seen from one before it."""

    after_s: float
    energy: float
    sharpness: float  # in those of the one before it


class Wave(NamedTuple):
    """A candidate as what is slower than a QRS complex shows it."""

    top_s: float  # after the middle of its QRS energy
    own_t_wave: float  # how large the wave in the other direction is that follows, as a share of it


class Levels:
    """Decides which candidates are beats: by a threshold between the levels of beats and of noise; in order of time."""

    def __init__(self) -> None:
        self._beats: deque[float] = deque(maxlen=BEATS)
        self._noises: deque[float] = deque(maxlen=NOISES)
        self._t_waves: deque[float] = deque(maxlen=BEATS)
        self._t_sharps: deque[float] = deque(maxlen=BEATS)  # the sharpest of them, or of what was taken for them
        self._intervals_s: deque[float] = deque(maxlen=BEATS)
        self._sharpnesses: deque[float] = deque(maxlen=BEATS)
        self._early: list[tuple[float, float]] = []  # candidates of the first seconds
        self._p_waves: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # (time, s to what follows) of what may be
        self._last_s: float | None = None  # the last beat, unless a gap came after it
        self._seen_s: float | None = None  # the last beat in any case
        self._blunt: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # the same of what may be T waves
        self._dull: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # of what may be T waves, nearly as sharp
        self._large: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # of T waves that may be ventricular beats
        self._wide: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # of those with a T wave of their own
        self._beats_s: deque[float] = deque(maxlen=4 * BEATS)  # when the last beats were
        self._last_energy = self._t_wave = self._t_sharp = self._largest_rejected = self._last_sharpness = 0.0
        self.complete = False
        self.doubtful = self._passed_over = False

    def interrupted(self) -> None:
        """Samples are missing: the last beat says nothing about the next one."""
        self._last_s = self._seen_s = None

    def accept(self, time_s: float, energy: float, sharpness: float, wave: Wave, following: list[Follower]) -> bool:
        """Whether the candidate is a beat.

        sharpness: its energy of what is fast; wave: features.slow_wave; following: what is known so far.
        """
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
        early = elapsed_s < max(T_WAVE_S, min(0.6 * usual_s, LATEST_T_WAVE_S))
        if early:
            threshold = max(threshold, ABOVE_T_WAVE * _quantile(self._t_waves or (0.1 * level,)))
            if elapsed_s < AFTERSHOCK_S:
                threshold = max(threshold, ABOVE_AFTERSHOCK * self._last_energy)
        if PREMATURE_S < elapsed_s < usual_s and not self._bursts(energy, level, following):
            paused = not any(f.energy > USUAL_BEAT[0] * level for f in following if f.after_s < PAUSE * usual_s)
            threshold = min(threshold, self._beyond_t_waves(early, paused, energy, sharpness, level))
        if self._is_p_wave(time_s, energy, following) and energy > threshold:
            return False
        forerunner = any(
            (later.after_s < FORERUNNER_S[0] and energy < FORERUNNER[0] * later.energy)
            or (later.after_s < FORERUNNER_S[1] and energy < FORERUNNER[1] * later.energy)
            for later in following
        )
        large = energy > min(threshold, max(usual, ABOVE_AFTERSHOCK * self._last_energy))
        blunt = large and self._is_t_wave(time_s, elapsed_s, sharpness / energy, wave)
        self._passed_over |= large and self._is_hardly_sharp(time_s, elapsed_s, sharpness / energy, wave)
        if energy > threshold and not forerunner and not blunt:
            if lost_s and energy <= usual:
                self._beats.extend([energy] * BEATS)
            self._take(time_s, energy, elapsed_s, level)
            self._last_sharpness = sharpness / energy
            self._sharpnesses.append(self._last_sharpness)
            return True
        self._passed_over |= blunt or (early and self._is_large_t_wave(time_s, elapsed_s, energy))
        self._passed_over |= self._is_wide_beat(time_s, elapsed_s, energy, wave.own_t_wave)
        if early or blunt:
            self._t_wave = max(self._t_wave, energy)
            self._t_sharp = max(self._t_sharp, sharpness)
        else:
            self._largest_rejected = max(self._largest_rejected, energy)
            small = energy <= threshold and self._is_small(energy, sharpness, level, elapsed_s / usual_s)
            if energy < level and not lost_s and not small:
                self._noises.append(energy)
        return False

    def _is_small(self, energy: float, sharpness: float, level: float, elapsed: float) -> bool:
        """Whether what is too small, so many usual intervals after a beat, may be one all the same: no noise."""
        noise = _quantile(self._noises or (0.1 * level,))
        if not self._sharpnesses or elapsed < SMALL_ELAPSED or energy < max(SMALL * level, BEYOND_NOISE * noise):
            return False
        return SMALL_AS_SHARP[0] < sharpness / energy / _quantile(self._sharpnesses) < SMALL_AS_SHARP[1]

    def _bursts(self, energy: float, level: float, following: list[Follower]) -> bool:
        """Whether something of half its energy, which is no beat either, follows."""
        soon = [later.energy for later in following if later.after_s < BURST_S]
        return any(BURST * energy < other < USUAL_BEAT[0] * level for other in soon)

    def _beyond_t_waves(self, early: bool, paused: bool, energy: float, sharpness: float, level: float) -> float:
        """What no T wave has come near, by its energy or by what is sharp in it; infinite where neither is known.

        By energy where T waves come, after a usual beat, whose those are, if it is not as blunt as they; by what is
        sharp in it, if it is no spike, nothing half as large came since the last beat and a pause follows, also later,
        and after a small beat.
        """
        if len(self._t_waves) < KNOWN_T_WAVES or self._last_energy > USUAL_BEAT[1] * level:
            return np.inf
        beyond, sharp, usual_sharp = np.inf, sharpness / energy, _quantile(self._sharpnesses)
        if early and self._last_energy > USUAL_BEAT[0] * level and sharp > BLUNT * usual_sharp:
            beyond = BEYOND_T_WAVES * _quantile(self._t_waves, HIGH_QUANTILE)
        alone = max(self._t_wave, self._largest_rejected) < BURST * energy
        if alone and paused and AS_SHARP[0] * usual_sharp < sharp < AS_SHARP[1] * usual_sharp:
            beyond = min(beyond, BEYOND_T_WAVES * _quantile(self._t_sharps, HIGH_QUANTILE) / (sharp + 1e-12))
        return max(beyond, BEYOND_NOISE * _quantile(self._noises or (0.1 * level,)), PREMATURE * level)

    def _is_p_wave(self, time_s: float, energy: float, following: list[Follower]) -> bool:
        """Whether what follows is hardly smaller and far sharper, at a distance at which that has been so before."""
        distances_s = [
            later.after_s
            for later in following
            if later.after_s < P_WAVE_S
            and P_WAVE[0] * later.energy < energy < P_WAVE[1] * later.energy
            and later.sharpness > SHARPER
        ]
        if not distances_s:
            return False
        self._p_waves.append((time_s, distances_s[0]))
        alike = [abs(d - distances_s[0]) < P_AGREE_S for at_s, d in self._p_waves if time_s - at_s < P_WAVES_S]
        return sum(alike) >= P_WAVES

    def _is_t_wave(self, time_s: float, elapsed_s: float, sharpness: float, wave: Wave) -> bool:
        """Whether it is far less sharp for its size than the beat before, at a distance at which most beats have such.

        A fast heart's beats are all as sharp; a ventricular beat follows few of the others so soon, or has a T wave.
        """
        after_s = elapsed_s + wave.top_s
        if after_s >= LATEST_T_WAVE_S or sharpness * SHARPER > self._last_sharpness:
            return False
        if elapsed_s >= T_WAVE_S and wave.own_t_wave >= OWN_T_WAVE:
            return False
        self._blunt.append((time_s, after_s))
        return self._follows_most(self._blunt, time_s, after_s)

    def _is_hardly_sharp(self, time_s: float, elapsed_s: float, sharpness: float, wave: Wave) -> bool:
        """Whether it is less sharp than the beat before, has no T wave of its own, and follows most beats there."""
        after_s = elapsed_s + wave.top_s
        sharp = sharpness * LESS_SHARP > self._last_sharpness
        if sharp or not SOONEST_T_WAVE_S < after_s < LATEST_T_WAVE_S or wave.own_t_wave >= OWN_T_WAVE:
            return False
        self._dull.append((time_s, after_s))
        return self._follows_most(self._dull, time_s, after_s)

    def _is_large_t_wave(self, time_s: float, elapsed_s: float, energy: float) -> bool:
        """Whether what was passed over is so large that most beats may be followed by a wide one, not by a T wave."""
        if elapsed_s < PREMATURE_S or energy < LARGE_T_WAVE * self._last_energy:
            return False
        self._large.append((time_s, elapsed_s))
        return self._follows_most(self._large, time_s, elapsed_s)

    def _is_wide_beat(self, time_s: float, elapsed_s: float, energy: float, own_t_wave: float) -> bool:
        """Whether what was passed over has a T wave of its own, as the third at that distance: T waves have none."""
        late = PREMATURE_S <= elapsed_s < np.inf
        if not late or energy < WIDE_BEAT * self._last_energy or own_t_wave < OWN_T_WAVE:
            return False
        self._wide.append((time_s, elapsed_s))
        return self._alike(self._wide, time_s, elapsed_s) >= P_WAVES

    def _follows_most(self, such: Collection[tuple[float, float]], time_s: float, elapsed_s: float) -> bool:
        """Whether nearly half of the beats told lately were followed by such, (time, s after), at that distance."""
        beats = sum(time_s - at_s < P_WAVES_S for at_s in self._beats_s)
        return self._alike(such, time_s, elapsed_s) >= max(P_WAVES, T_WAVES_SHARE * beats)

    @staticmethod
    def _alike(such: Collection[tuple[float, float]], time_s: float, elapsed_s: float) -> int:
        """How many such, (time, s after the beat before), were at that distance lately."""
        return sum(abs(d - elapsed_s) < P_AGREE_S for at_s, d in such if time_s - at_s < P_WAVES_S)

    def _threshold(self, level: float, share: float, quantile: float) -> float:
        """That share of the way from the noise to the level of beats."""
        noise = _quantile(self._noises or (0.1 * level,), quantile)
        return max(ABOVE_NOISE * noise + share * max(level - noise, 0.0), LEAST_SHARE * level)

    def _lost_s(self, time_s: float, usual_s: float) -> float:
        """How long the next beat has been overdue: has the heart paused, or have the beats become smaller?"""
        if self._seen_s is None:
            self._seen_s = time_s
        return max(time_s - self._seen_s - max(LOST_S, LOST_INTERVALS * usual_s), 0.0)

    def _level(self, time_s: float, energy: float, following: list[Follower]) -> float:
        """The energy of the smaller ones of the usual beats."""
        if not self._early or time_s - self._early[0][0] < LEARNING_S:
            self._early.append((time_s, energy))
            known = [*(e for _, e in self._early), *(later.energy for later in following)]
            seconds = time_s - self._early[0][0] + (following[-1].after_s if following else 0.0)
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
                self._t_sharps.append(self._t_sharp)
        silent = self._largest_rejected < min(LEAST_SHARE * level, BURST * energy)
        self.complete = self._last_s is not None and silent
        self.doubtful, self._passed_over = self._passed_over, False
        self._beats.append(energy)
        self._beats_s.append(time_s)
        self._last_s = self._seen_s = time_s
        self._last_energy = energy
        self._t_wave = self._t_sharp = self._largest_rejected = 0.0


def _quantile(values: Collection[float], share: float = 0.5) -> float:
    """The value that `share` of the others are below; for a handful of values much faster than numpy."""
    return sorted(values)[round(share * (len(values) - 1))]
