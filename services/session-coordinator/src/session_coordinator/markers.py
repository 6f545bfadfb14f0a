"""Markers on their way to everybody."""

import time
from collections.abc import Callable, Iterable
from typing import Any

from sense4hri import qos
from sense4hri.service import Service
from sense4hri_msgs.msg import Marker

TOPIC = "/study/markers"
YOUNG_S = 10.0
"""How long after its start a process waits for those who listen; after that they are connected, or cannot be."""


class Markers:
    """Publishes markers, of a process that has just begun only once all who are known to listen are connected.

    What is published before that never reaches them. A marker's stamp is that of its event, however long it waits.
    listeners: names of nodes that listen for sure, also where they are not known yet.
    """

    def __init__(self, service: Service[Any], listeners: Callable[[], Iterable[str]]) -> None:
        self._node, self._listeners = service.node, listeners
        self._publisher = service.publisher(Marker, TOPIC, qos.MARKERS)
        self._waiting: list[Marker] = []
        self._begun_s = time.monotonic()

    def put(self, marker: Marker) -> None:
        """Publish a marker, now or soon."""
        self._waiting.append(marker)
        self.send()

    def send(self) -> None:
        """Publish what waits, where somebody hears it; to be called now and then."""
        if self._waiting and (self._heard() or time.monotonic() > self._begun_s + YOUNG_S):
            self.close()

    def close(self) -> None:
        """Publish what waits, whoever hears it."""
        for marker in self._waiting:
            self._publisher.publish(marker)
        self._waiting.clear()

    def _heard(self) -> bool:
        known = [each.node_name for each in self._node.get_subscriptions_info_by_topic(TOPIC)]
        return {*self._listeners()} <= {*known} and 0 < len(known) <= self._publisher.get_subscription_count()
