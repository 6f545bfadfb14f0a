"""The state of one belt, or accelerometer at the chest: the last minute on an even grid, the breaths that were told."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.blocks import Block, Blocks, Hole, Presence
from sense4hri.chunk import TimedChunk
from sense4hri.lasting import IN_DOUBT, Lasting
from sense4hri.living import frozen
from sense4hri.motion import Motion
from sense4hri.slow import GRID_HZ, Slow, newest_run, runs
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_respiration import features
from interpreter_respiration.chest import AXES, Tilt, check_place, feels_gravity
from interpreter_respiration.config import Config
from interpreter_respiration.update import RespirationUpdate

FS_HZ = (5.0, 8000.0)
BRIDGED_S = 1.0  # a shorter hole hides no breath
SETTLED_S = 5.0  # after so much signal a breath does not change any more
EDGE_S = 1.0  # before a hole, where what follows never comes
APART_S = 0.8  # between two breaths
NEEDS_S = 10.0  # of signal before anything is said
SILENT_S = 15.0  # without a breath: apnoea, or no belt
LOOK_S = 60.0  # the past that tells how high a breath is
AGREE = 0.25  # difference of the two rates, as a share, from which they disagree
SURE = 0.5  # likeness from which the autocorrelation is evidence against the peaks
MISSED = 0.1  # of the breaths: so many smaller waves between them, and the rate may be another one
MISSED_PER_MIN, REPEATS = 1.5, 0.7  # and at least so many a minute where breathing is so alike one period later
APNOEA_S = 10.0  # without a breath (AASM manual, Berry et al. 2012)
ABRUPT = 4.0  # times the steepness of a usual breath: up to 3.7 in recordings of rest, from 6 on in most coughs
COUGHS_PER_MIN = 1.9  # among the breaths, from which they spoil the rate
TOO_HIGH = 2.0  # 1/min that the rate is above that of all the window, for pauses that no period holds
LASTING_QUALITY, LASTING_BREATHS = 0.4, 2.5  # before a rate is sure: drift looks like breathing for a moment

Floats = NDArray[np.float64]


class Seen(NamedTuple):
    """What a stretch without a hole shows. values: shape (n, columns); raw: what of them moves with the breath."""

    values: Floats
    times_ns: NDArray[np.int64]
    raw: Floats
    waves: Floats
    spread: float
    breaths: list[features.Breath]  # by indices into these
    every: list[features.Breath]  # and smaller waves between them
    period_s: float  # by autocorrelation
    likeness: float


class Told(NamedTuple):
    """A breath that was told; begin_ns, end_ns: of its inspiration. broken: no period ends with it.

    rise: of the waves, in the unit of the stream; steepness: the most that the signal moves in 0.1 s round it.
    """

    time_ns: int
    begin_ns: int
    end_ns: int
    broken: bool
    rise: float
    steepness: float


class Rate(NamedTuple):
    """What the breaths that were told say. period_s: the mean of periods_s; both NaN where unknown.

    agrees: the autocorrelation is not sure of another rate.
    """

    periods_s: Floats
    period_s: float
    agrees: bool


class Spoilt(NamedTuple):
    """What lowers the quality, 0..1: time at an end of the range, in movements, how much it steps; features.wander."""

    clipped: float
    moved: float
    steps: float
    wander: float


class Numbers(NamedTuple):
    """What is withheld from a poor signal, named as in RespirationUpdate."""

    breaths_per_min: float
    period_s: float
    rrv_rmssd_ms: float
    amplitude: float
    inhale_exhale_ratio: float


WITHHELD = Numbers(np.nan, np.nan, np.nan, np.nan, np.nan)


class RespirationStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate too low for breaths."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz, names = info.sampling_frequency_hz, info.channel_names
        if fs_hz and not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(
                f"sampling_frequency_hz is {fs_hz:g}, must be 0 or {FS_HZ[0]:g} to {FS_HZ[1]:g} for breaths"
            )
        self._config, self._info = config, info
        self._tilt = Tilt() if info.name.sensor_type == "accelerometer" else None
        self._columns = [names.index("respiration") if "respiration" in names else 0]
        if self._tilt:
            self._columns = _axes(info)
        self._blocks = Blocks(config.update_interval_s, bridged_s=BRIDGED_S, filled=True)
        self._slow, self._lasting = Slow(len(self._columns), BRIDGED_S), Lasting(LASTING_QUALITY, at_once=True)
        self._motion = Motion()
        self._presence = Presence(round(config.window_s / config.update_interval_s))
        self._restart()

    def evidence(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take acceleration of the device."""
        self._motion.take(info, timed)

    def push(self, timed: TimedChunk) -> list[RespirationUpdate]:
        """Take the next samples; return the updates that became due."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def _restart(self) -> None:
        self._slow.restart()
        self._lasting.restart()
        self._grid = np.empty((0, len(self._columns)))
        self._values = self._grid  # without what is held
        self._spread, self._times_ns = np.empty(0), np.empty(0, np.int64)
        self._presence.restart()
        self._told: list[Told] = []
        self._told_ns = -(2**62)  # the last breath that was told, or withheld

    def _interpret(self, block: Block) -> list[RespirationUpdate]:
        if block.begins:
            self._restart()
        samples = block.samples[:, self._columns]
        points = self._slow.push(samples, block.times_ns)
        self._presence.add(samples)
        kept = slice(-round((max(self._config.window_s, LOOK_S) + SETTLED_S) * GRID_HZ), None)
        self._grid = np.concatenate([self._grid, points.values])[kept]
        held = frozen(self._grid, round(BRIDGED_S * GRID_HZ))
        held &= ~features.returning(self._grid, held)
        self._values = np.where(held[:, None], np.nan, self._grid)
        self._spread = np.append(self._spread, points.spread)[kept]
        self._times_ns = np.append(self._times_ns, points.times_ns)[kept]
        if block.hole is None:
            return [self._update(block, SETTLED_S)]
        return self._finish(block, block.hole)

    def _finish(self, block: Block, hole: Hole) -> list[RespirationUpdate]:
        """A hole: breaths that wait for what follows are told at once, with the last sample before it."""
        update = self._update(block, EDGE_S)
        if hole is not Hole.CHAIN:
            self._restart()
        return [update] if update.breath_timestamps else []

    def _look(self, run: slice) -> Seen:
        raw, spread = self._shown(self._values[run]), self._spread[run]
        waves = features.breathing(raw) if len(raw) else raw
        found = features.raised(raw, waves, features.breaths(waves)) if len(raw) else []
        known = spread[np.isfinite(spread)]
        period_s, likeness = features.autocorrelation(waves[-round(self._config.window_s * GRID_HZ) :])
        usual = float(np.median(known)) if len(known) else np.nan
        every = features.with_smaller(raw, waves, found)
        if features.evenness(every) > max(features.MOSTLY, features.evenness(found)):
            found = every
        return Seen(self._values[run], self._times_ns[run], raw, waves, usual, found, every, period_s, likeness)

    def _shown(self, values: Floats) -> Floats:
        """What moves with the breath, shape (n,)."""
        if self._tilt is None or not len(values):
            return values[:, 0]
        return self._tilt.along(values, round(self._config.window_s * GRID_HZ))

    def _update(self, block: Block, settled_s: float) -> RespirationUpdate:
        """What the channel says at the end of a block; breaths older than settled_s are told."""
        absent = not len(self._times_ns) or block.end_ns - self._times_ns[-1] > (BRIDGED_S + 0.5) * SECOND_NS
        newest = len(self._values) if absent else newest_run(self._values[:, 0])
        fresh = self._before(newest)
        self._told = [breath for breath in self._told if breath.time_ns > self._start_ns(block)]
        if absent:
            return self._nothing(block, fresh, "the channel holds no number")
        seen = self._look(slice(newest, None))
        problem = self._problem(seen)
        if not problem:
            self._told = self._confirmed(seen)
            fresh += self._fresh(seen, block.end_ns - round(settled_s * SECOND_NS))
            return self._said(block, seen, fresh)
        if not problem.startswith("needs"):
            self._told_ns = block.end_ns
        return self._nothing(block, fresh, problem)

    def _window_s(self, block: Block) -> float:
        return block.window_s(self._config.window_s)

    def _start_ns(self, block: Block) -> int:
        return block.end_ns - round(self._window_s(block) * SECOND_NS)

    def _said(self, block: Block, seen: Seen, fresh: list[int]) -> RespirationUpdate:
        """What is told of breaths that are seen: their numbers, where they are good enough."""
        rate = self._rate(seen)
        quality, notes = self._judged(block, seen, rate)
        good = quality >= self._config.min_quality and rate.agrees
        numbers = self._numbers(seen, rate, self._start_ns(block)) if good else WITHHELD
        return RespirationUpdate(
            block.device_ns,
            block.received_ns,
            self._window_s(block),
            len(self._told),
            tuple(fresh),
            *numbers,
            signal_quality=quality,
            extra=(Feature("autocorrelation_rate", "1/min", (60 / seen.period_s,)),),
            reasons=(*notes, *self._missing(seen, rate, good)),
        )

    def _rate(self, seen: Seen) -> Rate:
        periods_s = self._periods_s()
        period_s = float(np.nanmean(periods_s)) if np.isfinite(periods_s).any() else np.nan
        return Rate(periods_s, period_s, _agree(period_s, seen))

    def _judged(self, block: Block, seen: Seen, rate: Rate) -> tuple[float, list[str]]:
        """(signal quality 0..1, why it is no higher): of the signal, of movement, of doubts in the rate."""
        quality, notes = self._quality(seen, self._window_s(block), rate.agrees)
        quality **= 1 + self._motion.at(block.received_ns, self._config.window_s).strength
        too_short = self._lasting.too_short(quality, block.end_ns, LASTING_BREATHS * rate.period_s)
        if too_short and quality > IN_DOUBT:
            quality = IN_DOUBT
            notes.append(f"signal_quality: above {LASTING_QUALITY:g} for less than {LASTING_BREATHS:g} breaths")
        doubts = self._doubts(seen, rate.periods_s, self._start_ns(block), block.end_ns)
        return min(quality, IN_DOUBT) if doubts else quality, [*notes, *doubts]

    def _numbers(self, seen: Seen, rate: Rate, start_ns: int) -> Numbers:
        recent = [breath for breath in seen.breaths if seen.times_ns[breath.peak] > start_ns]
        return Numbers(
            breaths_per_min=60 / rate.period_s,
            period_s=rate.period_s,
            rrv_rmssd_ms=features.rmssd_ms(rate.periods_s),
            amplitude=float(np.mean(features.heights(seen.raw, recent))) if recent else np.nan,
            inhale_exhale_ratio=np.nan if self._tilt else self._inhale_exhale(),
        )

    def _missing(self, seen: Seen, rate: Rate, good: bool) -> list[str]:
        """Why numbers are NaN."""
        notes = []
        if not good:
            notes.append(self._why_withheld(seen, rate))
        elif np.isnan(rate.period_s):
            notes.append("breaths_per_min, period_s need two breaths")
        if good and not np.isfinite(features.rmssd_ms(rate.periods_s)):
            notes.append("rrv_rmssd_ms needs four breaths")
        if self._tilt:
            notes.append("inhale_exhale_ratio: an accelerometer does not tell in from out")
        return notes

    @property
    def _what(self) -> str:
        return "accelerometer" if self._tilt else "belt"

    def _before(self, newest: int) -> list[int]:
        """Breaths of the stretches before the point `newest`, a hole being between, that were not told; filed."""
        fresh: list[int] = []
        for run in runs(self._values[:newest, 0]):
            end_ns = int(self._times_ns[run.stop - 1])
            if end_ns > self._told_ns and not self._problem(seen := self._look(run)):
                fresh += self._fresh(seen, end_ns - round(EDGE_S * SECOND_NS))
        return fresh

    def _fresh(self, seen: Seen, until_ns: int) -> list[int]:
        """Breaths up to this time that were not told before, filed."""
        fresh = []
        for breath in seen.breaths:
            time_ns = int(seen.times_ns[breath.peak])
            if self._told_ns + round(APART_S * SECOND_NS) < time_ns <= until_ns:
                before_ns = self._told[-1].time_ns if self._told else self._told_ns
                broken = max(int(seen.times_ns[0]), self._told_ns) > before_ns or self._hides(seen, before_ns, breath)
                ends = features.inspiration(seen.raw, breath)
                begin_ns, end_ns = (int(seen.times_ns[0]) + round(at * SECOND_NS / GRID_HZ) for at in ends)
                rise = float(seen.waves[breath.peak] - seen.waves[breath.trough])
                steepness = features.steepness(seen.raw, breath)
                self._told.append(Told(time_ns, begin_ns, end_ns, broken, rise, steepness))
                self._told_ns = time_ns
                fresh.append(time_ns)
        return fresh

    def _confirmed(self, seen: Seen) -> list[Told]:
        """Breaths that were told, without those that the breaths of the last minute show to have been noise.

        Before the first breath nothing tells how high one is. No period is measured across what was no breath.
        """
        least = features.SMALL * features.usual_rise(seen.waves, seen.breaths)
        is_breath = [not told.rise < least for told in self._told]
        return [
            told._replace(broken=told.broken or not after_breath)
            for told, is_one, after_breath in zip(self._told, is_breath, [True, *is_breath], strict=False)
            if is_one
        ]

    def _hides(self, seen: Seen, before_ns: int, breath: features.Breath) -> bool:
        """Whether a shift of posture between two breaths hides others, which makes the period far too long."""
        periods_s = self._periods_s()
        known = np.isfinite(periods_s)
        if not known.any() or known.mean() < features.MOSTLY:
            return False
        usual_s = float(np.median(periods_s[known]))
        if (int(seen.times_ns[breath.peak]) - before_ns) / SECOND_NS < features.LONG * usual_s:
            return False
        return features.shifted(seen.raw, int(np.searchsorted(seen.times_ns, before_ns)), breath.peak)

    def _periods_s(self) -> Floats:
        times_s = np.array([breath.time_ns / SECOND_NS for breath in self._told])
        after_hole = np.array([breath.broken for breath in self._told[1:]], bool)
        return np.where(after_hole, np.nan, np.diff(times_s)) if len(times_s) > 1 else np.empty(0)

    def _doubts(self, seen: Seen, periods_s: Floats, start_ns: int, end_ns: int) -> list[str]:
        """Why the rate may be another one although the belt shows breathing clearly."""
        doubts = [*self._missed(seen), *self._abrupt((end_ns - start_ns) / SECOND_NS)]
        known_s = periods_s[np.isfinite(periods_s)]
        if len(known_s):
            from_ns = max(start_ns, int(seen.times_ns[0]))
            paused_s = self._paused_s(seen, float(np.median(known_s)), from_ns, end_ns)
            too_high = 60 / float(known_s.mean()) * paused_s * SECOND_NS / (end_ns - from_ns)
            if too_high > TOO_HIGH:
                doubts.append(f"no breath for {paused_s:.0f} s more than between others: the rate is that of the rest")
        return doubts

    def _missed(self, seen: Seen) -> list[str]:
        """Why waves between the breaths that were told may be breaths too: they come as evenly, or are high enough."""
        even = seen.every if features.evenness(seen.every) >= features.MOSTLY else []
        high = features.high(seen.waves, seen.every, seen.breaths)
        for waves, why in ((even, "come as evenly"), (high, f"are {features.HIGH:g} of their height")):
            told, missed = self._between(seen, waves)
            if missed >= self._most_missed(seen, told):
                return [f"{missed} smaller waves between {told} breaths {why} and may be breaths too"]
        return []

    def _abrupt(self, window_s: float) -> list[str]:
        """Why some of the breaths that were told may be coughs: far more abrupt than usual, and one too many."""
        if len(self._told) < 3:
            return []
        times_s = np.array([told.time_ns / SECOND_NS for told in self._told])
        steepness = np.array([told.steepness for told in self._told])
        abrupt = steepness > ABRUPT * np.median(steepness)
        one_period = times_s[2:] - times_s[:-2] < features.LONG * np.median(np.diff(times_s))
        coughs = np.count_nonzero(abrupt[1:-1] & one_period)
        if 60 / window_s * coughs < COUGHS_PER_MIN:
            return []
        return [f"{coughs} of {len(times_s)} breaths are as abrupt as coughs, and come too early"]

    def _most_missed(self, seen: Seen, told: int) -> float:
        """How many smaller waves between the breaths that were told leave the rate unsure: one where these are uneven.

        So few between even breaths that are alike would change the rate by less than MISSED_PER_MIN.
        """
        periods_s = self._periods_s()
        if features.even_share(periods_s[np.isfinite(periods_s)]) < features.MOSTLY:
            return 1.0
        span_s = (self._told[-1].time_ns - max(self._told[0].time_ns, int(seen.times_ns[0]))) / SECOND_NS
        alike = MISSED_PER_MIN / 60 * span_s if seen.likeness >= REPEATS else 0.0
        return max(1.0, MISSED * told, alike)

    def _between(self, seen: Seen, waves: list[features.Breath]) -> tuple[int, int]:
        """(breaths that were told, waves between them that are none)."""
        times_ns = np.array([breath.time_ns for breath in self._told if breath.time_ns >= seen.times_ns[0]], np.int64)
        if len(times_ns) < 2:
            return len(times_ns), 0
        near_ns = round(APART_S / 2 * SECOND_NS)
        waves_ns = seen.times_ns[np.array([wave.peak for wave in waves], int)]
        between = waves_ns[(waves_ns > times_ns[0]) & (waves_ns < times_ns[-1])]
        apart_ns = np.abs(between[:, None] - times_ns).min(axis=1)
        return len(times_ns), int(np.count_nonzero(apart_ns > near_ns))

    def _paused_s(self, seen: Seen, usual_s: float, from_ns: int, end_ns: int) -> float:
        """Time from from_ns to end_ns without a breath that no period holds, in s, less what its breaths take usually.

        Where that time begins or ends in a pause, its length in it tells. It has one breath, or half one until it ends.
        """
        edges_s = self._edges_s(seen, from_ns, end_ns)
        breaths = np.array([*[1.0] * (len(edges_s) - 1), 0.5])
        edges_s = (edges_s - breaths * usual_s)[edges_s > features.LONG * usual_s]
        inside_s = [
            (after.time_ns - max(before.time_ns, from_ns)) / SECOND_NS
            for before, after in pairwise(self._told)
            if after.broken
        ]
        return float(edges_s.sum()) + sum(pause_s - usual_s for pause_s in inside_s if pause_s >= APNOEA_S)

    def _edges_s(self, seen: Seen, from_ns: int, end_ns: int) -> Floats:
        """Times before the first breath that was told and after the last, parted by those to be told soon, in s."""
        last_ns = max(self._told[-1].time_ns, from_ns)
        peaks_ns = seen.times_ns[np.array([breath.peak for breath in seen.breaths], int)]
        soon_ns = peaks_ns[peaks_ns > last_ns + round(APART_S * SECOND_NS)]
        after_ns = np.diff(np.concatenate([[last_ns], soon_ns, [end_ns]]))
        return np.concatenate([[self._told[0].time_ns - from_ns], after_ns]) / SECOND_NS

    def _inhale_exhale(self) -> float:
        """Mean time of inspiration over that of expiration; NaN without a whole breath."""
        whole = [(one, after) for one, after in pairwise(self._told) if not after.broken]
        inhale = sum(one.end_ns - one.begin_ns for one, _ in whole)
        exhale = sum(after.begin_ns - one.end_ns for one, after in whole)
        return inhale / exhale if exhale else np.nan

    def _quality(self, seen: Seen, window_s: float, agree: bool) -> tuple[float, list[str]]:
        """(signal quality 0..1, what lowers it)."""
        shown = round(self._config.window_s * GRID_HZ)
        raw, spoilt = seen.raw[-shown:], self._spoilt(seen, shown)
        filled = min(1.0, len(raw) / max(1.0, window_s * GRID_HZ - 2), self._presence.share())
        quality = float(np.interp(features.clean_share(raw, seen.spread), *features.CLEAN))
        quality *= features.rhythm(raw, seen.likeness) * (1 - spoilt.steps)
        quality *= filled * (1 - spoilt.clipped) ** 2 * (1 - min(1.0, spoilt.moved / features.OUTLYING_MOST))
        quality *= float(np.interp(spoilt.wander, *features.WANDERS)) * features.repeats(raw, seen.period_s)
        return quality * (1.0 if agree else 0.5), self._why_spoilt(spoilt)

    def _spoilt(self, seen: Seen, shown: int) -> Spoilt:
        """What spoils the newest points, as many as are shown."""
        raw, waves = seen.raw[-shown:], seen.waves[-shown:]
        return Spoilt(
            clipped=features.clipped(raw, self._info.range_min, self._info.range_max),
            moved=features.outlying(waves),
            steps=features.rise(features.abruptness(raw, waves), features.ABRUPT),
            wander=features.wander(raw, seen.period_s),
        )

    def _why_spoilt(self, spoilt: Spoilt) -> list[str]:
        notes = []
        if spoilt.clipped > 0.003:
            notes.append(f"{self._what} at an end of its range for {100 * spoilt.clipped:.1f} % of the window")
        if spoilt.moved > 0.02:
            notes.append(f"movements or speech: {100 * spoilt.moved:.0f} % of the window is no usual breath")
        if spoilt.steps > 0.3:
            notes.append(f"{self._what} steps from level to level: no chest moves so abruptly")
        if spoilt.wander > features.WANDERS_TOLD:
            notes.append(f"{self._what} wanders from breath to breath as far as a breath is high: drift, or none")
        return notes

    def _why_withheld(self, seen: Seen, rate: Rate) -> str:
        if rate.agrees:
            return f"signal_quality below {self._config.min_quality:g}: all but times and count of breaths withheld"
        both = f"{60 / rate.period_s:.1f} /min by peaks and {60 / seen.period_s:.1f} /min by autocorrelation"
        return f"{both} disagree: all but times and count of breaths withheld"

    def _problem(self, seen: Seen) -> str:
        """Why nothing can be said; empty where something can."""
        low, high = self._info.range_min, self._info.range_max
        if len(seen.raw) < NEEDS_S * GRID_HZ:
            return f"needs {NEEDS_S:g} s of signal without a hole"
        if self._tilt and self._info.unit == "m/s^2" and not feels_gravity(seen.values):
            return "accelerometer does not show gravity: falling, shaken, or not in m/s^2"
        recent = seen.raw[-round(SILENT_S * GRID_HZ) :]
        middle = float(np.median(recent))
        edge = features.AT_RAIL * (high - low)
        if low < high and not low + edge < middle < high - edge:
            return f"{self._what} saturated: at {middle:g} of a range from {low:g} to {high:g}"
        if features.is_still(recent, seen.spread):
            if seen.likeness >= features.ALIKE[1]:
                return f"{self._what} shows noise or mains greater than the breaths in it"
            return f"{self._what} not worn, lifted or saturated: nothing but noise moves it"
        return ""

    def _nothing(self, block: Block, fresh: list[int], problem: str) -> RespirationUpdate:
        nan, warming = np.nan, problem.startswith("needs")
        stamps = block.device_ns, block.received_ns, self._window_s(block)
        extra = (Feature("autocorrelation_rate", "1/min", (nan,)),)
        quality = nan if warming else 0.0
        self._lasting.too_short(quality, block.end_ns, 0.0)  # what comes after it has to last
        return RespirationUpdate(*stamps, -1, tuple(fresh), *WITHHELD, quality, extra, (problem,))


def _agree(period_s: float, seen: Seen) -> bool:
    """False where the autocorrelation is sure of another rate than the peaks."""
    if not seen.likeness >= SURE or np.isnan(period_s):
        return True
    return abs(seen.period_s / period_s - 1) <= AGREE


def _axes(info: StreamInfo) -> list[int]:
    """Columns of x, y and z. Raises ValueError where one is missing, or the device is worn where no breath is felt."""
    check_place(str(info.parameters.get("body_location", "")))
    if missing := [axis for axis in AXES if axis not in info.channel_names]:
        raise ValueError(f"channels are {', '.join(info.channel_names)}; breathing needs {', '.join(missing)} too")
    return [info.channel_names.index(axis) for axis in AXES]
