"""What is drawn on a stream's lane beside its signal: one row for each sensor type. Pure.

Another modality is one more row: what one mark is called, the way it is drawn (its name in static/js/ways.js), and from
which field of the features message it comes. Whoever needs another way of drawing writes it there.

Of a stream that is computed from another one, and so has no samples to draw, one number of its features is drawn.
"""

from typing import NamedTuple

from web_gui.marks import Kind, at, before, between, lasting, of_good, value

DRAWN: dict[str, tuple[Kind, ...]] = {
    "ecg": (Kind("beat", "tick", at("peak_timestamps")),),
    "ppg": (Kind("pulse", "tick", at("peak_timestamps")),),
    "respiration": (Kind("breath", "dot", at("breath_timestamps")),),
    "eda": (
        Kind("tonic level", "level", value("extra.tonic_now")),
        Kind("SCR onset", "ring", at("scr_onset_timestamps")),
        Kind("SCR peak", "dot", at("scr_peak_timestamps")),
    ),
    "emg": (Kind("burst", "shade", between("onset", "offset", "active")),),
    "eeg": (
        Kind("δ", "band", of_good("delta_uv2")),
        Kind("θ", "band", of_good("theta_uv2")),
        Kind("α", "band", of_good("alpha_uv2")),
        Kind("β", "band", of_good("beta_uv2")),
        Kind("γ", "band", of_good("gamma_uv2")),
    ),
    "eog": (
        Kind("blink", "shade", lasting("blink_timestamps", "blink_durations_ms", centred=True)),
        Kind("greatest closure", "tick", at("blink_timestamps")),
        Kind("saccade", "dash", at("saccade_timestamps")),
    ),
    "eye_tracking": (
        Kind(
            "fixation",
            "look",
            lasting("fixation_timestamps", "fixation_durations_ms", "extra.fixation_x", "extra.fixation_y"),
        ),
        Kind("blink", "shade", lasting("blink_timestamps", "blink_durations_ms")),
        Kind("saccade", "dash", at("saccade_timestamps")),
    ),
    "pupillometry": (Kind("interpolated", "bridge", before("extra.interpolated_begin_s", "extra.interpolated_end_s")),),
    "accelerometer": (Kind("intensity", "area", value("intensity_m_per_s2")),),
}


class Derived(NamedTuple):
    """What is drawn of a stream without samples. name: as among the readings; least_span: of the y axis, in unit."""

    field: str
    name: str
    unit: str
    least_span: float


DERIVED = {"respiration": Derived("breaths_per_min", "breathing rate", "breaths/min", 4.0)}
"""By sensor type; a stream of a type without an entry has no lane until its samples come."""

EVENTS = ("fixation_x", "fixation_y", "interpolated_begin_s", "interpolated_end_s")
"""Extras that hold one value for each event: they are drawn; beside the lane their mean would say nothing."""


def drawn(sensor_type: str) -> tuple[Kind, ...]:
    """Return the row of a sensor type, empty where there is none."""
    return DRAWN.get(sensor_type, ())
