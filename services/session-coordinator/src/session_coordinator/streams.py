"""Watches required streams: absent, stale or slow."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.graph import Follower, follow
from sense4hri.names import StreamName
from sense4hri.patterns import Patterns
from sense4hri.service import Service
from sense4hri.stream_info import long_s
from sense4hri.topics import Topic
from sense4hri_msgs.msg import StreamHealth

from session_coordinator.config import Config

ENOUGH = 0.95  # share of the nominal rate


@dataclass
class _Heard:
    """One topic; times on the coordinator's clock, in s."""

    since_s: float
    installed: bool = True
    latched: bool = False
    last_s: float | None = None
    health_subscription: Subscription | None = None
    health: StreamHealth | None = None


class StreamWatch:
    """Hears every topic that matches the globs of a session, without decoding it."""

    def __init__(self, service: Service[Config], now_s: Callable[[], float]) -> None:
        self._service, self._stale_s, self._now_s = service, service.config.stale_s, now_s
        self._globs: dict[str, Patterns] = {}
        self._follower: Follower | None = None
        self._heard: dict[str, _Heard] = {}
        self._unread: dict[str, str] = {}

    def follow(self, globs: Iterable[str]) -> None:
        """Watch what these globs match, and nothing else."""
        if self._follower is not None:
            self._follower.close()
        for topic in [*self._heard, *self._unread]:
            self._forget(topic)
        self._globs, self._follower = {glob: Patterns((glob,)) for glob in globs}, None
        if self._globs:
            self._follower = follow(
                self._service,
                self._globs,
                self._take,
                lambda topic: self._forget(topic.name),
                on_publishers=self._publishers,
                on_refused=self._refused,
                depth=1,
                raw=True,
            )
            self._service.graph.look()

    def look(self) -> dict[str, str]:
        """Return what is wrong now: topic, or glob that nothing that is read matches -> why."""
        troubles = {
            glob: next((why for topic, why in self._unread.items() if patterns.match(topic)), "absent")
            for glob, patterns in self._globs.items()
            if not any(map(patterns.match, self._heard))
        }
        now_s = self._now_s()
        return troubles | {topic: why for topic, heard in self._heard.items() if (why := self._trouble(heard, now_s))}

    def _trouble(self, heard: _Heard, now_s: float) -> str:
        if not heard.installed or (heard.latched and heard.last_s is not None):
            return ""
        health = heard.health
        stale_s = long_s(self._stale_s, health.nominal_rate_hz if health is not None else 0.0)
        if now_s - (heard.last_s or heard.since_s) > stale_s:
            return f"stale, silent for more than {stale_s:g} s"
        if heard.last_s is None:
            return "not heard yet"
        if health is not None and health.measured_rate_hz < ENOUGH * health.nominal_rate_hz:
            return f"slow, {health.measured_rate_hz:.1f} of {health.nominal_rate_hz:g} Hz"
        return ""

    def _take(self, topic: Topic, cdr: bytes) -> None:
        if heard := self._heard.get(topic.name):  # None where one of two types of the name has just gone
            heard.last_s = self._now_s()

    def _publishers(self, topic: Topic, profile: QoSProfile) -> None:
        self._unread.pop(topic.name, None)
        heard = self._heard.get(topic.name)
        if heard is None:
            heard = self._heard[topic.name] = _Heard(self._now_s())
            self._hear_health(topic.name, heard)
        heard.latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL

    def _refused(self, topic: Topic, why: str) -> None:
        if topic.excess:
            self._unread[topic.name] = why  # nor does anybody record it
            return
        self._heard[topic.name] = _Heard(self._now_s(), installed=False)
        self._service.log.warning(f"{topic.name}: {why}; that it is there must do")

    def _hear_health(self, topic: str, heard: _Heard) -> None:
        """A raw stream's driver says whether it is slow."""
        parsed = StreamName.parse(topic)
        if parsed is None or parsed[1] != "raw":
            return

        def learn(health: StreamHealth) -> None:
            heard.health = health

        heard.health_subscription = self._service.subscribe(
            StreamHealth, parsed[0].topic("health"), learn, qos.HEALTH, fit=True
        )

    def _forget(self, topic: str) -> None:
        self._unread.pop(topic, None)
        heard = self._heard.pop(topic, None)
        if heard is not None and heard.health_subscription is not None:
            self._service.unsubscribe(heard.health_subscription)
