"""Who wears what: the rules, over the store and what the graph shows; pure."""

import re
import sqlite3
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from sense4hri.names import UNASSIGNED, StreamName, is_human_id, is_sensor_id, meaning
from sense4hri.shapes import LONGEST_SHOWN

from metadata_registry.past import MOST_ASSIGNMENTS
from metadata_registry.sensors import Sensor, describe, wearer
from metadata_registry.store import Assignment, Store

MOST_SENSORS = 1000  # streams; a study has dozens, a stranger may publish without end
_PERSON_ID = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}")


class Outcome(NamedTuple):
    """The answer to an assignment: done or not, a sentence for the operator, the field that is wrong; HTTP's status."""

    success: bool
    message: str
    field: str = ""
    status: int = 400


class Registry:
    """Everything known, in memory as in the store.

    An order is stored before it is answered, so nothing is promised and then lost. What the graph shows is true whether
    it can be stored or not: it is known at once, and what the store did not take is tried again at the next look.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._sensors: dict[tuple[str, str], Sensor] = {}
        self._unsaved: set[tuple[str, str]] = set()  # not in the store as they are
        self._read_ns: dict[tuple[str, str], int] = {}  # when their parameters were read, which the store may not have
        self._unkept: deque[Assignment] = deque(maxlen=MOST_ASSIGNMENTS)  # not in the store yet, the oldest first
        self.load()
        self.duplicates: dict[str, tuple[str, ...]] = {}
        """Nodes that claim one sensor_id together; such a sensor keeps its first description and cannot be assigned."""
        self.full = False
        """True once a stream was left out because MOST_SENSORS are known."""

    def load(self) -> None:
        """Take up what the store holds; whose driver is there stays known."""
        there = {key for key, sensor in self._sensors.items() if sensor.online}
        self._sensors = {one.key: replace(one, online=one.key in there) for one in self._store.sensors()}
        self._assignments, self._orders = self._store.assignments(), self._store.orders()

    def sensors(self, human_id: str = "") -> list[Sensor]:
        """Every sensor, or those on one person, in a steady order; human_id is what its topics last bore."""
        known = [
            replace(self._sensors[key], human_id=self._wearer(self._sensors[key])) for key in sorted(self._sensors)
        ]
        return [sensor for sensor in known if human_id in ("", sensor.human_id)]

    def assignments(self) -> list[Assignment]:
        """The assignment of every sensor that its topics have shown, in a steady order."""
        return [self._assignments[sensor_id] for sensor_id in sorted(self._assignments)]

    def wanted(self, sensor_id: str) -> str | None:
        """The human_id an operator gave this sensor; None where none did and the driver's own configuration counts."""
        order = self._orders.get(sensor_id)
        return order.human_id if order else None

    def seen(self, stream: StreamName, node: str, host: str, parameters: Mapping[str, Any], now_ns: int) -> None:
        """A driver publishes this stream and says this about it. Raises sqlite3.Error where it cannot be kept yet."""
        known = self._sensors.get((stream.sensor_id, stream.sensor_type))
        if known and known.node != node and stream.sensor_id in self.duplicates:
            return
        if known is None and len(self._sensors) >= MOST_SENSORS:
            self.full = True
            return
        sensor = replace(
            known or Sensor(stream.sensor_id, stream.sensor_type, stream.human_id),
            human_id=stream.human_id,
            node=node,
            host=host or (known.host if known else ""),
            online=True,
        )
        sensor = describe(sensor, parameters)
        changed = known is None or repr(known) != repr(sensor)  # repr: two NaN are alike
        if changed:
            self._sensors[sensor.key] = sensor
            self._unsaved.add(sensor.key)
        if parameters and (changed or sensor.key not in self._read_ns):
            self._read_ns[sensor.key] = now_ns
        if sensor.sensor_id not in self._assignments:
            self._hold(Assignment(sensor.sensor_id, sensor.human_id, "", now_ns, "config"))
        self.keep()

    def online(self, keys: set[tuple[str, str]]) -> None:
        """Exactly these (sensor_id, sensor_type) have a living driver now."""
        for key, sensor in self._sensors.items():
            if sensor.online != (key in keys):
                self._sensors[key] = replace(sensor, online=key in keys)

    def assign(self, sensor_id: str, human_id: str, person_id: str, now_ns: int) -> Outcome:
        """An operator puts a sensor on a person; the order is on disk before this returns.

        It holds once `settle` sees the sensor's topics under human_id, or at once where they bear it already.
        """
        refused = self._refused(sensor_id, human_id, person_id)
        if refused is not None:
            return refused
        held = self._assignments.get(sensor_id)
        moves = held is None or held.human_id != human_id
        order = Assignment(sensor_id, human_id, person_id, now_ns, "operator", 0.0 if moves else 1.0)
        try:
            self.keep()
            self._store.assign(order)
        except sqlite3.Error as err:
            return Outcome(False, f"not assigned: the registry cannot write its database: {err}", status=503)
        self._orders[sensor_id] = order
        if not moves:
            self._assignments[sensor_id] = order
        said = f"sensor_id '{sensor_id}' is assigned to human_id '{human_id}'"
        said += f" with person_id '{person_id}'" if person_id else ""
        others = self._others_with(person_id, human_id)
        if others:
            said += (
                f"; person_id '{person_id}' is still named for {', '.join(others)} too, the newest assignment counts"
            )
        if not any(sensor.online for key, sensor in self._sensors.items() if key[0] == sensor_id):
            said += "; its driver is not there: human_id will be set when it is back"
        return Outcome(True, said)

    def settle(self, worn: Mapping[str, Collection[str]], now_ns: int) -> None:
        """Believe the graph. worn: by sensor_id, the human_ids that its living topics bear.

        Raises sqlite3.Error where what was seen, now or before, cannot be kept yet.
        """
        for sensor_id, human_ids in worn.items():
            held, order = self._assignments.get(sensor_id), self._orders.get(sensor_id)
            if held is None or held.human_id in human_ids or len(human_ids) != 1:
                continue
            (human_id,) = human_ids
            if order is not None and order.human_id == human_id:
                self._hold(replace(order, since_ns=now_ns, confidence=1.0))
            else:
                self._hold(Assignment(sensor_id, human_id, "", now_ns, "config"))
        self.keep()

    def keep(self) -> None:
        """Store what the graph has shown and the store does not have yet, in its order. Raises sqlite3.Error."""
        for key in list(self._unsaved):
            self._store.save(self._sensors[key])
            self._unsaved.remove(key)
        for key, read_ns in list(self._read_ns.items()):
            sensor = self._sensors[key]
            self._store.past.read(key[0], wearer(sensor), sensor.node, read_ns, sensor.parameters_json)
            del self._read_ns[key]
        while self._unkept:
            self._store.assign(self._unkept[0])
            self._unkept.popleft()

    def not_done(self, worn: Mapping[str, Collection[str]]) -> dict[str, str]:
        """Return the sensors whose topics bear another name than an operator gave them, each with a sentence."""
        return {
            sensor_id: f"human_id '{wanted}' was asked for, but its topics are under {_named(human_ids)}"
            for sensor_id, human_ids in sorted(worn.items())
            if (wanted := self.wanted(sensor_id)) is not None and set(human_ids) != {wanted}
        }

    def _wearer(self, sensor: Sensor) -> str:
        assignment = self._assignments.get(sensor.sensor_id)
        return assignment.human_id if assignment else sensor.human_id

    def _refused(self, sensor_id: str, human_id: str, person_id: str) -> Outcome | None:
        """Return why these cannot be brought together, None where they can."""
        rules = "letters, digits and single '_', a letter first, at most 63"
        if not is_sensor_id(sensor_id):
            small = rules.replace("letters", "small letters", 1)
            return Outcome(False, f"sensor_id {_shown(sensor_id)} is not legal: {small}", "sensor_id")
        if not is_human_id(human_id):
            return Outcome(False, f"human_id {_shown(human_id)} is not legal: {rules}", "human_id")
        if human_id != UNASSIGNED and (means := meaning(human_id)):
            return Outcome(False, f"human_id {human_id!r} is no participant: it means {means}", "human_id")
        if person_id and not _PERSON_ID.fullmatch(person_id):
            why = "letters, digits and '_', no digit first, at most 100 (or empty)"
            return Outcome(False, f"person_id {_shown(person_id)} is not legal: {why}", "person_id")
        if person_id and human_id == UNASSIGNED:
            return Outcome(False, f"person_id {person_id!r} cannot be '{UNASSIGNED}', who is nobody", "person_id")
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

    def _hold(self, assignment: Assignment) -> None:
        self._assignments[assignment.sensor_id] = assignment
        self._unkept.append(assignment)


def _shown(text: str) -> str:
    """Return what somebody sent as a refusal says it: a line that can be read."""
    return repr(text) if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]!r}..."


def _named(human_ids: Collection[str]) -> str:
    return " and ".join(f"'{human_id}'" for human_id in sorted(human_ids))
