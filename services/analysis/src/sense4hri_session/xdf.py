"""XDF: device stamps as they are, clock offsets beside them; the reader brings them together, as LabRecorder has it.

Times are seconds since the session's start; a device clock counts from the first packet of its epoch, and every
epoch is a stream of its own, since readers draw one straight line through the offsets of a stream. (Parquet and CSV
hold the times with the clock's wander.) Format: <https://github.com/sccn/xdf/wiki/Specifications>.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from os import SEEK_CUR
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree
from xml.sax import saxutils

import numpy as np
from numpy.typing import NDArray
from sense4hri.plain_text import plain
from sense4hri_recording.errors import SessionError

from sense4hri_session.blocks import Block
from sense4hri_session.edf import marker_text
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

FILE_HEADER, STREAM_HEADER, SAMPLES, CLOCK_OFFSET, STREAM_FOOTER = 1, 2, 3, 4, 6
OFFSET_INTERVAL_S = 5.0
CONCERNED = "Metadata"  # a stream of its own, since tools take every text of a stream of markers for an event
LSL_UNITS = {"uV": "microvolts"}


class Writer:
    """Writes chunks; streams are numbered from 1."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._streams = 0
        file.write(b"XDF:")
        self._chunk(FILE_HEADER, b'<?xml version="1.0"?><info><version>1.0</version></info>')

    def stream(
        self, name: str, kind: str, rate_hz: float, form: str, channels: list[tuple[str, str]], desc: str
    ) -> int:
        """Begin a stream. form: `double64` or `string`. channels: (label, unit). desc: further XML."""
        self._streams += 1
        listed = "".join(
            f"<channel><label>{escape(label)}</label><unit>{escape(unit)}</unit><type>{escape(kind)}</type></channel>"
            for label, unit in channels
        )
        xml = (
            f'<?xml version="1.0"?><info><name>{escape(name)}</name><type>{escape(kind)}</type>'
            f"<channel_count>{len(channels)}</channel_count><nominal_srate>{rate_hz:g}</nominal_srate>"
            f"<channel_format>{form}</channel_format><source_id>{escape(name)}</source_id>"
            f"<desc>{desc}<channels>{listed}</channels></desc></info>"
        )
        self._chunk(STREAM_HEADER, struct.pack("<I", self._streams) + xml.encode())
        return self._streams

    def samples(self, stream: int, rows: NDArray[np.void]) -> None:
        """Numbers of one chunk, see `rows_of`."""
        self._chunk(SAMPLES, struct.pack("<IBI", stream, 4, len(rows)) + rows.tobytes())

    def texts(self, stream: int, items: Iterable[tuple[float, str]]) -> None:
        """Strings of a stream with one channel."""
        parts = []
        for time_s, text in items:
            data = plain(text).encode()
            parts.append(struct.pack("<BdBI", 8, time_s, 4, len(data)) + data)
        if parts:
            self._chunk(SAMPLES, struct.pack("<IBI", stream, 4, len(parts)) + b"".join(parts))

    def offset(self, stream: int, at_s: float, offset_s: float) -> None:
        """Session time = stream time + offset_s, at this stream time."""
        self._chunk(CLOCK_OFFSET, struct.pack("<Idd", stream, at_s, offset_s))

    def end(self, stream: int, first_s: float, last_s: float, samples: int) -> None:
        """Write the stream's footer."""
        xml = (
            f'<?xml version="1.0"?><info><first_timestamp>{first_s!r}</first_timestamp>'
            f"<last_timestamp>{last_s!r}</last_timestamp><sample_count>{samples}</sample_count></info>"
        )
        self._chunk(STREAM_FOOTER, struct.pack("<I", stream) + xml.encode())

    def _chunk(self, tag: int, content: bytes) -> None:
        self._file.write(struct.pack("<BIH", 4, len(content) + 2, tag) + content)


def rows_of(times_s: NDArray[np.floating[Any]], values: NDArray[np.float64]) -> NDArray[np.void]:
    """Samples as they are in a chunk: numbers, shape (n, channels), each sample with its time."""
    kind = np.dtype([("has", "u1"), ("time", "<f8"), ("values", "<f8", (values.shape[1],))])
    rows = np.empty(len(times_s), kind)
    rows["has"], rows["time"], rows["values"] = 8, times_s, values
    return rows


def write(session: Session, path: Path) -> None:
    """Write every stream, the markers and the states."""
    with path.open("xb") as file:
        writer = Writer(file)
        for stream in session.streams.values():
            _write_stream(writer, session, stream)
        markers = session.timeline_rows
        _write_texts(writer, session, "markers", "Markers", [(m["time_ns"], marker_text(m)) for m in markers])
        _write_texts(writer, session, "markers/human_id", CONCERNED, [(m["time_ns"], m["human_id"]) for m in markers])
        states: dict[str, list[tuple[int, str]]] = {human_id: [] for human_id in session.humans}
        for row in session.states.to_dict("records"):
            states.setdefault(row["human_id"], []).append((row["received_ns"] or row["time_ns"], row["state"]))
        for human_id, texts in states.items():
            _write_texts(writer, session, f"{human_id}/state", "Markers", texts)
    _read_back(path)


def _read_back(path: Path) -> None:
    """Raise SessionError where the chunks do not follow each other to the end, or a header is no XML."""
    with path.open("rb") as file:
        file.seek(len(b"XDF:"))
        while head := file.read(7):
            _, length, tag = struct.unpack("<BIH", head)
            content = file.read(length - 2) if tag in (FILE_HEADER, STREAM_HEADER, STREAM_FOOTER) else b""
            try:
                if content:
                    ElementTree.fromstring(content[0 if tag == FILE_HEADER else 4 :])
            except ElementTree.ParseError as err:
                raise SessionError(f"{path.name} cannot be read back: a header is no XML: {err}") from err
            file.seek(length - 2 - len(content), SEEK_CUR)
        if file.tell() != path.stat().st_size:
            raise SessionError(f"{path.name} cannot be read back: its last chunk is cut off")


def escape(text: str) -> str:
    """Text in XML, which knows no control characters."""
    return saxutils.escape(plain(text))


class _Open:
    """A stream being written: one epoch of one channel set."""

    def __init__(self, number: int, origin_ns: int) -> None:
        self.number, self.origin_ns = number, origin_ns
        self.samples = 0
        self.first_s = self.last_s = 0.0
        self.offset_at_s = -1e18

    def add(self, writer: Writer, session: Session, block: Block) -> None:
        stamps = block.time_ns if block.device_time_ns is None else block.device_time_ns
        at_s = (stamps - self.origin_ns) * 1e-9
        ros_s = (block.time_ns - session.start_ns) * 1e-9
        self.first_s = self.first_s if self.samples else float(at_s[0])
        self.last_s, self.samples = float(at_s[-1]), self.samples + len(at_s)
        rows, ends = rows_of(at_s, block.samples), np.cumsum(block.counts)
        last_s, offsets_s = at_s[ends - 1].tolist(), (ros_s - at_s)[ends - 1].tolist()
        low = 0
        for high, message_s, offset_s in zip(ends.tolist(), last_s, offsets_s, strict=True):
            if message_s - self.offset_at_s >= OFFSET_INTERVAL_S:
                writer.offset(self.number, message_s, offset_s)
                self.offset_at_s = message_s
            writer.samples(self.number, rows[low:high])
            low = high


def _write_stream(writer: Writer, session: Session, stream: Stream) -> None:
    opened: dict[tuple[int, tuple[str, ...]], _Open] = {}
    for block in stream.blocks():
        key = (block.segment, block.channels)
        if key not in opened:
            timed = block.device_time_ns is not None and stream.clock is not None
            origin_ns = (
                stream.clock.segments[block.segment - 1].device_ns if timed and stream.clock else session.start_ns
            )
            name = stream.key if not opened else f"{stream.key} ({len(opened) + 1})"
            desc = f"<clock>{'device' if timed else 'host'}</clock><clock_origin_ns>{origin_ns}</clock_origin_ns>"
            desc += f"<session_start_ns>{session.start_ns}</session_start_ns>"
            units = [stream.unit_of(label) for label in block.channels]
            channels = [(label, LSL_UNITS.get(unit, unit)) for label, unit in zip(block.channels, units, strict=True)]
            kind = stream.name.sensor_type.upper()
            number = writer.stream(name, kind, stream.sampling_frequency_hz, "double64", channels, desc)
            opened[key] = _Open(number, origin_ns)
        opened[key].add(writer, session, block)
    for item in opened.values():
        writer.end(item.number, item.first_s, item.last_s, item.samples)


def _write_texts(writer: Writer, session: Session, name: str, kind: str, items: list[tuple[int, str]]) -> None:
    """Write texts as a stream of one channel; those of one time stay in their order."""
    if not items:
        return
    number = writer.stream(name, kind, 0.0, "string", [(name, "")], "<clock>host</clock>")
    timed = sorted((((time_ns - session.start_ns) * 1e-9, text) for time_ns, text in items), key=lambda item: item[0])
    writer.texts(number, timed)
    for at_s in (timed[0][0], timed[-1][0] + 1.0):
        writer.offset(number, at_s, 0.0)
    writer.end(number, timed[0][0], timed[-1][0], len(timed))
