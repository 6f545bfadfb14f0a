"""Which numbers of a features message the page shows, and why one of them is absent. Pure."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from web_gui.intake import LONGEST_SENTENCE, shown

Plain = Mapping[str, Any]  # a message as plain values: nested messages are mappings, times are ns


class Reading(NamedTuple):
    """One row.

    path: field of the message; digits: None = as its size asks; needs_s: signal it needs by the contract; device: the
    sensor's own name.
    """

    label: str
    path: str
    unit: str
    digits: int | None
    needs_s: float = 0.0
    device: str = ""


_CARDIAC = (
    Reading("heart rate", "heart_rate_bpm", "bpm", 1, device="heart_rate"),
    Reading("RR interval", "rr_interval_ms", "ms", 0, device="rr_interval"),
    Reading("RMSSD", "hrv.rmssd_ms", "ms", 1, needs_s=30),
    Reading("SDNN", "hrv.sdnn_ms", "ms", 1, needs_s=120),
    Reading("pNN50", "hrv.pnn50_percent", "%", 1, needs_s=30),
    Reading("LF/HF", "hrv.lf_hf_ratio", "", 2, needs_s=300),
)
READINGS: dict[str, tuple[Reading, ...]] = {
    "ecg": _CARDIAC,
    "ppg": (
        *(r._replace(device="pp_interval") if r.device == "rr_interval" else r for r in _CARDIAC),
        Reading("pulse amplitude", "pulse_amplitude", "raw", 0),
    ),
    "eda": (
        Reading("tonic level", "tonic_us", "µS", 2),
        Reading("tonic slope", "tonic_slope_us_per_min", "µS/min", 2),
        Reading("SCR rate", "scr_rate_per_min", "/min", 1),
        Reading("SCR amplitude", "scr_amplitude_us", "µS", 2),
        Reading("SCR rise time", "scr_rise_time_s", "s", 1),
        Reading("half recovery", "scr_half_recovery_s", "s", 1),
    ),
    "respiration": (
        Reading("breathing rate", "breaths_per_min", "/min", 1, device="respiration_rate"),
        Reading("period", "period_s", "s", 1),
        Reading("RRV (RMSSD)", "rrv_rmssd_ms", "ms", 0),
        Reading("inhale/exhale", "inhale_exhale_ratio", "", 2),
    ),
    "eog": (
        Reading("blink rate", "blink_rate_per_min", "/min", 1),
        Reading("blink duration", "blink_duration_ms", "ms", 0),
        Reading("saccade rate", "saccade_rate_per_min", "/min", 1),
    ),
    "eye_tracking": (
        Reading("fixation", "fixation_duration_ms", "ms", 0),
        Reading("saccade amplitude", "saccade_amplitude_deg", "°", 1),
        Reading("dispersion", "gaze_dispersion_deg", "°", 2),
        Reading("gaze entropy", "gaze_entropy_bits", "bit", 2),
        Reading("blink rate", "blink_rate_per_min", "/min", 1),
        Reading("valid", "valid_ratio", "", 2),
    ),
    "pupillometry": (
        Reading("diameter", "diameter", "mm", 2),
        Reading("change", "change_percent", "%", 1),
        Reading("dilation speed", "dilation_speed_per_s", "mm/s", 2),
        Reading("missing", "missing_ratio", "", 2),
    ),
    "eeg": (
        Reading("engagement", "engagement_index", "", 2),
        Reading("theta/alpha", "theta_alpha_ratio", "", 2),
        Reading("frontal asymmetry", "frontal_alpha_asymmetry", "", 2),
    ),
    "emg": (Reading("RMS", "rms_uv", "µV", 1), Reading("median frequency", "median_frequency_hz", "Hz", 0)),
    "accelerometer": (
        Reading("intensity", "intensity_m_per_s2", "m/s²", 2),
        Reading("step rate", "step_rate_per_min", "/min", 0),
    ),
}
STANDARD = ("header", "device_timestamp", "window_s", "signal_quality", "extra", "reasons")  # of every features message
_DISPLAY = {"uV": "µV", "uS": "µS", "uT": "µT", "m/s^2": "m/s²", "degC": "°C", "deg": "°"}
_DISPLAY_BESIDE = {"1": "", "1/min": "/min", "deg/s": "°/s"}


def display_unit(unit: str) -> str:
    """Return a canonical unit as a reader expects it: `uV` is shown as `µV`."""
    return _DISPLAY.get(unit, unit)


def unit_beside(unit: str) -> str:
    """Return a unit as it stands beside a number: a share has none, of `1/min` the number is the 1."""
    return _DISPLAY_BESIDE.get(unit, display_unit(unit))


def rows(sensor_type: str, features: Plain, device: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the rows of one stream: label, value or None, unit, digits, reason of a None, the device's own value."""
    return [_row(reading, features, device) for reading in readings_of(sensor_type, features)]


def readings_of(sensor_type: str, features: Plain) -> tuple[Reading, ...]:
    """Return the rows of a sensor type; of one that READINGS does not know, every number of its message by its name."""
    if sensor_type in READINGS:
        return READINGS[sensor_type]
    names = [name for name, value in features.items() if name not in STANDARD and isinstance(value, float)]
    return tuple(Reading(name.replace("_", " "), name, "", None) for name in names)


def _row(reading: Reading, features: Plain, device: Mapping[str, float]) -> dict[str, Any]:
    value = number(at_path(features, reading.path))
    own = device.get(reading.device)
    return {
        "label": reading.label,
        "value": value,
        "unit": reading.unit,
        "digits": reading.digits,
        "reason": "" if value is not None else reason(reading, features),
        "device": None if own is None or not math.isfinite(own) else own,
    }


def reason(reading: Reading, features: Plain) -> str:
    """Return in words why a value is absent: too little signal yet, else the message's own reason."""
    window_s = number(at_path(features, "hrv.window_s"))
    if window_s is not None and window_s < reading.needs_s:
        return f"needs {reading.needs_s:.0f} s, has {window_s:.0f} s"
    given = [str(text) for text in features.get("reasons", ())]
    fitting = [text for text in given if _concerns(text, reading)]
    return shown("; ".join(fitting or given), LONGEST_SENTENCE) or "not computed; the interpreter gives no reason"


def further_reasons(sensor_type: str, features: Plain) -> list[str]:
    """Return the message's reasons that no absent value of the page tells already."""
    absent = [r for r in readings_of(sensor_type, features) if number(at_path(features, r.path)) is None]
    given = [str(text) for text in features.get("reasons", ())]
    return [text for text in given if not any(_concerns(text, reading) for reading in absent)]


def _concerns(text: str, reading: Reading) -> bool:
    """True where a reason names the reading: by its label, its field, or the field's first word."""
    leaf = reading.path.rsplit(".", 1)[-1].lower()
    return any(word in text.lower() for word in (reading.label.lower(), leaf, leaf.split("_")[0]))


def at_path(plain: Plain, path: str) -> Any:
    """Return the value at a dotted path, None where there is none."""
    value: Any = plain
    for part in path.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def number(value: Any) -> float | None:
    """Return a finite number, the mean of a list's finite ones, or None."""
    if isinstance(value, list | tuple):
        finite = [float(v) for v in value if math.isfinite(v)]
        return sum(finite) / len(finite) if finite else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)
