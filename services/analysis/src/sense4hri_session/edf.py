"""EDF+ and BDF+: one file per stream, constant rate, markers and gaps as annotations.

Every file of a session begins at the same whole second, so that files lie beside each other as they are.
Format: Kemp & Olivan 2003 (EDF+); 24 bits as BDF+ where a sensor's resolution is above 16 bits or not known,
or where values beyond its range, or far beyond its usual ones, would make 16 bits too coarse.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from sense4hri.plain_text import plain
from sense4hri_recording.errors import SessionError
from sense4hri_report.rules import counted

from sense4hri_session.constant_rate import SECOND_NS, ConstantRate, span_of, whole_rate_hz
from sense4hri_session.plain_text import ascii_only
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

try:
    import pyedflib
except ImportError:  # pyproject.toml: from Python 3.13 on it has to be built
    pyedflib = None  # type: ignore[assignment]

LACKING = (
    "no EDF, and no EEG and EMG in BIDS: pyedflib is not installed; "
    "pip install 'sense4hri_session[edf]' builds it with a C compiler"
)
GAP = "BAD_gap"
CLOCK = "BAD_clock"
BEGINS_NS, ENDS_NS = 473_385_600 * SECOND_NS, 3_629_059_200 * SECOND_NS  # 1985-01-01, 2085-01-01 less a day
LARGEST_LIMIT = 9_000_000
SWING = 0.1  # of the range
COARSE = 2.0  # steps of the sensor that one step of a file may be
FLAT = 16.0  # steps of the file in which a signal is no more than a staircase
LABEL = 16  # characters; an annotation of one channel ends with @@ and its label (EDFbrowser, MNE)
TAKEN = ("status", "trigger", "edf annotations", "bdf annotations")  # labels by which readers know no signal
DIMENSION = 8  # characters
ANNOTATION = 40  # bytes that the library writes
ROOM, MOST_ROOM = 2, 64  # annotations in a second; as many as are needed, where those are more
_UNITS = {"1": "", "a.u.": "au"}


def is_there() -> bool:
    """True where the library that writes EDF is installed."""
    return pyedflib is not None


def is_a_date(start_ns: int) -> bool:
    """True where a file can say that it begins then."""
    return BEGINS_NS <= start_ns < ENDS_NS


def write(session: Session, stream: Stream, start_ns: int, stem: Path) -> Iterator[str]:
    """Write one stream as `stem` and its ending, and read it back; yields sentences on what it does not hold.

    Nothing where the library is not there. Raises SessionError where it cannot be read back.
    """
    if not is_there():
        return
    rate = whole_rate_hz(stream)
    grid = ConstantRate(stream, start_ns, float(rate), span_of(session))
    written = _write(session, grid, stem)
    if not grid.samples:
        written.path.unlink()
    yield from (f"{stream.key}, EDF: {words}" for words in _not_held(session, grid, written))
    if grid.samples:
        yield from _read_back(written.path, stream, rate, grid.samples, written.annotated)


class _Written(NamedTuple):
    """A file. wide: of 24 bits; annotated: the texts of its annotations; flat: it shows too little of a channel."""

    path: Path
    wide: bool
    annotated: list[str]
    flat: bool


def _write(session: Session, grid: ConstantRate, stem: Path) -> _Written:
    """Write the file with as many bits, and as much room for annotations, as it needs."""
    bits = int(grid.stream.metadata.get("resolution_bits") or 0)
    wide = not 0 < bits <= 16 or _coarseness(grid.stream, 16) > COARSE
    path = stem.with_name(stem.name + (".bdf" if wide else ".edf"))
    annotated, flat = _file(path, session, grid, wide, ROOM)
    if flat and not wide:
        path.unlink()
        wide, path = True, path.with_suffix(".bdf")
        annotated, flat = _file(path, session, grid, wide, ROOM)
    needed = math.ceil(len(annotated) / max(_seconds(grid), 1))
    if needed > ROOM:
        annotated, _ = _file(path, session, grid, wide, min(needed, MOST_ROOM))
    return _Written(path, wide, annotated, flat)


def _not_held(session: Session, grid: ConstantRate, written: _Written) -> Iterator[str]:
    """What the file does not hold, or only coarsely."""
    yield from grid.left_out()
    onsets = [onset for onset, _ in _markers(session, grid)]
    early, late = sum(onset < 0 for onset in onsets), sum(onset > _seconds(grid) for onset in onsets)
    if grid.samples and early:
        yield f"{counted(early, 'marker')} left out, the file begins after them"
    if grid.samples and late:
        yield f"{counted(late, 'marker')} left out, the file ends before them"
    if (times := _coarseness(grid.stream, 24 if written.wide else 16)) > COARSE:
        yield f"values beyond the sensor's range make a step of the file {times:.0f} of the sensor's"
    if written.flat:
        yield f"values far beyond its usual ones leave these less than {FLAT:g} steps of the file"
    if grid.samples:
        yield from (f"its header has {words}" for words in _otherwise(grid.stream))


def _file(path: Path, session: Session, grid: ConstantRate, wide: bool, room: int) -> tuple[list[str], bool]:
    """Write the file, also anew; returns the texts of its annotations, and whether it shows too little of a channel.

    room: so many annotations in a second.
    """
    scale = _scale(grid.stream)
    kind = pyedflib.FILETYPE_BDFPLUS if wide else pyedflib.FILETYPE_EDFPLUS
    writer = pyedflib.EdfWriter(str(path), len(grid.stream.channels), kind)
    try:
        writer.set_number_of_annotation_signals(room)
        limits = _header(writer, grid, wide, scale)
        swings = _samples(writer, grid, limits, scale)
        steps = swings / np.ptp(limits, axis=1) * 2 ** (24 if wide else 16)
        return _annotations(writer, session, grid), bool(((steps > 0) & (steps < FLAT)).any())
    finally:
        writer.close()


def _coarseness(stream: Stream, bits: int) -> float:
    """How many steps of the sensor one step of a file with so many bits is; 0 where the sensor's are not known."""
    about = stream.metadata
    width = float(about.get("range_max", math.nan)) - float(about.get("range_min", math.nan))
    resolution = int(about.get("resolution_bits") or 0)
    if not (0 < resolution <= 24 and 0 < width < math.inf):
        return 0.0
    spans = [high - low for low, high in map(_roomy, stream.seen.channels.values()) if math.isfinite(high - low)]
    return max(spans, default=0.0) / width * 2 ** (resolution - bits)


def seconds_of(path: Path) -> float:
    """How long a file is."""
    with pyedflib.EdfReader(str(path)) as reader:
        return float(reader.getFileDuration())


def _read_back(path: Path, stream: Stream, rate: int, samples: int, annotated: list[str]) -> Iterator[str]:
    try:
        with pyedflib.EdfReader(str(path)) as reader:
            found, texts = int(reader.getNSamples()[0]), Counter(str(text) for text in reader.readAnnotations()[2])
    except (OSError, ValueError) as err:
        raise SessionError(f"{path.name} cannot be read back: {err}") from err
    if found != math.ceil(samples / rate) * rate:
        raise SessionError(f"{path.name}, read back, has {found} samples per channel, {samples} were written")
    lacking = sum((Counter(annotated) - texts).values())
    if lacking:
        yield f"{stream.key}, EDF: {lacking} of {len(annotated)} annotations have no room in the file"


def _header(writer: Any, grid: ConstantRate, wide: bool, scale: int) -> NDArray[np.float64]:
    """Returns the physical limits, shape (channels, 2)."""
    stream, rate, about = grid.stream, int(grid.rate_hz), grid.stream.metadata
    lowest, highest = (-(1 << 23), (1 << 23) - 1) if wide else (-(1 << 15), (1 << 15) - 1)
    bounds = [stream.seen.channels[name] for name in stream.channels]
    limits = [_limits(low / scale, high / scale) for low, high in map(_roomy, bounds)]
    how = f"resampled to {rate} Hz (cubic spline) from {stream.rate_in_words}; {GAP}: missing"
    short = labels(stream)
    writer.setSignalHeaders(
        [
            {
                "label": short[name],
                "dimension": _dimension(_unit(stream, name)),
                "sample_frequency": rate,
                "physical_min": low,
                "physical_max": high,
                "digital_min": lowest,
                "digital_max": highest,
                "transducer": ascii_only(f"{about.get('vendor', '')} {about.get('model', '')}".strip())[:80],
                "prefilter": how,
            }
            for name, (low, high) in zip(stream.channels, limits, strict=True)
        ]
    )
    writer.setStartdatetime(datetime.fromtimestamp(grid.start_ns // SECOND_NS, UTC).replace(tzinfo=None))
    writer.setPatientCode(ascii_only(stream.name.human_id))  # 63 characters at most (contract, 1); 73 have room
    writer.setEquipment(ascii_only(stream.name.sensor_id)[:20])
    writer.setRecordingAdditional(f"cubic_spline_to_{rate}_Hz_{GAP}=missing")
    return np.array(limits)


def _samples(writer: Any, grid: ConstantRate, limits: NDArray[np.float64], scale: int) -> NDArray[np.float64]:
    """One second at a time; what is missing holds the last value. Returns by how much each channel usually changes."""
    rate = int(grid.rate_hz)
    waiting = np.empty((0, len(limits)))
    held = np.clip(0.0, limits[:, 0], limits[:, 1])
    swings = [np.zeros(len(limits))]
    for piece in grid.pieces():
        waiting = np.concatenate([waiting, np.clip(piece / scale, *limits.T)])
        while len(waiting) >= rate:
            held = _write_second(writer, waiting[:rate], held)
            swings.append(np.ptp(waiting[:rate], axis=0))
            waiting = waiting[rate:]
    if len(waiting):
        rest = np.full((rate - len(waiting), len(limits)), np.nan)
        grid.gaps.append((grid.samples / rate, len(rest) / rate))
        _write_second(writer, np.concatenate([waiting, rest]), held)
    return np.asarray(np.nanmedian(swings, axis=0))


def _write_second(writer: Any, second: NDArray[np.float64], held: NDArray[np.float64]) -> NDArray:
    filled = second
    if np.isnan(second).any():
        filled = pd.DataFrame(second).ffill().fillna(pd.Series(held)).to_numpy()
    writer.blockWritePhysicalSamples(np.ascontiguousarray(filled.T).ravel())
    return np.asarray(filled[-1])


def _annotations(writer: Any, session: Session, grid: ConstantRate) -> list[str]:
    """Returns the texts that were written."""
    notes = [(onset, duration, GAP) for onset, duration in grid.gaps]
    short = labels(grid.stream)
    notes += [(onset, duration, f"{GAP}@@{short[name]}") for onset, duration, name in grid.absent]
    notes += [(0.0, -1.0, f"{CLOCK}: {words}") for words in grid.left_out()]
    notes += [(onset, -1.0, text) for onset, text in _markers(session, grid) if 0 <= onset <= _seconds(grid)]
    shown = [(onset, duration, _short(text)) for onset, duration, text in sorted(notes)]
    for onset, duration, text in shown:
        writer.writeAnnotation(onset, duration, text)
    return [text for _, _, text in shown]


def _markers(session: Session, grid: ConstantRate) -> list[tuple[float, str]]:
    """Onset in s from the file's start, and text, of every marker that concerns a stream's person."""
    markers = markers_of(session, grid.stream.name.human_id)
    return [((marker["time_ns"] - grid.start_ns) * 1e-9, marker_text(marker)) for marker in markers]


def _seconds(grid: ConstantRate) -> int:
    """How long a file is."""
    return math.ceil(grid.samples / grid.rate_hz)


def _short(text: str) -> str:
    """As much of a text as an annotation takes, whole characters; `…` where that is not all."""
    data = plain(text).encode()
    if len(data) <= ANNOTATION:
        return data.decode()
    return data[: ANNOTATION - len("…".encode())].decode("utf-8", "ignore") + "…"


def labels(stream: Stream) -> dict[str, str]:
    """Return every channel's name as the header has room for it, none twice and none that is `TAKEN`."""
    found: dict[str, str] = {}
    for name in stream.channels:
        shown, number = ascii_only(name)[:LABEL].strip(), 1
        while shown in found.values() or shown.lower() in TAKEN:
            number += 1
            shown = ascii_only(name)[: LABEL - len(f"_{number}")].strip() + f"_{number}"
        found[name] = shown
    return found


def _unit(stream: Stream, channel: str) -> str:
    """Unit of the numbers in the file, in full."""
    unit = stream.unit_of(channel)
    return scaled(stream, ascii_only(_UNITS.get(unit, unit)))


def _dimension(unit: str) -> str:
    """As much of a unit as the header has room for; `~` where that is not all."""
    return unit if len(unit) <= DIMENSION else unit[: DIMENSION - 1] + "~"


def _otherwise(stream: Stream) -> Iterator[str]:
    """A few words for each unit and channel that the header cannot call what it is."""
    for unit in dict.fromkeys(_unit(stream, name) for name in stream.channels):
        if (shown := _dimension(unit)) != unit:
            yield f"{shown!r} for the unit {unit}"
    for name, label in labels(stream).items():
        if label != name:
            yield f"{label!r} for the channel {plain(name)}"


def scaled(stream: Stream, unit: str) -> str:
    """Return the unit of the numbers in the file: `1000 uV` where they are thousands of it."""
    scale = _scale(stream)
    return f"{scale} {unit}" if scale > 1 else unit


def markers_of(session: Session, human_id: str) -> list[dict[Any, Any]]:
    """Begin and end of the session and the markers that concern one participant, those for all among them."""
    return [row for row in session.timeline_rows if row["human_id"] in ("", human_id)]


def marker_text(marker: dict[Any, Any]) -> str:
    """`stimulus: image 7`."""
    return f"{marker['name']}: {marker['value']}" if marker["value"] else str(marker["name"])


def _roomy(bounds: tuple[float, float]) -> tuple[float, float]:
    """Room for a curve that swings over its samples."""
    low, high = bounds
    room = SWING * (high - low) if math.isfinite(high - low) else 0.0
    return low - room, high + room


def _limits(low: float, high: float) -> tuple[float, float]:
    """Limits round the data whose text fits the header's eight characters."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return -1, 1
    if low == high:
        low, high = low - 1.0, high + 1.0
    digits = min(max(0, 4 - math.ceil(math.log10(max(abs(low), abs(high), 1e-3)))), 5)
    if digits == 0:
        return math.floor(low), math.ceil(high)
    unit = 10.0**-digits
    return round(math.floor(low / unit) * unit, digits), round(math.ceil(high / unit) * unit, digits)


def _scale(stream: Stream) -> int:
    """Thousands by which samples are divided so that their limits fit into eight characters."""
    bounds = map(_roomy, stream.seen.channels.values())
    finite = [abs(limit) for limits in bounds for limit in limits if math.isfinite(limit)]
    scale = 1
    while max(finite, default=0) / scale > LARGEST_LIMIT:
        scale *= 1000
    return scale
