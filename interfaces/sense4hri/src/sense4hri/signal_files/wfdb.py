"""WFDB records, as PhysioNet publishes them: a header, and samples of formats 16, 80 and 212, of several rates.

A record may consist of segments, each a record of its own; one without a name (`~`) is a gap. Where the first one has
no length, its header is the layout: it names all signals, of which a segment may have a few, in any order.
"""

from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.signal_files.content import (
    FloatArray,
    Sampled,
    Signal,
    UnreadableFileError,
    beside,
    evenly,
    nanoseconds,
    text_of,
)
from sense4hri.stamps import SECOND_NS

PACKED = {16: (1, 2), 80: (1, 1), 212: (2, 3)}
"""Of each format: so many samples in so many bytes."""


class Line(NamedTuple):
    """A signal line of a header; skew_frames: so much later it was written than the others; bits: 0 = not told.

    number: in the header, from 0; two signals may be described alike.
    """

    number: int
    file: str
    format: int
    per_frame: int
    skew_frames: int
    offset_bytes: int
    gain: float
    baseline: float
    unit: str
    bits: int
    name: str


class Header(NamedTuple):
    """A record: frames per second and how many (0 = not told), the first one's time (0 = not told), and its signals.

    parts: name and number of frames of each segment, where it has segments.
    """

    path: Path
    frames_hz: float
    frames: int
    start_ns: int
    lines: tuple[Line, ...]
    parts: tuple[tuple[str, int], ...] = ()


Key = int | str
"""Of a signal among those of a record of segments: its number, or its name where there is a layout."""


class Segment(NamedTuple):
    """A segment with samples: its first frame in the record, how many it has, its own header and its signals."""

    first: int
    frames: int
    header: Header
    lines: dict[Key, Line]


def open_wfdb(path: Path) -> tuple[Signal, ...]:
    """Return the signals of a record, those of one rate together. Raises UnreadableFileError; OSError: not there."""
    header = _header(path.with_suffix(".hea"))
    if header.parts:
        return tuple(_joined(header))
    if not header.lines:
        raise UnreadableFileError(f"{header.path}: the record has no signals")
    rates = dict.fromkeys(line.per_frame for line in header.lines)
    return tuple(_signal(header, [line for line in header.lines if line.per_frame == rate]) for rate in rates)


def shortfall(path: Path) -> str:
    """Return how much of a record is there, in words; empty where that is all that its header says.

    Segments of a record are not looked at: one that is too short leaves a gap. Raises UnreadableFileError.
    """
    header = _header(path.with_suffix(".hea"))
    there = min((_frames_there(header, line) for line in header.lines), default=0)
    return f"it ends after {there} of its {header.frames} frames" if header.lines and there < header.frames else ""


def _frames_there(header: Header, line: Line) -> int:
    file = beside(header.path, line.file)
    octets = max(0, file.stat().st_size - line.offset_bytes) if file.is_file() else 0
    samples, in_octets = PACKED.get(line.format, (1, 1))
    return octets * samples // in_octets // sum(each.per_frame for each in header.lines if each.file == line.file)


def _signal(header: Header, lines: list[Line]) -> Signal:
    def read(wanted: tuple[int, ...]) -> Sampled:
        columns = [_values(header, lines[number]) for number in wanted]
        return evenly(header.frames_hz * lines[0].per_frame, np.column_stack(columns), header.start_ns)

    units = tuple(line.unit for line in lines)
    return Signal(tuple(line.name for line in lines), units, read, bits=max(line.bits for line in lines))


def _joined(header: Header) -> Iterator[Signal]:
    """Yield the signals of a record of segments, those of one rate together."""
    has_layout = header.parts[0][1] == 0
    firsts = accumulate((frames for _, frames in header.parts), initial=0)
    segments = []
    for first, (name, frames) in zip(firsts, header.parts, strict=False):
        if name != "~":
            own = _header(beside(header.path, f"{name}.hea"))
            if own.parts or own.frames_hz != header.frames_hz:
                raise UnreadableFileError(f"{own.path}: must be a plain record of the rate of {header.path.name}")
            lines = {line.name if has_layout else number: line for number, line in enumerate(own.lines)}
            segments.append(Segment(first, frames, own, lines))
    played = [each for each in segments if each.frames]
    there = {key for each in played for key in each.lines}
    tracks = {key: line for key, line in segments[0].lines.items() if key in there} if played else {}
    if not tracks:
        raise UnreadableFileError(f"{header.path}: the record has no signals")
    for per_frame in dict.fromkeys(line.per_frame for line in tracks.values()):
        yield _track(header, [key for key, line in tracks.items() if line.per_frame == per_frame], played)


def _track(header: Header, keys: list[Key], segments: list[Segment]) -> Signal:
    """Return the signals of these keys; a segment without any of them is a gap, one without some has NaN there."""
    lines = [[each.lines[key] for each in segments if key in each.lines] for key in keys]
    for same in lines:
        if {(line.unit, line.per_frame) for line in same} != {(same[0].unit, lines[0][0].per_frame)}:
            raise UnreadableFileError(f"{header.path}: {same[0].name} has another unit or rate in another segment")
    per_frame = lines[0][0].per_frame

    def read(wanted: tuple[int, ...]) -> Sampled:
        chosen = [keys[number] for number in wanted]
        tables, numbers = [np.empty((0, len(chosen)))], [np.empty(0)]
        for first, frames, own, own_lines in segments:
            if columns := {key: _values(own, own_lines[key]) for key in chosen if key in own_lines}:
                length = min(frames * per_frame, *map(len, columns.values()))
                absent = np.full(length, np.nan)
                tables.append(np.column_stack([columns.get(key, absent)[:length] for key in chosen]))
                numbers.append(first * per_frame + np.arange(length, dtype=np.float64))
        fs_hz = header.frames_hz * per_frame
        even = evenly(fs_hz, np.vstack(tables))
        within_ns = nanoseconds(np.concatenate(numbers), SECOND_NS / fs_hz)
        return even._replace(times_ns=header.start_ns + within_ns)

    names, units = tuple(same[0].name for same in lines), tuple(same[0].unit for same in lines)
    return Signal(names, units, read, bits=max(line.bits for same in lines for line in same))


def _values(header: Header, line: Line) -> FloatArray:
    """Return one signal in the header's unit, shape (n,)."""
    together = [each for each in header.lines if each.file == line.file]
    width = sum(each.per_frame for each in together)
    before = sum(each.per_frame for each in together[: together.index(line)])
    try:
        raw = np.fromfile(beside(header.path, line.file), dtype=np.uint8, offset=line.offset_bytes)
    except OSError as err:
        raise UnreadableFileError(f"{header.path}: {err}") from err
    counts = _counts(raw, line.format, header.path)
    frames = counts[: counts.size // width * width].reshape(-1, width)[:, before : before + line.per_frame]
    beyond = np.full((min(line.skew_frames, len(frames)), line.per_frame), np.nan)
    table = np.vstack([frames[line.skew_frames :], beyond])[: header.frames or None]
    return (table.ravel() - line.baseline) / line.gain


def _counts(raw: NDArray[np.uint8], kind: int, header: Path) -> FloatArray:
    """Return samples as the converter gave them; NaN where one is absent."""
    if kind == 16:
        counts = raw[: raw.size // 2 * 2].view("<i2").astype(np.float64)
        counts[counts == -32768] = np.nan
        return counts
    if kind == 80:
        return np.where(raw == 0, np.nan, raw.astype(np.float64) - 128.0)
    if kind == 212:
        triples = np.pad(raw, (0, -raw.size % 3)).reshape(-1, 3).astype(np.int16)
        first = triples[:, 0] | (triples[:, 1] & 0x0F) << 8
        second = triples[:, 2] | (triples[:, 1] & 0xF0) << 4
        twelve = np.stack([first, second], axis=1).ravel()[: raw.size * 2 // 3]  # an odd last one has two bytes
        counts = np.where(twelve > 2047, twelve - 4096, twelve).astype(np.float64)
        counts[counts == -2048] = np.nan
        return counts
    raise UnreadableFileError(f"{header}: WFDB format {kind} is not among {', '.join(map(str, PACKED))}")


def _header(path: Path) -> Header:
    lines = [line for line in text_of(path).splitlines() if line.strip() and not line.startswith("#")]
    try:
        first = lines[0].split()
        _, is_joined, parts = first[0].partition("/")
        frames_hz = float(first[2].split("/")[0].split("(")[0]) if len(first) > 2 else 250.0
        frames = max(0, int(first[3])) if len(first) > 3 else 0
        if is_joined:
            named = tuple((name, _frames(count)) for name, count in map(str.split, lines[1 : 1 + int(parts)]))
            if len(named) < int(parts):
                raise ValueError(f"{parts} segments are announced, {len(named)} are there")
            return Header(path, frames_hz, frames, _start_ns(first[4:]), (), named)
        signals = tuple(_line(line, number) for number, line in enumerate(lines[1 : 1 + int(first[1])]))
        return Header(path, frames_hz, frames, _start_ns(first[4:]), signals)
    except (IndexError, ValueError) as err:
        raise UnreadableFileError(f"{path}: not a WFDB header: {err}") from err


def _start_ns(words: list[str]) -> int:
    """Return `HH:MM:SS[.fff] DD/MM/YYYY` as ns since 1970, taken for UTC; 0 where the date is not told."""
    if len(words) < 2:
        return 0
    clock, _, fraction = words[0].partition(".")
    second = datetime.strptime(f"{clock} {words[1]}", "%H:%M:%S %d/%m/%Y").replace(tzinfo=UTC)
    return (int(second.timestamp()) * SECOND_NS) + round(float(f"0.{fraction or 0}") * SECOND_NS)


def _frames(count: str) -> int:
    if int(count or 0) < 0:
        raise ValueError(f"{count} frames; it must be 0 or more")
    return int(count or 0)


def _line(text: str, number: int) -> Line:
    """Read `file format[xN][:skew][+offset] gain[(baseline)][/unit] bits zero first checksum block name`."""
    words = text.split(maxsplit=8)
    kind, _, offset = words[1].partition("+")
    kind, _, skew = kind.partition(":")
    kind, _, per_frame = kind.partition("x")
    gain, _, unit = (words[2] if len(words) > 2 else "200").partition("/")
    gain, _, baseline = gain.rstrip(")").partition("(")
    zero = words[4] if len(words) > 4 else "0"
    return Line(
        number,
        words[0],
        int(kind),
        int(per_frame or 1),
        _frames(skew),
        int(offset or 0),
        float(gain) or 200.0,
        float(baseline or zero),
        unit or "mV",
        int(words[3]) if len(words) > 3 else 0,
        words[8].strip() if len(words) > 8 else str(number),
    )
