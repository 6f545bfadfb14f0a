"""Empatica E4, the zip it exports or the folder of it: ACC, BVP, EDA, TEMP with the session's UTC times, and its tags.

The first line of a file is when it begins, in s since 1970, the second its rate. HR.csv and IBI.csv are not read: they
are made of BVP.
"""

import io
import zipfile
import zlib
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
from sense4hri.signal_files.content import Event, FloatArray, Sampled, Signal, SignalFile, UnreadableFileError, evenly
from sense4hri.stamps import SECOND_NS

from driver_file.packed import check_unpacked

ACC_PER_G = 64.0
FILES = (
    ("ACC.csv", "accelerometer", ("x", "y", "z"), "g", 1 / ACC_PER_G),
    ("BVP.csv", "ppg", ("bvp",), "a.u.", 1.0),
    ("EDA.csv", "eda", ("eda",), "uS", 1.0),
    ("TEMP.csv", "temperature", ("temperature",), "degC", 1.0),
)
TAGS = "tags.csv"
HEAD = 2  # lines before the samples
READ = {*(each[0] for each in FILES), TAGS}
Opened = Callable[[str], io.TextIOBase]


def open_empatica(path: Path) -> SignalFile:
    """Return what is in a zip or folder. Raises UnreadableFileError where it holds none of an E4's files."""
    if path.is_dir():
        return _all(path, {each.name for each in path.iterdir()}, lambda name: (path / name).open(errors="replace"))
    try:
        with zipfile.ZipFile(path) as archive:
            infos = [its for its in archive.infolist() if its.filename.rpartition("/")[2] in READ]
            held = {its.filename.rpartition("/")[2]: its for its in infos}
            if len(held) < len(infos):
                raise UnreadableFileError(f"{path}: several recordings of an E4 in it; give the folder or zip of one")
            check_unpacked(path, sum(its.file_size for its in infos))
            texts = {name: archive.read(its).decode(errors="replace") for name, its in held.items()}
    except (zipfile.BadZipFile, RuntimeError, zlib.error) as err:
        raise UnreadableFileError(f"{path}: {err}") from err
    return _all(path, set(texts), lambda name: io.StringIO(texts[name]))


def _all(path: Path, there: set[str], open_: Opened) -> SignalFile:
    held = [each for each in FILES if each[0] in there]
    if not held:
        raise UnreadableFileError(f"{path}: none of {', '.join(each[0] for each in FILES)} of an Empatica E4 in it")
    empty = [each for each in held if not _has_samples(each[0], open_)]
    if empty == held:
        raise UnreadableFileError(f"{path}: no samples in {', '.join(each[0] for each in held)}")
    signals = tuple(_signal(path, open_, *each) for each in held if each not in empty)
    tags = _table(path, TAGS, open_, 1)[:, 0].tolist() if TAGS in there else []
    events = tuple(Event(round(at_s * SECOND_NS), "tag") for at_s in tags)
    named = ", ".join(f"{name} ({kind})" for name, kind, *_ in empty)
    return SignalFile(signals, events, (f"without samples, left out: {named}",) if empty else ())


def _has_samples(name: str, open_: Opened) -> bool:
    with open_(name) as file:
        return len(list(islice(filter(str.strip, file), HEAD + 1))) > HEAD


def _signal(
    path: Path, open_: Opened, name: str, kind: str, channels: tuple[str, ...], unit: str, factor: float
) -> Signal:
    def read(wanted: tuple[int, ...]) -> Sampled:
        table = _table(path, name, open_, len(channels))
        if len(table) < HEAD or table[1, 0] <= 0:
            raise UnreadableFileError(f"{path}: {name} begins with no time and rate")
        return evenly(float(table[1, 0]), factor * table[HEAD:, list(wanted)], round(table[0, 0] * SECOND_NS))

    return Signal(channels, (unit,) * len(channels), read, kind)


def _table(path: Path, name: str, open_: Opened, columns: int) -> FloatArray:
    """Return the rows of a file, a last one that was cut off left out."""
    with open_(name) as file:
        rows = [(number, line.split(",")) for number, line in enumerate(file, 1) if line.strip()]
    if rows and len(rows[-1][1]) < columns:
        del rows[-1]
    for number, cells in rows:
        if len(cells) != columns:
            raise UnreadableFileError(f"{path}: {name}: line {number}: {len(cells)} numbers, not {columns}")
    try:
        return np.array([[float(cell) for cell in cells] for _, cells in rows]).reshape(len(rows), columns)
    except ValueError as err:
        raise UnreadableFileError(f"{path}: {name}: {err}") from err
