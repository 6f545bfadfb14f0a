"""Exports of Polar Sensor Logger: semicolons, a row per sample, the sensor's own stamps in ns in the second column."""

import re
from pathlib import Path

import numpy as np

from sense4hri.signal_files.columns import COMMENTS, ENCODING, Columns, open_columns
from sense4hri.signal_files.content import Sampled, Signal, UnreadableFileError, stamped

MARK = "Phone timestamp;"
SENSOR_TYPES = {"mg": "accelerometer", "g": "accelerometer", "uV": "ecg", "dps": "gyroscope", "G": "magnetometer"}
PPG_BITS = 22
PPG_CHANNEL = re.compile(r"channel \d+|ambient")


def is_polar_logger(path: Path) -> bool:
    """True for a file that Polar Sensor Logger wrote."""
    with path.open(encoding=ENCODING, errors="replace") as file:
        return file.readline().startswith(MARK)


def open_polar_logger(path: Path) -> Signal:
    """Return the one signal of an export. Raises UnreadableFileError where it has no sensor timestamps."""
    columns = open_columns(path)
    numbers = [i for i, name in enumerate(columns.names) if i > 1 and name and not name.startswith("timestamp")]
    if not numbers or "sensor timestamp" not in columns.names[1]:
        raise UnreadableFileError(f"{path}: a Polar Sensor Logger file without samples and sensor timestamps")
    names = [columns.names[number] for number in numbers]
    units = tuple(name.partition("[")[2].rstrip("]").strip() or "counts" for name in names)
    channels = tuple(name.partition("[")[0].strip() for name in names)
    sensor_type = _type(channels, units)
    bits = PPG_BITS if sensor_type == "ppg" else 0
    return Signal(
        channels, units, lambda wanted: _read(columns, tuple(numbers[each] for each in wanted)), sensor_type, bits
    )


def _type(channels: tuple[str, ...], units: tuple[str, ...]) -> str:
    """Return the sensor type that the first known unit tells, or the names of a PPG's channels; else empty."""
    if told := [SENSOR_TYPES[unit] for unit in units if unit in SENSOR_TYPES]:
        return told[0]
    return "ppg" if all(map(PPG_CHANNEL.fullmatch, channels)) else ""


def _read(columns: Columns, wanted: tuple[int, ...]) -> Sampled:
    """Stamps are read as whole numbers: nanoseconds of years do not fit a double."""
    values = columns.numbers(wanted)
    if len(values) < 2:
        raise UnreadableFileError(f"{columns.path}: a Polar Sensor Logger file without samples and sensor timestamps")
    try:
        text = np.loadtxt(
            columns.path, str, COMMENTS, ";", skiprows=columns.skip, usecols=1, max_rows=len(values), encoding="latin-1"
        )
        return stamped(text.astype(np.int64), values)
    except (ValueError, OverflowError) as err:
        raise UnreadableFileError(f"{columns.path}: sensor timestamp [ns]: {err}") from err
