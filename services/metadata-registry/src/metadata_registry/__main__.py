"""metadata-registry: wires the registry to the graph, the ROS services and the HTTP API."""

import sqlite3
import sys
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

from sense4hri import qos
from sense4hri.errors import Refusal
from sense4hri.schema import parameter
from sense4hri.service import Service, run
from sense4hri.stamps import from_ns
from sense4hri_msgs.msg import SensorAssignment, SensorAssignmentArray, SensorInfo, SensorInfoArray
from sense4hri_msgs.srv import AssignSensor, ListSensors

from metadata_registry.config import Config
from metadata_registry.graph import Driver, Drivers
from metadata_registry.registry import Outcome, Registry
from metadata_registry.sensors import Duplicates, Sensor
from metadata_registry.store import Assignment, opened


@dataclass(frozen=True)
class AssignWish:
    """Who wears a sensor from now on."""

    sensor_id: str
    human_id: str
    person_id: str = parameter("", help="the ROS4HRI person, where one is known")


@dataclass(frozen=True)
class Assigned:
    """An assignment that holds, and what an operator should know about it."""

    success: bool
    message: str


class Shell:
    """The registry as seen from outside: topics, services, HTTP."""

    def __init__(self, service: Service[Config], registry: Registry) -> None:
        self._service, self._registry = service, registry
        self._drivers = Drivers(service, self._described)
        self._duplicates = Duplicates()
        self._trouble = ""
        self._published: dict[str, str] = {}
        self._sensors = service.publisher(SensorInfoArray, "/study/sensors", qos.SENSORS)
        self._assignments = service.publisher(SensorAssignmentArray, "/study/assignments", qos.ASSIGNMENTS)
        self._known = service.metrics.gauge("sensors", "Streams of sensors the registry knows.")
        self._online = service.metrics.gauge("sensors_online", "Streams of sensors whose driver is there.")
        self._contested = service.metrics.gauge("sensors_duplicate", "Sensor ids that more than one driver claims.")
        service.serve(ListSensors, "/study/list_sensors", self._list)
        service.serve(AssignSensor, "/study/assign_sensor", self._assign)
        service.http.get("/sensors", registry.sensors, list[Sensor])
        service.http.get("/assignments", registry.assignments, list[Assignment])
        service.http.post("/assign", self._post, AssignWish, Assigned)

    def scan(self) -> None:
        """Look at the graph, bring drivers and registry into line, publish what has changed."""
        duplicates = self._duplicates.find(self._drivers.scan(), time.monotonic())
        for sensor_id in duplicates.keys() - self._registry.duplicates.keys():
            nodes = " and ".join(duplicates[sensor_id])
            self._service.log.error(
                f"sensor_id '{sensor_id}' is claimed by {nodes}: give one of them another sensor_id"
            )
        self._registry.duplicates = duplicates
        online = self._drivers.online()
        self._registry.online({(s.sensor_id, s.sensor_type) for driver in online for s in driver.names()})
        for driver in online:
            self._correct(driver)
        self.publish()

    def publish(self) -> None:
        """Publish sensors and assignments where they differ from what was published last."""
        sensors = [_with_trouble(s, self._registry.duplicates.get(s.sensor_id, ())) for s in self._registry.sensors()]
        assignments = self._registry.assignments()
        self._known.set(len(sensors))
        self._online.set(sum(s.online for s in sensors))
        self._contested.set(len(self._registry.duplicates))
        if self._differs("sensors", sensors):
            message = SensorInfoArray(sensors=[_sensor_info(s) for s in sensors])
            message.header.stamp = from_ns(self._now_ns())
            self._sensors.publish(message)
        if self._differs("assignments", assignments):
            array = SensorAssignmentArray(assignments=[_sensor_assignment(a) for a in assignments])
            array.header.stamp = from_ns(self._now_ns())
            self._assignments.publish(array)

    def _differs(self, what: str, now: list[Any]) -> bool:
        before, self._published[what] = self._published.get(what), repr(now)
        return before != self._published[what]

    def _now_ns(self) -> int:
        return int(self._service.node.get_clock().now().nanoseconds)

    def _described(self, driver: Driver) -> None:
        trouble = ""
        for stream in driver.names():
            # who publishes raw but says nothing of this sensor, such as a replay, is not its driver
            told = driver.parameters if driver.parameters.get("sensor_id") == stream.sensor_id else {}
            try:
                self._registry.seen(stream, driver.node, self._drivers.host(stream), told, self._now_ns())
            except sqlite3.Error as err:
                trouble = str(err)
        if trouble != self._trouble and trouble:
            self._service.log.error(
                f"what the drivers say cannot be kept in {self._service.config.database}: {trouble}"
            )
        self._trouble = trouble

    def _correct(self, driver: Driver) -> None:
        """Set human_id where a driver differs from what an operator said."""
        sensor_id, told = driver.parameters.get("sensor_id"), driver.parameters.get("human_id")
        if sensor_id is None or told is None or sensor_id in self._registry.duplicates:
            return
        wanted = self._registry.wanted(sensor_id)
        if wanted is not None and wanted != told:
            self._drivers.set_human_id(driver, wanted)

    def _list(self, request: Any, response: Any) -> Any:
        response.sensors = [_sensor_info(s) for s in self._registry.sensors(request.human_id)]
        return response

    def _assign(self, request: Any, response: Any) -> Any:
        outcome = self._change(request.sensor_id, request.human_id, request.person_id)
        response.success, response.message = outcome.success, outcome.message
        return response

    def _post(self, wish: AssignWish) -> Assigned:
        """Put a sensor on a person; kept on disk once this is answered."""
        success, message, field = self._change(wish.sensor_id, wish.human_id, wish.person_id)
        if not success:
            raise Refusal(message, field, 400 if field else 503)
        return Assigned(True, message)

    def _change(self, sensor_id: str, human_id: str, person_id: str) -> Outcome:
        outcome = self._registry.assign(sensor_id, human_id, person_id, self._now_ns())
        self._service.log.info(outcome.message) if outcome.success else self._service.log.warning(outcome.message)
        for driver in self._drivers.online() if outcome.success else ():
            self._correct(driver)
        self.publish()
        return outcome


def _with_trouble(sensor: Sensor, nodes: tuple[str, ...]) -> Sensor:
    """A sensor_id claimed twice shows who claims it, under a name no parameter can have."""
    if not nodes:
        return sensor
    claimed = '{"!duplicate_sensor_id": [' + ", ".join(f'"{node}"' for node in nodes) + "]"
    rest = sensor.parameters_json.removeprefix("{")
    return replace(sensor, parameters_json=claimed + (rest if rest == "}" else ", " + rest))


def _sensor_info(sensor: Sensor) -> SensorInfo:
    return SensorInfo(**{**asdict(sensor), "channel_names": list(sensor.channel_names)})


def _sensor_assignment(a: Assignment) -> SensorAssignment:
    since = from_ns(a.since_ns)
    return SensorAssignment(
        sensor_id=a.sensor_id,
        human_id=a.human_id,
        person_id=a.person_id,
        since=since,
        source=a.source,
        confidence=a.confidence,
    )


async def serve(service: Service[Config]) -> None:
    """Keep the registry until told to stop."""
    store = opened(service.config.database, service.log.error)
    shell = Shell(service, Registry(store))
    service.graph.poll_s = service.config.scan_interval_s
    service.every(service.config.scan_interval_s, shell.scan)
    service.ready()
    await service.stopped.wait()
    store.close()


def main() -> int:
    """Run the registry; return the exit status."""
    return run("metadata_registry", Config, serve)


if __name__ == "__main__":
    sys.exit(main())
