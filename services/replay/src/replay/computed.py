"""How far the features that services compute now are behind the raw streams that are played to them.

Playback waits for them, the first ones too: fusion puts features and topics that are played beside each other by
their stamps, and cannot wait long for a stream that may be dead. It gives up on one that stays silent, until that
speaks again.
"""

import time
from collections.abc import Iterable
from typing import Any

from rclpy.qos import QoSProfile
from sense4hri import qos
from sense4hri.cdr import header_ns
from sense4hri.graph import follow
from sense4hri.names import StreamName
from sense4hri.service import Service
from sense4hri.topics import Topic

from replay.lag import Lag

PATIENCE_S = 5.0  # host time that a silent stream is waited for; a busy host may keep a process from running so long


class Computed:
    """The features of the raw topics with these names."""

    def __init__(self, service: Service[Any], topics: Iterable[str]) -> None:
        streams = [parsed[0] for topic in topics if (parsed := StreamName.parse(topic)) and parsed[1] == "raw"]
        self._raw = {name.topic("features"): name.topic("raw") for name in streams}
        self._streams: dict[str, Lag] = {}
        self._since_s = 0.0
        self._follower = follow(
            service,
            self._raw,
            self._hear,
            on_publishers=self._found,
            profile=qos.deep(qos.FEATURES),
            raw=True,
            hold=True,
        )

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
        lagging = [stream for stream in self._streams.values() if stream.behind()]
        if not lagging:
            self._since_s = now_s
        elif now_s - self._since_s > PATIENCE_S:
            for stream in lagging:
                stream.given_up = True
        return bool(lagging)

    def close(self) -> None:
        """Listen no more."""
        self._follower.close()

    def _found(self, topic: Topic, profile: QoSProfile) -> None:
        self._streams.setdefault(self._raw[topic.name], Lag())

    def _hear(self, topic: Topic, cdr: bytes) -> None:
        self._streams[self._raw[topic.name]].spoke(header_ns(cdr))
