"""The state of one channel of an EOG: its last minute on an even grid, and until when it has been decided."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.living import LONGEST_HELD_S, frozen
from sense4hri.slow import Slow, newest_run, runs
from sense4hri.stamps import SECOND_NS

from interpreter_eog import features
from interpreter_eog.config import Config

BRIDGED_S = 0.1  # a shorter hole hides no blink
ABSENT = "holds no number"
NEEDS_S = 0.9  # of signal before anything is said
NOISE_AFTER_S = 30.0  # of nothing but noise it is told
AT_RAIL = 0.5  # share of the newest STILL_S at an end of the range that is called saturated
CONTEXT_S = 1.5  # before what is to be decided
BESIDE_S = 0.5  # before and after an event, in which noise may have made it
COUNTS_SPREAD_UV = 50.0  # a channel without a scale is taken to have this standard deviation
COUNTS_MARGIN = 8.0  # times its ripple that its standard deviation is taken for at least

Floats = NDArray[np.float64]


class Blink(NamedTuple):
    """A blink on the event clock; height: of its summit, in uV."""

    time_ns: int
    duration_ms: float
    height: float


class Saccade(NamedTuple):
    """A saccade on the event clock."""

    time_ns: int
    amplitude_uv: float


class Look(NamedTuple):
    """What a channel shows at an update; events also from a little before what was asked for.

    humps: what looks like a blink, upwards and downwards. problem: why nothing can be said of now, empty where it can;
    events are from before it then.
    """

    quality: float
    deflection: float
    humps: tuple[list[Blink], list[Blink]]
    saccades: list[Saccade]
    problem: str


class Channel:
    """Samples in, what they show out. low, high: range of the channel, equal where it is unknown."""

    def __init__(self, config: Config, calibrated: bool, low: float, high: float) -> None:
        self._config, self._calibrated, self._range = config, calibrated, (low, high)
        self._slow = Slow(1, BRIDGED_S, features.GRID_HZ)
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._slow.restart()
        self._grid, self._times_ns = np.empty(0), np.empty(0, np.int64)
        self._raw = self._grid  # without what is held
        self._noise: list[float] = []  # of the samples of each of the newest blocks

    def push(self, samples: Floats, times_ns: NDArray[np.int64]) -> None:
        """Take the next samples, shape (n,)."""
        points = self._slow.push(samples[:, None], times_ns)
        kept = slice(-round((max(self._config.window_s, self._config.baseline_s) + 2) * features.GRID_HZ), None)
        self._grid = np.append(self._grid, points.values[:, 0])[kept]
        held = frozen(self._grid[:, None], round(LONGEST_HELD_S * features.GRID_HZ))
        self._raw = np.where(held, np.nan, self._grid)
        self._times_ns = np.append(self._times_ns, points.times_ns)[kept]
        noise = np.nanmax([features.sample_noise(samples), _median(points.spread), 0.0])
        self._noise = [*self._noise, float(noise)][-round(self._config.window_s / self._config.update_interval_s) :]

    def look(self, end_ns: int, window_s: float, since_ns: int) -> Look:
        """Return what the window shows, and the events since then, those before a hole among them."""
        problem = self._absent(end_ns)
        newest = len(self._raw) if problem.startswith(ABSENT) else newest_run(self._raw)
        before = [run for run in runs(self._raw[:newest]) if self._times_ns[run.stop - 1] > since_ns]
        looks = [self._look(run, int(self._times_ns[run.stop - 1]), window_s, since_ns) for run in before]
        looks.append(_nothing(problem, 0.0) if problem else self._look(slice(newest, None), end_ns, window_s, since_ns))
        up, down = ([blink for look in looks for blink in look.humps[side]] for side in (0, 1))
        return looks[-1]._replace(humps=(up, down), saccades=[each for look in looks for each in look.saccades])

    def known_s(self, after_ns: int, until_ns: int) -> float:
        """Return for how long there was a signal after a time and until another."""
        here = (self._times_ns > after_ns) & (self._times_ns <= until_ns)
        return np.count_nonzero(here & np.isfinite(self._raw)) / features.GRID_HZ

    def levels(self, end_ns: int, window_s: float) -> list[Floats]:
        """Return the stretches of the window without a hole, without noise and mains."""
        begin = int(np.searchsorted(self._times_ns, end_ns - round(window_s * SECOND_NS)))
        return [features.level_of(self._raw[begin:][run]) for run in runs(self._raw[begin:])]

    def _look(self, run: slice, end_ns: int, window_s: float, since_ns: int) -> Look:
        """What a stretch without a hole shows."""
        if len(self._raw[run]) < NEEDS_S * features.GRID_HZ:
            begun = len(self._raw) < NEEDS_S * features.GRID_HZ
            return _nothing(f"needs {NEEDS_S:g} s of signal without a hole", np.nan if begun else 0.0)
        raw, times_ns = self._scaled(self._raw[run]), self._times_ns[run]
        level = features.level_of(raw)
        noise = features.ripple(raw, level)
        quality = self._quality(level[times_ns > end_ns - round(window_s * SECOND_NS)], noise, window_s)
        problem = self._useless(level, noise, quality)
        if problem:
            return _nothing(problem, quality if problem.startswith("quality") else 0.0)
        past = level[-round(self._config.baseline_s * features.GRID_HZ) :]
        deflection = float(level[-1] - np.median(past)) if self._calibrated else np.nan
        return Look(quality, deflection, *self._events(raw, level, times_ns, since_ns), "")

    def _scaled(self, raw: Floats) -> Floats:
        """Microvolts; of a channel without a scale what would be such if it moved as much as eyes usually do."""
        if self._calibrated:
            return raw
        spread = max(float(np.std(raw)), COUNTS_MARGIN * features.ripple(raw, features.level_of(raw)))
        return (raw - raw[0]) * (COUNTS_SPREAD_UV / spread) if spread > 0 else raw - raw[0]

    def _events(
        self, raw: Floats, level: Floats, times_ns: NDArray[np.int64], since_ns: int
    ) -> tuple[tuple[list[Blink], list[Blink]], list[Saccade]]:
        """(blinks upwards and downwards, saccades) since then."""
        limit, margin = features.speed_limit(level), features.NOISE_MARGIN * features.ripple(raw, level)
        begin = int(np.searchsorted(times_ns, since_ns - round(CONTEXT_S * SECOND_NS)))
        raw, level, times_ns = raw[begin:], level[begin:], times_ns[begin:]
        least = max(margin, self._config.least_blink_uv)
        up, down = (
            [
                Blink(int(times_ns[b.peak]), 1e3 * b.duration_s, b.height)
                for b in features.blinks(sign * level, least)
                if b.height >= features.NOISE_MARGIN * _ripple_beside(raw, level, b.peak)
            ]
            for sign in (1, -1)
        )
        steps = [
            step
            for step in features.saccades(level, max(margin, self._config.least_saccade_uv), limit)
            if abs(step.amplitude) >= features.NOISE_MARGIN * _ripple_beside(raw, level, round(step.onset))
        ]
        return (up, down), [Saccade(_time_ns(times_ns, step.onset), step.amplitude) for step in steps]

    def _quality(self, level: Floats, noise: float, window_s: float) -> float:
        """Of the window: the newest stretch without a hole tells how clean, all points how much of it is there."""
        points = round(window_s * features.GRID_HZ)
        filled = min(1.0, float(np.isfinite(self._raw[-points:]).sum()) / max(1.0, points - 3))
        noises = np.maximum(noise, self._noise) if self._calibrated else np.array([noise])
        return features.quality(level, noises, filled)

    def _absent(self, end_ns: int) -> str:
        """Why there is no signal now; empty where there is."""
        if not len(self._raw) or end_ns - self._times_ns[-1] > (BRIDGED_S + 0.2) * SECOND_NS:
            return ABSENT
        newest = self._raw[-round(features.STILL_S * features.GRID_HZ) :]
        low, high = self._range
        if low < high and float(np.mean((newest <= low) | (newest >= high))) > AT_RAIL:
            return "is saturated: at an end of its range"
        return ""

    def _useless(self, level: Floats, noise: float, quality: float) -> str:
        """Why the signal says nothing; empty where it does."""
        if features.is_still(level):
            return "is flat: nothing moves it"
        if len(level) >= NOISE_AFTER_S * features.GRID_HZ and features.is_noise(level, noise):
            return "is flat: nothing but noise moves it"
        if quality < self._config.min_quality:
            return f"quality {quality:.2f} is below {self._config.min_quality:g}"
        return ""


def _ripple_beside(raw: Floats, level: Floats, at: int) -> float:
    """The greater ripple of both sides of a point: a muscle that works for a moment is not in that of the minute."""
    reach = round(BESIDE_S * features.GRID_HZ)
    sides = slice(max(0, at - reach), at), slice(at, at + reach)
    return float(np.nanmax([features.ripple(raw[side], level[side]) for side in sides]))


def _nothing(problem: str, quality: float) -> Look:
    return Look(quality, np.nan, ([], []), [], problem)


def _time_ns(times_ns: NDArray[np.int64], index: float) -> int:
    """The time at an index that may lie between two points, on the grid's steps."""
    return int(times_ns[0]) + round(index * SECOND_NS / features.GRID_HZ)


def _median(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else np.nan
