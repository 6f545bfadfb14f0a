"""EyeLink ASC, as edf2asc writes it: gaze in px and pupil in the tracker's own units, of one eye or both, and messages.

A sample that the tracker lost (`.`, or a pupil of 0 beside it) is NaN. Times are the tracker's, in ms. Of two eyes the
left one is `eye_tracking`; the right one's columns are `gaze_x_right` and `gaze_y_right`.
"""

import re
from pathlib import Path

import numpy as np
from sense4hri.signal_files.content import (
    Event,
    FloatArray,
    IntArray,
    Sampled,
    Signal,
    SignalFile,
    UnreadableFileError,
    stamped,
)

MESSAGE = re.compile(r"MSG\s+(\d+)\s+(\S+)\s*(.*)")
EYE = 3  # columns of one eye: x, y, pupil
MS = 1_000_000


def open_eyelink(path: Path) -> SignalFile:
    """Return what is in the file. Raises UnreadableFileError that names the line."""
    rows: list[list[str]] = []
    events: list[Event] = []
    both = "RIGHT"
    with path.open(errors="replace") as file:
        for number, line in enumerate(file, 1):
            if line[:1].isdigit():
                rows.append([str(number), *line.split()])
            elif found := MESSAGE.match(line):
                events.append(Event(int(found[1]) * MS, found[2], found[3]))
            elif line.startswith("SAMPLES"):
                both = "RIGHT" if "LEFT" not in line else "LEFT"
    if not rows:
        raise UnreadableFileError(f"{path}: no samples in it")
    return SignalFile(_signals(path, rows, only=both), tuple(events))


def _signals(path: Path, rows: list[list[str]], only: str) -> tuple[Signal, ...]:
    """Return gaze and pupil; only: the eye, where there is one."""
    eyes = 2 if _numbers(rows[0][2:]) >= 2 * EYE else 1
    times_ns, values = _table(path, rows, eyes * EYE)
    lost = np.isnan(values[:, 0::EYE])
    pupils = values[:, 2::EYE]
    pupils[lost & (pupils == 0)] = np.nan
    sides = ("left", "right") if eyes == 2 else (only.lower(),)
    pupil = _signal(times_ns, pupils, tuple(f"diameter_{side}" for side in sides), "a.u.", "pupillometry")
    first = _signal(times_ns, values[:, :2], ("gaze_x", "gaze_y"), "px", "eye_tracking")
    if eyes == 1:
        return first, pupil
    return first, pupil, _signal(times_ns, values[:, 3:5], ("gaze_x_right", "gaze_y_right"), "px", "eye_tracking")


def _signal(times_ns: IntArray, values: FloatArray, names: tuple[str, ...], unit: str, kind: str) -> Signal:
    def read(wanted: tuple[int, ...]) -> Sampled:
        return stamped(times_ns, values[:, list(wanted)])

    return Signal(names, (unit,) * len(names), read, kind)


def _numbers(cells: list[str]) -> int:
    """Return how many cells from the first on are numbers or a lost sample."""
    are = [cell == "." or re.fullmatch(r"-?[\d.]+(e[-+]?\d+)?", cell) is not None for cell in cells]
    return are.index(False) if False in are else len(are)


def _table(path: Path, rows: list[list[str]], columns: int) -> tuple[IntArray, FloatArray]:
    try:
        times = [float(row[1]) for row in rows]
        values = [[float("nan") if cell == "." else float(cell) for cell in row[2 : 2 + columns]] for row in rows]
        return np.rint(np.array(times) * MS).astype(np.int64), np.array(values).reshape(len(rows), columns)
    except ValueError as err:
        odd = next((row for row in rows if _numbers(row[2 : 2 + columns]) < columns), rows[0])
        said = " ".join(odd[1:])
        raise UnreadableFileError(f"{path}: line {odd[0]}: {said!r} is no sample with {columns} values") from err
