"""What kind of signal a channel is, from its name."""

import re

from sense4hri.signal_files.units import VOLTS, spelt

ELECTRODE = r"(Fp|AF|F|FT|FC|T|TP|C|CP|P|PO|O|I|N)(z|\d{1,2})(-\w+)?"  # of the 10-20 system, also Fpz-Cz
NAMES = (
    ("eog", r"(h|v)?eog.*"),
    ("emg", r"emg.*"),
    ("ecg", r"ecg.*|ekg.*|i{1,3}|av[rlf]|v[1-6]?|mlii|mli|mcl\d|lead.*"),
    ("ppg", r"ppg.*|pleth.*|bvp.*|pulse.*"),
    ("respiration", r"resp.*|rsp.*|breath.*"),
    ("eda", r"eda.*|gsr.*|scr?|skin.*conduct.*"),
    ("pupillometry", r"pupil.*|diameter_(left|right)"),
    ("eye_tracking", r"gaze.*"),
    ("accelerometer", r"acc.*"),
    ("gyroscope", r"gyr.*"),
    ("magnetometer", r"mag.*"),
    ("temperature", r"temp.*"),
    ("eeg", r"eeg.*"),
)


def type_of(channel: str, told: str = "", unit: str = "") -> str:
    """Return the sensor type of a channel, empty where nothing tells it.

    told: what the format says. An electrode's bare name (`O1`) means an EEG only where the unit is one of voltage.
    """
    name = channel.strip()
    if not told and spelt(unit) in VOLTS and re.fullmatch(ELECTRODE, name, re.IGNORECASE):
        return "eeg"
    return told or next((kind for kind, form in NAMES if re.fullmatch(form, name, re.IGNORECASE)), "")


def types_of(channels: tuple[str, ...], units: tuple[str, ...], told: str) -> list[str]:
    """Return the sensor type of every channel of a signal."""
    return [type_of(channel, told, unit) for channel, unit in zip(channels, units, strict=True)]
