"""A BIDS folder: EEG and EMG as EDF, other regular streams as `_physio.tsv.gz`; markers as `_events.tsv`.

Onsets of events count from the first message received. Samples were taken before they were received, so physiological
recordings begin before that, all at one whole second, as `StartTime` says. In BIDS they have a constant rate: resampled
as for EDF, `n/a` where samples are missing.
Format: <https://bids-specification.readthedocs.io> (physiological and other continuous recordings).
"""

from __future__ import annotations

import gzip
import io
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from sense4hri.modalities import modality
from sense4hri.names import UNASSIGNED
from sense4hri.plain_text import plain
from sense4hri_recording.errors import SessionError
from sense4hri_report.rules import counted

from sense4hri_session import bids_electro
from sense4hri_session.bids_files import UNITS, device_of, write_json, write_tsv
from sense4hri_session.codebook import MARKERS
from sense4hri_session.constant_rate import SECOND_NS, ConstantRate, session_start_ns, span_of, whole_rate_hz
from sense4hri_session.edf import is_a_date, markers_of
from sense4hri_session.file_names import Names
from sense4hri_session.flat import lines_of
from sense4hri_session.plain_text import cell
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream

VERSION = "1.11.1"
NO_LABEL = "[^A-Za-z0-9]+"
ONSET = (
    "seconds from the first message received, as StartTime of every physio recording of the participant; "
    "the session itself begins at trial_type session_start"
)
FILE_ONSET = "seconds from the beginning of the recording of the same name, a whole second of UTC"
COORDINATES = {"gaze_x": "x_coordinate", "gaze_y": "y_coordinate"}


def write(session: Session, streams: list[Stream], folder: Path) -> Iterator[str]:
    """Write the whole folder with these streams, and read it back; yields sentences on what it does not hold.

    Raises SessionError where it cannot be read back.
    """
    folder.mkdir()
    _write_description(session, folder)
    people = [human for human in session.humans if human != UNASSIGNED]
    yield from _left_out(session, streams, people)
    subjects = _subjects(people)
    _write_participants(subjects, folder)
    task = re.sub(NO_LABEL, "", str(session.info.get("task") or ""))[:60] or "study"
    file_ns = session_start_ns(session)
    for human, subject in subjects.items():
        worn = [stream for stream in streams if stream.name.human_id == human]
        yield from _write_person(session, human, worn, subject, task, file_ns, folder)


def _write_description(session: Session, folder: Path) -> None:
    study = str(session.info.get("study") or "Sense4HRI study")
    write_json(
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
        "the first message received (of eeg and emg from the beginning of their file), on the clock of the recording "
        "host, corrected for each device's own clock.\n"
        "Participants are pseudonyms.\n",
        "utf-8",
    )


def _subjects(people: list[str]) -> dict[str, str]:
    """What BIDS calls each participant. Who is called as a label may be has that one: `sub-pa` is `pa`, not `p_a`."""
    labels = Names(NO_LABEL, "")
    for human in sorted(people, key=lambda human: re.search(NO_LABEL, human) is not None):
        labels.of(human)
    return {human: f"sub-{labels.of(human)}" for human in people}


def _write_participants(subjects: Mapping[str, str], folder: Path) -> None:
    rows = [{"participant_id": subject, "pseudonym": cell(human)} for human, subject in subjects.items()]
    write_tsv(folder / "participants.tsv", ["participant_id", "pseudonym"], rows)
    write_json(folder / "participants.json", {"pseudonym": {"Description": "human_id in the recording, a pseudonym"}})


def _left_out(session: Session, streams: list[Stream], people: list[str]) -> Iterator[str]:
    """What belongs to no participant, for which BIDS has no place."""
    for stream in streams:
        if stream.name.human_id not in people:
            yield f"{stream.key}, BIDS: left out, nobody wore it"
    markers = Counter(str(row["human_id"]) for row in session.timeline_rows)
    for human in sorted(markers.keys() - set(people) - ({""} if people else set())):
        why = f"{human!r} is no participant" if human else "there is no participant"
        yield f"BIDS: {counted(markers[human], 'marker')} left out, {why}"


def _write_person(
    session: Session, human: str, streams: list[Stream], subject: str, task: str, file_ns: int, root: Path
) -> Iterator[str]:
    """Write what one person wore. file_ns: when the files of signals begin."""
    markers = markers_of(session, human)
    start = f"{subject}_task-{task}"
    folder = root / subject / "beh"
    folder.mkdir(parents=True)
    _write_events(markers, session.start_ns, ONSET, task, folder / start)
    recordings = Names(NO_LABEL, "")
    for stream in streams:
        suffix = modality(stream.name.sensor_type).bids_suffix
        label = recordings.of(f"{stream.name.sensor_type}/{stream.name.sensor_id}")
        if suffix == "physio" or not is_a_date(file_ns):
            yield from _write_physio(session, stream, task, file_ns, folder / f"{start}_recording-{label}_physio")
        else:
            stem = root / subject / suffix / f"{start}_acq-{label}"
            stem.parent.mkdir(exist_ok=True)
            yield from bids_electro.write(session, stream, suffix, file_ns, {"TaskName": task}, stem)
            if any(stem.parent.glob(f"{stem.name}_{suffix}.?df")):
                _write_events(markers, file_ns, FILE_ONSET, task, stem)


def _write_events(markers: list[dict[Any, Any]], zero_ns: int, onset: str, task: str, stem: Path) -> None:
    """Write markers as `stem_events`, onsets counted from zero_ns, as `onset` says."""
    rows = [
        {
            "onset": f"{(row['time_ns'] - zero_ns) * 1e-9:.6f}",
            "duration": "n/a",
            "trial_type": cell(str(row["name"] or "n/a")),
            "value": cell(str(row["value"] or "n/a")),
        }
        for row in markers
    ]
    if not rows:
        return
    write_tsv(stem.with_name(f"{stem.name}_events.tsv"), list(rows[0]), rows)
    levels = {name: MARKERS.get(name, f"marker {name}") for name in (str(row["trial_type"]) for row in rows)}
    write_json(
        stem.with_name(f"{stem.name}_events.json"),
        {
            "TaskName": task,
            "onset": {"Description": onset, "Units": "s"},
            "trial_type": {"Description": "name of the marker or of what happened to the session", "Levels": levels},
            "value": {"Description": "free text given with the marker; of a sensor, from whom to whom it went"},
        },
    )


def _write_physio(session: Session, stream: Stream, task: str, file_ns: int, path: Path) -> Iterator[str]:
    rate, gaze = whole_rate_hz(stream), _is_gaze(stream)
    grid = ConstantRate(stream, file_ns, float(rate), span_of(session))
    packed_path = path.with_name(path.name + ".tsv.gz")
    with (
        packed_path.open("xb") as opened,
        gzip.GzipFile("", "wb", 6, opened, mtime=0) as packed,
        io.TextIOWrapper(packed, "utf-8", newline="") as file,
    ):
        line = "\t".join(["%.10g"] * (len(stream.channels) + gaze)) + "\n"
        for piece in grid.pieces():
            done = grid.samples - len(piece)
            rows = np.column_stack([(done + np.arange(len(piece))) / rate, piece]) if gaze else piece
            text = line * len(piece) % tuple(rows.ravel().tolist())
            file.write(text.replace("nan", "n/a"))
    _read_back(packed_path, grid.samples)
    yield from (f"{stream.key}, BIDS: {words}" for words in grid.left_out())
    sidecar = {
        "SamplingFrequency": rate,
        "StartTime": (file_ns - session.start_ns) / SECOND_NS,
        "PhysioType": "eyetrack" if gaze else "generic",
        "Columns": [*("timestamp",)[:gaze], *(_column(stream, name) for name in stream.channels)],
        "TaskName": task,
        **device_of(stream),
        "Resampled": f"by a cubic spline, from {stream.rate_in_words}; n/a where samples are missing",
    }
    about = _columns(stream) | (_gaze(stream) if gaze else {}) | sidecar
    write_json(path.with_name(path.name + ".json"), about)


def _is_gaze(stream: Stream) -> bool:
    """True for gaze as BIDS knows it, with both coordinates."""
    return stream.name.sensor_type == "eye_tracking" and tuple(stream.channels[:2]) == tuple(COORDINATES)


def _column(stream: Stream, channel: str) -> str:
    """Return what a channel's column is called: of gaze as BIDS wants it, else as the channel."""
    return COORDINATES.get(channel, plain(channel)) if _is_gaze(stream) else plain(channel)


def _columns(stream: Stream) -> dict[str, Any]:
    """Return what the sidecar says of every column."""
    found: dict[str, Any] = {}
    for name in stream.channels:
        words = f"{stream.name.sensor_type} of sensor {stream.name.sensor_id}, channel {name}"
        unit = stream.unit_of(name)
        found[_column(stream, name)] = {"Description": words} | ({"Units": UNITS.get(unit, unit)} if unit else {})
    return found


def _gaze(stream: Stream) -> dict[str, Any]:
    """Return what BIDS wants of gaze. Where the screen is nobody told, so its coordinates are the tracker's own."""
    return {
        "timestamp": {"Description": "seconds since StartTime", "Units": "s"},
        **_eye(stream),
        "SampleCoordinateSystem": "custom",
        "SampleCoordinateSystemDescription": f"as the tracker gives it, in {stream.unit or 'no unit'}",
    }


def _eye(stream: Stream) -> dict[str, str]:
    """Return which eye it is, by the body location or the names of channels; BIDS has no word for not knowing."""
    said = " ".join((str(stream.metadata.get("body_location") or ""), *stream.channels)).lower()
    eyes = [eye for eye in ("left", "right") if eye in said]
    if len(eyes) == 1:
        return {"RecordedEye": eyes[0]}
    return {"RecordedEye": "cyclopean", "RecordedEyeDescription": "not told: one eye, or both together"}


def _read_back(path: Path, lines: int) -> None:
    try:
        with gzip.open(path, "rb") as file:
            found = lines_of(file)
    except (OSError, EOFError, zlib.error) as err:
        raise SessionError(f"{path.name} cannot be read back: {err}") from err
    if found != lines:
        raise SessionError(f"{path.name}, read back, has {found} lines, {lines} were written")
