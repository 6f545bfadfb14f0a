"""Real recordings: WFDB, Polar Sensor Logger exports, and plain columns of numbers.

Only what is needed to play one signal is read. Own small readers, so that the bench depends on no file library.
"""

import csv
import dataclasses
import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sensor_bench.signals.waveforms import FloatArray

RATES_HZ = (1.0, 20_000.0)
UNITS = {
    "ecg": {"uV": 1.0, "mV": 1e3, "V": 1e6},
    "ppg": {"counts": 1.0},
    "accelerometer": {"mg": 1e-3, "g": 1.0, "m/s^2": 1 / 9.80665},
}
"""Accepted units per stream, as factors to uV, counts and g."""
ECG_NAMES = ("ecg", "ekg", "i", "v", "mlii", "mcl", "lead")
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
    """Header name, or number from 0, of the column or WFDB signal; empty = the first that fits."""
    unit: str = ""
    """Of a plain column file; ecg: uV (default), mV, V; ppg: counts, or empty = fitted to a sensor's range."""
    gain: float = 1.0
    """Multiplies what the file says, e.g. -1 for an upside-down lead, mV per count for raw ADC values."""


class Recording(NamedTuple):
    """One signal in uV (ecg), counts (ppg) or g (accelerometer)."""

    fs_hz: float
    values: FloatArray
    """(n, channels)"""


class UnreadableRecordingError(ValueError):
    """The file is not what it was announced as; the message names file and place."""


def load(playback: Playback, stream: str) -> Recording:
    """Read `playback` for the stream `ecg`, `ppg` or `accelerometer`."""
    path = Path(playback.file)
    if path.suffix in (".hea", ".dat"):
        recording, unit = _wfdb(path.with_suffix(".hea"), playback.column)
    elif _first_line(path).startswith("Phone timestamp;"):
        recording, unit = _polar_logger(path)
    else:
        recording, unit = _columns(path, playback), playback.unit
    if not RATES_HZ[0] <= recording.fs_hz <= RATES_HZ[1]:
        raise UnreadableRecordingError(f"{path}: fs_hz {recording.fs_hz:g} is not between 1 and 20000")
    values = recording.values * playback.gain
    if values.shape[0] < recording.fs_hz:
        raise UnreadableRecordingError(f"{path}: only {values.shape[0]} samples, less than a second")
    values = _without_holes(values)
    unit = playback.unit or unit
    if stream == "ppg" and not unit:
        values = _fitted(values)
    if stream == "ppg" and values.shape[1] == 1:
        # one wavelength for the three optical channels, and darkness
        values = np.hstack([np.repeat(values, 3, axis=1), np.full_like(values, AMBIENT_COUNTS)])
    known = UNITS[stream]
    if unit and unit not in known:
        raise UnreadableRecordingError(f"{path}: unit {unit!r} is none of {', '.join(known)} for {stream}")
    return Recording(recording.fs_hz, values * (known[unit] if unit else next(iter(known.values()))))


def found_in(path: str) -> dict[str, Playback]:
    """What a strap (`ecg`) and an arm band (`ppg`) can play from one file that nobody described.

    Plain columns must carry their rate in the file's name, as in `rest_100hz.csv`; columns or signals are told apart
    by name, and one without a telling name is taken for an ECG (in mV if it spans less than 50, else in uV).
    """
    file = Path(path)
    if file.suffix in (".hea", ".dat"):
        names = _wfdb_names(file.with_suffix(".hea"))
        fs_hz = 0.0
    elif _is_binary(file):
        raise UnreadableRecordingError(f"{path}: not WFDB, not a Polar Sensor Logger export, not columns of numbers")
    elif (first := _first_line(file)).startswith("Phone timestamp;"):
        return {"ecg" if "ecg" in first.lower() else "ppg": Playback(path)}
    else:
        rate = re.search(r"(\d+(?:\.\d+)?) ?hz", file.name, re.IGNORECASE)
        if rate is None:
            raise UnreadableRecordingError(f"{path}: its name does not tell the sampling rate, as rest_100hz.csv does")
        fs_hz, names = float(rate.group(1)), _split(first) if not first.startswith("#") else []
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


def _first_line(path: Path) -> str:
    with path.open(errors="replace") as file:
        return file.readline()


def _without_holes(values: FloatArray) -> FloatArray:
    """NaN (absent samples) replaced by the last value before it."""
    index = np.where(np.isfinite(values), np.arange(values.shape[0])[:, None], 0)
    np.maximum.accumulate(index, axis=0, out=index)
    return np.nan_to_num(np.take_along_axis(values, index, axis=0))


def _fitted(values: FloatArray) -> FloatArray:
    """A pulse wave of unknown scale, made as large as a Verity Sense's, more blood fewer counts."""
    low, high = np.percentile(values, [2, 98], axis=0)
    return RESTING_PPG_COUNTS - (values - values.mean(axis=0)) / np.maximum(high - low, 1e-12) * FITTED_PPG_COUNTS


# --- WFDB ----------------------------------------------------------------------------------------------------------


class _Signal(NamedTuple):
    """A signal line of a WFDB header."""

    file: str
    format: int
    per_frame: int
    offset_bytes: int
    gain: float
    baseline: float
    unit: str
    name: str


def _wfdb_signal(line: str) -> _Signal:
    """`file format[xN][:skew][+offset] gain[(baseline)][/unit] bits zero first checksum block name`."""
    words = line.split(maxsplit=8)
    kind, _, offset = words[1].partition("+")
    kind, _, per_frame = kind.partition(":")[0].partition("x")
    gain_text, _, unit = (words[2] if len(words) > 2 else "200").partition("/")
    gain_text, _, baseline = gain_text.rstrip(")").partition("(")
    zero = words[4] if len(words) > 4 else "0"
    return _Signal(
        words[0],
        int(kind),
        int(per_frame or 1),
        int(offset or 0),
        float(gain_text) or 200.0,
        float(baseline or zero),
        unit or "mV",
        words[8].strip() if len(words) > 8 else "",
    )


def _wfdb_header(header: Path) -> tuple[float, list[_Signal]]:
    """Frame rate and signals of a record."""
    try:
        lines = [line for line in header.read_text().splitlines() if line.strip() and not line.startswith("#")]
        first = lines[0].split()
        fs_hz = float(first[2].split("/")[0].split("(")[0]) if len(first) > 2 else 250.0
        return fs_hz, [_wfdb_signal(line) for line in lines[1 : 1 + int(first[1])]]
    except UnicodeDecodeError as error:
        raise UnreadableRecordingError(f"{header}: not a WFDB header: no text") from error
    except (OSError, IndexError, ValueError) as error:
        raise UnreadableRecordingError(f"{header}: not a WFDB header: {error}") from error


def _wfdb_names(header: Path) -> list[str]:
    return [signal.name for signal in _wfdb_header(header)[1]]


def _wfdb(header: Path, column: str) -> tuple[Recording, str]:
    fs_hz, signals = _wfdb_header(header)
    if not signals:
        raise UnreadableRecordingError(f"{header}: the record has no signals")
    number = _column_number(header, column, [signal.name for signal in signals])
    chosen = signals[number]
    together = [i for i, signal in enumerate(signals) if signal.file == chosen.file]
    width = sum(signals[i].per_frame for i in together)
    before = sum(signals[i].per_frame for i in together if i < number)
    try:
        raw = np.fromfile(header.parent / chosen.file, dtype=np.uint8, offset=chosen.offset_bytes)
    except OSError as error:
        raise UnreadableRecordingError(f"{header}: {error}") from error
    counts = _wfdb_counts(raw, chosen.format, header)
    frames = counts[: counts.size // width * width].reshape(-1, width)
    values = frames[:, before : before + chosen.per_frame].reshape(-1, 1)
    return Recording(fs_hz * chosen.per_frame, (values - chosen.baseline) / chosen.gain), chosen.unit


def _wfdb_counts(raw: "np.ndarray[tuple[int], np.dtype[np.uint8]]", kind: int, header: Path) -> FloatArray:
    if kind == 16:
        counts = raw[: raw.size // 2 * 2].view("<i2").astype(np.float64)
        counts[counts == -32768] = np.nan
        return counts
    if kind == 80:
        return raw.astype(np.float64) - 128.0
    if kind == 212:
        triples = raw[: raw.size // 3 * 3].reshape(-1, 3).astype(np.int16)
        first = triples[:, 0] | (triples[:, 1] & 0x0F) << 8
        second = triples[:, 2] | (triples[:, 1] & 0xF0) << 4
        twelve = np.stack([first, second], axis=1).ravel()
        counts = np.where(twelve > 2047, twelve - 4096, twelve).astype(np.float64)
        counts[counts == -2048] = np.nan
        return counts
    raise UnreadableRecordingError(f"{header}: WFDB format {kind} is not among 16, 80, 212")


# --- columns of numbers --------------------------------------------------------------------------------------------


def _column_number(path: Path, column: str, names: list[str]) -> int:
    if not column:
        return 0
    if column in names:
        return names.index(column)
    if column.isdecimal() and int(column) < len(names):
        return int(column)
    raise UnreadableRecordingError(f"{path}: no column {column!r}; there are {', '.join(names)}")


def _polar_logger(path: Path) -> tuple[Recording, str]:
    """Polar Sensor Logger: semicolons, one row per sample, device stamps in the second column."""
    with path.open() as file:
        rows = csv.reader(file, delimiter=";")
        header = [name.strip() for name in next(rows) if name.strip()]
        try:
            table = [[int(row[1]), *map(float, row[2 : len(header)])] for row in rows if len(row) >= len(header)]
        except ValueError as error:
            raise UnreadableRecordingError(f"{path}: {error}") from error
    if len(table) < 2 or len(header) < 3 or "sensor timestamp" not in header[1]:
        raise UnreadableRecordingError(f"{path}: a Polar Sensor Logger file without samples and sensor timestamps")
    fs_hz = (len(table) - 1) / ((table[-1][0] - table[0][0]) * 1e-9)
    unit = header[2].partition("[")[2].rstrip("]").strip()
    return Recording(fs_hz, np.array([row[1:] for row in table])), unit if unit in ("mg", "uV") else "counts"


def _columns(path: Path, playback: Playback) -> Recording:
    """Text with numbers in columns; comment lines begin with #, one header line is allowed."""
    if playback.fs_hz <= 0:
        raise UnreadableRecordingError(f"{path}: fs_hz is needed for a file of plain columns")
    with path.open(errors="replace") as file:
        lines = itertools.dropwhile(lambda line: line.startswith("#") or not line.strip(), file)
        rows = (_split(line) for line in lines if line.strip())
        first = next(rows, None)
        if first is None:
            raise UnreadableRecordingError(f"{path}: no data")
        has_header = not all(map(_is_number, first))
        names = first if has_header else [str(i) for i in range(len(first))]
        wanted = _column_number(path, playback.column, names)
        numbers = list(_numbers(path, rows if has_header else itertools.chain([first], rows), wanted))
    return Recording(playback.fs_hz, np.array(numbers).reshape(-1, 1))


def _split(line: str) -> list[str]:
    for mark in (",", ";", "\t"):
        if mark in line:
            return [cell.strip() for cell in line.strip().split(mark)]
    return line.split()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text == ""
    return True


def _numbers(path: Path, rows: Iterable[list[str]], wanted: int) -> Iterable[float]:
    for number, row in enumerate(rows, 1):
        try:
            yield float(row[wanted]) if row[wanted] else float("nan")
        except (IndexError, ValueError) as error:
            raise UnreadableRecordingError(f"{path}: row {number}: {error}") from error
