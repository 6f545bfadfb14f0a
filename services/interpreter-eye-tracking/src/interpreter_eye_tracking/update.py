"""What the EyeTracking message says."""

from typing import NamedTuple

import numpy as np
from sense4hri.step import Feature

from interpreter_eye_tracking.window import Told


class EyeUpdate(NamedTuple):
    """One update; times on the event clock, NaN where something cannot be computed."""

    device_ns: int | None
    received_ns: int
    window_s: float
    fixation_count: int
    fixation_duration_ms: float
    fixation_timestamps: tuple[int, ...]
    fixation_durations_ms: tuple[float, ...]
    saccade_count: int
    saccade_amplitude_deg: float
    saccade_timestamps: tuple[int, ...]
    saccade_durations_ms: tuple[float, ...]
    saccade_amplitudes_deg: tuple[float, ...]
    gaze_x: float
    gaze_y: float
    gaze_dispersion_deg: float
    gaze_entropy_bits: float
    blink_count: int
    blink_rate_per_min: float
    blink_timestamps: tuple[int, ...]
    blink_durations_ms: tuple[float, ...]
    valid_ratio: float
    signal_quality: float
    extra: tuple[Feature, ...]
    reasons: tuple[str, ...]


def nothing(
    device_ns: int | None,
    received_ns: int,
    window_s: float,
    fresh: Told,
    deg: float,
    extra: tuple[Feature, ...],
    reason: str,
) -> EyeUpdate:
    """Return an update that says why there is nothing to say, but for the events that ended before."""
    nan = np.nan
    return EyeUpdate(
        device_ns,
        received_ns,
        window_s,
        -1,
        nan,
        tuple(each.begin_ns for each in fresh.fixations),
        tuple(each.duration_ms for each in fresh.fixations),
        -1,
        nan,
        tuple(each.begin_ns for each in fresh.saccades),
        tuple(each.duration_ms for each in fresh.saccades),
        tuple(deg * each.amplitude for each in fresh.saccades),
        nan,
        nan,
        nan,
        nan,
        -1,
        nan,
        tuple(each.begin_ns for each in fresh.blinks),
        tuple(each.duration_ms for each in fresh.blinks),
        nan,
        0.0,
        extra,
        (reason,),
    )
