"""The graph side: which streams become outlets, and what of them is sent."""

import time
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sense4hri import host_clocks, qos, stamps
from sense4hri.discovery import RawStreams
from sense4hri.errors import Refused
from sense4hri.graph import follow
from sense4hri.host_clocks import HostClocks, sanitised, this_host
from sense4hri.modalities import MODALITIES
from sense4hri.names import ROOT, StreamName
from sense4hri.patterns import Patterns
from sense4hri.plain_text import plain
from sense4hri.service import Service
from sense4hri.stream_info import StreamInfo
from sense4hri.topics import Topic
from sense4hri.wire import chunk_of
from sense4hri_msgs import msg
from sense4hri_msgs.msg import ClockModel, HostClockArray, Marker, PhysioRaw, StreamHealth

from bridge_lsl import described
from bridge_lsl.config import Config
from bridge_lsl.outlets import Offered
from bridge_lsl.stamping import Model, Stamping, here_ns

MARKERS = "/study/markers"
LOOK_EVERY_S = 10.0
DOUBT_EVERY_S = 600.0  # a line of a host whose times cannot be corrected
FEATURES = [getattr(msg, each.message) for each in MODALITIES.values() if each.message]


@dataclass
class Bridged:
    """One topic on LSL; the outlet is there from its first message on, when its channels are known."""

    name: StreamName
    stamping: Stamping
    subscriptions: list[Subscription] = field(default_factory=list)
    outlet: Offered | None = None
    labels: tuple[str, ...] = ()
    host: str = ""
    """On whose wall clock its times are; empty until the stream's health has said it."""


class Bridge:
    """Offers what is wanted of the graph, for as long as it is there."""

    def __init__(self, service: Service[Config]) -> None:
        self._service, self._wanted = service, Patterns(service.config.topics)
        self._bridged: dict[str, Bridged] = {}
        self._host_clocks, self._here = HostClocks(), this_host()
        service.subscribe(HostClockArray, host_clocks.TOPIC, self._hear_hosts, qos.HOST_CLOCKS)
        self._offered = service.metrics.gauge("lsl_outlets", "Outlets offered to the Lab Streaming Layer.")
        RawStreams(service, None, self._add, self._remove)
        follow(
            service,
            [f"{ROOT}/*/*/*/features"],
            self._feature,
            lambda topic: self._end(topic.name),
            on_publishers=self._features,
            types=FEATURES,
            profile=qos.FEATURES,
        )
        if service.config.markers:
            self._markers = Offered(described.of_markers())
            service.subscribe(Marker, MARKERS, self._marker, qos.MARKERS)
        self._twice: list[str] = []
        service.every(LOOK_EVERY_S, self._look)

    def _look(self) -> None:
        """Say what another bridge offers too: under the same source_id, as it is the same."""
        node, before = self._service.node, self._twice
        ours = [*self._bridged, *([MARKERS] if self._service.config.markers else [])]
        readers = {topic: [each.node_name for each in node.get_subscriptions_info_by_topic(topic)] for topic in ours}
        self._twice = sorted(topic for topic, names in readers.items() if names.count(node.get_name()) > 1)
        if self._twice and self._twice != before:
            others = f" and {len(self._twice) - 1} more" if self._twice[1:] else ""
            offers = f"another {node.get_name()} offers {self._twice[0]}{others} too, or one did that was just killed"
            self._service.log.warning(f"{offers}: LSL programs see each of two such outlets")

    def _add(self, info: StreamInfo) -> None:
        topic = info.name.topic("raw")
        if not self._wanted.match(topic):
            return
        bridged = self._begin(topic, info.name, info.sampling_frequency_hz)
        take = partial(self._raw, bridged, info)
        bridged.subscriptions.append(
            self._service.subscribe(PhysioRaw, topic, take, qos.deep(qos.RAW), raw=True, fit=True)
        )

    def _features(self, topic: Topic, profile: QoSProfile) -> None:
        """Begin with every publisher anew: what one started afresh computes may have other names."""
        parsed = StreamName.parse(topic.name)
        if parsed is None or not self._wanted.match(topic.name):
            raise Refused("it is not among the topics to bridge")
        self._begin(topic.name, parsed[0], 0.0)

    def _begin(self, topic: str, name: StreamName, rate_hz: float) -> Bridged:
        """Follow a topic, the clock model beside it, and on which host its driver is."""
        self._end(topic)
        bridged = self._bridged[topic] = Bridged(name, Stamping(rate_hz))
        learn = partial(self._clock, bridged)
        bridged.subscriptions.append(self._service.subscribe(ClockModel, name.topic("clock"), learn, qos.CLOCK))
        locate = partial(self._health, bridged)
        bridged.subscriptions.append(self._service.subscribe(StreamHealth, name.topic("health"), locate, qos.HEALTH))
        return bridged

    def _remove(self, name: StreamName) -> None:
        self._end(name.topic("raw"))

    def _end(self, topic: str) -> None:
        bridged = self._bridged.pop(topic, None)
        if bridged is None:
            return
        for subscription in bridged.subscriptions:
            self._service.unsubscribe(subscription)
        bridged.outlet = None
        self._count()

    def _clock(self, bridged: Bridged, model: ClockModel) -> None:
        reference_ns = stamps.to_ns(model.device_reference)
        bridged.stamping.model = Model(reference_ns, model.offset_ns, model.skew_ppm, model.segment)

    def _health(self, bridged: Bridged, health: StreamHealth) -> None:
        bridged.host = health.host

    def _hear_hosts(self, told: HostClockArray) -> None:
        self._host_clocks.take(told, time.monotonic())

    def _raw(self, bridged: Bridged, info: StreamInfo, cdr: bytes) -> None:
        chunk = chunk_of(cdr)
        if len(chunk.samples) == 0:
            return
        if bridged.outlet is None or chunk.channels != bridged.labels:
            bridged.labels = chunk.channels
            bridged.outlet = Offered(described.of_raw(info, chunk.channels))
            self._count()
        bridged.outlet.push(chunk.samples, self._here_ns(bridged, bridged.stamping.wall_ns(chunk)))

    def _feature(self, topic: Topic, message: Any) -> None:
        bridged, values = self._bridged[topic.name], described.numbers(message)
        if bridged.outlet is None:
            bridged.labels = tuple(values)
            bridged.outlet = Offered(described.of_features(bridged.name, bridged.labels))
            self._count()
        received_ns, device_ns = stamps.to_ns(message.header.stamp), stamps.to_ns(message.device_timestamp)
        times_ns = self._here_ns(bridged, np.array([bridged.stamping.event_ns(received_ns, device_ns)]))
        bridged.outlet.push([described.row(values, bridged.labels)], times_ns)

    def _here_ns(self, bridged: Bridged, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return times of the stream's host on this host's clock; where they cannot be led to it, that is logged."""
        elsewhere = bridged.host and sanitised(bridged.host) != sanitised(self._here)
        if elsewhere and (doubt := self._host_clocks.doubt(bridged.host, times_ns[-1:].tolist())):
            self._service.log.warning_at_times(doubt, DOUBT_EVERY_S, about=doubt)
        return here_ns(times_ns, bridged.host, self._here, self._host_clocks)

    def _marker(self, marker: Marker) -> None:
        at_ns = np.array([stamps.event_ns(marker)])
        self._markers.push([[plain(marker.name), plain(marker.value), marker.human_id]], at_ns)

    def _count(self) -> None:
        self._offered.set(sum(bridged.outlet is not None for bridged in self._bridged.values()))
