"""Parquet and CSV: samples and everything else as tables on the corrected timeline."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from sense4hri_session.session import Session
from sense4hri_session.stream import Stream


def sample_table(stream: Stream, frame: pd.DataFrame, start_ns: int) -> pa.Table:
    """A table of samples with `time_s` from the session's start before everything else."""
    frame = frame.copy()
    frame.insert(0, "time_s", (frame["time_ns"] - start_ns) * 1e-9)
    fields = [("time_s", pa.float64()), ("time_ns", pa.int64()), *((name, pa.float64()) for name in stream.channels)]
    fields += [("device_time_ns", pa.int64()), ("received_ns", pa.int64()), ("segment", pa.int32())]
    return pa.Table.from_pandas(frame, pa.schema(fields), preserve_index=False)


def write_samples(session: Session, stream: Stream, parquet: Path | None, csv: Path | None) -> Iterator[int]:
    """Write one stream's samples; yields how many each time."""
    writers: list[pa_parquet.ParquetWriter | pa_csv.CSVWriter] = []
    try:
        for frame in stream.tables():
            table = sample_table(stream, frame, session.start_ns)
            if not writers:
                about = {b"unit": stream.unit.encode(), b"stream": stream.key.encode()}
                if parquet is not None:
                    writers.append(pa_parquet.ParquetWriter(parquet, table.schema.with_metadata(about)))
                if csv is not None:
                    writers.append(pa_csv.CSVWriter(csv, table.schema))
            for writer in writers:
                writer.write_table(table.cast(writer.schema) if isinstance(writer, pa_parquet.ParquetWriter) else table)
            yield table.num_rows
    finally:
        for writer in writers:
            writer.close()


def write_table(session: Session, frame: pd.DataFrame, parquet: Path | None, csv: Path | None) -> None:
    """Write a small table. What is no number or text becomes JSON."""
    frame = frame.copy()
    if "time_ns" in frame:
        frame.insert(0, "time_s", (frame["time_ns"].astype("int64") - session.start_ns) * 1e-9)
    for name in frame.columns:
        if frame[name].map(lambda value: isinstance(value, list | dict)).any():
            frame[name] = frame[name].map(_json)
        elif name.endswith("_ns") and frame[name].isna().any():
            frame[name] = frame[name].map(lambda value: pd.NA if value is None else value).astype("Int64")
    table = pa.Table.from_pandas(frame, preserve_index=False)
    if parquet is not None:
        pa_parquet.write_table(table, parquet)
    if csv is not None:
        pa_csv.write_csv(table, csv)


def named_tables(session: Session) -> Iterator[tuple[str, pd.DataFrame]]:
    """Every table but the samples, by the name of its file."""
    fixed = {
        "markers": session.markers,
        "timeline": session.timeline,
        "states": session.states,
        "expressions": session.expressions,
        "assignments": session.assignments,
        "clock_models": session.clock_models,
    }
    yield from fixed.items()
    for topic in session.reader.topics:
        parts = topic.split("/")
        if len(parts) != 7 or parts[6] not in ("features", "device", "health"):
            continue
        key, name = "/".join(parts[3:6]), "_".join(parts[3:6])
        if parts[6] == "features":
            yield f"{name}_features", session.features(key)
            yield f"{name}_events", session.events(key)
        elif parts[6] == "device":
            yield f"{name}_device", session.device(key)
        else:
            yield f"{name}_health", session.health(key)


def _json(value: object) -> str | None:
    return None if value is None else json.dumps(value, ensure_ascii=False)
