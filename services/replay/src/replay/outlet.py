"""The graph side of one played topic: a publisher that waits for its reliable subscribers."""

from __future__ import annotations

from collections import Counter, deque
from typing import Any
from uuid import uuid4

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.validate_full_topic_name import validate_full_topic_name
from rosgraph_msgs.msg import Clock
from sense4hri.cdr import with_header_ns
from sense4hri.message_types import message_class

from replay import offers
from replay.recorded import BagError, Topic

WINDOW = 500  # messages sent before every reliable subscriber must have acknowledged them
ASK_AFTER = 50  # from here on it is asked, without waiting: acknowledgements come with heartbeats, up to 3 s apart
PROCESS_BYTES = 12  # of an endpoint's id are the same for one process
_AT_ONCE = Duration(seconds=0)


def refusal(node: Node, topic: Topic, name: str) -> str:
    """Return why a topic is not to be played under this name, empty where it can be."""
    if topic.refused:
        return topic.refused
    try:
        validate_full_topic_name(name)
    except InvalidTopicNameException:
        return "it is no name of a topic of ROS 2"
    if message_class(topic.type_name) is None:
        return f"its type {topic.type_name} is not installed here"
    return taken(node, name)


def taken(node: Node, name: str, own: int = 0) -> str:
    """Return why others, who publish a topic already, are to be left alone with it.

    own: how many publishers are not others.
    """
    nodes = Counter(_who(info) for info in node.get_publishers_info_by_topic(name))
    nodes.subtract({node.get_fully_qualified_name(): own})
    told = ", ".join(sorted(+nodes))
    return f"it is published already, by {told}: stop that, or exclude or remap the topic" if told else ""


def process_of(node: Node) -> bytes:
    """Return what the ids of this process's endpoints begin with; by its name another replay is the same node."""
    name = f"/_{uuid4().hex}"
    publisher = node.create_publisher(Clock, name, 1)
    (info,) = node.get_publishers_info_by_topic(name)
    node.destroy_publisher(publisher)
    return bytes(info.endpoint_gid)[:PROCESS_BYTES]


class Outlet:
    """Publishes the recorded bytes of one topic under its new name, where there was no `refusal` of it.

    Raises BagError where its type is another version here.
    """

    def __init__(self, node: Node, topic: Topic, name: str) -> None:
        self.topic, self.name, self.node = topic, name, node
        self.latched = topic.latched
        self.published = 0
        self.standing: deque[int] = deque(maxlen=topic.latched_depth if topic.latched else 0)
        """Log times of what a late subscriber is given."""
        kind: Any = message_class(topic.type_name)
        self._stamped = _begins_with_header(kind)
        profile: QoSProfile = offers.profile(topic)
        self._window = min(WINDOW, profile.depth)
        self._unacknowledged = 0
        self._publisher = node.create_publisher(kind, name, profile)
        try:
            self._refuse_other_definition()
        except BagError:
            self.close()
            raise

    def publish(self, cdr: bytes, log_ns: int) -> None:
        """Send one message."""
        self._publisher.publish(with_header_ns(cdr, log_ns) if self._stamped else cdr)
        self.published += 1
        self.standing.append(log_ns)
        self._unacknowledged += 1

    def full(self) -> bool:
        """True where subscribers must catch up before the next message."""
        if self._unacknowledged < min(ASK_AFTER, self._window):
            return False
        return not self.acknowledged() and self._unacknowledged >= self._window

    def acknowledged(self) -> bool:
        """True where every reliable subscriber has what was sent."""
        if self._unacknowledged and self._publisher.wait_for_all_acked(_AT_ONCE):
            self._unacknowledged = 0
        return self._unacknowledged == 0

    def give_up(self) -> None:
        """Wait no more for what was sent already."""
        self._unacknowledged = 0

    def subscribers(self) -> int:
        """How many subscriptions are matched."""
        return self._publisher.get_subscription_count()

    def precedes(self, process: bytes) -> bool:
        """True where all who publish it are replays, and this process, by its id, the first of them."""
        infos = self.node.get_publishers_info_by_topic(self.name)
        replays = {self.node.get_fully_qualified_name()} == {_who(info) for info in infos}
        return replays and min(bytes(info.endpoint_gid)[:PROCESS_BYTES] for info in infos) == process

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_publisher(self._publisher)

    def _refuse_other_definition(self) -> None:
        """Bytes of another version of a type would be read as nonsense."""
        for own in self.node.get_publishers_info_by_topic(self.name):
            hashes = {self.topic.type_hash, str(own.topic_type_hash)}
            if len(hashes) == 2 and all(text.startswith("RIHS01_") for text in hashes):
                raise BagError(f"{self.topic.type_name} was recorded in another version than the one installed")


def _who(info: TopicEndpointInfo) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _begins_with_header(kind: Any) -> bool:
    return next(iter(kind.get_fields_and_field_types().values()), "") == "std_msgs/Header"
