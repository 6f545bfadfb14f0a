"""BrainVision: a header (.vhdr), its samples (.eeg) as 16-bit integers or 32-bit floats, and its markers (.vmrk).

Brain Products' "BrainVision Core Data Format 1.0". Times begin at the date of the first `New Segment` marker, taken for
UTC; else at 0.
"""

import configparser
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from sense4hri.signal_files.content import Event, Sampled, Signal, SignalFile, UnreadableFileError, beside, evenly
from sense4hri.signal_files.guess import type_of
from sense4hri.stamps import SECOND_NS

FORMATS = {"INT_16": "<i2", "INT_32": "<i4", "IEEE_FLOAT_32": "<f4"}
BITS = {"INT_16": 16}
Sections = configparser.ConfigParser


def open_brainvision(path: Path) -> SignalFile:
    """Return what is in the file. Raises UnreadableFileError."""
    header = _sections(path)
    try:
        common = header["Common Infos"]
        fs_hz = 1e6 / float(common["SamplingInterval"])
        start_ns, events = _markers(path, common.get("MarkerFile", ""), fs_hz)
        return SignalFile((_signal(path, header, fs_hz, start_ns),), events)
    except UnreadableFileError:
        raise
    except (KeyError, ValueError, IndexError, ArithmeticError) as err:
        raise UnreadableFileError(f"{path}: not a BrainVision header: {err}") from err


def _sections(path: Path) -> Sections:
    """Read a file of sections; the line before the first one and free comments are no part of them."""
    text = path.read_text(errors="replace")
    found = Sections(interpolation=None, strict=False, delimiters=("=",), comment_prefixes=(";",))
    found.optionxform = str  # type: ignore[method-assign, assignment]
    try:
        found.read_string(text[max(0, text.find("[")) :].partition("[Comment]")[0])
    except configparser.Error as err:
        raise UnreadableFileError(f"{path}: {str(err).partition(chr(10))[0]}") from err
    return found


def _signal(path: Path, header: Sections, fs_hz: float, start_ns: int) -> Signal:
    common, kind = header["Common Infos"], header["Binary Infos"]["BinaryFormat"]
    count = int(common["NumberOfChannels"])
    infos = [header["Channel Infos"][f"Ch{number + 1}"].split(",") for number in range(count)]
    scales = np.array([float(info[2] or 1) if len(info) > 2 else 1.0 for info in infos])
    if kind not in FORMATS:
        raise UnreadableFileError(f"{path}: BinaryFormat {kind} is not among {', '.join(FORMATS)}")
    data = beside(path, common["DataFile"].replace("$b", path.stem))
    by_sample = common.get("DataOrientation", "MULTIPLEXED") == "MULTIPLEXED"

    def read(wanted: tuple[int, ...]) -> Sampled:
        stored = np.fromfile(data, FORMATS[kind])
        whole = stored[: stored.size // count * count]
        table = whole.reshape(-1, count) if by_sample else whole.reshape(count, -1).T
        return evenly(fs_hz, table[:, list(wanted)] * scales[list(wanted)], start_ns)

    names = tuple(info[0].replace(r"\1", ",") for info in infos)
    units = tuple((info[3] if len(info) > 3 else "") or "uV" for info in infos)
    return Signal(names, units, read, "eeg" if not _told(names) else "", BITS.get(kind, 0))


def _told(names: tuple[str, ...]) -> bool:
    """True where a channel's name says that it is something other than an EEG."""
    return any(type_of(name) not in ("", "eeg") for name in names)


def _markers(path: Path, name: str, fs_hz: float) -> tuple[int, tuple[Event, ...]]:
    """Return when the first sample was taken, 0 where nothing tells it, and the markers."""
    file = beside(path, name.replace("$b", path.stem))
    if not file.is_file():
        return 0, ()
    sections = _sections(file)
    infos = sections["Marker Infos"] if sections.has_section("Marker Infos") else {}
    marks = [text.split(",") for text in infos.values()]
    start_ns = next((_date_ns(mark[5]) for mark in marks if mark[0] == "New Segment" and len(mark) > 5), 0)
    told = [mark for mark in marks if mark[0] != "New Segment"]
    return start_ns, tuple(_event(mark, start_ns, fs_hz) for mark in told)


def _event(mark: list[str], start_ns: int, fs_hz: float) -> Event:
    """Read `type,description,position of the sample from 1, ...`."""
    kind, text = (word.replace(r"\1", ",").strip() for word in mark[:2])
    return Event(start_ns + round((int(mark[2]) - 1) / fs_hz * SECOND_NS), text or kind, kind)


def _date_ns(text: str) -> int:
    """Return `YYYYMMDDhhmmssuuuuuu` as ns since 1970; 0 where it is not set."""
    if not text.strip().strip("0"):
        return 0
    second = datetime.strptime(text[:14], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    return int(second.timestamp()) * SECOND_NS + int(text[14:20] or 0) * 1000
