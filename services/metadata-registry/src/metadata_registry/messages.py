"""What the registry knows as messages of the contract."""

import json
from dataclasses import asdict, replace
from typing import Any

from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import SensorAssignment, SensorInfo

from metadata_registry.sensors import Sensor
from metadata_registry.store import Assignment


def with_troubles(sensor: Sensor, troubles: dict[str, Any]) -> Sensor:
    """Say in parameters_json, before everything else, what is wrong with a sensor."""
    said = {name: trouble for name, trouble in troubles.items() if trouble}
    if not said:
        return sensor
    rest = sensor.parameters_json.removeprefix("{")
    return replace(sensor, parameters_json=json.dumps(said)[:-1] + (rest if rest == "}" else ", " + rest))


def sensor_info(sensor: Sensor) -> SensorInfo:
    return SensorInfo(**{**asdict(sensor), "channel_names": list(sensor.channel_names)})


def sensor_assignment(a: Assignment) -> SensorAssignment:
    since = from_ns(a.since_ns)
    return SensorAssignment(
        sensor_id=a.sensor_id,
        human_id=a.human_id,
        person_id=a.person_id,
        since=since,
        source=a.source,
        confidence=a.confidence,
    )
