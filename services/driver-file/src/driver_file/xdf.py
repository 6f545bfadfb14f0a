"""XDF of LabRecorder, by pyxdf: a stream of numbers is a signal; one of text, or of markers without a rate, are events.

Times are those of the recording computer, as pyxdf makes them of each stream's clock offsets; jitter stays as it is.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyxdf
from sense4hri import lsl
from sense4hri.lsl_types import channel_type
from sense4hri.signal_files.content import (
    Event,
    IntArray,
    Sampled,
    Signal,
    SignalFile,
    UnreadableFileError,
    nanoseconds,
    stamped,
)
from sense4hri.signal_files.guess import type_of
from sense4hri.stamps import SECOND_NS

from driver_file.packed import unpacked

KNOWN = (*lsl.CONTENT_TYPES, lsl.MARKERS)


def open_xdf(path: Path) -> SignalFile:
    """Return what is in the file. Raises UnreadableFileError."""
    try:
        with unpacked(path) if path.suffix.lower() == ".xdfz" else path.open("rb") as file, _damages() as damages:
            streams, _ = pyxdf.load_xdf(file, dejitter_timestamps=False)
    except (OSError, ValueError, KeyError, IndexError, EOFError, SyntaxError) as err:
        raise UnreadableFileError(f"{path}: {err}") from err
    events = [event for stream in streams if _tells_events(stream) for event in _events(stream)]
    sampled = [stream for stream in streams if not _tells_events(stream)]
    signals = tuple(_signal(each) for each in sampled if len(each["time_stamps"]))
    notes = [f"damaged, what could be read is played: {found}" for found in damages[:1]]
    if silent := [_name(each) for each in sampled if not len(each["time_stamps"])]:
        notes.append(f"without samples, left out: {', '.join(silent)}")
    return SignalFile(signals, tuple(sorted(events)), tuple(notes))


@contextmanager
def _damages() -> Iterator[list[str]]:
    """Yield what pyxdf says of damages meanwhile; by itself it would write tracebacks into the log."""
    logger, said = logging.getLogger("pyxdf.pyxdf"), list[str]()

    def take(record: logging.LogRecord) -> bool:
        if record.levelno >= logging.ERROR:
            said.append(record.getMessage())
        return False

    logger.addFilter(take)
    try:
        yield said
    finally:
        logger.removeFilter(take)


def _tells_events(stream: Any) -> bool:
    """Return whether a stream is of text, or of numbers that LSL's apps call markers."""
    info = stream["info"]
    is_marker = lsl.sensor_type(info["type"][0] or "") == lsl.MARKERS and not float(info["nominal_srate"][0])
    return is_marker or isinstance(stream["time_series"], list)


def _name(stream: Any) -> str:
    return str((stream["info"].get("name") or ["a stream without a name"])[0])


def _signal(stream: Any) -> Signal:
    info = stream["info"]
    count = int(info["channel_count"][0])
    names, units, contents = zip(*_channels(info, count), strict=True)
    kind = info["type"][0] or ""
    kind = told if (told := lsl.sensor_type(kind)) in KNOWN else type_of(kind)
    types = [channel_type(kind, *each) for each in zip(contents, names, units, strict=True)]

    def read(wanted: tuple[int, ...]) -> Sampled:
        values = np.asarray(stream["time_series"], np.float64)[:, list(wanted)]
        sampled = stamped(_ns(stream["time_stamps"]), values)
        nominal_hz = float(info["nominal_srate"][0])
        return sampled._replace(fs_hz=(sampled.fs_hz or nominal_hz) if nominal_hz > 0 else 0.0)

    return Signal(
        tuple(names), tuple(units), read, channel_types=tuple(each if each in KNOWN else "" for each in types)
    )


def _channels(info: Any, count: int) -> list[tuple[str, ...]]:
    """Return name, unit and content type of every channel; its number where the stream does not describe it."""
    described = ((info.get("desc") or [None])[0] or {}).get("channels") or [None]
    channels = (described[0] or {}).get("channel") or []
    said = ("label", "unit", "type")
    found = [tuple((each.get(name) or [""])[0] or "" for name in said) for each in channels]
    return [found[i] if i < len(found) and found[i][0] else (str(i), "", "") for i in range(count)]


def _events(stream: Any) -> list[Event]:
    times_ns = _ns(stream["time_stamps"]).tolist()
    rows = [[text for each in row if (text := str(each))] for row in stream["time_series"]]
    return [Event(at, row[0], " ".join(row[1:])) for at, row in zip(times_ns, rows, strict=True) if row]


def _ns(times_s: Any) -> IntArray:
    return nanoseconds(np.asarray(times_s, np.float64), SECOND_NS)
