"""metadata-registry: wires the registry to the graph, the ROS services and the HTTP API."""

import asyncio
import sqlite3
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from sense4hri import qos
from sense4hri.errors import Refusal
from sense4hri.run import run
from sense4hri.schema import parameter
from sense4hri.service import Service
from sense4hri.stamps import from_ns
from sense4hri.topics import BEST_EFFORT
from sense4hri_msgs.msg import SensorAssignmentArray, SensorInfoArray
from sense4hri_msgs.srv import AssignSensor, ListSensors

from metadata_registry.config import Config
from metadata_registry.graph import Driver, Drivers
from metadata_registry.messages import sensor_assignment, sensor_info, with_troubles
from metadata_registry.people import People
from metadata_registry.registry import MOST_SENSORS, Outcome, Registry
from metadata_registry.sensors import Duplicates, Sensor
from metadata_registry.store import Assignment, Store, opened

MOVE_S, LOOK_S = 4.0, 0.1
PERSONAL = ("human_id", "person_id")


@dataclass(frozen=True)
class AssignWish:
    """Who wears a sensor from now on."""

    sensor_id: str
    human_id: str
    person_id: str = parameter("", help="the ROS4HRI person, where one is known")


@dataclass(frozen=True)
class Assigned:
    """An assignment that holds, or will once its driver is back, and what an operator should know about it."""

    success: bool
    message: str


class Shell:
    """The registry as seen from outside: topics, services, HTTP."""

    def __init__(self, service: Service[Config], store: Store) -> None:
        self._service, self._registry = service, Registry(store)
        self._drivers = Drivers(service, self._described)
        self._duplicates = Duplicates()
        self._trouble = ""
        self._said_full = False
        self._differs_since_s: dict[str, float] = {}
        self._not_done: dict[str, str] = {}
        self._published: dict[str, str] = {}
        self._sensors = service.publisher(SensorInfoArray, "/study/sensors", qos.SENSORS)
        self._assignments = service.publisher(SensorAssignmentArray, "/study/assignments", qos.ASSIGNMENTS)
        self._known = service.metrics.gauge("sensors", "Streams of sensors the registry knows.")
        self._online = service.metrics.gauge("sensors_online", "Streams of sensors whose driver is there.")
        self._contested = service.metrics.gauge("sensors_duplicate", "Sensor ids that more than one driver claims.")
        self._undone = service.metrics.gauge(
            "assignments_not_done", "Sensors whose topics bear another name than an operator gave them."
        )
        service.serve(ListSensors, "/study/list_sensors", self._list)
        service.serve(AssignSensor, "/study/assign_sensor", self._assign)
        service.http.get("/sensors", self._told, list[Sensor])
        service.http.get("/assignments", self._registry.assignments, list[Assignment])
        service.http.post("/assign", self._post, AssignWish, Assigned)
        People(service, store, self._registry, self._worn_by, self.scan)

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
        self._settle()
        if self._registry.full and not self._said_full:
            self._said_full = True
            self._service.log.error(f"more than {MOST_SENSORS} streams were published: the others are not kept")
        self.publish()

    def _settle(self) -> None:
        """Take the graph's word for who wears what, and tell of what it does not bear out for longer than MOVE_S."""
        worn, now_s = self._drivers.worn(), time.monotonic()
        self._attempt(lambda: self._registry.settle(worn, self._now_ns()))
        differing = self._registry.not_done(worn)
        self._differs_since_s = {one: self._differs_since_s.get(one, now_s) for one in differing}
        told = {one: differing[one] for one, since_s in self._differs_since_s.items() if now_s - since_s >= MOVE_S}
        for sensor_id in told.keys() - self._not_done.keys():
            self._service.log.error(f"{sensor_id}: {told[sensor_id]}")
        self._not_done = told

    def publish(self) -> None:
        """Publish sensors and assignments where they differ from what was published last."""
        sensors = self._told()
        assignments = self._registry.assignments()
        self._known.set(len(sensors))
        self._online.set(sum(s.online for s in sensors))
        self._contested.set(len(self._registry.duplicates))
        self._undone.set(len(self._not_done))
        if self._differs("sensors", sensors):
            message = SensorInfoArray(sensors=[sensor_info(s) for s in sensors])
            message.header.stamp = from_ns(self._now_ns())
            self._sensors.publish(message)
        if self._differs("assignments", assignments):
            array = SensorAssignmentArray(assignments=[sensor_assignment(a) for a in assignments])
            array.header.stamp = from_ns(self._now_ns())
            self._assignments.publish(array)

    def _told(self, human_id: str = "") -> list[Sensor]:
        """Every sensor, with what is wrong about it under names that no parameter can have."""
        unreliable = self._drivers.unreliable()
        return [
            with_troubles(
                sensor,
                {
                    "!duplicate_sensor_id": list(self._registry.duplicates.get(sensor.sensor_id, ())),
                    "!assignment_not_done": self._not_done.get(sensor.sensor_id, ""),
                    "!quality_of_service": f"raw is published {BEST_EFFORT}" if sensor.sensor_id in unreliable else "",
                },
            )
            for sensor in self._registry.sensors(human_id)
        ]

    def _worn_by(self, human_id: str) -> set[str]:
        """The sensors on a participant, and those whose drivers are there and are to be told so, or just have been."""
        to_be = {sensor_id for sensor_id in self._drivers.worn() if self._registry.wanted(sensor_id) == human_id}
        return self._drivers.on(human_id) | to_be

    def _differs(self, what: str, now: list[Any]) -> bool:
        before, self._published[what] = self._published.get(what), repr(now)
        return before != self._published[what]

    def _now_ns(self) -> int:
        return int(self._service.node.get_clock().now().nanoseconds)

    def _described(self, driver: Driver) -> None:
        # who publishes raw but says nothing of this sensor, such as a replay, is not its driver
        own = driver.parameters.get("sensor_id")
        for stream in driver.names():
            told = driver.parameters if own == stream.sensor_id else {}
            host = self._drivers.host(stream)
            self._attempt(partial(self._registry.seen, stream, driver.node, host, told, self._now_ns()))

    def _attempt(self, keep: Callable[[], None]) -> None:
        """Keep what the graph says, and what could not be kept before; where that fails it is said once."""
        trouble = ""
        try:
            keep()
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
        if not isinstance(sensor_id, str) or told is None or sensor_id in self._registry.duplicates:
            return
        wanted = self._registry.wanted(sensor_id)
        if wanted is not None and wanted != told:
            self._drivers.set_human_id(driver, wanted)

    def _list(self, request: Any, response: Any) -> Any:
        response.sensors = [sensor_info(s) for s in self._told(request.human_id)]
        return response

    async def _assign(self, request: Any, response: Any) -> Any:
        outcome = await self._change(request.sensor_id, request.human_id, request.person_id)
        response.success, response.message = outcome.success, outcome.message
        return response

    async def _post(self, wish: AssignWish) -> Assigned:
        """Put a sensor on a person; answered once its topics bear the name, or have not for some seconds."""
        success, message, field, status = await self._change(wish.sensor_id, wish.human_id, wish.person_id)
        if not success:
            raise Refusal(message, field, status)
        return Assigned(True, message)

    async def _change(self, sensor_id: str, human_id: str, person_id: str) -> Outcome:
        outcome = self._registry.assign(sensor_id, human_id, person_id, self._now_ns())
        if outcome.success:
            outcome = await self._moved(sensor_id, human_id, outcome)
        self._log(outcome)
        return outcome

    def _log(self, outcome: Outcome) -> None:
        """Log what became of an order; what was typed in place of a pseudonym may be a name, and is not repeated."""
        if outcome.success:
            self._service.log.info(outcome.message)
        elif outcome.field in PERSONAL:
            self._service.log.warning(f"an assignment was refused: its {outcome.field} is not legal")
        else:
            self._service.log.warning(outcome.message)

    async def _moved(self, sensor_id: str, human_id: str, outcome: Outcome) -> Outcome:
        """Have the driver told, and wait until its topics bear the name: the graph is believed, not the driver."""
        deadline_s = time.monotonic() + MOVE_S
        self.scan()
        there = sensor_id in self._drivers.worn()
        while there and (worn := self._drivers.worn().get(sensor_id, set())) != {human_id}:
            if time.monotonic() > deadline_s or self._registry.wanted(sensor_id) != human_id:
                return self._stays(sensor_id, human_id, sorted(worn))
            await asyncio.sleep(LOOK_S)
            self._service.graph.look()
            self.scan()
        return outcome

    def _stays(self, sensor_id: str, human_id: str, worn: list[str]) -> Outcome:
        """Return why an assignment is not done."""
        driver, names = self._drivers.publisher_of(sensor_id), " and ".join(f"'{name}'" for name in worn) or "nobody"
        wanted = self._registry.wanted(sensor_id)
        if wanted != human_id:
            why = "another assignment came meanwhile"
        elif driver is None:
            why = "its driver has gone meanwhile, and will be told when it is back"
        elif "human_id" not in driver.parameters:
            why = f"{driver.node} has no parameter human_id to be told by"
        elif driver.problem:
            why = f"{driver.node} does not take human_id: {driver.problem}"
        else:
            why = f"{driver.node} has taken human_id, but does not move its topics"
        message = f"not done: sensor_id '{sensor_id}' is still on {names}, not on '{human_id}': {why}"
        stands = "; the order stands until another one is given" if wanted == human_id else ""
        return Outcome(False, message + stands, status=409)


async def serve(service: Service[Config]) -> None:
    """Keep the registry until told to stop."""
    store = opened(service.config.database, service.log.error)
    shell = Shell(service, store)
    service.every(service.config.scan_interval_s, shell.scan)
    service.ready()
    await service.stopped.wait()
    store.close()


def main() -> int:
    """Run until stopped; return the exit status."""
    return run("metadata_registry", Config, serve)


if __name__ == "__main__":
    sys.exit(main())
