"""One session to a folder of files that the tools of the field open."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from sense4hri_recording.errors import SessionError
from tqdm import tqdm

from sense4hri_session import bids, edf, flat, xdf
from sense4hri_session.clock_fit import Segment
from sense4hri_session.codebook import Exported, codebook
from sense4hri_session.constant_rate import session_start_ns, why_no_grid
from sense4hri_session.file_names import Names
from sense4hri_session.plain_text import cell
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

FORMATS = ("parquet", "csv", "edf", "xdf", "bids")
SECOND_NS = 1_000_000_000


def formats_here() -> tuple[str, ...]:
    """Return the formats that can be written where this runs."""
    return tuple(name for name in FORMATS if name != "edf" or edf.is_there())


def export(session: Session, target: Path, formats: tuple[str, ...] | None = None, progress: bool = False) -> list[str]:
    """Write `target`, a new folder, whole or not at all; returns the notes that are in its session.json.

    formats: None for all that can be written here.
    Raises SessionError where it exists already, a format is unknown or cannot be written here, the disk refuses or the
    recording is damaged.
    """
    formats = formats_here() if formats is None else formats
    unknown = set(formats) - set(FORMATS)
    if unknown:
        raise SessionError(f"{', '.join(sorted(unknown))}: no such format; one of {', '.join(FORMATS)}")
    if set(formats) - set(formats_here()):
        raise SessionError(edf.LACKING)
    if target.exists():
        raise SessionError(f"{target} exists already and is left as it is: name another folder")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    except OSError as err:
        raise SessionError(f"{target} cannot be made: {err.filename or target}: {err.strerror}") from err
    try:
        notes = _write(session, folder, formats, progress)
        folder.chmod(0o777 & ~_umask())
        folder.rename(target)
    except OSError as err:
        raise SessionError(f"{target} was not written: {err.strerror or err}") from err
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return notes


def _write(session: Session, folder: Path, formats: tuple[str, ...], progress: bool) -> list[str]:
    flat_formats = [str(name) for name in ("parquet", "csv") if name in formats]
    passes = 1 + bool(flat_formats) + sum(name in formats for name in ("edf", "xdf", "bids"))
    samples = sum(stream.seen.samples for stream in session.streams.values())
    kept = folder / ".kept"
    mark(folder, _parts(session))
    with (
        tqdm(total=samples * passes, unit=" samples", unit_scale=True, desc="export", disable=not progress) as bar,
        session.kept(kept, bar.update) as placed,
    ):
        notes, exported = _write_formats(session, folder, formats, flat_formats, bar)
    shutil.rmtree(kept)
    notes += [note for note in session.notes if note not in notes]  # some messages are decoded only while it is written
    codebook(session, exported).map(cell).to_csv(folder / "codebook.csv", index=False)
    about = json.dumps(summary(session, notes, exported, placed), indent=2, ensure_ascii=False)
    (folder / "session.json").write_text(about + "\n", "utf-8", "backslashreplace")
    return notes


def mark(folder: Path, parts: list[dict[str, object]]) -> None:
    """Let a withdrawal know the folder as an export of these parts before anything of a person is in it."""
    (folder / "codebook.csv").touch()
    (folder / "session.json").write_text(json.dumps({"parts": parts}), "utf-8", "backslashreplace")


def _write_formats(
    session: Session, folder: Path, formats: tuple[str, ...], flat_formats: list[str], bar: tqdm[NoReturn]
) -> tuple[list[str], list[Exported]]:
    names, notes = Names(), list(session.notes)
    streams = list(session.streams.values())
    exported = list(_write_flat(session, folder, flat_formats, names, notes, bar)) if flat_formats else []
    regular = [stream for stream in streams if not why_no_grid(session, stream)]
    if {"edf", "bids"} & set(formats):
        why = {stream.key: why_no_grid(session, stream) for stream in streams if stream not in regular}
        notes += [f"{key} {words}: it is not in EDF and BIDS" for key, words in why.items()]
        notes += [] if edf.is_there() else [edf.LACKING]
    if "edf" in formats:
        _write_edf(session, folder / "edf", regular, names, notes, bar)
    samples = sum(stream.seen.samples for stream in streams)
    if "xdf" in formats:
        xdf.write(session, folder / "session.xdf")
        bar.update(samples)
    if "bids" in formats:
        notes += bids.write(session, regular, folder / "bids")
        bar.update(samples)
    return notes, exported


def _write_flat(
    session: Session, folder: Path, formats: list[str], names: Names, notes: list[str], bar: tqdm[NoReturn]
) -> Iterator[Exported]:
    """Write samples and tables as Parquet and CSV; yield each once it is written."""
    for kind in formats:
        (folder / kind).mkdir()
    for stream in session.streams.values():
        name = names.of(stream.key)
        for written in flat.write_samples(session, stream, *_paths(folder, name, formats)):
            bar.update(written)
        columns = ["time_s", "time_ns", *stream.columns.values(), "device_time_ns", "received_ns", "segment"]
        yield Exported(name, columns, [stream.name.topic("raw")], stream)
    for table in _tables(session, notes):
        if len(table.frame):
            name = names.of(table.name)
            columns = flat.write_table(session, table.frame, *_paths(folder, name, formats))
            yield Exported(name, columns, table.topics)


def _write_edf(
    session: Session, folder: Path, streams: list[Stream], names: Names, notes: list[str], bar: tqdm[NoReturn]
) -> None:
    folder.mkdir()
    start_ns = session_start_ns(session)
    for stream in streams if _is_a_date(start_ns, notes) else []:
        notes += edf.write(session, stream, start_ns, folder / names.of(stream.key))
        bar.update(stream.seen.samples)


def _tables(session: Session, notes: list[str]) -> Iterator[flat.Table]:
    """Every table but the samples; `notes` gets a sentence for each topic that makes no sense."""
    yield from flat.named_tables(session)
    for topic in sorted(session.strange):
        try:
            yield flat.Table(topic, session.table(topic), [topic])
        except SessionError as err:
            notes.append(f"{topic} is not exported: {err}")


def _is_a_date(start_ns: int, notes: list[str]) -> bool:
    """True where EDF can say when it begins; else a note says why there is none."""
    if not edf.is_a_date(start_ns):
        notes.append(f"no EDF: the recording begins {start_ns // SECOND_NS} s after 1970; EDF knows 1985 to 2084")
    return edf.is_a_date(start_ns)


def summary(session: Session, notes: list[str], exported: list[Exported], placed: dict[str, int]) -> dict[str, object]:
    """What a reader has to know of the clocks, the streams, and everything that was recorded.

    placed: samples of each stream, those of repeated messages left out.
    """
    tables = {topic for item in exported for topic in item.topics}
    return {
        "recording": session.path.name,
        "start_ns": session.start_ns,
        "end_ns": session.end_ns,
        "parts": _parts(session),
        "session": session.info,
        "notes": notes,
        "topics": {
            topic.name: {"type": topic.type_name, "messages": topic.messages, "exported": topic.name in tables}
            for topic in session.reader.topics.values()
        },
        "streams": {key: _stream_summary(stream, placed[key]) for key, stream in session.streams.items()},
        "clocks": {
            sensor_id: [_segment_summary(number, segment) for number, segment in enumerate(fit.segments, 1)]
            for sensor_id, fit in session.clocks.items()
        },
    }


def _stream_summary(stream: Stream, samples: int) -> dict[str, object]:
    return {
        "channels": list(stream.channels),
        "unit": stream.unit,
        "sampling_frequency_hz": stream.sampling_frequency_hz,
        "measured_rate_hz": stream.measured_rate_hz or None,
        "samples": samples,
        "undecodable_messages": stream.seen.undecodable,
        "channel_sets": len(stream.seen.channel_sets),
    }


def _segment_summary(number: int, segment: Segment) -> dict[str, object]:
    return {
        "segment": number,
        "method": "two-way" if segment.measured else "lower envelope",
        "device_ns": segment.device_ns,
        "offset_ns": segment.ros_ns_at_start() - segment.device_ns,
        "skew_ppm": segment.skew_ppm(),
        "knots_s": segment.knots_s.tolist(),
        "offset_s": segment.offset_s.tolist(),
        "subtracted_s": segment.excess_s,
    }


def _parts(session: Session) -> list[dict[str, object]]:
    return [
        {"folder": part.path.name, "start_ns": part.first_ns, "end_ns": part.last_ns} for part in session.reader.parts
    ]


def _paths(folder: Path, name: str, formats: list[str]) -> tuple[Path | None, Path | None]:
    parquet = folder / "parquet" / f"{name}.parquet" if "parquet" in formats else None
    return parquet, folder / "csv" / f"{name}.csv" if "csv" in formats else None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
