"""codebook.csv: one row per column of every exported table, and one per marker name and state that occurs.

Units and meanings are the comments of the message definitions inside the recording itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import pandas as pd

from sense4hri_session import tables
from sense4hri_session.session import Session

CLOCK = {
    "time_s": ("s", "ROS time, corrected", "seconds from the first message of the recording"),
    "time_ns": ("ns", "ROS time, corrected", "time of the sample or event; of tables without one, receipt by recorder"),
    "device_time_ns": ("ns", "device", "the device's own clock; the newest sample of a message has its raw stamp"),
    "received_ns": ("ns", "ROS time, raw", "header stamp: receipt of the frame that brought it; never corrected"),
    "segment": ("1", "", "epoch of the device clock, from 1; 0 = the device gives no time"),
    "frame_id": ("", "", "header frame: the sensor, or whom it concerns"),
    "stream": ("", "", "human/type/sensor"),
    "face_id": ("", "", "ROS4HRI face"),
    "event": ("", "", "what happened"),
    "value": ("", "", "the value; in the unit beside it, or free text of a marker"),
    "reasons": ("", "", "why a value is empty or doubtful"),
    "features": ("", "", "values computed by the device, as JSON"),
}
MARKERS = {
    "session_start": "the session begins (start_at)",
    "session_stop": "the session ends (stop_at)",
    "baseline_start": "a baseline begins",
    "baseline_end": "a baseline ends",
    "condition_start": "a condition begins",
    "condition_end": "a condition ends",
    "stimulus": "a stimulus is shown",
    "response": "a participant responds",
    "sync": "an event every device sees, to align clocks",
    "note": "a note of the experimenter",
    "mvc": "maximum voluntary contraction",
}
_FIELD = re.compile(r"^\s*([\w/]+)(\[[^\]]*\])?\s+(\w+)\s*(?:#\s*(.*))?$")
_UNIT = re.compile(r"^(s|ms|ns|Hz|1/min|uV|uV2|ms2|%|1e-6|rad/s|m/s\^2|uS|unit|degC|dBm|bit|deg|mm|px)\b")


def codebook(session: Session, exported: list[tuple[str, list[str]]]) -> pd.DataFrame:
    """exported: (name of the table, its columns). Columns: table, column, unit, clock, description."""
    rows = list(_columns(session, exported))
    markers = session.timeline
    counts = markers["name"].value_counts().to_dict() if len(markers) else {}
    for name in [*MARKERS, *(str(name) for name in counts if name not in MARKERS)]:
        text = MARKERS.get(name, "the study's own marker")
        rows.append(("markers", f"name={name}", "", "", f"{text}; {counts.get(name, 0)} in this session"))
    states = session.states
    for state, count in (states["state"].value_counts().to_dict() if len(states) else {}).items():
        rows.append(("states", f"state={state}", "", "", f"{count} messages in this session"))
    return pd.DataFrame(rows, columns=["table", "column", "unit", "clock", "description"])


def _columns(session: Session, exported: list[tuple[str, list[str]]]) -> Iterator[tuple[str, str, str, str, str]]:
    comments = {name: _comments(topic.definition) for name, topic in session.reader.topics.items()}
    every: dict[str, str] = {}
    for found in comments.values():
        every |= found
    streams = {"_".join(stream.name): stream for stream in session.streams.values()}
    event_columns = {column for kinds in tables.EVENTS.values() for _, _, beside in kinds for column in beside}
    for table, columns in exported:
        stream = streams.get(table)
        for column in columns:
            if stream is not None and column in stream.channels:
                about = f"sample of channel {column}, {stream.name.sensor_type} of {stream.name.sensor_id}"
                yield table, column, stream.unit or "unknown", "", about
            elif column in CLOCK:
                yield (table, column, *CLOCK[column])
            elif column.startswith("extra_"):
                yield table, column, "", "", "a value without a field of its own"
            else:
                text = every.get(column) or every.get(column.removesuffix("_ns")) or _nested(column, every)
                unit = match[1] if (match := _UNIT.match(text)) else ""
                clock = "ROS time, corrected" if column.endswith("_timestamps") else ""
                if column in event_columns and not text:
                    text = "beside the event"
                yield table, column, "ns" if column.endswith(("_ns", "_timestamps")) else unit, clock, text


def _nested(column: str, comments: dict[str, str]) -> str:
    """The comment of `hrv_rmssd_ms` is that of `rmssd_ms`."""
    for at in (i for i, letter in enumerate(column) if letter == "_"):
        if column[at + 1 :] in comments:
            return comments[column[at + 1 :]]
    return column.replace("_", " ")


def _comments(definition: str) -> dict[str, str]:
    matches = (_FIELD.match(line) for line in definition.splitlines() if "=" not in line.split("#")[0])
    return {match[3]: match[4] for match in matches if match and match[4]}
