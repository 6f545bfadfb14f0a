"""What was recorded under a name of the study or of a stream and is not that: told by whoever reads, never left out."""

from __future__ import annotations

import re
from typing import Protocol

from sense4hri import host_clocks
from sense4hri.modalities import modality
from sense4hri.names import ROOT, StreamName, is_human_id

MESSAGES = "sense4hri_msgs/msg/"
_HEADER = re.compile(r"^\s*std_msgs(?:/|::)(?:msg(?:/|::))?Header\s+header\b", re.M)
TYPES = {
    "raw": "PhysioRaw",
    "device": "PhysioDeviceFeature",
    "clock": "ClockModel",
    "clock_measurement": "ClockMeasurement",
    "health": "StreamHealth",
}
STUDY = {
    "/study/session": "SessionState",
    "/study/ack": "SessionAck",
    "/study/markers": "Marker",
    "/study/sensors": "SensorInfoArray",
    "/study/assignments": "SensorAssignmentArray",
    host_clocks.TOPIC: "HostClockArray",
    host_clocks.PROBES: "ClockProbe",
}


class Recorded(Protocol):
    """One topic of a recording. definition: text of its type and every nested one."""

    @property
    def name(self) -> str: ...
    @property
    def type_name(self) -> str: ...
    @property
    def definition(self) -> str: ...


def stream_of(topic: Recorded) -> tuple[StreamName, str] | None:
    """(stream, field) of a topic that can be read as a stream's, its name right or not; None for any other."""
    found = StreamName.loosely(topic.name)
    return None if found is None or why_strange(topic) else found


def why_strange(topic: Recorded) -> str:
    """Why a topic cannot be read as what its name says, in a sentence.

    Empty where it can, and for topics that are neither the study's nor below ROOT.
    """
    type_name = topic.type_name
    recorded = f"it is recorded as {type_name or 'a type without a name'}"
    if topic.name in STUDY and type_name != MESSAGES + STUDY[topic.name]:
        return f"{recorded}, {topic.name} is {MESSAGES}{STUDY[topic.name]}"
    if not topic.name.startswith(ROOT + "/") or _is_state(topic.name, type_name):
        return ""
    found = StreamName.loosely(topic.name)
    if found is None:
        return f"it is no topic of a stream, {ROOT}/<human_id>/<sensor_type>/<sensor_id>/<field>"
    expected = _expected(*found)
    if not expected and found[1] == "features" and not _HEADER.search(topic.definition.partition("\n===")[0]):
        return f"{recorded}, which has no header; features begin with one"
    if not expected or type_name == MESSAGES + expected:
        return ""
    return f"{recorded}, a stream's {found[1]} is {MESSAGES}{expected}"


def _expected(name: StreamName, field: str) -> str:
    """Name of the message of a stream's field; empty where the contract knows none."""
    return modality(name.sensor_type).message if field == "features" else TYPES.get(field, "")


def _is_state(topic: str, type_name: str) -> bool:
    parts = topic.removeprefix(ROOT + "/").split("/")
    return parts[1:] == ["state"] and is_human_id(parts[0]) and type_name == f"{MESSAGES}UserState"
