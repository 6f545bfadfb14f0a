"""A BIDS folder: every regular stream as `_physio.tsv.gz` with its sidecar, markers as `_events.tsv`.

All recordings of a participant count from the session's start, which is onset 0 of the events. Physiological
recordings in BIDS have a constant rate: resampled as for EDF, `n/a` where samples are missing.
Format: <https://bids-specification.readthedocs.io> (physiological and other continuous recordings).
"""

from __future__ import annotations

import gzip
import io
import json
import re
from pathlib import Path
from typing import Any

import pandas as pd
from sense4hri.modalities import modality

from sense4hri_session.constant_rate import ConstantRate, whole_rate_hz
from sense4hri_session.edf import markers_of
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

VERSION = "1.10.0"
_UNITS = {"a.u.": "arbitrary", "counts": "arbitrary", "degC": "oC"}


def write(session: Session, folder: Path) -> None:
    """Write the whole folder."""
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
    rows = [{"participant_id": f"sub-{label(human)}", "pseudonym": human} for human in people]
    _tsv(folder / "participants.tsv", pd.DataFrame(rows, columns=["participant_id", "pseudonym"]))
    _json(folder / "participants.json", {"pseudonym": {"Description": "human_id in the recording, a pseudonym"}})
    task = label(str(session.info.get("task") or "")) or "study"
    for human in people:
        _write_person(session, human, task, folder / f"sub-{label(human)}" / "beh")


def label(text: str) -> str:
    """A BIDS label: letters and digits only."""
    return re.sub(r"[^A-Za-z0-9]", "", text)


def _write_person(session: Session, human: str, task: str, folder: Path) -> None:
    folder.mkdir(parents=True)
    start = f"sub-{label(human)}_task-{task}"
    markers = markers_of(session, human)
    rows = [
        {
            "onset": f"{(row['time_ns'] - session.start_ns) * 1e-9:.6f}",
            "duration": "n/a",
            "trial_type": row["name"],
            "value": row["value"] or "n/a",
        }
        for row in markers.to_dict("records")
    ]
    if rows:
        _tsv(folder / f"{start}_events.tsv", pd.DataFrame(rows))
        levels = {str(row["trial_type"]): f"marker {row['trial_type']}" for row in rows}
        _json(
            folder / f"{start}_events.json",
            {
                "TaskName": task,
                "onset": {"Description": "corrected time from the session's start", "Units": "s"},
                "trial_type": {"Description": "name of the marker", "Levels": levels},
                "value": {"Description": "free text given with the marker"},
            },
        )
    for stream in session.streams.values():
        if stream.name.human_id == human and whole_rate_hz(stream) and stream.seen.samples:
            suffix = modality(stream.name.sensor_type).bids_suffix
            name = f"{start}_recording-{label(stream.name.sensor_type + stream.name.sensor_id)}_{suffix}"
            _write_physio(session, stream, task, folder / name)


def _write_physio(session: Session, stream: Stream, task: str, path: Path) -> None:
    rate = whole_rate_hz(stream)
    grid = ConstantRate(stream, session.start_ns, float(rate))
    packed_path = path.with_name(path.name + ".tsv.gz")
    with (
        packed_path.open("xb") as plain,
        gzip.GzipFile("", "wb", 6, plain, mtime=0) as packed,
        io.TextIOWrapper(packed, "utf-8", newline="") as file,
    ):
        line = "\t".join(["%.10g"] * len(stream.channels)) + "\n"
        for piece in grid.pieces():
            text = "".join([line % tuple(row) for row in piece.tolist()])
            file.write(text.replace("nan", "n/a"))
    columns: dict[str, Any] = {}
    for name in stream.channels:
        columns[name] = {"Description": f"{stream.name.sensor_type} of sensor {stream.name.sensor_id}, channel {name}"}
        if stream.unit:
            columns[name]["Units"] = _UNITS.get(stream.unit, stream.unit)
    about = {
        "SamplingFrequency": rate,
        "StartTime": 0.0,
        "PhysioType": "generic",
        "Columns": list(stream.channels),
        "TaskName": task,
        "Manufacturer": str(stream.metadata.get("vendor") or "n/a"),
        "ManufacturersModelName": str(stream.metadata.get("model") or "n/a"),
        "DeviceSerialNumber": str(stream.metadata.get("serial_number") or "n/a"),
        "SoftwareVersions": str(stream.metadata.get("firmware_version") or "n/a"),
        "Resampled": f"by a cubic spline, from {stream.measured_rate_hz:.3f} Hz; n/a where samples are missing",
    }
    _json(path.with_name(path.name + ".json"), about | columns)


def _json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", "utf-8")


def _tsv(path: Path, frame: pd.DataFrame) -> None:
    frame.to_csv(path, sep="\t", index=False, na_rep="n/a", lineterminator="\n")
