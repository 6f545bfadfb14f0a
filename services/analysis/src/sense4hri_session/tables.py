"""Messages to rows: every field a column, times as int64 ns, nested names joined by `_`."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any

import numpy as np

SECOND_NS = 1_000_000_000

# For every events message: the field with the times, what the event is called, and the arrays beside the times.
EVENTS: dict[str, tuple[tuple[str, str, tuple[str, ...]], ...]] = {
    "ECG": (("peak_timestamps", "r_peak", ("rr_intervals_ms",)),),
    "PPG": (("peak_timestamps", "pulse", ("rr_intervals_ms",)),),
    "EDA": (("scr_onset_timestamps", "scr_onset", ()), ("scr_peak_timestamps", "scr_peak", ("scr_amplitudes_us",))),
    "Respiration": (("breath_timestamps", "breath", ()),),
    "EMG": (
        ("onset_timestamps", "emg_onset", ("onset_channels",)),
        ("offset_timestamps", "emg_offset", ("offset_channels",)),
    ),
    "EOG": (
        ("blink_timestamps", "blink", ("blink_durations_ms",)),
        ("saccade_timestamps", "saccade", ("saccade_amplitudes_uv",)),
    ),
    "EyeTracking": (
        ("fixation_timestamps", "fixation", ("fixation_durations_ms",)),
        ("saccade_timestamps", "saccade", ("saccade_durations_ms", "saccade_amplitudes_deg")),
        ("blink_timestamps", "blink", ("blink_durations_ms",)),
    ),
}


def is_time(value: Any) -> bool:
    """True for a builtin_interfaces/Time."""
    return hasattr(value, "nanosec") and hasattr(value, "sec")


def time_ns(value: Any) -> int:
    """A Time message in ns; 0 means "no time"."""
    return int(value.sec) * SECOND_NS + int(value.nanosec)


def flatten(message: Any, prefix: str = "") -> dict[str, Any]:
    """A message as a row. A header gives `received_ns` and `frame_id`, `extra` one column per name."""
    row: dict[str, Any] = {}
    for name in (field.name for field in fields(message) if field.default is MISSING):  # constants have a default
        value = getattr(message, name)
        if name == "header" and not prefix:
            row["received_ns"], row["frame_id"] = time_ns(value.stamp), value.frame_id
        elif name == "device_timestamp" and not prefix:
            row["device_time_ns"] = time_ns(value) or None
        elif name == "extra":
            row |= {f"{prefix}extra_{item.name}": _few(item.values) for item in value}
        elif name == "reasons":
            row[f"{prefix}reasons"] = "; ".join(value)
        elif is_time(value):
            row[f"{prefix}{name}_ns"] = time_ns(value) or None
        elif hasattr(value, "__dataclass_fields__"):
            row |= flatten(value, f"{prefix}{name}_")
        elif isinstance(value, list) and value and is_time(value[0]):
            row[f"{prefix}{name}"] = [time_ns(item) for item in value]
        elif isinstance(value, list) and value and hasattr(value[0], "__dataclass_fields__"):
            row[f"{prefix}{name}"] = [flatten(item) for item in value]
        elif isinstance(value, np.ndarray):
            row[f"{prefix}{name}"] = value.tolist()
        else:
            row[f"{prefix}{name}"] = value
    return row


def _few(values: Any) -> Any:
    return float(values[0]) if len(values) == 1 else [float(value) for value in values]
