"""What the definitions in a file must be before a message is read by them: of a size, and of our types what we read.

A file carries its own definitions, of another version, damaged or made to harm.
"""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict
from sense4hri.modalities import MODALITIES

DEEPEST, MOST_FIELDS = 16, 10_000
_TIME, _HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
_OURS = "sense4hri_msgs/msg/"
NUMBER, TEXT, TEXTS, NUMBERS = "number", "string", "string[]", "number[]"
_KINDS = {
    "builtin_interfaces/msg/Time": {NUMBER: "sec nanosec"},
    "std_msgs/msg/Header": {_TIME: "stamp", TEXT: "frame_id"},
    f"{_OURS}ClockMeasurement": {_HEADER: "header", _TIME: "device_timestamp", NUMBER: "offset_ns uncertainty_s"},
    f"{_OURS}ClockModel": {
        _HEADER: "header",
        _TIME: "device_reference",
        NUMBER: "offset_ns skew_ppm uncertainty_s latency_s segment state",
    },
    f"{_OURS}Marker": {
        _HEADER: "header",
        TEXT: "name value source human_id session_id",
        NUMBER: "uncertainty_s",
    },
    f"{_OURS}SensorInfo": {TEXT: "sensor_id sensor_type"},
    f"{_OURS}SensorInfoArray": {f"{_OURS}SensorInfo[]": "sensors"},
    f"{_OURS}SensorAssignment": {TEXT: "sensor_id human_id", _TIME: "since"},
    f"{_OURS}SensorAssignmentArray": {f"{_OURS}SensorAssignment[]": "assignments"},
    f"{_OURS}SessionState": {
        _HEADER: "header",
        TEXT: "session_id study task metadata_json detail",
        NUMBER: "phase",
        _TIME: "start_at stop_at",
        TEXTS: "human_ids required_streams",
    },
    f"{_OURS}UserState": {_HEADER: "header", TEXT: "human_id state person_id face_id"},
    f"{_OURS}PhysioFeature": {TEXT: "name unit", f"{NUMBER}[]": "values"},
    f"{_OURS}PhysioDeviceFeature": {
        _HEADER: "header",
        _TIME: "device_timestamp",
        f"{_OURS}PhysioFeature[]": "features",
    },
    **{
        f"{_OURS}{message}": {_HEADER: "header", _TIME: "device_timestamp", f"{_OURS}PhysioFeature[]": "extra"}
        for message in {each.message for each in MODALITIES.values() if each.message}
    },
    f"{_OURS}StreamHealth": {
        _HEADER: "header",
        TEXT: "host",
        NUMBER: "state realtime_minus_monotonic_ns nominal_rate_hz samples_total lost_samples_total gaps_total "
        "duplicates_total reconnects_total latency_s battery_percent rssi_dbm contact",
        TEXTS: "reasons",
    },
}
"""Fields that readers cannot do without, by their kind."""
_ANYWHERE = {
    **dict.fromkeys(["human_id", "person_id", "face_id", "unit", "vendor", "model", "parameters_json"], TEXT),
    **dict.fromkeys(["signal_quality", "sampling_frequency_hz", "transport_delay_s", "resolution_bits"], NUMBER),
    **dict.fromkeys(("reasons", "channel_names"), TEXTS),
    "header": _HEADER,
    "device_timestamp": _TIME,
}
"""Of a field that one of our messages may have, its kind."""


def check(types: Typesdict, type_name: str) -> None:
    """Raise ValueError for a type that holds itself, is too large, or lacks what its name promises."""
    _count(types, type_name, {}, 0)
    for name, (_, fields) in types.items():
        found = {field: _kind(node) for field, node in fields}
        expected = {field: kind for kind, named in _KINDS.get(name, {}).items() for field in named.split()}
        lacking = sorted(set(expected) - set(found))
        if lacking:
            raise ValueError(f"{name} has no {', '.join(lacking)}")
        if name.startswith(_OURS):
            expected = {field: kind for field, kind in _ANYWHERE.items() if field in found} | expected
            expected |= {field: f"{_TIME}[]" for field in found if field.endswith("_timestamps")}
        wrong = [field for field, kind in expected.items() if found[field] != kind]
        if wrong:
            raise ValueError(f"{name} has {wrong[0]} as {found[wrong[0]]}, not as {expected[wrong[0]]}")


def _kind(node: tuple[Any, Any]) -> str:
    """`number`, `string`, the name of a type, or one of these with `[]`."""
    number, detail = node
    if number == Nodetype.BASE:
        return TEXT if detail[0] in ("string", "wstring") else NUMBER
    if number == Nodetype.NAME:
        return str(detail)
    return f"{_kind(detail[0])}[]"


def _count(types: Typesdict, name: str, counted: dict[str, int], depth: int) -> int:
    """How many values a message has at least."""
    if depth > DEEPEST:
        raise ValueError(f"{name[:100]} is nested deeper than {DEEPEST} levels")
    if name not in counted and name in types:
        counted[name] = sum(_values(types, node, counted, depth) for _, node in types[name][1])
        if counted[name] > MOST_FIELDS:
            raise ValueError(f"{name[:100]} has more than {MOST_FIELDS} fields")
    return counted.get(name, 0)


def _values(types: Typesdict, node: tuple[Any, Any], counted: dict[str, int], depth: int) -> int:
    number, detail = node
    if number == Nodetype.NAME:
        return _count(types, detail, counted, depth + 1)
    if number == Nodetype.BASE:
        return 1
    inner, length = detail
    each = _values(types, inner, counted, depth)
    is_text_or_type = inner[0] == Nodetype.NAME or inner[1][0] == "string"
    return each * length if number == Nodetype.ARRAY and is_text_or_type else each
