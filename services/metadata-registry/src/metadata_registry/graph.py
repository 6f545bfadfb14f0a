"""The drivers on the graph: who they are, what their parameters say, and setting the one that moves their topics."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import qos_profile_parameter_events
from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.discovery import RAW_TYPE
from sense4hri.graph import ask, ask_parameters
from sense4hri.names import ROOT, StreamName
from sense4hri.service import Service
from sense4hri.topics import UNKNOWN_NODE
from sense4hri_msgs.msg import StreamHealth

from metadata_registry.config import Config
from metadata_registry.sensors import Claim

HEALTH_LOST_S = 3.0


class Beat(NamedTuple):
    """The newest health message of a stream."""

    host: str
    received_s: float


@dataclass
class Driver:
    """One node that publishes raw streams."""

    node: str
    streams: frozenset[StreamName] = frozenset()
    instances: frozenset[str] = frozenset()
    parameters: dict[str, Any] = field(default_factory=dict)
    asked_s: float = -math.inf
    asking: bool = False
    ask_again: bool = False
    silent: bool = False
    setting: bool = False
    problem: str = ""
    """Why it did not take human_id when it was last told; empty where it did."""
    set_after_s: float = 0.0
    refusals: int = 0

    def names(self) -> set[StreamName]:
        """Its streams where they belong now; for a moment after a move the old topics are still seen."""
        human_id = self.parameters.get("human_id")
        if not any(stream.human_id == human_id for stream in self.streams):
            return set(self.streams)
        return {stream for stream in self.streams if stream.human_id == human_id}


class Drivers:
    """Follows the drivers of the graph. Everything runs on the main thread; times are of the monotonic clock, s."""

    def __init__(self, service: Service[Config], described: Callable[[Driver], None]) -> None:
        self._service, self._described = service, described
        self._turn_s = time.monotonic()
        self._drivers: dict[str, Driver] = {}
        self._beats: dict[StreamName, Beat] = {}
        self._listening: dict[StreamName, Subscription] = {}
        self._raw = service.watch([f"{ROOT}/*/*/*/raw"], lambda topic: None, [RAW_TYPE])
        service.subscribe(ParameterEvent, "/parameter_events", self._changed, qos_profile_parameter_events)

    def scan(self) -> list[Claim]:
        """Look at the graph, ask new and changed drivers for their parameters; return every claim to a sensor_id."""
        streams: dict[str, set[StreamName]] = {}
        instances: dict[str, set[str]] = {}
        claims = []
        for topic in self._raw.topics.values():
            parsed = StreamName.parse(topic.name)
            if parsed is None or topic.excess:
                continue
            for publisher in topic.publishers:
                if publisher.node_name == UNKNOWN_NODE:
                    continue
                node = publisher.node_namespace.rstrip("/") + "/" + publisher.node_name
                instance = bytes(publisher.endpoint_gid[:12]).hex()  # the participant's part of the id
                streams.setdefault(node, set()).add(parsed[0])
                instances.setdefault(node, set()).add(instance)
                claims.append(Claim(parsed[0].sensor_id, node, instance))
        self._follow(streams, instances)
        return claims

    def online(self) -> list[Driver]:
        """The drivers that are on the graph and, where they publish health, did so within the last 3 s."""
        return [driver for driver in self._drivers.values() if any(self._alive(stream) for stream in driver.streams)]

    def worn(self) -> dict[str, set[str]]:
        """By sensor_id, the human_ids that living topics bear: one each, unless a driver is just moving its topics."""
        found: dict[str, set[str]] = {}
        for stream in {stream for driver in self._drivers.values() for stream in driver.streams}:
            if self._alive(stream):
                found.setdefault(stream.sensor_id, set()).add(stream.human_id)
        return found

    def on(self, human_id: str) -> set[str]:
        """The sensors whose topics bear this human_id, also those of a driver that vanished and DDS still shows."""
        streams = {stream for driver in self._drivers.values() for stream in driver.streams}
        return {stream.sensor_id for stream in streams if stream.human_id == human_id}

    def unreliable(self) -> set[str]:
        """The sensors of which a raw topic is published best effort."""
        return {
            parsed[0].sensor_id
            for topic in self._raw.topics.values()
            if topic.best_effort and (parsed := StreamName.parse(topic.name)) is not None
        }

    def publisher_of(self, sensor_id: str) -> Driver | None:
        """Return a node that publishes raw streams of a sensor now, None where nobody does."""
        claiming = [one for one in self.online() if any(stream.sensor_id == sensor_id for stream in one.streams)]
        return claiming[0] if claiming else None

    def host(self, stream: StreamName) -> str:
        """The host a stream's health names; empty until it has come."""
        return self._beats[stream].host if stream in self._beats else ""

    def set_human_id(self, driver: Driver, human_id: str) -> None:
        """Have a driver move its topics; a failure is logged, and tried again by a later call, at growing distances."""
        if driver.setting or time.monotonic() < driver.set_after_s:
            return
        driver.setting = True
        self._service.start(self._set(driver, human_id))

    def _follow(self, streams: dict[str, set[StreamName]], instances: dict[str, set[str]]) -> None:
        for node in self._drivers.keys() - streams.keys():
            del self._drivers[node]
        for node in streams:
            driver = self._drivers.setdefault(node, Driver(node))
            seen = frozenset(streams[node]), frozenset(instances[node])
            if seen != (driver.streams, driver.instances) or driver.asked_s == -math.inf:
                driver.streams, driver.instances = seen
                self._ask(driver)
        self._ask_in_turn()
        self._listen({stream for found in streams.values() for stream in found})

    def _ask_in_turn(self) -> None:
        """Have the driver that was asked longest ago tell its parameters again.

        One at a time: whoever asks is first made known to everybody on the graph, and all at once would cost each node
        the more the more drivers there are.
        """
        now_s = time.monotonic()
        if self._drivers and now_s - self._turn_s > self._service.config.refresh_interval_s:
            self._turn_s = now_s
            self._ask(min(self._drivers.values(), key=lambda driver: driver.asked_s))

    def _listen(self, present: set[StreamName]) -> None:
        for stream in present - self._listening.keys():

            def beat(message: StreamHealth, stream: StreamName = stream) -> None:
                self._beat(stream, message.host)

            self._listening[stream] = self._service.subscribe(
                StreamHealth, stream.topic("health"), beat, qos.HEALTH, fit=True
            )
        for stream in self._listening.keys() - present:
            self._service.unsubscribe(self._listening.pop(stream))
            self._beats.pop(stream, None)

    def _beat(self, stream: StreamName, host: str) -> None:
        news = self.host(stream) != host
        self._beats[stream] = Beat(host, time.monotonic())
        for driver in self._drivers.values() if news else ():
            if stream in driver.streams:
                self._described(driver)

    def _alive(self, stream: StreamName) -> bool:
        beat = self._beats.get(stream)
        return beat is None or time.monotonic() - beat.received_s < HEALTH_LOST_S

    def _changed(self, event: ParameterEvent) -> None:
        if driver := self._drivers.get(event.node):
            self._ask(driver)

    def _ask(self, driver: Driver) -> None:
        driver.asked_s = time.monotonic()
        if driver.asking:
            driver.ask_again = True
            return
        driver.asking = True
        self._service.start(self._describe(driver))

    async def _describe(self, driver: Driver) -> None:
        try:
            driver.parameters = await ask_parameters(
                self._service, driver.node, timeout_s=self._service.config.answer_timeout_s
            )
        except TimeoutError as err:
            driver.asked_s = -math.inf
            if not driver.silent:
                self._service.log.warning(f"{driver.node} does not tell its parameters: {err}; asked until it does")
            driver.silent = True
        else:
            driver.silent = False
        driver.asking = False
        if driver.ask_again:
            driver.ask_again = False
            self._ask(driver)
        if self._drivers.get(driver.node) is driver:
            self._described(driver)

    async def _set(self, driver: Driver, human_id: str) -> None:
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=human_id)
        request = SetParameters.Request(parameters=[Parameter(name="human_id", value=value)])
        problem = ""
        try:
            timeout_s = self._service.config.answer_timeout_s
            response = await ask(self._service, SetParameters, f"{driver.node}/set_parameters", request, timeout_s)
            if not response.results or not response.results[0].successful:
                problem = response.results[0].reason if response.results else "no result"
        except TimeoutError as err:
            problem = str(err)
        driver.setting, driver.problem = False, problem
        if problem:
            driver.refusals += 1
            driver.set_after_s = time.monotonic() + min(30.0, 2.0**driver.refusals)
            if driver.refusals == 1:
                self._service.log.error(
                    f"{driver.node} does not take human_id '{human_id}': {problem}; tried again until it does"
                )
            return
        self._service.log.info(f"{driver.node} has taken human_id '{human_id}'")
        driver.refusals = 0
        driver.set_after_s = time.monotonic() + self._service.config.answer_timeout_s
        driver.parameters["human_id"] = human_id
        self._ask(driver)
