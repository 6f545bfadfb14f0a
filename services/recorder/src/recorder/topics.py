"""Which topics are recorded: follows the graph, subscribes without deserialising, counts what came and what did not."""

from __future__ import annotations

import importlib
import time
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sense4hri import qos
from sense4hri.cdr import header_ns
from sense4hri.patterns import Patterns
from sense4hri_recording.rosbag2 import Channel

from recorder import schemas
from recorder.config import Config
from recorder.losses import Losses
from recorder.writing import Writing

QUEUE_DEPTH = 5000
RECHECK_POLLS = 20  # publishers of known topics are looked at every so many polls


class Topic:
    """One recorded topic. Its callback runs on the ROS thread and does nothing but count and queue."""

    def __init__(self, writing: Writing, channel: Channel, stamped: bool) -> None:
        self.channel = channel
        self.received = 0
        self.subscription: Subscription | None = None
        self.profile: QoSProfile | None = None
        self.losses = Losses()
        self._writing, self._stamped = writing, stamped

    def take(self, cdr: bytes, info: dict[str, Any]) -> None:
        log_ns = info["received_timestamp"] or time.time_ns()
        number = info["publication_sequence_number"] or 0
        lost, missed = self.losses.take(number)
        self.received += 1
        publish_ns = (max(header_ns(cdr), 0) if self._stamped else 0) or info["source_timestamp"] or log_ns
        self._writing.put(self.channel, cdr, log_ns, publish_ns, number & 0xFFFFFFFF, lost, missed)


@dataclass(frozen=True)
class Refused:
    """A topic that matches but cannot be recorded, and why."""

    topic: str
    type_name: str
    why: str


class Topics:
    """Every topic that matches is subscribed as soon as someone publishes on it."""

    def __init__(self, node: Node, config: Config, writing: Writing) -> None:
        self._node, self._writing = node, writing
        self._wanted, self._excluded = Patterns(config.patterns), Patterns(config.exclude)
        self._identifying = Patterns(() if config.record_identifying else config.identifying)
        self.recorded: dict[tuple[str, str], Topic] = {}
        self.refused: dict[tuple[str, str], Refused] = {}
        self.withheld: set[str] = set()
        self._decided: dict[str, bool] = {}
        self._polls = 0

    def poll(self) -> None:
        """Look at the graph once."""
        self._polls += 1
        for topic, types in self._node.get_topic_names_and_types():
            for type_name in types:
                key = (topic, type_name)
                if key not in self.recorded and key not in self.refused and self._is_wanted(topic):
                    self._add(topic, type_name)
        if self._polls % RECHECK_POLLS == 0:
            for (name, type_name), recorded in self.recorded.items():
                self._follow(recorded, self._offers(name, type_name))

    def unmatched(self) -> list[str]:
        """Recorded topics that somebody publishes on, but whose publisher is not connected yet."""
        return sorted(
            topic.channel.topic
            for topic in self.recorded.values()
            if topic.subscription is not None
            and topic.subscription.get_publisher_count() == 0
            and self._node.count_publishers(topic.channel.topic)
        )

    def close(self) -> None:
        """End every subscription."""
        for topic in self.recorded.values():
            if topic.subscription is not None:
                self._node.destroy_subscription(topic.subscription)
                topic.subscription = None

    def _is_wanted(self, topic: str) -> bool:
        wanted = self._decided.get(topic)
        if wanted is None:
            wanted = self._decided[topic] = self._decide(topic)
        return wanted

    def _decide(self, topic: str) -> bool:
        if not self._wanted.match(topic) or self._excluded.match(topic):
            return False
        if self._identifying.match(topic):
            self.withheld.add(topic)
            return False
        return True

    def _offers(self, topic: str, type_name: str) -> list[TopicEndpointInfo]:
        return [info for info in self._node.get_publishers_info_by_topic(topic) if info.topic_type == type_name]

    def _add(self, topic: str, type_name: str) -> None:
        offers = self._offers(topic, type_name)
        if not offers:
            return
        try:
            definition, kind = schemas.definition(type_name), _message_class(type_name)
        except schemas.UnknownType as err:
            self.refused[topic, type_name] = Refused(topic, type_name, str(err))
            self._node.get_logger().error(f"NOT RECORDED: {topic}: {err}")
            return
        entries = [qos_entry(offer.qos_profile) for offer in offers]
        channel = Channel(topic, type_name, str(offers[0].topic_type_hash), entries, definition)
        recorded = Topic(self._writing, channel, schemas.begins_with_header(type_name))
        self.recorded[topic, type_name] = recorded
        _note_publishers(recorded, offers)
        self._subscribe(recorded, kind)

    def _subscribe(self, topic: Topic, kind: type) -> None:
        topic.profile = qos.adapt(self._node, topic.channel.topic, QUEUE_DEPTH)
        topic.losses.replays = topic.profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        # with a lifespan it is a log (/rosout), not a state
        ephemeral = any(0 < entry["lifespan"]["sec"] < 2**31 for entry in topic.channel.qos)
        topic.channel.state = topic.losses.replays and not ephemeral

        def take(cdr: bytes, info: dict[str, Any]) -> None:
            topic.take(cdr, info)

        topic.subscription = self._node.create_subscription(
            kind,
            topic.channel.topic,
            take,  # type: ignore[arg-type]  # rclpy hands two arguments to a callback that takes two
            topic.profile,
            raw=True,
        )

    def _follow(self, topic: Topic, offers: list[TopicEndpointInfo]) -> None:
        """Take note of other publishers; where one offers less than was asked for, ask for less."""
        _note_publishers(topic, offers)
        profile = topic.profile
        if not offers or profile is None or topic.subscription is None:
            return
        if all(_serves(offer.qos_profile, profile) for offer in offers):
            return
        self._node.destroy_subscription(topic.subscription)
        self._subscribe(topic, _message_class(topic.channel.type_name))


def _note_publishers(topic: Topic, offers: list[TopicEndpointInfo]) -> None:
    topic.losses.follow(frozenset(bytes(offer.endpoint_gid) for offer in offers))
    topic.channel.publishers = len(offers)


def qos_entry(profile: QoSProfile) -> dict[str, Any]:
    """A publisher's QoS as rosbag2 writes it (metadata version 9)."""
    return {
        "history": profile.history.name.lower(),
        "depth": profile.depth,
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
        "deadline": _duration(profile.deadline.nanoseconds),
        "lifespan": _duration(profile.lifespan.nanoseconds),
        "liveliness": profile.liveliness.name.lower(),
        "liveliness_lease_duration": _duration(profile.liveliness_lease_duration.nanoseconds),
        "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions,
    }


def _duration(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {"sec": seconds, "nsec": rest}


def _serves(offer: QoSProfile, asked: QoSProfile) -> bool:
    if asked.reliability == ReliabilityPolicy.RELIABLE and offer.reliability != ReliabilityPolicy.RELIABLE:
        return False
    return asked.durability != DurabilityPolicy.TRANSIENT_LOCAL or offer.durability == DurabilityPolicy.TRANSIENT_LOCAL


def _message_class(type_name: str) -> type:
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as err:
        raise schemas.UnknownType(f"{type_name}: {err}") from err
