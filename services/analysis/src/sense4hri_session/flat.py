"""Parquet and CSV: samples and everything else as tables on the corrected timeline."""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
from sense4hri.shapes import plain
from sense4hri_recording.errors import SessionError

from sense4hri_session.plain_text import cell
from sense4hri_session.session import Session
from sense4hri_session.stream import Rows, Stream

READ_BYTES = 1 << 20


def sample_table(stream: Stream, rows: Rows, start_ns: int) -> pa.Table:
    """A table of samples with `time_s` from the session's start before everything else."""
    columns = {
        "time_s": pa.array((rows.time_ns - start_ns) * 1e-9),
        "time_ns": pa.array(rows.time_ns),
        **{
            name: pa.array(samples, from_pandas=True)  # NaN: no value
            for name, samples in zip(stream.columns.values(), rows.samples.T, strict=True)
        },
        "device_time_ns": pa.array(rows.device_time_ns, mask=~rows.timed),
        "received_ns": pa.array(rows.received_ns),
        "segment": pa.array(rows.segment),
    }
    return pa.table(columns)


def write_samples(session: Session, stream: Stream, parquet: Path | None, csv: Path | None) -> Iterator[int]:
    """Write one stream's samples and read them back; yields how many each time. Raises SessionError."""
    writers: list[pa_parquet.ParquetWriter | pa_csv.CSVWriter] = []
    rows = 0
    try:
        for piece in stream.rows():
            table = sample_table(stream, piece, session.start_ns)
            if not writers:
                about = {b"unit": stream.unit.encode(), b"stream": stream.key.encode()}
                if parquet is not None:
                    writers.append(pa_parquet.ParquetWriter(parquet, table.schema.with_metadata(about)))
                if csv is not None:
                    writers.append(pa_csv.CSVWriter(csv, _in_cells(table).schema))
            for writer in writers:
                is_parquet = isinstance(writer, pa_parquet.ParquetWriter)
                writer.write_table(table.cast(writer.schema) if is_parquet else _in_cells(table))
            rows += table.num_rows
            yield table.num_rows
    finally:
        for writer in writers:
            writer.close()
    if writers:
        _read_back(parquet, csv, rows)


class Table(NamedTuple):
    """A table to be exported. name: no two have the same. topics: those it is made of, all of one type."""

    name: str
    frame: pd.DataFrame
    topics: list[str]


def write_table(session: Session, frame: pd.DataFrame, parquet: Path | None, csv: Path | None) -> list[str]:
    """Write a small table and read it back; returns its columns. What is no number or text becomes JSON."""
    frame = frame.copy()
    if "time_ns" in frame and "time_s" not in frame:
        frame.insert(0, "time_s", (frame["time_ns"].astype("int64") - session.start_ns) * 1e-9)
    for name in frame.columns:
        if frame[name].map(lambda value: isinstance(value, list | dict)).any():
            frame[name] = frame[name].map(_json)
    table = pa.Table.from_pandas(frame, preserve_index=False)
    if parquet is not None:
        pa_parquet.write_table(table, parquet)
    if csv is not None:
        pa_csv.write_csv(_in_cells(table), csv)
    _read_back(parquet, csv, table.num_rows)
    return [str(name) for name in frame.columns]


def _read_back(parquet: Path | None, csv: Path | None, rows: int) -> None:
    """Raise SessionError where a file does not hold so many rows; no cell of a CSV has a line of its own."""
    found = {}
    if parquet is not None:
        found[parquet] = int(pa_parquet.read_metadata(parquet).num_rows)
    if csv is not None:
        with csv.open("rb") as file:
            found[csv] = lines_of(file) - 1
    for path, count in found.items():
        if count != rows:
            raise SessionError(f"{path.name}, read back, has {count} rows, {rows} were written")


def lines_of(file: BinaryIO | gzip.GzipFile) -> int:
    """Count the lines of an open file, the last one ended as well."""
    return sum(piece.count(b"\n") for piece in iter(lambda: file.read(READ_BYTES), b""))


def named_tables(session: Session) -> Iterator[Table]:
    """Every table but the samples. Raises SessionError where the messages of one make no sense."""
    yield Table("markers", session.markers, ["/study/markers"])
    yield Table("timeline", session.timeline, ["/study/markers"])
    yield Table("states", session.states, session.topics_of("UserState"))
    yield Table("expressions", session.expressions, session.topics_of("Expression"))
    yield Table("assignments", session.assignments, ["/study/assignments"])
    yield Table("clock_models", session.clock_models, session.topics_of("ClockModel"))
    for topic, name, field in session.fields():
        key = "/".join(name)
        table = f"{key}/{field}"
        if field == "features":
            yield Table(table, session.features(key), [topic.name])
            yield Table(f"{key}/events", session.events(key), [topic.name])
        elif field == "device":
            yield Table(table, session.device(key), [topic.name])
        elif field not in ("raw", "clock"):
            yield Table(table, session.table(topic.name), [topic.name])


def _in_cells(table: pa.Table) -> pa.Table:
    """The same for a spreadsheet: no text is a formula or breaks the line."""
    columns = [
        pa.array([None if text is None else cell(text) for text in column.to_pylist()], pa.string())
        if pa.types.is_string(column.type) or pa.types.is_large_string(column.type)
        else column
        for column in table.columns
    ]
    return pa.table(columns, names=[cell(name) for name in table.column_names])


def _json(value: object) -> str | None:
    """A value as JSON, which knows no NaN and no infinity: they are null."""
    nothing = value is None or (isinstance(value, float) and math.isnan(value))
    return None if nothing else json.dumps(plain(value), ensure_ascii=False, allow_nan=False)
