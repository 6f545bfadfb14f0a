"""The streams of an interpreter: what comes in of each, and where its features go out."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.publisher import Publisher
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw

from sense4hri import filling, qos, stamps, wire
from sense4hri.chunk import Chunk
from sense4hri.errors import FrameError
from sense4hri.feed import Beside, Event, Feed, Report
from sense4hri.names import StreamName
from sense4hri.service import Service
from sense4hri.step import Step, Update
from sense4hri.stream_info import StreamInfo

LONGEST_WAIT = 500  # chunks of a stream beside kept while nothing is known of it yet


@dataclass(frozen=True)
class Shape:
    """What kind of interpreter this is; see `run_interpreter`."""

    step: Callable[[Any, StreamInfo], Step]
    update: type
    message: type
    sources: tuple[str, ...]
    publishes: str = ""
    beside: tuple[str, ...] = ()

    def takes(self, method: str) -> bool:
        """True where the steps have this optional method."""
        return hasattr(self.step, method)

    def serves(self, name: StreamName) -> bool:
        """True for a stream of the source types, or of those beside them."""
        return name.sensor_type in {*self.sources, *self.beside}

    def features_of(self, source: StreamName) -> StreamName:
        """Return where the features of a source stream are published. Raises ValueError where the name is too long."""
        return source.derived(self.publishes or source.sensor_type)


class RawInput:
    """The subscription to one raw stream: messages become chunks, what cannot be used is counted.

    heard: True once a message has come.
    """

    def __init__(self, service: Service[Any], name: StreamName, take: Callable[[Chunk], None]) -> None:
        self._service, self._take = service, take
        self.heard = False
        labels = {"sensor_type": name.sensor_type, "sensor_id": name.sensor_id}
        self._messages = service.metrics.counter("messages", "Messages handled.", **labels, field="raw")
        self._bad = service.metrics.counter("undecodable_frames", "Messages that could not be used.", **labels)
        self._subscription = service.subscribe(
            PhysioRaw, name.topic("raw"), self._on_raw, qos.deep(qos.RAW), raw=True, fit=True
        )

    def drop(self) -> None:
        """Count a message that cannot be used."""
        self._bad.inc()

    def close(self) -> None:
        """Leave the topic."""
        self._service.unsubscribe(self._subscription)

    def _on_raw(self, message: bytes) -> None:
        self._messages.inc()
        self.heard = True
        try:
            chunk = wire.chunk_of(message)
        except FrameError:
            self.drop()
            raise
        self._take(chunk)


class Neighbour:
    """A stream beside others: its chunks go to them once it is known what they are."""

    def __init__(self, service: Service[Any], name: StreamName, pass_on: Callable[[Beside], None]) -> None:
        self._pass_on = pass_on
        self._info: StreamInfo | None = None
        self._waiting: list[Chunk] = []
        self.input = RawInput(service, name, self._take)

    @property
    def known(self) -> bool:
        """True once the stream's metadata is there."""
        return self._info is not None

    def begin(self, info: StreamInfo) -> None:
        """Pass on what has waited for the stream's metadata."""
        self._info, waiting, self._waiting = info, self._waiting, []
        for chunk in waiting:
            self._take(chunk)

    def close(self) -> None:
        """Leave the graph."""
        self.input.close()

    def _take(self, chunk: Chunk) -> None:
        if self._info is not None:
            self._pass_on(Beside(chunk.received_ns, self._info, chunk))
        elif len(self._waiting) < LONGEST_WAIT:
            self._waiting.append(chunk)
        else:
            self.input.drop()


class Stream:
    """One source stream: its feed, and the topic of its features. Raises ValueError where that has no legal name.

    features: what they are called.
    """

    def __init__(self, service: Service[Any], name: StreamName, shape: Shape) -> None:
        self._service, self._name, self._message = service, name, shape.message
        self.features = shape.features_of(name)
        self._source: list[Any] = []
        self.input = RawInput(service, name, self._on_raw)
        self._feed = Feed(
            lambda info: shape.step(service.config, info),
            service.config.update_interval_s,
            ordered=shape.takes("marker") or shape.takes("beside"),
            refused=lambda reason: service.log.error(f"{name.topic('raw')}: cannot be interpreted: {reason}"),
            dropped=self.input.drop,
        )
        labels = {"sensor_type": self.features.sensor_type, "sensor_id": self.features.sensor_id}
        self._published = service.metrics.counter("messages", "Messages handled.", **labels, field="features")
        self._duration = service.metrics.histogram("update_duration_seconds", "Time to take one message in.", **labels)
        self._quality = service.metrics.gauge("signal_quality_ratio", "Of the newest features, 0 to 1.", **labels)
        self._publisher: Publisher = service.publisher(shape.message, self.features.topic("features"), qos.FEATURES)
        self._device = self._listen_to_device() if shape.takes("device_reported") else None

    def _listen_to_device(self) -> Any:
        topic = self._name.topic("device")
        return self._service.subscribe(PhysioDeviceFeature, topic, self._on_device, qos.deep(qos.DEVICE))

    @property
    def known(self) -> bool:
        """True once the stream's metadata is there."""
        return self._feed.known

    def begin(self, info: StreamInfo) -> None:
        """Start with what is known of the stream now."""
        rate, unit = info.sampling_frequency_hz, info.unit or "unknown"
        self._service.log.info(f"{self._name.topic('raw')}: {rate:g} Hz, unit {unit} (from {info.source})")
        if self.features != self._name:
            about = f"source_{self._name.sensor_type}_{self._name.sensor_id}"
            self._source = [wire.feature(about, "Hz", rate)]
        self._publish(self._feed.know(info))

    def put(self, event: Event) -> None:
        """Take what came in; publish what became due."""
        self._publish(self._feed.put(event))

    def cut_at(self, start_ns: int) -> None:
        """Begin a new segment with the first raw message stamped start_ns or later."""
        self._feed.cut_at(start_ns)

    def close(self) -> None:
        """Publish what was held, and leave the graph."""
        self._publish(self._feed.finish())
        self.input.close()
        if self._device is not None:
            self._service.unsubscribe(self._device)
        self._service.node.destroy_publisher(self._publisher)
        self._service.log.info(f"{self._name.topic('raw')}: gone")

    def _on_raw(self, chunk: Chunk) -> None:
        started = time.perf_counter()
        self.put(chunk)
        self._duration.observe(time.perf_counter() - started)

    def _on_device(self, message: PhysioDeviceFeature) -> None:
        received_ns = stamps.to_ns(message.header.stamp)
        for feature in message.features:
            for value in feature.values:
                self.put(Report(received_ns, feature.name, float(value)))

    def _publish(self, updates: Iterable[Update]) -> None:
        for update in updates:
            message = filling.fill(filling.blank(self._message), update)
            message.header.frame_id = self.features.sensor_id
            stamps.set_time(message.header.stamp, update.received_ns)
            stamps.set_time(message.device_timestamp, update.device_ns)
            message.extra = [*message.extra, *self._source]
            self._publisher.publish(message)
            self._published.inc()
            self._quality.set(message.signal_quality)
