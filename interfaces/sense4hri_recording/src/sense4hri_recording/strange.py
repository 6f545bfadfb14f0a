"""What was recorded below the streams' names and is no stream's: told by whoever reads, never left out in silence."""

from __future__ import annotations

from sense4hri.modalities import modality
from sense4hri.names import ROOT, StreamName, is_human_id

MESSAGES = "sense4hri_msgs/msg/"
TYPES = {
    "raw": "PhysioRaw",
    "device": "PhysioDeviceFeature",
    "clock": "ClockModel",
    "clock_measurement": "ClockMeasurement",
    "health": "StreamHealth",
}


def stream_of(topic: str, type_name: str) -> tuple[StreamName, str] | None:
    """(stream, field) of a topic that can be read as a stream's, its name right or not; None for any other."""
    found = StreamName.loosely(topic)
    return None if found is None or why_strange(topic, type_name) else found


def why_strange(topic: str, type_name: str) -> str:
    """Why a topic below ROOT cannot be read as a stream's, in a sentence; empty where it can, and for other topics."""
    if not topic.startswith(ROOT + "/") or _is_state(topic, type_name):
        return ""
    found = StreamName.loosely(topic)
    if found is None:
        return f"it is no topic of a stream, {ROOT}/<human_id>/<sensor_type>/<sensor_id>/<field>"
    expected = _expected(*found)
    if not expected or type_name == MESSAGES + expected:
        return ""
    return f"it is recorded as {type_name or 'a type without a name'}, a stream's {found[1]} is {MESSAGES}{expected}"


def _expected(name: StreamName, field: str) -> str:
    """Name of the message of a stream's field; empty where the contract knows none."""
    return modality(name.sensor_type).message if field == "features" else TYPES.get(field, "")


def _is_state(topic: str, type_name: str) -> bool:
    parts = topic.removeprefix(ROOT + "/").split("/")
    return parts[1:] == ["state"] and is_human_id(parts[0]) and type_name == f"{MESSAGES}UserState"
