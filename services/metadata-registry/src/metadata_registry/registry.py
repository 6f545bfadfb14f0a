"""Who wears what: the rules, over the store and what the graph shows; pure."""

import re
import sqlite3
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from sense4hri.names import StreamName, is_human_id, is_sensor_id

from metadata_registry.sensors import Sensor, describe
from metadata_registry.store import Assignment, Store

_PERSON_ID = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class Outcome(NamedTuple):
    """The answer to an assignment: done or not, a sentence for the operator, and the field that is wrong or empty."""

    success: bool
    message: str
    field: str = ""


class Registry:
    """Everything known, in memory as in the store; the store is written first, so nothing is promised and then lost."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._sensors = {sensor.key: sensor for sensor in store.sensors()}
        self._assignments = store.assignments()
        self.duplicates: dict[str, tuple[str, ...]] = {}
        """Nodes that claim one sensor_id together; such a sensor keeps its first description and cannot be assigned."""

    def sensors(self, human_id: str = "") -> list[Sensor]:
        """Every sensor, or those on one person, in a steady order; human_id is who the assignment says wears it."""
        known = [
            replace(self._sensors[key], human_id=self._wearer(self._sensors[key])) for key in sorted(self._sensors)
        ]
        return [sensor for sensor in known if human_id in ("", sensor.human_id)]

    def assignments(self) -> list[Assignment]:
        """The assignment that counts for every sensor, in a steady order."""
        return [self._assignments[sensor_id] for sensor_id in sorted(self._assignments)]

    def wanted(self, sensor_id: str) -> str | None:
        """The human_id an operator gave this sensor; None where none did and the driver's own configuration counts."""
        assignment = self._assignments.get(sensor_id)
        return assignment.human_id if assignment and assignment.source == "operator" else None

    def seen(self, stream: StreamName, node: str, host: str, parameters: Mapping[str, Any], now_ns: int) -> None:
        """A driver publishes this stream and says this about it. Raises sqlite3.Error where it cannot be kept."""
        known = self._sensors.get((stream.sensor_id, stream.sensor_type))
        if known and known.node != node and stream.sensor_id in self.duplicates:
            return
        sensor = replace(
            known or Sensor(stream.sensor_id, stream.sensor_type, stream.human_id),
            human_id=stream.human_id,
            node=node,
            host=host or (known.host if known else ""),
            online=True,
        )
        sensor = describe(sensor, parameters)
        if known is None or repr(known) != repr(sensor):  # repr: two NaN are alike
            self._sensors[sensor.key] = sensor
            self._store.save(sensor)
        self._configured(sensor, now_ns)

    def online(self, keys: set[tuple[str, str]]) -> None:
        """Exactly these (sensor_id, sensor_type) have a living driver now."""
        for key, sensor in self._sensors.items():
            if sensor.online != (key in keys):
                self._sensors[key] = replace(sensor, online=key in keys)

    def assign(self, sensor_id: str, human_id: str, person_id: str, now_ns: int) -> Outcome:
        """An operator puts a sensor on a person; kept on disk before this returns."""
        refused = self._refused(sensor_id, human_id, person_id)
        if refused is not None:
            return refused
        assignment = Assignment(sensor_id, human_id, person_id, now_ns, "operator")
        try:
            self._store.assign(assignment)
        except sqlite3.Error as err:
            return Outcome(False, f"not assigned: the registry cannot write its database: {err}")
        self._assignments[sensor_id] = assignment
        said = f"sensor_id '{sensor_id}' is assigned to human_id '{human_id}'"
        said += f" with person_id '{person_id}'" if person_id else ""
        others = self._others_with(person_id, human_id)
        if others:
            said += (
                f"; person_id '{person_id}' is still named for {', '.join(others)} too, the newest assignment counts"
            )
        streams = [sensor for key, sensor in self._sensors.items() if key[0] == sensor_id]
        if not any(sensor.online for sensor in streams):
            said += "; its driver is not there: human_id will be set when it is back"
        elif any(sensor.human_id != human_id for sensor in streams):
            said += "; its driver is being told now, and again when it is back should it vanish meanwhile"
        return Outcome(True, said)

    def _wearer(self, sensor: Sensor) -> str:
        assignment = self._assignments.get(sensor.sensor_id)
        return assignment.human_id if assignment else sensor.human_id

    def _refused(self, sensor_id: str, human_id: str, person_id: str) -> Outcome | None:
        """Return why these cannot be brought together, None where they can."""
        rules = "letters, digits and single '_', a letter first, at most 63"
        if not is_sensor_id(sensor_id):
            small = rules.replace("letters", "small letters", 1)
            return Outcome(False, f"sensor_id {sensor_id!r} is not legal: {small}", "sensor_id")
        if not is_human_id(human_id):
            return Outcome(False, f"human_id {human_id!r} is not legal: {rules}", "human_id")
        if person_id and not _PERSON_ID.fullmatch(person_id):
            why = "letters, digits and '_', no digit first (or empty)"
            return Outcome(False, f"person_id {person_id!r} is not legal: {why}", "person_id")
        if sensor_id in self.duplicates:
            why = f"is claimed by {' and '.join(self.duplicates[sensor_id])}: give one of them another sensor_id"
            return Outcome(False, f"sensor_id {sensor_id!r} {why}", "sensor_id")
        known = sorted({key[0] for key in self._sensors})
        if sensor_id not in known:
            why = f"is not known; known are: {', '.join(known) or 'none yet'}"
            return Outcome(False, f"sensor_id {sensor_id!r} {why}", "sensor_id")
        return None

    def _others_with(self, person_id: str, human_id: str) -> list[str]:
        if not person_id:
            return []
        return sorted({a.human_id for a in self._assignments.values() if a.person_id == person_id} - {human_id})

    def _configured(self, sensor: Sensor, now_ns: int) -> None:
        """Where no operator has assigned the sensor, its driver's own configuration is the assignment."""
        current = self._assignments.get(sensor.sensor_id)
        if current is None or (current.source == "config" and current.human_id != sensor.human_id):
            assignment = Assignment(sensor.sensor_id, sensor.human_id, "", now_ns, "config")
            self._assignments[sensor.sensor_id] = assignment
            self._store.assign(assignment)
