"""What is in a file of recorded signals, whatever its format. Imports no ROS."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.signal_files.guess import types_of
from sense4hri.stamps import SECOND_NS

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
REGULAR_SHARE = 0.95  # of the steps between stamps that are within NEAR of the median step, where a signal has a rate
NEAR = 0.5
FURTHEST_NS = 1 << 62  # from 0: 146 years; leaves room for the rounds of a loop


class UnreadableFileError(ValueError):
    """The file is not what it was announced as; the message names file and place."""


class Sampled(NamedTuple):
    """Samples as the file has them.

    fs_hz: 0 where they are irregular. times_ns: the file's own time of each, shape (n,). values: shape (n, channels).
    """

    fs_hz: float
    times_ns: IntArray
    values: FloatArray


class Signal(NamedTuple):
    """Channels of a file that were sampled together; nothing is read before `read(numbers of channels)`.

    units: as the file says, empty where it does not. sensor_type: empty where the format does not tell. bits: of the
    converter, 0 = unknown. channel_types: where the format tells them one by one.
    """

    channels: tuple[str, ...]
    units: tuple[str, ...]
    read: Callable[[tuple[int, ...]], Sampled]
    sensor_type: str = ""
    bits: int = 0
    channel_types: tuple[str, ...] = ()

    @property
    def types(self) -> list[str]:
        """Sensor type of every channel, empty where nothing tells it."""
        return list(self.channel_types) or types_of(self.channels, self.units, self.sensor_type)


class Event(NamedTuple):
    """Something that the file says happened, in the file's own time."""

    time_ns: int
    name: str
    value: str = ""


class SignalFile(NamedTuple):
    """Everything in a file. notes: what whoever plays it should know, such as where it is damaged."""

    signals: tuple[Signal, ...]
    events: tuple[Event, ...] = ()
    notes: tuple[str, ...] = ()


def number_of(path: object, column: str, names: tuple[str, ...]) -> int:
    """Return which of the columns is meant: by name, else by number from 0. Raises UnreadableFileError."""
    if column in names:
        return names.index(column)
    if column.isdecimal() and int(column) < len(names):
        return int(column)
    raise UnreadableFileError(f"{path}: no column {column!r}; there are {', '.join(names)}")


def text_of(path: Path) -> str:
    """Return a file's text: UTF-8, and where it is none what Windows wrote before."""
    octets = path.read_bytes()
    try:
        return octets.decode("utf-8-sig")
    except UnicodeDecodeError:
        return octets.decode("cp1252", "replace")


def beside(header: Path, name: str) -> Path:
    """Return the file that a header names; UnreadableFileError where that is not in or below the header's folder."""
    folder = header.parent
    is_plain = name == Path(name).name != ".."  # may be a link to elsewhere, as git-annex keeps large files
    if "\0" in name or not (is_plain or (folder / name).resolve().is_relative_to(folder.resolve())):
        raise UnreadableFileError(f"{header}: names {name!r}, which is not in its folder")
    return folder / name


def nanoseconds(times: FloatArray, unit_ns: float) -> IntArray:
    """Return times in a unit as whole nanoseconds, those that do not fit and those that are NaN as FURTHEST_NS."""
    fits = np.abs(times) < FURTHEST_NS / unit_ns
    return np.where(fits, np.rint(np.where(fits, times, 0.0) * unit_ns), FURTHEST_NS).astype(np.int64)


def evenly(fs_hz: float, values: FloatArray, start_ns: int = 0) -> Sampled:
    """Return samples of a constant rate, the first at start_ns. Raises ValueError where that is no rate."""
    if not 0 < fs_hz < math.inf:
        raise ValueError(f"a sampling rate of {fs_hz:g} Hz")
    times_ns = start_ns + np.rint(np.arange(len(values)) * (SECOND_NS / fs_hz)).astype(np.int64)
    return Sampled(fs_hz, times_ns, values)


def stamped(times_ns: IntArray, values: FloatArray) -> Sampled:
    """Return samples with stamps of their own; their rate is that of the steps that are no gap, or 0."""
    steps = np.diff(times_ns)
    median = float(np.median(steps)) if len(steps) else 0.0
    usual = steps[np.abs(steps - median) <= NEAR * median]
    is_regular = median > 0 and len(usual) >= REGULAR_SHARE * len(steps)
    return Sampled(SECOND_NS / float(np.mean(usual)) if is_regular else 0.0, times_ns, values)
