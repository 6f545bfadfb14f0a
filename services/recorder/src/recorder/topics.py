"""Which topics are recorded: follows the graph, subscribes without deserialising, counts what came and what did not."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.cdr import header_ns
from sense4hri.errors import Refused as CannotHear
from sense4hri.graph import follow
from sense4hri.names import ROOT
from sense4hri.patterns import Patterns
from sense4hri.service import Service
from sense4hri.topics import UNKNOWN_NODE
from sense4hri.topics import Topic as Published
from sense4hri_recording.rosbag2 import Channel

from recorder import schemas
from recorder.config import Config
from recorder.hearing import Hearing
from recorder.losses import Losses
from recorder.queued import Queue
from recorder.taken import Taken

QUEUE_DEPTH, OTHERS_DEPTH = 5000, 200
LOOK_S = 0.05
OWN = (f"{ROOT}/", "/study/")
MOST_OWN, MOST_OWN_OTHERS = {"raw": 16, "device": 16, "health": 16}, 400  # of one node: a driver is one device
MOST_OTHERS = MOST_REFUSED = MOST_WITHHELD = 1000
HOLD_S = 20.0  # after the last publisher is gone: one that is started again is heard from its first message


class Topic:
    """One recorded topic. first: it is the study's own. `take` runs on the hearing thread, only counts and queues.

    late: what comes now is not taken in any more, only counted, in `left`.
    """

    def __init__(self, queue: Queue, channel: Channel, stamped: bool, first: bool) -> None:
        self.channel, self.first = channel, first
        self.received = self.left = 0
        self.late = False
        self.losses = Losses()
        self._queue, self._stamped = queue, stamped

    @property
    def silent(self) -> bool:
        """True where nothing has come yet, so that there is nothing to account for."""
        return self.received == self.left == 0

    def take(self, message: Taken) -> None:
        log_ns = message.received_ns or time.time_ns()
        lost, missed = self.losses.take(message.publisher, message.number)
        if self.late:
            self.left += 1 + lost
            return
        self.received += 1
        publish_ns = (header_ns(message.cdr) if self._stamped else 0) or message.sent_ns
        number = message.number & 0xFFFFFFFF
        self._queue.put(self.channel, message.cdr, log_ns, publish_ns, number, lost, missed, self.first)


@dataclass(frozen=True)
class Refused:
    """A topic that matches but cannot be recorded, and why."""

    topic: str
    type_name: str
    why: str


class Topics:
    """Every topic that matches is subscribed as soon as someone publishes on it, and stays so."""

    def __init__(self, service: Service[Config], queue: Queue) -> None:
        config = service.config
        self._service, self._queue, self.hearing = service, queue, Hearing(service)
        self._left: dict[tuple[str, str], float] = {}  # topics without a publisher, since when
        self._released: set[tuple[str, str]] = set()
        self._released_in = 0  # the round of the hearing in which the newest of them were
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
            by=self._subscribe,
            hold=True,
        )
        service.watch(identifying, self._withhold, exclude=config.exclude)
        service.look_every(LOOK_S)

    def unmatched(self) -> list[str]:
        """Recorded topics that somebody publishes on, but whose publisher is not connected yet."""
        return sorted(
            name
            for (name, type_name) in self.recorded
            if (subscription := self._follower.subscription(name, type_name)) is not None
            and subscription.get_publisher_count() == 0
            and self._service.node.count_publishers(name)
        )

    def close(self) -> list[str]:
        """Take in what is there, and end every subscription; what is too much for that is counted as lost.

        Returns the topics that had more than could be counted.
        """
        uncounted = self.hearing.close(self._late)
        self._follower.close()
        for topic in self.recorded.values():
            if topic.left:
                self._queue.leave(topic.channel, topic.left)
        return uncounted

    def release(self) -> None:
        """Let go of topics that nobody has published on for some time."""
        self._forget_silent()
        long_ago_s = time.monotonic() - HOLD_S
        released = [key for key, since_s in self._left.items() if since_s < long_ago_s]
        for key in released:
            del self._left[key]
            self._follower.release(*key)
        self._released.update(released)
        self._released_in = self.hearing.rounds

    def _forget_silent(self) -> None:
        """Forget what was released in a call before and never said anything: a stranger may think of new names for
        ever. The round in which it was may still take something of it, and is waited for."""
        if self.hearing.rounds == self._released_in:
            return
        for key in self._released:
            if self._follower.subscription(*key) is None and self.recorded[key].silent:
                del self.recorded[key]
        self._released.clear()

    def _late(self) -> None:
        for topic in self.recorded.values():
            topic.late = True

    def _subscribe(self, topic: Published, kind: type, take: Callable[..., None], profile: QoSProfile) -> Subscription:
        first = self.recorded[topic.name, topic.type_name].first
        if not first:
            profile = qos.adapt([profile], OTHERS_DEPTH)
        return self.hearing.subscribe(kind, topic.name, take, profile, first)

    def _take(self, topic: Published, message: Taken) -> None:
        self.recorded[topic.name, topic.type_name].take(message)

    def _publishers(self, topic: Published, profile: QoSProfile) -> None:
        """Take note of who publishes a topic, and how it is heard."""
        key = topic.name, topic.type_name
        self._left.pop(key, None)
        recorded = self.recorded.get(key)
        if recorded is None:
            recorded = self.recorded[key] = self._begin(topic)
        self.refused.pop(key, None)
        recorded.losses.replays = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        # with a lifespan it is a log (/rosout), not a state
        ephemeral = any(0 < entry["lifespan"]["sec"] < 2**31 for entry in recorded.channel.qos)
        recorded.channel.state = recorded.losses.replays and not ephemeral
        recorded.channel.publishers, recorded.channel.gone = len(topic.publishers), False

    def _begin(self, topic: Published) -> Topic:
        """Raises CannotHear."""
        try:
            definition = schemas.definition(topic.type_name)
        except schemas.UnknownType as err:
            raise CannotHear(str(err)) from err
        heard = self._follower.topics
        first = is_own(topic, heard)
        others = sum(not self.recorded[one.name, one.type_name].first for one in heard)
        if not first and others >= MOST_OTHERS:
            raise CannotHear(f"{MOST_OTHERS} topics that are not the study's own are recorded already")
        entries = [qos_entry(publisher.qos_profile) for publisher in topic.publishers]
        channel = Channel(topic.name, topic.type_name, str(topic.publishers[0].topic_type_hash), entries, definition)
        stamped = schemas.begins_with_header(topic.type_name)
        return Topic(self._queue, channel, stamped, first)

    def _refuse(self, topic: Published, why: str) -> None:
        if len(self.refused) < MOST_REFUSED:
            self.refused[topic.name, topic.type_name] = Refused(topic.name, topic.type_name, why)
        self._service.log.error(f"NOT RECORDED: {topic.name}: {why}")

    def _withhold(self, topic: Published) -> None:
        if self._wanted.match(topic.name) and len(self.withheld) < MOST_WITHHELD:
            self.withheld.add(topic.name)

    def unheard(self, globs: Iterable[str]) -> Refused | None:
        """Return a refused topic of a glob of which no other topic is heard; None where there is none."""
        heard = [topic.name for topic in self._follower.topics if topic.publishers]
        for patterns in (Patterns((glob,)) for glob in globs):
            refused = [one for one in list(self.refused.values()) if patterns.match(one.topic)]
            if refused and not any(map(patterns.match, heard)):
                return refused[0]
        return None

    def _gone(self, topic: Published) -> None:
        self.refused.pop((topic.name, topic.type_name), None)
        if recorded := self.recorded.get((topic.name, topic.type_name)):
            recorded.channel.publishers, recorded.channel.gone = 0, True
            self._left[topic.name, topic.type_name] = time.monotonic()


def is_own(topic: Published, heard: Iterable[Published]) -> bool:
    """True where it is the study's own by its name, and its nodes publish no more of them now than a node does.

    heard: the topics that are there already; one whose publishers have left has none.
    """
    if not topic.name.startswith(OWN):
        return False
    field = topic.name.rpartition("/")[2]
    beside = [one for one in heard if one.name.startswith(OWN) and one.name.rpartition("/")[2] == field]
    most = MOST_OWN.get(field, MOST_OWN_OTHERS)
    return all(sum(node in _nodes(one) for one in beside) < most for node in _nodes(topic))


def _nodes(topic: Published) -> set[str]:
    """Full names of the nodes that publish it, of those that have said theirs."""
    named = [one for one in topic.publishers if one.node_name != UNKNOWN_NODE]
    return {f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in named}


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
