"""How many streams one process may have: a driver is one device (contract, section 2). Pure.

Each raw topic costs every service a subscription, questions and topics of its own, and each of these costs every other
service: 500 silent ones of one stranger had doubled the memory of a whole study.
"""

from collections.abc import Collection, Iterable
from typing import Any

from sense4hri.names import ROOT

MOST = 32
"""Topics of one field. A driver has one for each sensor type of its device, of which the contract knows thirteen."""
FEW = 10
"""Of a process with more, a service makes nothing of a stream until its first message; no device here has as many."""
FIELDS = ("raw", "device", "health", "clock_measurement")
"""Fields that drivers publish; interpreters and clock-sync have a topic for each stream of the study."""
WHOLE_STUDY = "replay"
"""Node of the house that publishes the streams of all drivers."""
TOO_MANY = f"beyond the first {MOST} of its process, which are all that is read: a driver is one device"


class Crowd:
    """Counts the topics of each process; those beyond the first MOST of a field have no place until one leaves."""

    def __init__(self) -> None:
        self._placed: dict[tuple[bytes, str], set[str]] = {}
        self._places: dict[str, set[tuple[bytes, str]]] = {}

    def is_beyond(self, topic: str, publishers: Collection[Any]) -> bool:
        """Take note of who publishes a topic now; True where each of them needs a place for it and has none.

        publishers: rclpy's TopicEndpointInfo of each. One that has not said its node's name yet needs a place.
        """
        field = topic.rpartition("/")[2]
        if field not in FIELDS or not topic.startswith(f"{ROOT}/"):
            return False
        counted = {(bytes(each.endpoint_gid[:12]), field) for each in publishers}
        self._leave(topic, self._places.get(topic, set()) - counted)
        placed = {key for key in counted if self._place(topic, key)}
        return bool(counted) and not placed and all(each.node_name != WHOLE_STUDY for each in publishers)

    def is_one_of_many(self, topic: str, publishers: Collection[Any]) -> bool:
        """True where each process with a place for it has more than FEW of its field, a replay excepted."""
        keys = self._places.get(topic, set())
        many = bool(keys) and all(len(self._placed[key]) > FEW for key in keys)
        return many and all(each.node_name != WHOLE_STUDY for each in publishers)

    def keep(self, topics: Iterable[str]) -> None:
        """Forget all topics but these."""
        for topic in self._places.keys() - set(topics):
            self._leave(topic, self._places[topic])

    def _place(self, topic: str, key: tuple[bytes, str]) -> bool:
        """Give it a place, where it has none yet; False where there is none."""
        topics = self._placed.get(key, set())
        if topic not in topics and len(topics) >= MOST:
            return False
        self._placed.setdefault(key, set()).add(topic)
        self._places.setdefault(topic, set()).add(key)
        return True

    def _leave(self, topic: str, keys: Iterable[tuple[bytes, str]]) -> None:
        for key in list(keys):
            self._placed[key].discard(topic)
            self._places[topic].discard(key)
            if not self._placed[key]:
                del self._placed[key]
        if not self._places.get(topic, True):
            del self._places[topic]
