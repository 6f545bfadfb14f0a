"""Plain columns of numbers as a signal, with a rate or a column of times."""

import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path

import numpy as np
from sense4hri.errors import ConfigError
from sense4hri.signal_files.columns import Columns, open_columns
from sense4hri.signal_files.content import (
    IntArray,
    Sampled,
    Signal,
    SignalFile,
    UnreadableFileError,
    evenly,
    nanoseconds,
    number_of,
    stamped,
)
from sense4hri.signal_files.units import KNOWN, spelt

from driver_file.config import FileConfig

UNIT = re.compile(r"[(\[]\s*([^()\[\]]+?)\s*[)\]]$")
DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d")
EPOCH, MICROSECOND = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)
NANOSECONDS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}


def open_plain(path: Path, config: FileConfig) -> SignalFile:
    """Return the columns of a file as one signal. Raises UnreadableFileError, ConfigError where nothing tells times."""
    columns = open_columns(path)
    fs_hz = config.sampling_frequency_hz or columns.rate_hz
    if not config.time_column and not fs_hz:
        raise ConfigError(
            f"sampling_frequency_hz or time_column: {path} does not tell its rate; columns: {', '.join(columns.names)}"
        )
    if not config.time_column:
        return _one(columns, lambda wanted: evenly(fs_hz, columns.numbers(wanted)))
    clock = number_of(path, config.time_column, columns.names)

    def read(wanted: tuple[int, ...]) -> Sampled:
        if DATE.match(next(columns.texts(clock), (0, ""))[1]):
            values = columns.numbers(wanted)
            times_ns = _dates_ns(columns, clock, len(values))
        else:
            table = columns.numbers((clock, *wanted))
            table = table[np.isfinite(table[:, 0])]
            times_ns, values = nanoseconds(table[:, 0], NANOSECONDS[config.time_unit]), table[:, 1:]
        sampled = stamped(times_ns, values)
        return sampled._replace(fs_hz=fs_hz or sampled.fs_hz)

    return _one(columns, read)


def _dates_ns(columns: Columns, clock: int, rows: int) -> IntArray:
    """Return the dates and times of so many rows as ns since 1970, to the us; without a zone they are of UTC."""
    return np.array([_date_ns(columns, clock, *each) for each in islice(columns.texts(clock), rows)], np.int64)


def _date_ns(columns: Columns, clock: int, line: int, text: str) -> int:
    try:
        date = datetime.fromisoformat(text)
    except ValueError as err:
        name = columns.names[clock]
        raise UnreadableFileError(f"{columns.path}: line {line}: column {name!r} holds {text!r}, no date") from err
    return ((date if date.tzinfo else date.replace(tzinfo=UTC)) - EPOCH) // MICROSECOND * 1000


def _one(columns: Columns, read: Callable[[tuple[int, ...]], Sampled]) -> SignalFile:
    return SignalFile((Signal(columns.names, tuple(map(_unit_in, columns.names)), read),))


def _unit_in(name: str) -> str:
    """Return the unit that ends a name in brackets, as in `ECG (mV)`; empty where that is none; `(1)` is a number."""
    found = UNIT.search(name)
    return found[1] if found and spelt(found[1]) in KNOWN - {"1"} else ""
