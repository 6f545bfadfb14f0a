"""EyeLink ASC, as edf2asc writes it: gaze in px and pupil in the tracker's own units, of one eye or both, and messages.

A sample that the tracker lost (`.`, or a pupil of 0 beside it) is NaN. Times are the tracker's, in ms; the second of
two samples in one ms, at 2000 Hz without decimals, is half a ms later. Of two eyes the left one is
`eye_tracking`; the right one's columns are `gaze_x_right` and `gaze_y_right`.
"""

import math
import re
from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sense4hri.signal_files.content import (
    Event,
    FloatArray,
    IntArray,
    Sampled,
    Signal,
    SignalFile,
    UnreadableFileError,
    nanoseconds,
    stamped,
)

MESSAGE = re.compile(r"MSG\s+(\d+(?:\.\d+)?)\s+(\S+)\s*(.*)")
FLAGS = re.compile(r"[ICR.]{3}|[ICR.]{5}")
BOTH_FLAGS = 5  # signs of two eyes; of one there are 3
EYE = 3  # columns of one eye: x, y, pupil
MS = 1_000_000


class Eyes(NamedTuple):
    """What the SAMPLES line says: which eyes, left one first, and the unit of gaze."""

    sides: tuple[str, ...]
    unit: str


def open_eyelink(path: Path) -> SignalFile:
    """Return what is in the file. Raises UnreadableFileError that names the line."""
    times_ms, values = array("d"), array("d")
    events: list[Event] = []
    eyes: Eyes | None = None
    with path.open(errors="replace") as file:
        for number, line in enumerate(file, 1):
            if line[:1].isdigit():
                cells = line.split()
                eyes = eyes or _guessed(cells[1:])
                _take(path, number, cells, len(eyes.sides) * EYE, times_ms, values)
            elif found := MESSAGE.match(line):
                events.append(Event(round(float(found[1]) * MS), found[2], found[3]))
            elif line.startswith("SAMPLES"):
                eyes = _said(path, number, line.split(), eyes)
    if not eyes or not times_ms:
        raise UnreadableFileError(f"{path}: no samples in it")
    table = np.array(values).reshape(len(times_ms), -1)
    times = np.array(times_ms)
    times[1:] += 0.5 * (np.diff(times) == 0)
    return SignalFile(_signals(nanoseconds(times, MS), table, eyes), tuple(events))


def _said(path: Path, number: int, words: list[str], before: Eyes | None) -> Eyes:
    """Read `SAMPLES GAZE LEFT RIGHT VEL RES RATE ...`; velocity and what else comes after the columns of the eyes."""
    sides = tuple(side.lower() for side in ("LEFT", "RIGHT") if side in words)
    eyes = Eyes(sides, "px" if "GAZE" in words else "a.u.")
    if not sides or (before and before != eyes):
        raise UnreadableFileError(f"{path}: line {number}: names no eye, or others than before: {' '.join(words)!r}")
    return eyes


def _guessed(cells: list[str]) -> Eyes:
    """Tell the eyes, where no line says them: by the tracker's flags, else by the columns."""
    flags = next(filter(FLAGS.fullmatch, cells), "")
    are_both = len(flags) == BOTH_FLAGS if flags else _numbers(cells) >= 2 * EYE
    return Eyes(("left", "right") if are_both else ("right",), "px")


def _take(
    path: Path, number: int, cells: list[str], columns: int, times_ms: "array[float]", values: "array[float]"
) -> None:
    """Append a sample: its time, and x, y, pupil of each eye."""
    try:
        if len(cells) <= columns:
            raise ValueError("too few cells")
        row = [math.nan if cell == "." else float(cell) for cell in cells[1 : 1 + columns]]
        times_ms.append(float(cells[0]))
        values.extend(row)
    except ValueError as err:
        said = " ".join(cells)
        raise UnreadableFileError(f"{path}: line {number}: {said!r} is no sample with {columns} values") from err


def _signals(times_ns: IntArray, values: FloatArray, eyes: Eyes) -> tuple[Signal, ...]:
    """Return gaze and pupil of values of shape (n, 3 for each eye)."""
    lost = np.isnan(values[:, 0::EYE])
    pupils = values[:, 2::EYE]
    pupils[lost & (pupils == 0)] = np.nan
    pupil = _signal(times_ns, pupils, tuple(f"diameter_{side}" for side in eyes.sides), "a.u.", "pupillometry")
    first = _signal(times_ns, values[:, :2], ("gaze_x", "gaze_y"), eyes.unit, "eye_tracking")
    if len(eyes.sides) == 1:
        return first, pupil
    return first, pupil, _signal(times_ns, values[:, 3:5], ("gaze_x_right", "gaze_y_right"), eyes.unit, "eye_tracking")


def _signal(times_ns: IntArray, values: FloatArray, names: tuple[str, ...], unit: str, kind: str) -> Signal:
    def read(wanted: tuple[int, ...]) -> Sampled:
        return stamped(times_ns, values[:, list(wanted)])

    return Signal(names, (unit,) * len(names), read, kind)


def _numbers(cells: list[str]) -> int:
    """Return how many cells from the first on are numbers or a lost sample."""
    are = [cell == "." or re.fullmatch(r"-?[\d.]+(e[-+]?\d+)?", cell) is not None for cell in cells]
    return are.index(False) if False in are else len(are)
