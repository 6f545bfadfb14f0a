"""codebook.csv: one row per column of every exported table, and one per marker name and state that occurs.

Units and meanings are the comments of the message definitions inside the recording itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import pandas as pd
from sense4hri import extras
from sense4hri_recording.reader import Topic

from sense4hri_session import definitions
from sense4hri_session.definitions import About
from sense4hri_session.session import Session
from sense4hri_session.stream import Stream
from sense4hri_session.tables import EXTRA

CLOCK = {
    "time_s": ("s", "ROS time, corrected", "seconds from the first message of the recording"),
    "time_ns": ("ns", "ROS time, corrected", "time of the sample or event; of tables without one, receipt by recorder"),
    "device_time_ns": ("ns", "device", "the device's own clock; the newest sample of a message has its raw stamp"),
    "received_ns": ("ns", "ROS time, raw", "header stamp: receipt of the frame that brought it; never corrected"),
    "name": ("", "", "what it is called"),
    "unit": ("", "", "unit of the value"),
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
    "sensor_left": "a sensor of this participant went to somebody else",
    "sensor_came": "a sensor of somebody else came to this participant",
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


class Exported(NamedTuple):
    """A table that was written. topics: those it was made of, all of one type; stream: whose samples it holds."""

    table: str
    columns: list[str]
    topics: list[str]
    stream: Stream | None = None


def codebook(session: Session, exported: list[Exported]) -> pd.DataFrame:
    """Columns: table, column, unit, clock, description."""
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


def _columns(session: Session, exported: list[Exported]) -> Iterator[tuple[str, str, str, str, str]]:
    for item in exported:
        explained = _explained(session, item)
        channels = {} if item.stream is None else {column: name for name, column in item.stream.columns.items()}
        for column in item.columns:
            yield (item.table, column, *_about(session, item, column, channels.get(column), explained))


def _explained(session: Session, item: Exported) -> dict[str, About]:
    known = _topic(session, item)
    return definitions.columns(known.definition, known.type_name) if known else {}


def _message(session: Session, item: Exported) -> str:
    """The name of the message that a table was made of."""
    known = _topic(session, item)
    return known.type_name.split("/")[-1] if known else ""


def _topic(session: Session, item: Exported) -> Topic | None:
    return next((session.reader.topics[topic] for topic in item.topics if topic in session.reader.topics), None)


def _about(
    session: Session, item: Exported, column: str, channel: str | None, explained: dict[str, About]
) -> tuple[str, str, str]:
    """Unit, clock and meaning of one column. channel: whose samples it has, if any."""
    stream, own = item.stream, explained.get(column)
    if stream is not None and channel is not None:
        about = f"sample of channel {channel}, {stream.name.sensor_type} of {stream.name.sensor_id}"
        return stream.unit_of(channel) or "unknown", "", about
    if own is None or column in ("frame_id", "device_time_ns"):
        if column in CLOCK:
            return CLOCK[column]
        if column.startswith(EXTRA):
            told = {unit for topic in item.topics for unit in session.extra_units.get((topic, column), ())}
            return " or ".join(sorted(told)), "", extras.about(_message(session, item), column.removeprefix(EXTRA))
        return "ns" if column.endswith("_ns") else "", "", column.replace("_", " ")
    clock = "ROS time, corrected" if column.endswith("_timestamps") else ""
    return own.unit, clock, own.text or column.replace("_", " ")
