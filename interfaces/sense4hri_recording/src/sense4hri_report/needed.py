"""The fields of messages that the report cannot do without."""

from rosbags.interfaces.typing import Typesdict

NEEDED = {
    "builtin_interfaces/msg/Time": "sec nanosec",
    "std_msgs/msg/Header": "stamp",
    "sense4hri_msgs/msg/ClockModel": "header device_reference offset_ns skew_ppm uncertainty_s latency_s segment state",
    "sense4hri_msgs/msg/Marker": "header name value source human_id session_id uncertainty_s",
    "sense4hri_msgs/msg/SensorAssignment": "sensor_id human_id since",
    "sense4hri_msgs/msg/SensorAssignmentArray": "assignments",
    "sense4hri_msgs/msg/SensorInfo": "sensor_id sensor_type",
    "sense4hri_msgs/msg/SensorInfoArray": "sensors",
    "sense4hri_msgs/msg/SessionState": "header session_id study task metadata_json phase start_at stop_at human_ids "
    "required_streams detail",
    "sense4hri_msgs/msg/StreamHealth": "header state host realtime_minus_monotonic_ns nominal_rate_hz samples_total "
    "lost_samples_total gaps_total duplicates_total reconnects_total latency_s battery_percent rssi_dbm contact "
    "reasons",
}
"""Fields that the report cannot do without; a file carries its own definitions, of another version or damaged."""


def check(types: Typesdict) -> None:
    """Raise ValueError for a definition without a field that is needed."""
    for name, (_, fields) in types.items():
        lacking = set(NEEDED.get(name, "").split()) - {field_name for field_name, _ in fields}
        if lacking:
            raise ValueError(f"{name} has no {', '.join(sorted(lacking))}")
