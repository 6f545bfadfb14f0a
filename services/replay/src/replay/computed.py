"""How far the features that services compute now are behind the raw streams that are played to them.

Playback waits for them: fusion puts features and topics that are played beside each other by their stamps, and cannot
wait long for a stream that may be dead. It gives up on one that stays silent, until that speaks again.
"""

import time
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.cdr import header_ns
from sense4hri.names import StreamName
from sense4hri.service import Service

from replay.lag import Lag
from replay.outlet import message_class

LOOK_S = 0.5  # host time between two looks for who computes
PATIENCE_S = 5.0  # host time that a silent stream is waited for; a busy host may keep a process from running so long


class Computed:
    """The features of the raw topics with these names."""

    def __init__(self, service: Service[Any], topics: Iterable[str]) -> None:
        self._service = service
        self._raw = {t: parsed[0] for t in topics if (parsed := StreamName.parse(t)) and parsed[1] == "raw"}
        self._streams: dict[str, Lag] = {}
        self._heard: list[Subscription] = []
        self._looked_s = self._since_s = 0.0

    def sent(self, topic: str, at_ns: int) -> None:
        """A message of a topic with this stamp has been played."""
        if (stream := self._streams.get(topic)) is not None:
            stream.sent(at_ns)

    def begin(self) -> None:
        """Playing begins, or goes on elsewhere."""
        for stream in self._streams.values():
            stream.begin()

    def behind(self) -> bool:
        """True where playback is to wait."""
        now_s = time.monotonic()
        if now_s - self._looked_s > LOOK_S:
            self._looked_s = now_s
            self._look()
        lagging = [stream for stream in self._streams.values() if stream.behind()]
        if not lagging:
            self._since_s = now_s
        elif now_s - self._since_s > PATIENCE_S:
            for stream in lagging:
                stream.given_up = True
        return bool(lagging)

    def close(self) -> None:
        """Listen no more."""
        for subscription in self._heard:
            self._service.unsubscribe(subscription)
        self._heard.clear()

    def _look(self) -> None:
        for topic, name in self._raw.items():
            features = name.topic("features")
            if topic not in self._streams and (said := self._service.node.get_publishers_info_by_topic(features)):
                stream = self._streams[topic] = Lag()
                kind = message_class(said[0].topic_type)
                heard = self._service.subscribe(kind, features, _hear(stream), qos.deep(qos.FEATURES), raw=True)
                self._heard.append(heard)


def _hear(stream: Lag) -> Callable[[bytes], None]:
    def hear(cdr: bytes) -> None:
        stream.spoke(header_ns(cdr))

    return hear
