"""Which topics are recorded: follows the graph, subscribes without deserialising, counts what came and what did not."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from sense4hri.cdr import header_ns
from sense4hri.errors import Refused as CannotHear
from sense4hri.graph import follow
from sense4hri.patterns import Patterns
from sense4hri.service import Service
from sense4hri.topics import Topic as Published
from sense4hri_recording.rosbag2 import Channel

from recorder import schemas
from recorder.config import Config
from recorder.losses import Losses
from recorder.writing import Writing

QUEUE_DEPTH = 5000
FAST_LOOK_S, LOOK_S = 0.02, 0.05
FAST_S = 10.0  # after the start, when every topic is new


class Topic:
    """One recorded topic. Its callback runs on the ROS thread and does nothing but count and queue."""

    def __init__(self, writing: Writing, channel: Channel, stamped: bool) -> None:
        self.channel = channel
        self.received = 0
        self.losses = Losses()
        self._writing, self._stamped = writing, stamped

    def take(self, cdr: bytes, info: dict[str, Any]) -> None:
        log_ns = info["received_timestamp"] or time.time_ns()
        number = info["publication_sequence_number"] or 0
        lost, missed = self.losses.take(number)
        self.received += 1
        publish_ns = (header_ns(cdr) if self._stamped else 0) or info["source_timestamp"]
        self._writing.put(self.channel, cdr, log_ns, publish_ns, number & 0xFFFFFFFF, lost, missed)


@dataclass(frozen=True)
class Refused:
    """A topic that matches but cannot be recorded, and why."""

    topic: str
    type_name: str
    why: str


class Topics:
    """Every topic that matches is subscribed as soon as someone publishes on it, and stays so."""

    def __init__(self, service: Service[Config], writing: Writing) -> None:
        config = service.config
        self._service, self._writing = service, writing
        identifying = () if config.record_identifying else config.identifying
        self._wanted = Patterns(config.patterns)
        self.recorded: dict[tuple[str, str], Topic] = {}
        self.refused: dict[tuple[str, str], Refused] = {}
        self.withheld: set[str] = set()
        self._follower = follow(
            service,
            config.patterns,
            self._take,
            self._gone,
            on_publishers=self._publishers,
            on_refused=self._refuse,
            exclude=(*config.exclude, *identifying),
            depth=QUEUE_DEPTH,
            raw=True,
            with_info=True,
            on_ros_thread=True,
            hold=True,
        )
        service.watch(identifying, self._withhold, exclude=config.exclude)
        service.graph.poll_s = FAST_LOOK_S
        service.start(self._slow_down())

    def unmatched(self) -> list[str]:
        """Recorded topics that somebody publishes on, but whose publisher is not connected yet."""
        return sorted(
            name
            for (name, type_name) in self.recorded
            if (subscription := self._follower.subscription(name, type_name)) is not None
            and subscription.get_publisher_count() == 0
            and self._service.node.count_publishers(name)
        )

    def close(self) -> None:
        """End every subscription."""
        self._follower.close()

    async def _slow_down(self) -> None:
        await asyncio.sleep(FAST_S)
        self._service.graph.poll_s = LOOK_S

    def _take(self, topic: Published, cdr: bytes, info: dict[str, Any]) -> None:
        self.recorded[topic.name, topic.type_name].take(cdr, info)

    def _publishers(self, topic: Published, profile: QoSProfile) -> None:
        """Take note of who publishes a topic, and how it is heard."""
        key = topic.name, topic.type_name
        recorded = self.recorded.get(key)
        if recorded is None:
            recorded = self.recorded[key] = self._begin(topic)
        recorded.losses.replays = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        # with a lifespan it is a log (/rosout), not a state
        ephemeral = any(0 < entry["lifespan"]["sec"] < 2**31 for entry in recorded.channel.qos)
        recorded.channel.state = recorded.losses.replays and not ephemeral
        _note_publishers(recorded, topic)

    def _begin(self, topic: Published) -> Topic:
        """Raises CannotHear."""
        try:
            definition = schemas.definition(topic.type_name)
        except schemas.UnknownType as err:
            raise CannotHear(str(err)) from err
        entries = [qos_entry(publisher.qos_profile) for publisher in topic.publishers]
        channel = Channel(topic.name, topic.type_name, str(topic.publishers[0].topic_type_hash), entries, definition)
        return Topic(self._writing, channel, schemas.begins_with_header(topic.type_name))

    def _refuse(self, topic: Published, why: str) -> None:
        self.refused[topic.name, topic.type_name] = Refused(topic.name, topic.type_name, why)
        self._service.log.error(f"NOT RECORDED: {topic.name}: {why}")

    def _withhold(self, topic: Published) -> None:
        if self._wanted.match(topic.name):
            self.withheld.add(topic.name)

    def _gone(self, topic: Published) -> None:
        if recorded := self.recorded.get((topic.name, topic.type_name)):
            _note_publishers(recorded, topic)


def _note_publishers(recorded: Topic, topic: Published) -> None:
    recorded.losses.follow(topic.instances)
    recorded.channel.publishers = len(topic.publishers)


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
