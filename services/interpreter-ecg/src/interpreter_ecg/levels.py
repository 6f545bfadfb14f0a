"""What has been learned of the energies of beats, noise, T and P waves, and so which candidate is a beat. Pure."""

from collections import deque
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

REFRACTORY_S = 0.2
T_WAVE_S = 0.36  # up to here, or 60 % of the usual interval, what follows a beat may be its T wave
SOONEST_T_WAVE_S, LATEST_T_WAVE_S = 0.25, 0.5  # its top, after a beat
LESS_SHARP = 1.2  # times than the beat before: what follows may be a T wave. 19 of 20 beats reach 1.12 (101, 123)
IN_TURN = 1.05  # times longer than the time to a T wave the interval before is: breathing is no such in every other one
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
    like_t_wave: float  # the same of the wave in its own direction


class Candidate(NamedTuple):
    """What may be a beat. sharpness: its energy of what is fast; wave: features.slow_wave; following: known so far."""

    time_s: float
    energy: float
    sharpness: float
    wave: Wave
    following: list[Follower]

    @property
    def edge(self) -> float:
        """How sharp it is for its energy."""
        return self.sharpness / self.energy


class _Now(NamedTuple):
    """What is usual when a candidate comes. level: of the energies of beats, forgotten while one is overdue."""

    elapsed_s: float  # since the last beat
    usual_s: float  # from beat to beat
    lost_s: float  # that the next one has been overdue
    level: float

    @property
    def early(self) -> bool:
        """Whether it may be the T wave of the last beat."""
        return self.elapsed_s < max(T_WAVE_S, min(0.6 * self.usual_s, LATEST_T_WAVE_S))

    @property
    def share(self) -> float:
        """Of the way from the noise to the level of beats, from which a candidate is one."""
        return float(np.interp(self.elapsed_s / self.usual_s, ELAPSED, SHARE))


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
        self._interval_s = 0.0  # that the last beat ended, 0 after a gap
        self._blunt: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # the same of what may be T waves
        self._dull: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # of what may be T waves, nearly as sharp
        self._large: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # of T waves that may be ventricular beats
        self._wide: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # of those with a T wave of their own
        self._low: deque[tuple[float, float]] = deque(maxlen=2 * BEATS)  # of those that are as sharp as beats
        self._beats_s: deque[float] = deque(maxlen=4 * BEATS)  # when the last beats were
        self._last_energy = self._t_wave = self._t_sharp = self._largest_rejected = self._last_sharpness = 0.0
        self.complete = False
        self.doubtful = self._passed_over = False

    def interrupted(self) -> None:
        """Samples are missing: the last beat says nothing about the next one."""
        self._last_s = self._seen_s = None

    @property
    def usual_s(self) -> float:
        """From beat to beat; before any that of 75 /min."""
        return _quantile(self._intervals_s or (0.8,))

    def accept(self, candidate: Candidate) -> bool:
        """Whether the candidate is a beat."""
        level = self._level(candidate)
        elapsed_s = np.inf if self._last_s is None else candidate.time_s - self._last_s
        if elapsed_s < REFRACTORY_S:
            return False
        usual_s = self.usual_s
        lost_s = self._lost_s(candidate.time_s, usual_s)
        now = _Now(elapsed_s, usual_s, lost_s, level * float(np.exp(-lost_s / FORGET_S)))
        usual = self._threshold(level, now.share, 0.5)
        threshold = self._least_energy(candidate, now, usual)
        if self._is_p_wave(candidate) and candidate.energy > threshold:
            self._passed_over |= self._is_sharp_beat(candidate, now.elapsed_s)
            return False
        blunt = self._is_blunt(candidate, now, min(threshold, max(usual, ABOVE_AFTERSHOCK * self._last_energy)))
        if candidate.energy > threshold and not blunt and not _is_forerunner(candidate):
            if now.lost_s and candidate.energy <= usual:
                self._beats.extend([candidate.energy] * BEATS)
            self._take(candidate, now)
            return True
        self._pass_over(candidate, now, threshold, blunt)
        return False

    def _least_energy(self, candidate: Candidate, now: _Now, usual: float) -> float:
        """Return what a beat has more energy than, now. usual: so much, where the last one is not long ago."""
        least = usual
        if now.lost_s:
            least = self._threshold(now.level, now.share, LOST_QUANTILE)
            unknown = ABOVE_UNKNOWN * _quantile(self._noises or (0.1 * now.level,), LOST_QUANTILE)
            least = max(least, min(unknown, usual))
        if now.early:
            least = max(least, ABOVE_T_WAVE * _quantile(self._t_waves or (0.1 * now.level,)))
            if now.elapsed_s < AFTERSHOCK_S:
                least = max(least, ABOVE_AFTERSHOCK * self._last_energy)
        if PREMATURE_S < now.elapsed_s < now.usual_s and not _bursts(candidate, now.level):
            least = min(least, self._beyond_t_waves(candidate, now))
        return least

    def _is_blunt(self, candidate: Candidate, now: _Now, large: float) -> bool:
        """Whether it is a T wave, however tall; what is hardly less sharp than a beat only makes the rate doubtful."""
        if candidate.energy <= large:
            return False
        blunt = self._is_t_wave(candidate, now.elapsed_s)
        self._passed_over |= self._is_hardly_sharp(candidate, now.elapsed_s)
        return blunt

    def _pass_over(self, candidate: Candidate, now: _Now, threshold: float, blunt: bool) -> None:
        """Learn of what is no beat: a T wave, or noise."""
        self._passed_over |= blunt or (now.early and self._is_large_t_wave(candidate, now.elapsed_s))
        self._passed_over |= self._is_wide_beat(candidate, now.elapsed_s)
        self._passed_over |= self._is_sharp_beat(candidate, now.elapsed_s)
        if now.early or blunt:
            self._t_wave = max(self._t_wave, candidate.energy)
            self._t_sharp = max(self._t_sharp, candidate.sharpness)
            return
        self._largest_rejected = max(self._largest_rejected, candidate.energy)
        small = candidate.energy <= threshold and self._is_small(candidate, now)
        if candidate.energy < now.level and not now.lost_s and not small:
            self._noises.append(candidate.energy)

    def _is_small(self, candidate: Candidate, now: _Now) -> bool:
        """Whether what is too small may be a beat all the same, so long after the last one: no noise."""
        noise = _quantile(self._noises or (0.1 * now.level,))
        if not self._sharpnesses or now.elapsed_s / now.usual_s < SMALL_ELAPSED:
            return False
        if candidate.energy < max(SMALL * now.level, BEYOND_NOISE * noise):
            return False
        return SMALL_AS_SHARP[0] < candidate.edge / _quantile(self._sharpnesses) < SMALL_AS_SHARP[1]

    def _beyond_t_waves(self, candidate: Candidate, now: _Now) -> float:
        """What no T wave has come near, by its energy or by what is sharp in it; infinite where neither is known.

        By energy where T waves come, after a usual beat, whose those are, if it is not as blunt as they; by what is
        sharp in it, if it is no spike, nothing half as large came since the last beat and a pause follows, also later,
        and after a small beat.
        """
        if len(self._t_waves) < KNOWN_T_WAVES or self._last_energy > USUAL_BEAT[1] * now.level:
            return np.inf
        beyond, sharp, usual_sharp = np.inf, candidate.edge, _quantile(self._sharpnesses)
        if now.early and self._last_energy > USUAL_BEAT[0] * now.level and sharp > BLUNT * usual_sharp:
            beyond = BEYOND_T_WAVES * _quantile(self._t_waves, HIGH_QUANTILE)
        alone = max(self._t_wave, self._largest_rejected) < BURST * candidate.energy
        if alone and _pauses(candidate, now) and AS_SHARP[0] * usual_sharp < sharp < AS_SHARP[1] * usual_sharp:
            beyond = min(beyond, BEYOND_T_WAVES * _quantile(self._t_sharps, HIGH_QUANTILE) / (sharp + 1e-12))
        return max(beyond, BEYOND_NOISE * _quantile(self._noises or (0.1 * now.level,)), PREMATURE * now.level)

    def _is_p_wave(self, candidate: Candidate) -> bool:
        """Whether what follows is hardly smaller and far sharper, at a distance at which that has been so before."""
        distances_s = [
            later.after_s
            for later in candidate.following
            if later.after_s < P_WAVE_S
            and P_WAVE[0] * later.energy < candidate.energy < P_WAVE[1] * later.energy
            and later.sharpness > SHARPER
        ]
        if not distances_s:
            return False
        self._p_waves.append((candidate.time_s, distances_s[0]))
        return self._alike(self._p_waves, candidate.time_s, distances_s[0]) >= P_WAVES

    def _is_t_wave(self, candidate: Candidate, elapsed_s: float) -> bool:
        """Whether it is far less sharp for its size than the beat before, at a distance at which most beats have such.

        A fast heart's beats are all as sharp; a ventricular beat follows few of the others so soon, or has a T wave.
        """
        after_s = elapsed_s + candidate.wave.top_s
        if after_s >= LATEST_T_WAVE_S or candidate.edge * SHARPER > self._last_sharpness:
            return False
        if elapsed_s >= T_WAVE_S and candidate.wave.own_t_wave >= OWN_T_WAVE:
            return False
        self._blunt.append((candidate.time_s, after_s))
        return self._follows_most(self._blunt, candidate.time_s, after_s)

    def _is_hardly_sharp(self, candidate: Candidate, elapsed_s: float) -> bool:
        """Whether it has no T wave of its own and follows most beats there, being less sharp or out of their rhythm."""
        after_s = elapsed_s + candidate.wave.top_s
        if not SOONEST_T_WAVE_S < after_s < LATEST_T_WAVE_S or candidate.wave.own_t_wave >= OWN_T_WAVE:
            return False
        sharp = candidate.edge * LESS_SHARP > self._last_sharpness
        if sharp and not self._is_out_of_rhythm(candidate, elapsed_s):
            return False
        self._dull.append((candidate.time_s, after_s))
        return self._follows_most(self._dull, candidate.time_s, after_s)

    def _is_out_of_rhythm(self, candidate: Candidate, elapsed_s: float) -> bool:
        """Whether it comes sooner than the beat before did, and has no T wave at all, as an early narrow beat has."""
        return self._interval_s > IN_TURN * elapsed_s and candidate.wave.like_t_wave < OWN_T_WAVE

    def _is_large_t_wave(self, candidate: Candidate, elapsed_s: float) -> bool:
        """Whether what was passed over is so large that most beats may be followed by a wide one, not by a T wave."""
        if elapsed_s < PREMATURE_S or candidate.energy < LARGE_T_WAVE * self._last_energy:
            return False
        self._large.append((candidate.time_s, elapsed_s))
        return self._follows_most(self._large, candidate.time_s, elapsed_s)

    def _is_wide_beat(self, candidate: Candidate, elapsed_s: float) -> bool:
        """Whether what was passed over has a T wave of its own, as the third at that distance: T waves have none."""
        if not PREMATURE_S <= elapsed_s < np.inf or candidate.wave.own_t_wave < OWN_T_WAVE:
            return False
        if candidate.energy < WIDE_BEAT * self._last_energy:
            return False
        self._wide.append((candidate.time_s, elapsed_s))
        return self._alike(self._wide, candidate.time_s, elapsed_s) >= P_WAVES

    def _is_sharp_beat(self, candidate: Candidate, elapsed_s: float) -> bool:
        """Whether what was passed over is as sharp as the beat before, as no T wave is, and follows most beats so."""
        if elapsed_s >= LATEST_T_WAVE_S or candidate.energy < PREMATURE * self._last_energy:
            return False
        if not AS_SHARP[0] * self._last_sharpness < candidate.edge < AS_SHARP[1] * self._last_sharpness:
            return False
        self._low.append((candidate.time_s, elapsed_s))
        return self._follows_most(self._low, candidate.time_s, elapsed_s)

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

    def _level(self, candidate: Candidate) -> float:
        """The energy of the smaller ones of the usual beats."""
        time_s, energy, _, _, following = candidate
        if not self._early or time_s - self._early[0][0] < LEARNING_S:
            self._early.append((time_s, energy))
            known = [*(e for _, e in self._early), *(later.energy for later in following)]
            seconds = time_s - self._early[0][0] + (following[-1].after_s if following else 0.0)
            learned = _quantile(sorted(known)[-max(1, round(seconds)) :])
            return _quantile([*self._beats, *[learned] * (4 - len(self._beats))], LOW_QUANTILE)
        if not self._beats:
            return energy
        return _quantile(self._beats, LOW_QUANTILE)

    def _take(self, candidate: Candidate, now: _Now) -> None:
        """Learn of a beat."""
        if self._last_s is not None:
            self._intervals_s.append(min(max(now.elapsed_s, 0.3), 2.0))
            if self._t_wave:
                self._t_waves.append(min(self._t_wave, 0.6 * now.level))
                self._t_sharps.append(self._t_sharp)
        silent = self._largest_rejected < min(LEAST_SHARE * now.level, BURST * candidate.energy)
        self.complete = self._last_s is not None and silent
        self.doubtful, self._passed_over = self._passed_over, False
        self._beats.append(candidate.energy)
        self._beats_s.append(candidate.time_s)
        self._interval_s = now.elapsed_s if self._last_s is not None else 0.0
        self._last_s = self._seen_s = candidate.time_s
        self._last_energy, self._last_sharpness = candidate.energy, candidate.edge
        self._sharpnesses.append(candidate.edge)
        self._t_wave = self._t_sharp = self._largest_rejected = 0.0


def _is_forerunner(candidate: Candidate) -> bool:
    """Whether a much larger candidate follows soon, of which it is a first deflection, or the P wave."""
    return any(
        later.after_s < within_s and candidate.energy < share * later.energy
        for later in candidate.following
        for within_s, share in zip(FORERUNNER_S, FORERUNNER, strict=True)
    )


def _bursts(candidate: Candidate, level: float) -> bool:
    """Whether something of half its energy, which is no beat either, follows."""
    soon = [later.energy for later in candidate.following if later.after_s < BURST_S]
    return any(BURST * candidate.energy < other < USUAL_BEAT[0] * level for other in soon)


def _pauses(candidate: Candidate, now: _Now) -> bool:
    """Whether no usual beat follows before a good part of the usual interval."""
    soon = [later for later in candidate.following if later.after_s < PAUSE * now.usual_s]
    return not any(later.energy > USUAL_BEAT[0] * now.level for later in soon)


def _quantile(values: Collection[float], share: float = 0.5) -> float:
    """The value that `share` of the others are below; for a handful of values much faster than numpy."""
    return sorted(values)[round(share * (len(values) - 1))]
