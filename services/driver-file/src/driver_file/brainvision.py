"""BrainVision: a header (.vhdr), its samples (.eeg) as 16-bit integers or 32-bit floats, and its markers (.vmrk).

Brain Products' "BrainVision Core Data Format 1.0". Times begin at the date of the first `New Segment` marker, taken for
UTC; else at 0. A later `New Segment` with a date is where the recording went on after a pause.
"""

import configparser
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.signal_files.content import (
    Event,
    IntArray,
    Sampled,
    Signal,
    SignalFile,
    UnreadableFileError,
    beside,
    evenly,
    text_of,
)
from sense4hri.signal_files.guess import type_of
from sense4hri.stamps import SECOND_NS

FORMATS = {"INT_16": "i2", "INT_32": "i4", "IEEE_FLOAT_32": "f4"}
BITS = {"INT_16": 16}
READ = (("DataFormat", "BINARY"), ("DataType", "TIMEDOMAIN"))
ORIENTATIONS = ("MULTIPLEXED", "VECTORIZED")
NEW_SEGMENT = "New Segment"
Sections = configparser.ConfigParser
Clock = Callable[[IntArray], IntArray]
"""From numbers of samples, from 0, to their times in ns."""


def open_brainvision(path: Path) -> SignalFile:
    """Return what is in the file. Raises UnreadableFileError."""
    header = _sections(path)
    try:
        common = header["Common Infos"]
        fs_hz = 1e6 / float(common["SamplingInterval"])
        marks = _marks(path, common.get("MarkerFile", ""))
        clock = _clock(marks, fs_hz)
        told = tuple(_event(mark, clock) for mark in marks if mark[0] != NEW_SEGMENT)
        return SignalFile((_signal(path, header, fs_hz, clock),), told, tuple(_notes(path, header)))
    except UnreadableFileError:
        raise
    except (KeyError, ValueError, IndexError, ArithmeticError) as err:
        raise UnreadableFileError(f"{path}: not a BrainVision header: {err}") from err


def _sections(path: Path) -> Sections:
    """Read a file of sections; the line before the first one and free comments are no part of them."""
    text = text_of(path)
    found = Sections(interpolation=None, strict=False, delimiters=("=",), comment_prefixes=(";",))
    found.optionxform = str  # type: ignore[method-assign, assignment]
    try:
        found.read_string(text[max(0, text.find("[")) :].partition("[Comment]")[0])
    except configparser.Error as err:
        raise UnreadableFileError(f"{path}: {str(err).partition(chr(10))[0]}") from err
    return found


class _Stored(NamedTuple):
    """Where the values are, and how they lie there. points: of each channel, 0 where the header does not tell."""

    data: Path
    kind: str
    channels: int
    orientation: str
    points: int

    def table(self) -> NDArray[Any]:
        """Return the values, shape (n, channels). Raises UnreadableFileError where they cannot be parted."""
        stored = np.fromfile(self.data, self.kind)
        if self.orientation == "MULTIPLEXED":
            return stored[: stored.size // self.channels * self.channels].reshape(-1, self.channels)
        if stored.size == self.channels * (self.points or stored.size // self.channels):
            return stored.reshape(self.channels, -1).T
        how = f"{stored.size} values of {self.channels} channels, one channel after the other"
        raise UnreadableFileError(f"{self.data}: {how}: cut off, or of another header")


def _signal(path: Path, header: Sections, fs_hz: float, clock: Clock) -> Signal:
    common = header["Common Infos"]
    for key, only in READ:
        if (said := common.get(key, only).upper()) != only:
            raise UnreadableFileError(f"{path}: {key} {said} is not read, only {only}")
    kind = header["Binary Infos"]["BinaryFormat"]
    infos = [header["Channel Infos"][f"Ch{number + 1}"].split(",") for number in range(int(common["NumberOfChannels"]))]
    scales = np.array([float(info[2] or 1) if len(info) > 2 else 1.0 for info in infos])
    stored = _stored(path, header)

    def read(wanted: tuple[int, ...]) -> Sampled:
        table = stored.table()
        even = evenly(fs_hz, table[:, list(wanted)] * scales[list(wanted)])
        return even._replace(times_ns=clock(np.arange(len(table))))

    names = tuple(info[0].replace(r"\1", ",") for info in infos)
    units = tuple((info[3] if len(info) > 3 else "") or "uV" for info in infos)
    return Signal(names, units, read, "eeg" if not _told(names) else "", BITS.get(kind, 0))


def _stored(path: Path, header: Sections) -> _Stored:
    """Return how a header says that the values are stored. Raises UnreadableFileError for what is not read."""
    common, binary = header["Common Infos"], header["Binary Infos"]
    kind = binary["BinaryFormat"]
    if kind not in FORMATS:
        raise UnreadableFileError(f"{path}: BinaryFormat {kind} is not among {', '.join(FORMATS)}")
    data = _named(path, common["DataFile"])
    orientation = common.get("DataOrientation", "MULTIPLEXED").upper()
    if orientation not in ORIENTATIONS:
        raise UnreadableFileError(f"{path}: DataOrientation {orientation} is neither {' nor '.join(ORIENTATIONS)}")
    order = ">" if binary.get("UseBigEndianOrder", "NO").upper() == "YES" else "<"
    return _Stored(data, order + FORMATS[kind], int(common["NumberOfChannels"]), orientation, _points(common))


def _named(path: Path, name: str) -> Path:
    """Return the file that a header names, `$b` being its own name."""
    return beside(path, name.replace("$b", path.stem))


def _points(common: Mapping[str, str]) -> int:
    """Return how many samples a channel has, 0 where the header does not tell."""
    return int(common.get("DataPoints") or 0)


def _notes(path: Path, header: Sections) -> Iterator[str]:
    """Yield what the header announces and is not there."""
    common, kind = header["Common Infos"], header["Binary Infos"]["BinaryFormat"]
    size = _named(path, common["DataFile"]).stat().st_size
    there = size // np.dtype(FORMATS[kind]).itemsize // int(common["NumberOfChannels"])
    if there < _points(common):
        yield f"it ends after {there} of its {_points(common)} samples"
    markers = common.get("MarkerFile", "")
    if markers and not _named(path, markers).is_file():
        yield f"{_named(path, markers).name} is not there: neither markers nor a date"


def _told(names: tuple[str, ...]) -> bool:
    """True where a channel's name says that it is something other than an EEG."""
    return any(type_of(name) not in ("", "eeg") for name in names)


def _marks(path: Path, name: str) -> list[list[str]]:
    """Return the parts of every marker: type, description, position of the sample from 1, ...; none without a file."""
    file = _named(path, name)
    if not file.is_file():
        return []
    sections = _sections(file)
    return [text.split(",") for text in sections["Marker Infos"].values()] if "Marker Infos" in sections else []


def _clock(marks: list[list[str]], fs_hz: float) -> Clock:
    """Return what makes times of samples' numbers: from each dated `New Segment` on those that follow its date.

    A date within the samples before it is no pause: of averages and epochs, or of a clock that was set.
    """
    segments: list[tuple[int, int]] = []  # number of the first sample, its time
    for mark in marks:
        date_ns = _date_ns(mark[5]) if mark[0] == NEW_SEGMENT and len(mark) > 5 else 0
        first = int(mark[2]) - 1 if date_ns else 0
        if date_ns and (not segments or date_ns >= segments[-1][1] + (first - segments[-1][0]) / fs_hz * SECOND_NS):
            segments.append((first, date_ns))
    firsts, starts_ns = np.array(segments or [(0, 0)], np.int64).T

    def times_ns(samples: IntArray) -> IntArray:
        segment = np.maximum(np.searchsorted(firsts, samples, "right") - 1, 0)
        within_ns = np.rint((samples - firsts[segment]) / fs_hz * SECOND_NS).astype(np.int64)
        return np.asarray(starts_ns[segment] + within_ns)

    return times_ns


def _event(mark: list[str], clock: Clock) -> Event:
    kind, text = (word.replace(r"\1", ",").strip() for word in mark[:2])
    return Event(int(clock(np.array([int(mark[2]) - 1]))[0]), text or kind, kind)


def _date_ns(text: str) -> int:
    """Return `YYYYMMDDhhmmssuuuuuu` as ns since 1970; 0 where it is not set."""
    if not text.strip().strip("0"):
        return 0
    second = datetime.strptime(text[:14], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    return int(second.timestamp()) * SECOND_NS + int(text[14:20] or 0) * 1000
