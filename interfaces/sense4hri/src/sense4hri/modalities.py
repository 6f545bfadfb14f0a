"""Every kind of signal the project knows: its message, units, channels and how it is shown. Imports no ROS.

A new modality is one entry here. A sensor type that is not in the table is shown, recorded and exported all the same,
with what `modality` returns for it: no features, any unit, a colour of its own.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

UNCALIBRATED = ("counts", "px", "a.u.")  # units of raw data of which no scale is known


class Modality(NamedTuple):
    """One kind of signal (contract, sections 2 and 5).

    message: name of its features message in sense4hri_msgs, empty where there is none. units: canonical units of raw
    data, the usual one first; empty = any. channels: names its channels usually have; empty = named by the sensor.
    stacked: several channels are drawn one below the other. least_span: smallest height of the y axis, in the usual
    unit; 0 = that of the signal. helper: measured beside other signals; nobody misses its features. parameters: of a
    stream, beside those that every stream has, each with what it is; a driver may give them.
    """

    sensor_type: str
    label: str
    message: str
    units: tuple[str, ...]
    channels: tuple[str, ...]
    colour_on_light: str
    colour_on_dark: str
    stacked: bool = False
    least_span: float = 0.0
    helper: bool = False
    bids_suffix: str = "physio"
    parameters: Mapping[str, str] = MappingProxyType({})


XYZ = ("x", "y", "z")
_TABLE = (
    Modality("ecg", "ECG", "ECG", ("uV",), (), "#08813f", "#5be08f", True, 300),
    Modality("ppg", "PPG", "PPG", ("counts",), (), "#0879ad", "#45c8f5"),
    Modality(
        "respiration",
        "respiration",
        "Respiration",
        ("a.u.", "N"),
        ("respiration",),
        "#947000",
        "#f4d35e",
    ),
    Modality("eda", "EDA", "EDA", ("uS",), ("eda",), "#6a45cf", "#b49bff", False, 0.2),
    Modality("emg", "EMG", "EMG", ("uV",), (), "#bf4f07", "#ff9d5c", True, 50, bids_suffix="emg"),
    Modality("eeg", "EEG", "EEG", ("uV",), (), "#2a5cc9", "#7fa8ff", stacked=True, least_span=30, bids_suffix="eeg"),
    Modality("eog", "EOG", "EOG", ("uV",), (), "#b52a80", "#f59ad0", True, 100),
    Modality(
        "eye_tracking",
        "eye tracking",
        "EyeTracking",
        ("deg", "1", "px"),
        ("gaze_x", "gaze_y", "confidence"),
        "#6c7400",
        "#d7e37a",
        parameters={"px_per_deg": "pixels of the screen to a degree of the visual field; NaN = not known"},
    ),
    Modality(
        "pupillometry",
        "pupil",
        "Pupillometry",
        ("mm",),
        ("diameter_left", "diameter_right", "confidence"),
        "#8d3aac",
        "#dfa6f2",
        least_span=0.3,
    ),
    Modality(
        "temperature", "temperature", "", ("degC",), ("temperature",), "#bd3a3a", "#ff9a94", least_span=0.5, helper=True
    ),
    Modality(
        "accelerometer",
        "acceleration",
        "Motion",
        ("m/s^2",),
        XYZ,
        "#566577",
        "#aab6c6",
        stacked=True,
        least_span=0.6,
        helper=True,
    ),
    Modality(
        "gyroscope", "rotation", "", ("rad/s",), XYZ, "#5f7388", "#93a3b8", stacked=True, least_span=0.3, helper=True
    ),
    Modality(
        "magnetometer",
        "magnetic field",
        "",
        ("uT",),
        XYZ,
        "#4a637d",
        "#8296b0",
        stacked=True,
        least_span=5,
        helper=True,
    ),
)
MODALITIES: dict[str, Modality] = {entry.sensor_type: entry for entry in _TABLE}
"""By sensor type, in the order in which they are shown."""


def modality(sensor_type: str) -> Modality:
    """Return the entry of a sensor type, a plain one where the table has none."""
    known = MODALITIES.get(sensor_type)
    return known or Modality(sensor_type, sensor_type.replace("_", " "), "", (), (), "#66727f", "#8e9bad", stacked=True)


def check_unit(sensor_type: str, unit: str) -> None:
    """Raise ValueError where raw data of this type must not be in this unit (contract, section 5)."""
    units = modality(sensor_type).units
    if units and unit not in (*units, *UNCALIBRATED):
        raise ValueError(
            f"unit {unit!r} of {sensor_type}: the canonical unit is {' or '.join(units)}; "
            f"where no scale is known, one of {', '.join(UNCALIBRATED)}"
        )


def colour_variables(dark: bool) -> str:
    """Return the colours as CSS variables, `--<type>: <colour>;` each; `--other` is for types without an entry."""
    entries = (*_TABLE, modality("other"))
    return " ".join(f"--{e.sensor_type}: {e.colour_on_dark if dark else e.colour_on_light};" for e in entries)


def colour_of(sensor_type: str) -> str:
    """Return the CSS value of a type's colour; a name from the graph never gets into a style."""
    return f"var(--{sensor_type if sensor_type in MODALITIES else 'other'})"


def style_sheet() -> str:
    """Return a style sheet with the colours of both themes, and `--type` for whatever has a `data-type`."""
    types = "".join(f'[data-type="{name}"] {{ --type: {colour_of(name)}; }}\n' for name in MODALITIES)
    return (
        f":root {{ {colour_variables(dark=True)} }}\n"
        f':root[data-theme="light"] {{ {colour_variables(dark=False)} }}\n'
        f"[data-type] {{ --type: {colour_of('other')}; }}\n{types}"
    )
