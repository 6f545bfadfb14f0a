"""What is in a file of recorded signals, whatever its format. Imports no ROS."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.stamps import SECOND_NS

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
REGULAR_SHARE = 0.95  # of the steps between stamps that are within NEAR of the median step, where a signal has a rate
NEAR = 0.5


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
    converter, 0 = unknown.
    """

    channels: tuple[str, ...]
    units: tuple[str, ...]
    read: Callable[[tuple[int, ...]], Sampled]
    sensor_type: str = ""
    bits: int = 0


class Event(NamedTuple):
    """Something that the file says happened, in the file's own time."""

    time_ns: int
    name: str
    value: str = ""


class SignalFile(NamedTuple):
    """Everything in a file."""

    signals: tuple[Signal, ...]
    events: tuple[Event, ...] = ()


def number_of(path: object, column: str, names: tuple[str, ...]) -> int:
    """Return which of the columns is meant: by name, else by number from 0. Raises UnreadableFileError."""
    if column in names:
        return names.index(column)
    if column.isdecimal() and int(column) < len(names):
        return int(column)
    raise UnreadableFileError(f"{path}: no column {column!r}; there are {', '.join(names)}")


def evenly(fs_hz: float, values: FloatArray, start_ns: int = 0) -> Sampled:
    """Return samples of a constant rate, the first at start_ns."""
    times_ns = start_ns + np.rint(np.arange(len(values)) * (SECOND_NS / fs_hz)).astype(np.int64)
    return Sampled(fs_hz, times_ns, values)


def stamped(times_ns: IntArray, values: FloatArray) -> Sampled:
    """Return samples with stamps of their own; their rate is that of the steps that are no gap, or 0."""
    steps = np.diff(times_ns)
    median = float(np.median(steps)) if len(steps) else 0.0
    usual = steps[np.abs(steps - median) <= NEAR * median]
    is_regular = median > 0 and len(usual) >= REGULAR_SHARE * len(steps)
    return Sampled(SECOND_NS / float(np.mean(usual)) if is_regular else 0.0, times_ns, values)
