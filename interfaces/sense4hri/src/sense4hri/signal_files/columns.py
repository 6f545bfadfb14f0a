"""Text with numbers in columns: CSV, tab or space separated, with or without a line of names.

Lines that begin with # or % are comments; of these the sampling rate and the names of columns are taken where they say
them, as BioSPPy's and OpenSignals' do. An empty cell is NaN. A last row that was cut off is left out. A cell in double
quotes may hold the separator. Between semicolons decimals may stand behind a comma, as Excel of half of Europe has it.
"""

import csv
import re
import warnings
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sense4hri.signal_files.content import FloatArray, UnreadableFileError

COMMENTS = ("#", "%")
ENCODING = "utf-8-sig"  # Excel begins its UTF-8 with a mark, which is no part of the first name
OLDER = "cp1252"  # of what is no UTF-8, as Excel's plain CSV
RATE = re.compile(r"sampling[ _]?(?:rate|frequency)\D*?(\d+(?:\.\d+)?)(?!\d|,\d{3}\b)", re.IGNORECASE)
LABELS = re.compile(r'Labels:=\s*(.*)|"column":\s*\[([^\]]*)\]')


class Columns(NamedTuple):
    """A file of columns; `numbers` reads it. rate_hz: as a comment says, 0 where none does. skip: lines before data."""

    path: Path
    names: tuple[str, ...]
    rate_hz: float
    mark: str | None
    skip: int
    encoding: str

    def numbers(self, wanted: tuple[int, ...]) -> FloatArray:
        """Return the wanted columns, shape (n, wanted); UnreadableFileError names line and column of what is none."""
        self._check_counts()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # no data: told by the shape
                return np.loadtxt(
                    self.path,
                    comments=COMMENTS,
                    delimiter=self.mark,
                    skiprows=self.skip,
                    usecols=wanted,
                    ndmin=2,
                    encoding=self.encoding,
                    quotechar='"',
                )
        except ValueError:  # an empty cell, a row cut off, or what is no number: which, and where
            return np.array(list(self._rows(wanted))).reshape(-1, len(wanted))

    def texts(self, column: int) -> Iterator[tuple[int, str]]:
        """Yield a column's cells as they stand, each with the number of its line; empty where a row is cut off."""
        for number, line in self._lines():
            cells = split(line, self.mark)
            yield number, cells[column] if column < len(cells) else ""

    def _check_counts(self) -> None:
        """Raise UnreadableFileError where a row holds more numbers than there are columns: which is whose is unknown.

        So a comma of thousands or decimals shows in columns that commas separate.
        """
        for number, line in self._lines():
            if self.mark and line.count(self.mark) >= len(self.names):
                cells = split(line, self.mark)
                if any(cells[len(self.names) :]) and all(_is_number(cell, self.mark) for cell in cells):
                    raise UnreadableFileError(
                        f"{self.path}: line {number}: {len(cells)} numbers in {len(self.names)} columns"
                    )

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Yield every row with its number in the file, from 1."""
        with self.path.open(encoding=self.encoding, errors="replace") as file:
            for number, line in enumerate(islice(file, self.skip, None), self.skip + 1):
                if _is_data(line):
                    yield number, line

    def _rows(self, wanted: tuple[int, ...]) -> Iterator[list[float]]:
        lines = list(self._lines())
        points = set[str]()
        for number, line in lines:
            cells = split(line, self.mark)
            if len(cells) <= max(wanted) and number == lines[-1][0]:
                return
            yield [self._number(cells, column, number) for column in wanted]
            points |= {each for each in ",." for column in wanted if each in cells[column]}
            if len(points) > 1:
                raise UnreadableFileError(
                    f"{self.path}: line {number}: numbers with commas and with points: which is which?"
                )

    def _number(self, cells: list[str], column: int, line: int) -> float:
        try:
            return _value(cells[column], self.mark)
        except (IndexError, ValueError) as err:
            what = f"holds {cells[column]!r}" if column < len(cells) else "is missing"
            raise UnreadableFileError(f"{self.path}: line {line}: column {self.names[column]!r} {what}") from err


def open_columns(path: Path) -> Columns:
    """Look at the head of a file. Raises UnreadableFileError where it holds none, OSError where it is not there."""
    said, skip, encoding = "", 0, _encoding(path)
    with path.open(encoding=encoding, errors="replace") as file:
        for line in file:
            if _is_data(line):
                break
            said, skip = said + line, skip + 1
        else:
            raise UnreadableFileError(f"{path}: no data")
        following = next(filter(_is_data, file), "")
    mark = next((each for each in (";", "\t", ",") if each in line), None)
    cells = _without_tail(split(line, mark))
    has_names = not all(_is_number(cell, mark) for cell in cells)
    if has_names and following:
        _check_count(path, cells, split(following, mark))
    rate = RATE.search(said)
    names = tuple(cells) if has_names else _labels(said, len(cells))
    return Columns(path, names, float(rate[1]) if rate else 0.0, mark, skip + has_names, encoding)


def _encoding(path: Path) -> str:
    try:
        with path.open(encoding=ENCODING) as file:
            for _ in file:
                pass
    except UnicodeDecodeError:
        return OLDER
    return ENCODING


def split(line: str, mark: str | None) -> list[str]:
    """Return the cells of a line, an empty first or last one too where a mark separates them."""
    if mark and '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=mark, skipinitialspace=True))]
    return [cell.strip().strip('"') for cell in line.strip(" \r\n" if mark else None).split(mark)]


def _without_tail(cells: list[str]) -> list[str]:
    """Return the cells without the empty one that a separator at a line's end leaves behind it."""
    return cells if cells[-1] else cells[:-1]


def _check_count(path: Path, names: list[str], cells: list[str]) -> None:
    """Raise UnreadableFileError where the first row has another number of cells than there are names."""
    if len(names) not in (len(cells), len(_without_tail(cells))):
        raise UnreadableFileError(f"{path}: {len(names)} names ({', '.join(names)}) over a row of {len(cells)} cells")


def _labels(said: str, count: int) -> tuple[str, ...]:
    """Return the names that a comment gives to so many columns, their numbers where none does."""
    found = LABELS.search(said)
    names = [name.strip(' "') for name in (found[1] or found[2]).split(",")] if found else []
    return tuple(names) if len(names) == count else tuple(map(str, range(count)))


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.startswith(COMMENTS)


def _value(text: str, mark: str | None) -> float:
    """Return the number in a cell, NaN of an empty one. Raises ValueError."""
    return float((text.replace(",", ".", 1) if mark == ";" and "." not in text else text) or "nan")


def _is_number(text: str, mark: str | None) -> bool:
    try:
        _value(text, mark)
    except ValueError:
        return False
    return True
