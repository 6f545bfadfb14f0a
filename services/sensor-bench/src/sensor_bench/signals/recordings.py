"""Real recordings as sources of a virtual sensor: WFDB, Polar Sensor Logger exports, and plain columns of numbers.

Only what is needed to play one signal is read.
"""

import dataclasses
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sense4hri.signal_files.columns import open_columns
from sense4hri.signal_files.content import Signal, UnreadableFileError, evenly, number_of
from sense4hri.signal_files.guess import type_of
from sense4hri.signal_files.polar_logger import is_polar_logger, open_polar_logger
from sense4hri.signal_files.wfdb import open_wfdb
from sense4hri.stamps import SECOND_NS

from sensor_bench.signals.waveforms import FloatArray

RATES_HZ = (1.0, 20_000.0)
UNITS = {
    "ecg": {"uV": 1.0, "mV": 1e3, "V": 1e6},
    "ppg": {"counts": 1.0},
    "accelerometer": {"mg": 1e-3, "g": 1.0, "m/s^2": 1 / 9.80665},
}
"""Accepted units per stream, as factors to uV, counts and g."""
ECG_NAMES = ("ecg", "ekg", "i", "v", "mlii", "mcl", "lead")
TIMES = re.compile(r"t|time.*|.*stamp.*|index|sample.*", re.IGNORECASE)
AXES = re.compile(r"(acc.*)?[xyz]", re.IGNORECASE)
PPG_NAMES = ("ppg", "pleth", "bvp", "pulse")
LARGEST_MV = 50.0
RESTING_PPG_COUNTS = 270_000.0
FITTED_PPG_COUNTS = 2_000.0
AMBIENT_COUNTS = -640.0


@dataclass(frozen=True)
class Playback:
    """A recording and how to read it."""

    file: str
    fs_hz: float = 0.0
    """Sampling rate of a plain column file; other formats know theirs."""
    column: str = ""
    """Header name, or number from 0, of the column or WFDB signal; empty = the first that fits by its name.

    Where none does it is the first that is no time; of an accelerometer in columns x, y and z all three.
    """
    unit: str = ""
    """Of a plain column file; ecg: uV (default), mV, V; ppg: counts, or empty = fitted to a sensor's range."""
    gain: float = 1.0
    """Multiplies what the file says, e.g. -1 for an upside-down lead, mV per count for raw ADC values."""


class Recording(NamedTuple):
    """One signal in uV (ecg), counts (ppg) or g (accelerometer)."""

    fs_hz: float
    values: FloatArray
    """(n, channels)"""


def load(playback: Playback, stream: str) -> Recording:
    """Read `playback` for the stream `ecg`, `ppg` or `accelerometer`."""
    path = Path(playback.file)
    fs_hz, values, unit = _read(path, playback, stream)
    if not RATES_HZ[0] <= fs_hz <= RATES_HZ[1]:
        raise UnreadableFileError(f"{path}: fs_hz {fs_hz:g} is not between 1 and 20000")
    if values.shape[0] < fs_hz:
        raise UnreadableFileError(f"{path}: only {values.shape[0]} samples, less than a second")
    if not np.isfinite(values * playback.gain).any():
        raise UnreadableFileError(f"{path}: no number in it to play as {stream}")
    values = _without_holes(values * playback.gain)
    unit = playback.unit or unit
    if stream == "ppg" and not unit:
        values = _fitted(values)
    if stream == "ppg" and values.shape[1] == 1:
        # one wavelength for the three optical channels, and darkness
        values = np.hstack([np.repeat(values, 3, axis=1), np.full_like(values, AMBIENT_COUNTS)])
    known = UNITS[stream]
    if unit and unit not in known:
        raise UnreadableFileError(f"{path}: unit {unit!r} is none of {', '.join(known)} for {stream}")
    return Recording(fs_hz, values * (known[unit] if unit else next(iter(known.values()))))


def _read(path: Path, playback: Playback, stream: str) -> tuple[float, FloatArray, str]:
    """Return rate, values of shape (n, channels) and unit of the one signal that is meant."""
    try:
        if path.suffix in (".hea", ".dat"):
            return _one_of(path, open_wfdb(path), playback.column, stream)
        if is_polar_logger(path):
            signal = open_polar_logger(path)
            fs_hz, _, values = signal.read(tuple(range(len(signal.channels))))
            return fs_hz, values, signal.units[0]
        columns = open_columns(path)
        if playback.fs_hz <= 0:
            raise UnreadableFileError(f"{path}: fs_hz is needed for a file of plain columns")
        wanted = _wanted(path, playback.column, stream, columns.names)
        return playback.fs_hz, evenly(playback.fs_hz, columns.numbers(wanted)).values, playback.unit
    except OSError as err:
        raise UnreadableFileError(f"{path}: {err}") from err


def _wanted(path: Path, column: str, stream: str, names: tuple[str, ...]) -> tuple[int, ...]:
    """Return which columns are played, see `Playback.column`."""
    if column:
        return (number_of(path, column, names),)
    axes = [number for number, name in enumerate(names) if AXES.fullmatch(name.strip())]
    if stream == "accelerometer" and len(axes) == 3:
        return tuple(axes)
    fitting = [number for number, name in enumerate(names) if type_of(name) == stream]
    others = [number for number, name in enumerate(names) if not TIMES.fullmatch(name.strip())]
    return ((fitting or others or [0])[0],)


def _one_of(path: Path, signals: tuple[Signal, ...], column: str, stream: str) -> tuple[float, FloatArray, str]:
    """Return rate, values and unit of the signal that is meant."""
    places = [(signal, number) for signal in signals for number in range(len(signal.channels))]
    names = tuple(signal.channels[number] for signal, number in places)
    signal, number = places[_wanted(path, column, stream, names)[0]]
    fs_hz, times_ns, values = signal.read((number,))
    if len(times_ns) and times_ns[-1] - times_ns[0] > (len(times_ns) - 0.5) / fs_hz * SECOND_NS:
        raise UnreadableFileError(f"{path}: has gaps: driver-file plays them, the bench does not")
    return fs_hz, values, signal.units[number]


def found_in(path: str) -> dict[str, Playback]:
    """What a strap (`ecg`) and an arm band (`ppg`) can play from one file that nobody described.

    Plain columns must carry their rate in the file's name, as in `rest_100hz.csv`; columns or signals are told apart
    by name, and one without a telling name is taken for an ECG (in mV if it spans less than 50, else in uV).
    """
    file = Path(path)
    if file.suffix in (".hea", ".dat"):
        names = [name for signal in open_wfdb(file) for name in signal.channels]
        fs_hz = 0.0
    elif _is_binary(file):
        raise UnreadableFileError(f"{path}: not WFDB, not a Polar Sensor Logger export, not columns of numbers")
    elif is_polar_logger(file):
        return {"ecg" if open_polar_logger(file).sensor_type == "ecg" else "ppg": Playback(path)}
    else:
        rate = re.search(r"(\d+(?:\.\d+)?) ?hz", file.name, re.IGNORECASE)
        if rate is None:
            raise UnreadableFileError(f"{path}: its name does not tell the sampling rate, as rest_100hz.csv does")
        fs_hz, names = float(rate.group(1)), list(open_columns(file).names)
    found: dict[str, Playback] = {}
    for name in names:
        for stream, words in (("ecg", ECG_NAMES), ("ppg", PPG_NAMES)):
            if stream not in found and name.lower().startswith(words):
                found[stream] = Playback(path, fs_hz, name)
    if not found:
        found["ecg"] = Playback(path, fs_hz)
    if "ecg" in found and fs_hz > 0:
        span = float(np.ptp(load(found["ecg"], "ecg").values))
        found["ecg"] = dataclasses.replace(found["ecg"], unit="mV" if span < LARGEST_MV else "uV")
    return found


def _is_binary(path: Path) -> bool:
    with path.open("rb") as file:
        return b"\0" in file.read(65536)


def _without_holes(values: FloatArray) -> FloatArray:
    """NaN (absent samples) replaced by the last value before it."""
    index = np.where(np.isfinite(values), np.arange(values.shape[0])[:, None], 0)
    np.maximum.accumulate(index, axis=0, out=index)
    return np.nan_to_num(np.take_along_axis(values, index, axis=0))


def _fitted(values: FloatArray) -> FloatArray:
    """A pulse wave of unknown scale, made as large as a Verity Sense's, more blood fewer counts."""
    low, high = np.percentile(values, [2, 98], axis=0)
    return RESTING_PPG_COUNTS - (values - values.mean(axis=0)) / np.maximum(high - low, 1e-12) * FITTED_PPG_COUNTS
