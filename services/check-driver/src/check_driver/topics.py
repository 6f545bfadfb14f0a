"""The topics of one sensor on the graph: names, types, quality of service, publishers (contract, section 2)."""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from sense4hri import qos
from sense4hri.modalities import MODALITIES
from sense4hri.names import ROOT, StreamName, is_sensor_id
from sense4hri_msgs.msg import ClockMeasurement, PhysioDeviceFeature, PhysioRaw, StreamHealth

from check_driver.findings import Findings
from check_driver.heard import Heard

Take = Callable[[Any, int], None]
KINDS: dict[str, tuple[type, Callable[[Heard], Take]]] = {
    "raw": (PhysioRaw, lambda heard: heard.raw),
    "device": (PhysioDeviceFeature, lambda heard: heard.device),
    "health": (StreamHealth, lambda heard: heard.take_health),
    "clock_measurement": (ClockMeasurement, lambda heard: heard.clock_measurement),
}
"""Fields that a driver publishes; by whom each message is taken."""
OTHERS = {"features": "an interpreter", "clock": "clock-sync"}
"""Fields that others publish beside them, and who does."""


class Topics:
    """Follows the topics of a sensor; `look` again and again, for they come one by one."""

    def __init__(self, node: Node, sensor_id: str, findings: Findings) -> None:
        self._node, self._sensor_id, self._findings = node, sensor_id, findings
        self.streams: dict[StreamName, Heard] = {}
        self._known: set[str] = set()
        self._judged: set[tuple[str, str]] = set()
        if not is_sensor_id(sensor_id):
            findings.wrong(2, sensor_id, "is no sensor_id: small letters, digits and single '_', a letter first")

    def look(self) -> bool:
        """Subscribe to what is new, and judge how it is offered; True once there is anything."""
        for topic, types in self._node.get_topic_names_and_types():
            parts = topic.split("/")
            if topic.startswith(ROOT + "/") and self._sensor_id in parts and self._node.count_publishers(topic):
                self._take(topic, types)
        return bool(self._known)

    def published(self) -> dict[str, list[str]]:
        """Return the driver's topics that somebody publishes now, with the full names of the nodes that do."""
        found: dict[str, list[str]] = {}
        for topic in sorted(self._known):
            infos = self._node.get_publishers_info_by_topic(topic)
            if infos:
                found[topic] = [f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in infos]
        return found

    def beside(self, node: str) -> None:
        """Judge what the driver's node publishes beside the topics of its sensor."""
        namespace, _, name = node.rpartition("/")
        with suppress(NodeNameNonExistentError):  # it has ended since
            for topic, _ in self._node.get_publisher_names_and_types_by_node(name, namespace or "/"):
                self._beside(topic, StreamName.loosely(topic))

    def _beside(self, topic: str, found: tuple[StreamName, str] | None) -> None:
        if found is None:
            return
        name, field = found
        if name.sensor_id != self._sensor_id:
            self._once(2, topic, f"is of the driver of {self._sensor_id}, too: one driver is one device")
        elif field in OTHERS:
            self._once(2, topic, f"is no driver's to publish: {field} comes from {OTHERS[field]}")

    def _take(self, topic: str, types: list[str]) -> None:
        loosely = StreamName.loosely(topic)
        if loosely is None:
            self._once(2, topic, "is no name of the contract: /humans/physiological/<human>/<type>/<sensor>/<field>")
            return
        name, field = loosely
        if name.sensor_id != self._sensor_id or field in OTHERS:
            return
        if name.fault:
            self._once(2, topic, name.fault)
        if field not in KINDS:
            self._once(2, topic, f"{field!r} is no field of a driver: {', '.join(KINDS)}")
            return
        kind, taken_by = KINDS[field]
        if types != [f"sense4hri_msgs/msg/{kind.__name__}"]:
            self._once(2, topic, f"is of {', '.join(types)}, must be sense4hri_msgs/msg/{kind.__name__}")
            return
        self._offered(topic)
        if topic not in self._known:
            self._known.add(topic)
            if name.sensor_type not in MODALITIES and not name.fault:
                self._findings.remark(topic, "a sensor type that the contract does not name: shown, not interpreted")
            heard = self.streams.setdefault(name, Heard(name, self._findings, since_s=time.monotonic()))
            profile = qos.fitting(qos.deep(getattr(qos, field.upper())), self._offers(topic))
            self._node.create_subscription(kind, topic, _when_it_came(taken_by(heard)), profile)

    def _offers(self, topic: str) -> list[Any]:
        return [info.qos_profile for info in self._node.get_publishers_info_by_topic(topic)]

    def _offered(self, topic: str) -> None:
        offers = self._offers(topic)
        if len(offers) > 1:
            self._once(2, topic, f"{len(offers)} publish it: a sensor_id is unique in a study")
        for offer in offers:
            if offer.reliability != ReliabilityPolicy.RELIABLE:
                self._once(2, topic, "is best effort, must be reliable")
            if offer.durability != DurabilityPolicy.VOLATILE:
                self._once(2, topic, "is latched (transient local), must be volatile")

    def _once(self, section: int, topic: str, what: str) -> None:
        if (topic, what) not in self._judged:
            self._judged.add((topic, what))
            self._findings.wrong(section, topic, what)


def _when_it_came(take: Take) -> Any:  # rclpy's annotation knows no callback with info
    """Return a callback that tells `take` when the middleware had a message: on a busy machine it then waits here."""

    def taken(message: Any, info: dict[str, Any]) -> None:
        take(message, info["received_timestamp"] or time.time_ns())

    return taken
