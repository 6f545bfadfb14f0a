"""Watches required streams: absent, stale or slow."""

import importlib
import time
from collections.abc import Iterable
from dataclasses import dataclass

from rclpy.qos import DurabilityPolicy
from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri.patterns import Patterns
from sense4hri.service import Service
from sense4hri_msgs.msg import StreamHealth

from session_coordinator.config import Config

ENOUGH = 0.95  # share of the nominal rate


@dataclass
class _Heard:
    """One topic; times on the monotonic clock, in s."""

    since_s: float
    subscription: Subscription | None = None
    latched: bool = False
    last_s: float | None = None
    health_subscription: Subscription | None = None
    health: StreamHealth | None = None


class StreamWatch:
    """Hears every topic that matches the globs of a session, without decoding it."""

    def __init__(self, service: Service[Config]) -> None:
        self._node, self._stale_s = service.node, service.config.stale_s
        self._globs: dict[str, Patterns] = {}
        self._heard: dict[str, _Heard] = {}

    def follow(self, globs: Iterable[str]) -> None:
        """Watch what these globs match, and nothing else."""
        self._globs = {glob: Patterns((glob,)) for glob in globs}
        if not self._globs:
            for topic in list(self._heard):
                self._forget(topic)

    def look(self) -> dict[str, str]:
        """Return what is wrong now: topic, or glob that nothing matches -> why."""
        if not self._globs:
            return {}
        present = {
            topic: types[0]
            for topic, types in self._node.get_topic_names_and_types()
            if any(patterns.match(topic) for patterns in self._globs.values()) and self._node.count_publishers(topic)
        }
        for topic in self._heard.keys() - present.keys():
            self._forget(topic)
        for topic in present.keys() - self._heard.keys():
            self._hear(topic, present[topic])
        troubles = {
            glob: "absent" for glob, patterns in self._globs.items() if not any(patterns.match(t) for t in present)
        }
        now_s = time.monotonic()
        return troubles | {topic: why for topic, heard in self._heard.items() if (why := self._trouble(heard, now_s))}

    def _trouble(self, heard: _Heard, now_s: float) -> str:
        if heard.subscription is None or (heard.latched and heard.last_s is not None):
            return ""
        if now_s - (heard.last_s or heard.since_s) > self._stale_s:
            return f"stale, silent for more than {self._stale_s:g} s"
        if heard.last_s is None:
            return "not heard yet"
        health = heard.health
        if health is not None and health.measured_rate_hz < ENOUGH * health.nominal_rate_hz:
            return f"slow, {health.measured_rate_hz:.1f} of {health.nominal_rate_hz:g} Hz"
        return ""

    def _hear(self, topic: str, type_name: str) -> None:
        heard = self._heard[topic] = _Heard(time.monotonic())
        kind = _message_class(type_name)
        if kind is None:
            self._node.get_logger().warning(f"{topic}: {type_name} is not installed; that it is there must do")
            return

        def take(cdr: bytes) -> None:
            heard.last_s = time.monotonic()

        profile = qos.adapt(self._node, topic, depth=1)
        heard.latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        heard.subscription = self._node.create_subscription(kind, topic, take, profile, raw=True)
        parsed = StreamName.parse(topic)
        if parsed is not None and parsed[1] == "raw":

            def learn(health: StreamHealth) -> None:
                heard.health = health

            health_topic = parsed[0].topic("health")
            heard.health_subscription = self._node.create_subscription(StreamHealth, health_topic, learn, qos.HEALTH)

    def _forget(self, topic: str) -> None:
        heard = self._heard.pop(topic)
        for subscription in (heard.subscription, heard.health_subscription):
            if subscription is not None:
                self._node.destroy_subscription(subscription)


def _message_class(type_name: str) -> type | None:
    package, _, name = type_name.partition("/msg/")
    try:
        found: type | None = getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ModuleNotFoundError:
        return None
    return found
