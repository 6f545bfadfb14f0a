"""One heart rate from several pipelines, and a person's resting baseline; pure."""

import math
from bisect import bisect_right, insort
from collections import deque
from collections.abc import Iterable, Sequence
from operator import itemgetter
from statistics import fmean, median
from typing import NamedTuple

from fusion_affect.tree import Limits

NAN = math.nan


class Reading(NamedTuple):
    """A heart rate as one pipeline of one sensor has it."""

    pipeline: str
    """The sensor_type: `ecg` or `ppg`."""
    sensor_id: str
    source: str
    """`features` = computed by an interpreter, `device` = by the sensor itself."""
    bpm: float
    quality: float
    """0..1; NaN = not known."""
    age_s: float
    reasons: tuple[str, ...] = ()
    topic: str = ""


class HeartRate(NamedTuple):
    """The heart rate of a person, NaN where there is none, and why."""

    bpm: float
    quality: float
    reasons: tuple[str, ...]
    by_pipeline: dict[str, float]
    topics: tuple[str, ...]


def combine(readings: Iterable[Reading], source: str, limits: Limits) -> HeartRate:
    """The mean over the pipelines, each the mean over its sensors; NaN where they disagree.

    Of a sensor that has both, `auto` takes the computed rate and, where that cannot be used, the sensor's own. The
    quality is that of the worst signal used.
    """
    candidates = _by_sensor(readings, source)
    if not candidates:
        wanted = "ecg or ppg heart rate" if source == "auto" else f"ecg or ppg heart rate from {source}"
        return HeartRate(NAN, NAN, (f"there is no {wanted}",), {}, ())
    used, refused = _usable(candidates, limits)
    if not used:
        return HeartRate(NAN, NAN, tuple(refused), {}, ())
    if problem := _disagreement(used, limits.max_disagreement_bpm):
        return HeartRate(NAN, NAN, (problem, *refused), {}, ())
    return _mean_over_pipelines(used, refused)


def _by_sensor(readings: Iterable[Reading], source: str) -> list[list[Reading]]:
    """Readings of the source, those of each sensor and pipeline together, what was computed first."""
    candidates: dict[tuple[str, str], list[Reading]] = {}
    for reading in sorted(readings, key=lambda r: (r.pipeline, r.sensor_id, r.source != "features")):
        if source in ("auto", reading.source):
            candidates.setdefault((reading.pipeline, reading.sensor_id), []).append(reading)
    return list(candidates.values())


def _usable(candidates: Iterable[Iterable[Reading]], limits: Limits) -> tuple[list[Reading], list[str]]:
    """Of each sensor the first reading that can be used, and a sentence for each before it."""
    used: list[Reading] = []
    refused: list[str] = []
    for of_sensor in candidates:
        for reading in of_sensor:
            if not (problem := _problem(reading, limits)):
                used.append(reading)
                break
            refused.append(f"{_name(reading)} {problem}")
    return used, refused


def _mean_over_pipelines(used: list[Reading], refused: list[str]) -> HeartRate:
    by_pipeline = {p: fmean(r.bpm for r in used if r.pipeline == p) for p in sorted({r.pipeline for r in used})}
    told = ", ".join(f"{_name(reading)} {reading.bpm:.1f}" for reading in used)
    bpm = fmean(by_pipeline.values())
    known = [reading.quality for reading in used if not math.isnan(reading.quality)]
    return HeartRate(
        bpm,
        min(known, default=NAN),
        (f"heart rate {bpm:.1f} bpm from {told}", *refused),
        by_pipeline,
        tuple(reading.topic for reading in used),
    )


def _name(reading: Reading) -> str:
    return f"{reading.pipeline}/{reading.sensor_id} {reading.source}"


def _problem(reading: Reading, limits: Limits) -> str:
    """Why a reading is left out; empty where it is used."""
    if reading.age_s > limits.heart_rate_max_age_s:
        return f"is stale: {reading.age_s:.1f} s old"
    if not (math.isfinite(reading.bpm) and reading.bpm > 0):
        why = [reason for reason in reading.reasons if "heart_rate" in reason] or reading.reasons
        return f"is missing{': ' if why else ''}{'; '.join(why)}"
    if reading.quality < limits.min_signal_quality:
        return f"is left out: signal quality {reading.quality:.2f} is below {limits.min_signal_quality:g}"
    return ""


def _disagreement(used: Sequence[Reading], limit_bpm: float) -> str:
    ordered = sorted(used, key=lambda reading: reading.bpm)
    if ordered[-1].bpm - ordered[0].bpm <= limit_bpm:
        return ""
    told = ", ".join(f"{_name(reading)} {reading.bpm:.1f}" for reading in ordered)
    return f"heart rates disagree by more than {limit_bpm:g} bpm: {told}"


class Baseline:
    """The resting heart rate of one person: the median over a stretch of rest, one value per grid point.

    The stretch lies between the markers `baseline_start` and `baseline_end` by their stamps, whenever and in whatever
    order they come, or is the first `first_s` of heart rate. The newest marked stretch takes the place of what was
    learnt before, if it holds enough.
    """

    ENOUGH, KEPT = 10, 3600

    def __init__(self, first_s: float = 0.0) -> None:
        self.bpm = NAN
        """1/min; NaN until learnt."""
        self.reason = ""
        """What is to be known about it; empty where nothing is asked for."""
        self._first = max(math.ceil(first_s), self.ENOUGH) if first_s else 0
        self._learnt: list[float] = []
        self._rates: deque[tuple[int, float]] = deque(maxlen=self.KEPT)  # of the newest grid points, NaN = none
        self._stretch: tuple[int, int] | None = None  # the newest that was marked to its end
        self._resting = False
        self._markers: list[tuple[int, str]] = []

    def mark(self, time_ns: int, name: str) -> None:
        """A marker `baseline_start` or `baseline_end` of this time; it may come before or after its grid point."""
        insort(self._markers, (time_ns, name))
        del self._markers[: -self.KEPT]

    def learn(self, time_ns: int, bpm: float) -> None:
        """The heart rate at a grid point (NaN = none); grid points come in order."""
        self._obey(time_ns)
        self._rates.append((time_ns, bpm))
        if self._first and not self._resting and math.isnan(self.bpm) and not math.isnan(bpm):
            self._learnt.append(bpm)
            self.reason = f"the resting baseline is being learnt: {len(self._learnt)} of {self._first} s"
            if len(self._learnt) >= self._first:
                self._settle(self._learnt)

    def _obey(self, now_ns: int) -> None:
        """Follow the markers so far."""
        begun_ns: int | None = None
        stretch = None
        for time_ns, name in self._markers[: bisect_right(self._markers, now_ns, key=itemgetter(0))]:
            if name == "baseline_start":
                begun_ns = time_ns
            elif begun_ns is not None:
                stretch, begun_ns = (begun_ns, time_ns), None
        if stretch is not None and stretch != self._stretch:
            self._settle([bpm for time_ns, bpm in self._rates if stretch[0] <= time_ns < stretch[1]])
            self._stretch = stretch
        self._resting = begun_ns is not None
        if self._resting:
            self.reason = "the resting baseline is being learnt until the marker baseline_end"

    def _settle(self, points: list[float]) -> None:
        rates = [bpm for bpm in points if not math.isnan(bpm)]
        if len(rates) < self.ENOUGH:
            told = f"the resting baseline was not learnt: {len(rates)} s of heart rate, {self.ENOUGH} are needed"
            stays = "" if math.isnan(self.bpm) else f"; the one of {self.bpm:.1f} bpm stays"
            self.reason = told + stays if points else ""
            return
        self.bpm = median(rates)
        self.reason = f"resting baseline {self.bpm:.1f} bpm"


class Baselines:
    """The resting baseline of everybody, of the MOST seen last; see `Baseline`."""

    MOST = 100

    def __init__(self, first_s: float) -> None:
        self._first_s = first_s
        self._of: dict[str, Baseline] = {}
        self._markers: deque[tuple[int, str, str]] = deque(maxlen=Baseline.KEPT)

    def mark(self, time_ns: int, name: str, human_id: str) -> None:
        """A marker of one person's rest; of everybody's, also who comes later, where human_id is empty."""
        self._markers.append((time_ns, name, human_id))
        for human in self._of if not human_id else {human_id} & self._of.keys():
            self._of[human].mark(time_ns, name)

    def of(self, human_id: str) -> Baseline:
        """Return a person's baseline."""
        baseline = self._of.pop(human_id, None) or self._new(human_id)
        self._of[human_id] = baseline  # behind all others: who was seen longest ago is the first
        if len(self._of) > self.MOST:
            del self._of[next(iter(self._of))]
        return baseline

    def _new(self, human_id: str) -> Baseline:
        baseline = Baseline(self._first_s)
        for time_ns, name, whose in self._markers:
            if whose in ("", human_id):
                baseline.mark(time_ns, name)
        return baseline
