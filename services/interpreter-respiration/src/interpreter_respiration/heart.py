"""The state of breathing from one ECG: the beats of the last minute, and the breaths that were told."""

from typing import NamedTuple

import numpy as np
from sense4hri.blocks import Block, Blocks, Hole
from sense4hri.chunk import TimedChunk
from sense4hri.motion import Motion
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Feature
from sense4hri.stream_info import StreamInfo

from interpreter_respiration import fusion
from interpreter_respiration.beats import Beat, alike, intervals_s, longest_pause_s, swing
from interpreter_respiration.config import Config
from interpreter_respiration.features import rise, spread_of
from interpreter_respiration.lead import Lead
from interpreter_respiration.update import RespirationUpdate

FS_HZ = (50.0, 8000.0)
FILLED_S = 1.0  # a longer loss lets the search for beats begin anew
MOST_LEADS = 3  # the first ones, that are looked at
NEEDS_S = 40.0  # of beats before anything is said, in a short window as much as COVERED of it
COVERED = (0.3, 0.9)  # share of the window that lies between beats in a row: quality 0 and 1
IRREGULAR = 0.2  # spread of the intervals, as a share of the median, from which they show more than breathing
OUTLYING = 0.15  # share of beats that may be ectopic, or none
HIDES = 0.75  # of a breath between two beats, from which one may have come and gone unseen
SWINGS = 0.7  # share of height or area that the baseline moves: up to 0.3 in recordings, 3 where a cable swings
CONFIRMED = 0.6  # likeness from which intervals, which no baseline moves, confirm QRS complexes
SILENT_S = 5.0  # of samples without a beat: there is no heart in them
SAME = 1.0  # 1/min between the rates of all beats and of those that look alike
FASTEST = 0.45  # breaths per beat that beats can show
SETTLED_S = 5.0  # after so much signal a breath does not change any more
APART_S = 0.8  # between two breaths
NEVER = "rrv_rmssd_ms, amplitude, inhale_exhale_ratio: beats do not tell them"
NO_TIMES = (
    "breath_timestamps: without sinus arrhythmia that QRS complexes confirm beats do not tell when lungs are full"
)


class Shown(NamedTuple):
    """What a lead shows: beats in a row, the share of the window that they cover, why they say nothing."""

    beats: list[Beat]
    covered: float
    problem: str


class HeartStream:
    """A Step of the kit (sense4hri.step). Raises ValueError for a rate no ECG has."""

    def __init__(self, config: Config, info: StreamInfo) -> None:
        fs_hz = info.sampling_frequency_hz
        if not FS_HZ[0] <= fs_hz <= FS_HZ[1]:
            raise ValueError(
                f"sampling_frequency_hz is {fs_hz:g}, must be {FS_HZ[0]:g} to {FS_HZ[1]:g} for breaths from an ECG"
            )
        self._config = config
        self._blocks = Blocks(config.update_interval_s, bridged_s=FILLED_S, filled=True)
        self._names = info.channel_names[:MOST_LEADS]
        blocks = round(config.window_s / config.update_interval_s)
        self._leads = [Lead(fs_hz, blocks) for _ in self._names]
        self._motion = Motion()
        self._told_ns = -(2**62)

    def evidence(self, info: StreamInfo, timed: TimedChunk) -> None:
        """Take acceleration of the device."""
        self._motion.take(info, timed)

    def push(self, timed: TimedChunk) -> list[RespirationUpdate]:
        """Take the next samples; return the updates that became due."""
        return [update for block in self._blocks.take(timed) for update in self._interpret(block)]

    def _interpret(self, block: Block) -> list[RespirationUpdate]:
        if block.begins:
            self._told_ns = -(2**62)
        start_ns = block.end_ns - round(self._config.window_s * SECOND_NS)
        for lead, samples in zip(self._leads, block.samples.T, strict=False):
            if block.begins:
                lead.forget()
            lead.take(samples, block.times_ns, start_ns)
            if block.hole is not None:
                lead.restart()
            if block.hole is Hole.CLOCK:
                lead.forget()
        return [self._update(block)] if block.hole is None else []

    def _update(self, block: Block) -> RespirationUpdate:
        shown = [self._shown(lead, block) for lead in self._leads]
        chosen = next((k for k, each in enumerate(shown) if not each.problem), 0)
        beats, covered, problem = shown[chosen]
        if problem:
            quality = np.nan if problem.startswith("needs") else 0.0
            return self._nothing(block, quality, _evidence(np.nan, np.nan), problem)
        seen = fusion.fused(beats, beats[0].time_ns, beats[-1].time_ns)
        quality = self._quality(block, seen, covered, self._leads[chosen].share())
        rate = fusion.told_per_min(seen)
        problem = self._doubt(seen, rate, beats, quality) or self._unlike(beats, rate)
        if problem:
            return self._nothing(block, quality, _evidence(seen.likeness, seen.rhythm), problem)
        return self._said(block, seen, rate, quality, self._other(shown, chosen))

    def _window_s(self, block: Block) -> float:
        return block.window_s(self._config.window_s)

    def _shown(self, lead: Lead, block: Block) -> Shown:
        window_s, beats = self._window_s(block), lead.chained(block.end_ns)
        covered = float(intervals_s(beats).sum()) / max(window_s, 1e-9)
        return Shown(beats, covered, self._problem(lead, beats, covered, window_s))

    def _other(self, shown: list[Shown], chosen: int) -> list[str]:
        """Why not the first lead is looked at; empty where it is."""
        return [f"from lead {self._names[chosen]}: in {self._names[0]} {shown[0].problem}"] if chosen else []

    def _quality(self, block: Block, seen: fusion.Fused, covered: float, filled: float) -> float:
        """Signal quality, 0..1. covered: share of the window between beats; filled: share of samples that are there."""
        sure = rise(max(seen.likeness, seen.rhythm), fusion.SURE)
        quality = rise(covered, COVERED) * fusion.agreement(seen.rates_per_min) * sure * filled
        return quality ** (1 + self._motion.at(block.received_ns, self._config.window_s).strength)

    def _said(
        self, block: Block, seen: fusion.Fused, rate_per_min: float, quality: float, other: list[str]
    ) -> RespirationUpdate:
        """What is told of waves that are breathing. other: what else is to be said of them."""
        timed = seen.likeness >= fusion.LEAST_ALIKE
        return RespirationUpdate(
            device_ns=block.device_ns,
            received_ns=block.received_ns,
            window_s=self._window_s(block),
            breath_count=len(seen.breaths),
            breath_timestamps=tuple(self._fresh(seen, block.end_ns)) if timed else (),
            breaths_per_min=rate_per_min,
            period_s=60 / rate_per_min,
            rrv_rmssd_ms=np.nan,
            amplitude=np.nan,
            inhale_exhale_ratio=np.nan,
            signal_quality=quality,
            extra=_evidence(seen.likeness, seen.rhythm),
            reasons=(NEVER, *([] if timed else [NO_TIMES]), *other),
        )

    def _fresh(self, seen: fusion.Fused, end_ns: int) -> list[int]:
        """Ends of inspiration that are certain now and were not told before.

        Of the newest 10 s, as it is promised; where updates come more seldom, of all since the update before.
        """
        oldest_s = SETTLED_S + max(SETTLED_S, self._config.update_interval_s + APART_S)
        fresh = []
        for breath in seen.breaths:
            time_ns = int(seen.times_ns[breath.peak])
            age_s = (end_ns - time_ns) / SECOND_NS
            if time_ns > self._told_ns + APART_S * SECOND_NS and SETTLED_S <= age_s <= oldest_s:
                self._told_ns = time_ns
                fresh.append(time_ns)
        return fresh

    def _needs_s(self) -> float:
        """Of intervals between beats, before anything is said."""
        return min(NEEDS_S, COVERED[1] * self._config.window_s)

    def _problem(self, lead: Lead, chained: list[Beat], covered: float, window_s: float) -> str:
        """Why the beats of a lead say nothing; empty where they may."""
        needs_s = self._needs_s()
        if window_s >= needs_s and lead.silent_s > SILENT_S:
            return "no heart beats are found" + (f" in the last {lead.silent_s:.0f} s" if lead.beats else "")
        if covered * window_s < needs_s:
            return _too_few(lead, chained, covered * window_s, needs_s)
        known_s = intervals_s(chained)
        spread = spread_of(known_s) / float(np.median(known_s))
        outlying = 1 - float(fusion.usual(known_s).mean())
        if spread > IRREGULAR or outlying > OUTLYING:
            return "heart beats are too irregular to show breathing, or are none"
        return ""

    def _doubt(self, seen: fusion.Fused, rate: float, beats: list[Beat], quality: float) -> str:
        """Why the waves are no evidence of breathing; empty where they are."""
        if not np.isfinite(rate) and seen.likeness < fusion.LEAST_ALIKE and seen.rhythm < fusion.RHYTHM_ALONE:
            needs = f"correlation {seen.likeness:.2f}, not {fusion.LEAST_ALIKE:g}"
            return f"sinus arrhythmia and R amplitude disagree, and neither is even: {needs}"
        if not np.isfinite(rate):
            return fusion.unclear(seen)
        if (high := max(seen.rates_per_min)) > FASTEST * 60 / float(np.median(intervals_s(beats))):
            return f"{high:.1f} breaths per min are too fast for beats to show"
        if seen.likeness < CONFIRMED and swing(beats) > SWINGS:
            return "the baseline of the ECG swings so far that QRS complexes follow it, breathing or not"
        if (pause_s := longest_pause_s(beats)) > HIDES * 60 / rate:
            return f"{pause_s:.1f} s between two heart beats may hide one of {rate:.1f} breaths per min"
        if np.isfinite(slow := fusion.slower_per_min(beats, rate)):
            return f"{rate:.1f} breaths per min may be an overtone of {slow:.1f} /min, or have noise among them"
        if quality < self._config.min_quality:
            return f"signal_quality below {self._config.min_quality:g}"
        return ""

    def _unlike(self, beats: list[Beat], rate_per_min: float) -> str:
        """Why beats that look unlike the others leave a rate in doubt; empty where the others tell it too."""
        others = alike(beats)
        if len(others) == len(beats):
            return ""
        if intervals_s(others).sum() >= self._needs_s() and longest_pause_s(others) <= HIDES * 60 / rate_per_min:
            without = fusion.told_per_min(fusion.fused(others, others[0].time_ns, others[-1].time_ns))
            if abs(without - rate_per_min) <= SAME:
                return ""
        unlike = f"{len(beats) - len(others)} of {len(beats)} heart beats look unlike the others, moved or ectopic"
        return f"{unlike}: without them {rate_per_min:.1f} breaths per min are not certain"

    def _nothing(self, block: Block, quality: float, evidence: tuple[Feature, ...], problem: str) -> RespirationUpdate:
        nan = np.nan
        stamps = block.device_ns, block.received_ns, self._window_s(block)
        return RespirationUpdate(*stamps, -1, (), nan, nan, nan, nan, nan, quality, evidence, (problem,))


def _too_few(lead: Lead, chained: list[Beat], covered_s: float, needs_s: float) -> str:
    """What keeps the intervals of beats in a row from adding up to needs_s."""
    if chained and (chained[-1].time_ns - chained[0].time_ns) / SECOND_NS >= needs_s:
        return f"losses leave {covered_s:.0f} s of intervals between heart beats, not {needs_s:g}"
    broken = len(lead.beats) > len(chained) + 1
    so_far = f", there are {covered_s:.0f} s since the last" if broken else ""
    return f"needs {needs_s:g} s of heart beats without a pause{so_far}"


def _evidence(likeness: float, rhythm: float) -> tuple[Feature, ...]:
    return Feature("likeness", "1", (likeness,)), Feature("rhythm", "1", (rhythm,))
