"""Exports of Polar Sensor Logger: semicolons, a row per sample, the sensor's own stamps in ns in the second column."""

from pathlib import Path

import numpy as np

from sense4hri.signal_files.columns import Columns, open_columns
from sense4hri.signal_files.content import Sampled, Signal, UnreadableFileError, stamped

MARK = "Phone timestamp;"
SENSOR_TYPES = {"mg": "accelerometer", "g": "accelerometer", "uV": "ecg", "dps": "gyroscope", "G": "magnetometer"}
PPG_BITS = 22


def is_polar_logger(path: Path) -> bool:
    """True for a file that Polar Sensor Logger wrote."""
    with path.open(errors="replace") as file:
        return file.readline().startswith(MARK)


def open_polar_logger(path: Path) -> Signal:
    """Return the one signal of an export. Raises UnreadableFileError where it has no sensor timestamps."""
    columns = open_columns(path)
    names = tuple(name for name in columns.names[2:] if name)
    if not names or "sensor timestamp" not in columns.names[1]:
        raise UnreadableFileError(f"{path}: a Polar Sensor Logger file without samples and sensor timestamps")
    units = tuple(name.partition("[")[2].rstrip("]").strip() or "counts" for name in names)
    channels = tuple(name.partition("[")[0].strip() for name in names)
    sensor_type = SENSOR_TYPES.get(units[0], "ppg" if len(names) > 1 else "")
    bits = PPG_BITS if sensor_type == "ppg" else 0
    return Signal(channels, units, lambda wanted: _read(columns, wanted), sensor_type, bits)


def _read(columns: Columns, wanted: tuple[int, ...]) -> Sampled:
    """Stamps are read as whole numbers: nanoseconds of years do not fit a double."""
    values = columns.numbers(tuple(2 + column for column in wanted))
    text = np.loadtxt(columns.path, dtype=str, delimiter=";", skiprows=columns.skip, usecols=1, ndmin=1)
    try:
        times_ns = text[: len(values)].astype(np.int64)
    except ValueError as err:
        raise UnreadableFileError(f"{columns.path}: sensor timestamp [ns]: {err}") from err
    if len(times_ns) < 2:
        raise UnreadableFileError(f"{columns.path}: a Polar Sensor Logger file without samples and sensor timestamps")
    return stamped(times_ns, values)
