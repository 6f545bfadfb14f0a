"""What is published of breathing, whatever it was seen by."""

from typing import NamedTuple

from sense4hri.step import Feature


class RespirationUpdate(NamedTuple):
    """What the Respiration message says; times on the event clock, NaN where something cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    breath_count: int
    breath_timestamps: tuple[int, ...]
    breaths_per_min: float
    period_s: float
    rrv_rmssd_ms: float
    amplitude: float
    inhale_exhale_ratio: float
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]
