"""A participant's fused state, and what beside the verdict of the tree goes into it; pure."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from fusion_affect.heart_rate import NAN, HeartRate
from fusion_affect.persons import Match
from fusion_affect.tree import UNKNOWN


class Expression(NamedTuple):
    """A facial expression: the word, 0..1, and -1..1 (both 0 where the recogniser does not fill them)."""

    word: str
    confidence: float
    valence: float = 0.0
    arousal: float = 0.0


class Indicator(NamedTuple):
    """One graded statement, and the topics it rests on."""

    name: str
    value: float
    confidence: float
    sources: tuple[str, ...]


@dataclass(frozen=True)
class State:
    """The fields of `UserState`."""

    time_ns: int
    human_id: str
    state: str
    confidence: float
    person_id: str
    face_id: str
    expression: str
    heart_rate_bpm: float
    indicators: tuple[Indicator, ...]
    extra: tuple[tuple[str, str, float], ...]
    """(name, unit, value)"""
    reasons: tuple[str, ...]


def confidence(state: str, seen: Expression | None, heart_rate: HeartRate) -> float:
    """0..1: the weaker of the expression's confidence and the worst signal used, as far as known; 0 when unknown."""
    if state == UNKNOWN:
        return 0.0
    known = [v for v in (seen.confidence if seen else NAN, heart_rate.quality) if not math.isnan(v)]
    return _bounded(min(known, default=0.0))


def _bounded(confidence: float) -> float:
    return 0.0 if math.isnan(confidence) else min(1.0, max(0.0, confidence))


def indicators(
    seen: Expression | None, who: Match, heart_rate: HeartRate, baseline_bpm: float
) -> tuple[Indicator, ...]:
    """Graded statements, each only where its input is there: many recognisers leave valence and arousal at 0."""
    found = []
    if seen and (seen.valence or seen.arousal):
        topic = (f"/humans/faces/{who.face_id}/expression",)
        found.append(_graded("expression_valence", seen.valence, seen.confidence, topic))
        found.append(_graded("expression_arousal", seen.arousal, seen.confidence, topic))
    if not math.isnan(heart_rate.bpm) and not math.isnan(baseline_bpm):
        change = heart_rate.bpm / baseline_bpm - 1
        found.append(Indicator("heart_rate_relative", change, _bounded(heart_rate.quality), heart_rate.topics))
    return tuple(found)


def _graded(name: str, value: float, confidence: float, sources: tuple[str, ...]) -> Indicator:
    """Return what a recogniser says on a scale of -1..1; NaN where it says something else."""
    is_known = -1 <= value <= 1
    return Indicator(name, value if is_known else NAN, _bounded(confidence) if is_known else 0.0, sources)


def missing(found: tuple[Indicator, ...], who: Match) -> tuple[str, ...]:
    """Return why indicators are NaN."""
    why = f"the expression of face {who.face_id} has none of -1..1"
    return tuple(f"{each.name} is missing: {why}" for each in found if math.isnan(each.value))


def extra(heart_rate: HeartRate, baseline_bpm: float) -> tuple[tuple[str, str, float], ...]:
    rates = [(f"heart_rate_{pipeline}", "1/min", bpm) for pipeline, bpm in heart_rate.by_pipeline.items()]
    return tuple(rates + ([] if math.isnan(baseline_bpm) else [("heart_rate_baseline", "1/min", baseline_bpm)]))
