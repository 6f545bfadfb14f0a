"""The graph side of one played topic: a publisher that waits for its reliable subscribers."""

from __future__ import annotations

from collections import Counter, deque
from typing import Any

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.validate_full_topic_name import validate_full_topic_name
from sense4hri.cdr import with_header_ns
from sense4hri.message_types import message_class

from replay import offers
from replay.recorded import BagError, Topic

WINDOW = 500  # messages sent before every reliable subscriber must have acknowledged them
ASK_AFTER = 50  # from here on it is asked, without waiting: acknowledgements come with heartbeats, up to 3 s apart
_AT_ONCE = Duration(seconds=0)


class Outlet:
    """Publishes the recorded bytes of one topic under its new name. Raises BagError where that cannot be done."""

    def __init__(self, node: Node, topic: Topic, name: str) -> None:
        self.topic, self.name = topic, name
        self.latched = topic.latched
        self.published = 0
        self.standing: deque[int] = deque(maxlen=topic.latched_depth if topic.latched else 0)
        """Log times of what a late subscriber is given."""
        self._node = node
        try:
            validate_full_topic_name(name)
        except InvalidTopicNameException as err:
            raise BagError("it is no name of a topic of ROS 2") from err
        kind = message_class(topic.type_name)
        if kind is None:
            raise BagError(f"its type {topic.type_name} is not installed here")
        self._stamped = _begins_with_header(kind)
        if why := self.taken():
            raise BagError(why)
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

    def taken(self, own: int = 0) -> str:
        """Return why it is not to be published, where others do so already; own: how many publishers are not others."""
        infos = self._node.get_publishers_info_by_topic(self.name)
        nodes = Counter(f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in infos)
        nodes.subtract({self._node.get_fully_qualified_name(): own})
        told = ", ".join(sorted(+nodes))
        return f"it is published already, by {told}: stop that, or exclude or remap the topic" if told else ""

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_publisher(self._publisher)

    def _refuse_other_definition(self) -> None:
        """Bytes of another version of a type would be read as nonsense."""
        for own in self._node.get_publishers_info_by_topic(self.name):
            hashes = {self.topic.type_hash, str(own.topic_type_hash)}
            if len(hashes) == 2 and all(text.startswith("RIHS01_") for text in hashes):
                raise BagError(f"{self.topic.type_name} was recorded in another version than the one installed")


def _begins_with_header(kind: Any) -> bool:
    return next(iter(kind.get_fields_and_field_types().values()), "") == "std_msgs/Header"
