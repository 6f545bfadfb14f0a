"""Messages to rows: every field a column, times as int64 ns, nested names joined by `_`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
import pandas as pd
from sense4hri.shapes import plain

SECOND_NS = 1_000_000_000
EXTRA = "extra_"
MOST_EXTRA = 500
"""Names of `extra` that are columns; a table's memory grows with rows times names."""

OWN = ("time_s", "time_ns", "received_ns", "device_time_ns", "frame_id")
"""Columns that a table has whatever the fields of its messages are called."""

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


def are_times(value: Any) -> bool:
    """True for a builtin_interfaces/Time[], also an empty one."""
    return isinstance(value, list) and all(map(is_time, value))


def is_header(value: Any) -> bool:
    """True for a std_msgs/Header; a third party's message may have a field of that name and of any type."""
    return is_time(getattr(value, "stamp", None)) and hasattr(value, "frame_id")


def time_ns(value: Any) -> int:
    """A Time message in ns; 0 means "no time"."""
    return int(value.sec) * SECOND_NS + int(value.nanosec)


def column(field: str) -> str:
    """What the column of a field is called: as the field, with `field_` before a name of OWN."""
    return f"field_{field}" if field in OWN else field


def flatten(message: Any, prefix: str = "") -> dict[str, Any]:
    """A message as a row. A header gives `received_ns` and `frame_id`, `extra` one column per name."""
    row: dict[str, Any] = {}
    for name in (field.name for field in fields(message) if field.default is MISSING):  # constants have a default
        value = getattr(message, name)
        if name == "header" and not prefix and is_header(value):
            row["received_ns"], row["frame_id"] = time_ns(value.stamp), value.frame_id
        elif name == "device_timestamp" and not prefix and is_time(value):
            row["device_time_ns"] = time_ns(value) or None
        elif name == "extra" and _are_features(value):
            row |= {f"{prefix}{EXTRA}{item.name}": _few(item.values) for item in value}
        elif name == "reasons" and isinstance(value, list):
            row[f"{prefix}reasons"] = "; ".join(map(str, value))
        elif is_time(value):
            row[column(f"{prefix}{name}_ns")] = time_ns(value) or None
        elif hasattr(value, "__dataclass_fields__"):
            row |= flatten(value, f"{prefix}{name}_")
        elif isinstance(value, list) and value and is_time(value[0]):
            row[column(f"{prefix}{name}")] = [time_ns(item) for item in value]
        elif isinstance(value, list) and value and hasattr(value[0], "__dataclass_fields__"):
            row[column(f"{prefix}{name}")] = [flatten(item) for item in value]
        elif isinstance(value, np.ndarray):
            row[column(f"{prefix}{name}")] = value.tolist()
        else:
            row[column(f"{prefix}{name}")] = value
    return row


def extra_units(message: Any) -> dict[str, str]:
    """The unit of every column that `extra` of a message gives."""
    extra: Any = getattr(message, "extra", None)
    return {f"{EXTRA}{item.name}": str(getattr(item, "unit", "")) for item in extra} if _are_features(extra) else {}


def frame(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """A table of rows. More than MOST_EXTRA names in `extra` become one column `extra`, each row's values as JSON.

    Times that some rows lack are Int64, since a float has no room for the last 7 bits of them.
    """
    names = {name for row in rows for name in row if name.startswith(EXTRA)}
    if len(names) > MOST_EXTRA:
        rows = [_folded(row) for row in rows]
    made = pd.DataFrame(rows)
    for name in [name for name in map(str, made) if name.endswith("_ns") and made[name].isna().any()]:
        times = [row.get(name) for row in rows]
        if all(time is None or time is pd.NA or isinstance(time, int) for time in times):
            made[name] = pd.array(times, "Int64")
    return made


def joined(frames: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Tables as one, in order of time_ns."""
    filled = [frame for frame in frames if len(frame)]
    if not filled:
        return pd.DataFrame()
    shared = set.intersection(*map(set, filled))
    times = [{n: "Int64" for n in set(frame) - shared if frame[n].dtype == np.int64} for frame in filled]
    whole = [frame.astype(kinds) for frame, kinds in zip(filled, times, strict=True)]
    return pd.concat(whole, ignore_index=True).sort_values("time_ns", kind="stable").reset_index(drop=True)


def _folded(row: dict[str, Any]) -> dict[str, Any]:
    extra = {name.removeprefix(EXTRA): value for name, value in row.items() if name.startswith(EXTRA)}
    return {name: value for name, value in row.items() if not name.startswith(EXTRA)} | {
        "extra": json.dumps(plain(extra))
    }


def _are_features(value: Any) -> bool:
    """True for a PhysioFeature[]."""
    return isinstance(value, list) and all(hasattr(item, "name") and hasattr(item, "values") for item in value)


def _few(values: Any) -> Any:
    """A number, or several; of none NaN, which could not be computed."""
    return [float(value) for value in values] if len(values) > 1 else float(next(iter(values), math.nan))
