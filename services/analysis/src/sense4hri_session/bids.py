"""A BIDS folder: every regular stream as `_physio.tsv.gz` with its sidecar, markers as `_events.tsv`.

All recordings of a participant and the onsets of events count from the first message received. Physiological
recordings in BIDS have a constant rate: resampled as for EDF, `n/a` where samples are missing.
Format: <https://bids-specification.readthedocs.io> (physiological and other continuous recordings).
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sense4hri.modalities import modality
from sense4hri_recording.errors import SessionError

from sense4hri_session.constant_rate import ConstantRate, span_of, whole_rate_hz
from sense4hri_session.edf import markers_of
from sense4hri_session.file_names import Names
from sense4hri_session.flat import lines_of
from sense4hri_session.plain_text import cell, plain
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

VERSION = "1.10.0"
NO_LABEL = "[^A-Za-z0-9]+"
ONSET = (
    "seconds from the first message received, where every physio recording of the participant begins (StartTime 0); "
    "the session itself begins at trial_type session_start"
)
_UNITS = {"a.u.": "arbitrary", "counts": "arbitrary", "degC": "oC"}


def write(session: Session, streams: list[Stream], folder: Path) -> Iterator[str]:
    """Write the whole folder with these streams, and read it back; yields sentences on what it does not hold.

    Raises SessionError where it cannot be read back.
    """
    folder.mkdir()
    study = str(session.info.get("study") or "Sense4HRI study")
    _json(
        folder / "dataset_description.json",
        {
            "Name": study,
            "BIDSVersion": VERSION,
            "DatasetType": "raw",
            "GeneratedBy": [{"Name": "sense4hri-export"}],
        },
    )
    (folder / "README.md").write_text(
        f"# {study}\n\nExported from the recording {session.path.name} by sense4hri-export. Times are in seconds from "
        "the first message received, on the clock of the recording host, corrected for each device's own clock.\n"
        "Participants are pseudonyms.\n",
        "utf-8",
    )
    people = [human for human in session.humans if human != "unassigned"]
    labels = Names(NO_LABEL, "")
    rows = [{"participant_id": f"sub-{labels.of(human)}", "pseudonym": human} for human in people]
    _tsv(folder / "participants.tsv", ["participant_id", "pseudonym"], rows)
    _json(folder / "participants.json", {"pseudonym": {"Description": "human_id in the recording, a pseudonym"}})
    task = re.sub(NO_LABEL, "", str(session.info.get("task") or ""))[:60] or "study"
    for human in people:
        own = [stream for stream in streams if stream.name.human_id == human]
        yield from _write_person(session, human, own, f"sub-{labels.of(human)}", task, folder)


def _write_person(
    session: Session, human: str, streams: list[Stream], subject: str, task: str, root: Path
) -> Iterator[str]:
    folder = root / subject / "beh"
    folder.mkdir(parents=True)
    start = f"{subject}_task-{task}"
    rows = [
        {
            "onset": f"{(row['time_ns'] - session.start_ns) * 1e-9:.6f}",
            "duration": "n/a",
            "trial_type": cell(str(row["name"])),
            "value": cell(str(row["value"] or "n/a")),
        }
        for row in markers_of(session, human)
    ]
    if rows:
        _tsv(folder / f"{start}_events.tsv", list(rows[0]), rows)
        levels = {str(row["trial_type"]): f"marker {row['trial_type']}" for row in rows}
        _json(
            folder / f"{start}_events.json",
            {
                "TaskName": task,
                "onset": {"Description": ONSET, "Units": "s"},
                "trial_type": {"Description": "name of the marker", "Levels": levels},
                "value": {"Description": "free text given with the marker"},
            },
        )
    recordings = Names(NO_LABEL, "")
    for stream in streams:
        suffix = modality(stream.name.sensor_type).bids_suffix
        name = f"{start}_recording-{recordings.of(stream.name.sensor_type + stream.name.sensor_id)}_{suffix}"
        yield from _write_physio(session, stream, task, folder / name)


def _write_physio(session: Session, stream: Stream, task: str, path: Path) -> Iterator[str]:
    rate = whole_rate_hz(stream)
    grid = ConstantRate(stream, session.start_ns, float(rate), span_of(session))
    packed_path = path.with_name(path.name + ".tsv.gz")
    with (
        packed_path.open("xb") as opened,
        gzip.GzipFile("", "wb", 6, opened, mtime=0) as packed,
        io.TextIOWrapper(packed, "utf-8", newline="") as file,
    ):
        line = "\t".join(["%.10g"] * len(stream.channels)) + "\n"
        for piece in grid.pieces():
            text = line * len(piece) % tuple(piece.ravel().tolist())
            file.write(text.replace("nan", "n/a"))
    _read_back(packed_path, grid.samples)
    yield from (f"{stream.key}, BIDS: {words}" for words in grid.left_out())
    columns: dict[str, Any] = {}
    for name in stream.channels:
        columns[plain(name)] = {
            "Description": f"{stream.name.sensor_type} of sensor {stream.name.sensor_id}, channel {name}"
        }
        if stream.unit:
            columns[plain(name)]["Units"] = _UNITS.get(stream.unit, stream.unit)
    sidecar = {
        "SamplingFrequency": rate,
        "StartTime": 0.0,
        "PhysioType": "generic",
        "Columns": [plain(name) for name in stream.channels],
        "TaskName": task,
        "Manufacturer": str(stream.metadata.get("vendor") or "n/a"),
        "ManufacturersModelName": str(stream.metadata.get("model") or "n/a"),
        "DeviceSerialNumber": str(stream.metadata.get("serial_number") or "n/a"),
        "SoftwareVersions": str(stream.metadata.get("firmware_version") or "n/a"),
        "Resampled": f"by a cubic spline, from {stream.measured_rate_hz:.3f} Hz; n/a where samples are missing",
    }
    _json(path.with_name(path.name + ".json"), columns | sidecar)


def _read_back(path: Path, lines: int) -> None:
    try:
        with gzip.open(path, "rb") as file:
            found = lines_of(file)
    except (OSError, EOFError, zlib.error) as err:
        raise SessionError(f"{path.name} cannot be read back: {err}") from err
    if found != lines:
        raise SessionError(f"{path.name}, read back, has {found} lines, {lines} were written")


def _json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", "utf-8", "backslashreplace")


def _tsv(path: Path, columns: list[str], rows: list[dict[str, str]]) -> None:
    with path.open("x", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, delimiter="\t", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
