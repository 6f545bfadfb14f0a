"""Shell of every interpreter: finds every raw stream of its sources and publishes features beside it."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import sense4hri_msgs.msg as msgs
from rclpy.publisher import Publisher
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw, SessionState

from sense4hri import filling, qos, stamps, wire
from sense4hri.chunk import Chunk
from sense4hri.discovery import RawStreams
from sense4hri.errors import FrameError
from sense4hri.feed import Beside, Event, Feed, Report
from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.names import StreamName
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.session import SessionMember, concerns
from sense4hri.step import Step, Update
from sense4hri.stream_info import StreamInfo

Config = TypeVar("Config", bound=InterpreterConfig)
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

    def features_of(self, source: StreamName) -> StreamName:
        """Return where the features of a source stream are published. Raises ValueError where the name is too long."""
        return source.derived(self.publishes or source.sensor_type)


def run_interpreter(
    name: str,
    schema: type[Config],
    step: Callable[[Any, StreamInfo], Step],
    update: type,
    message: type,
    *,
    sources: tuple[str, ...],
    publishes: str = "",
    beside: tuple[str, ...] = (),
) -> int:
    """Serve every raw stream of the source types on the graph until stopped; return the exit status.

    step: the class of a `Step`; step(config, stream_info) makes the state for one stream. update: the NamedTuple it
    gives, whose fields are named as those of message. publishes: sensor type of the features where that is not the
    source's; the sensor_id is then `<source id>_<source type>`. beside: further sensor types of the same device that a
    step takes with its method `beside` or `evidence`. Raises TypeError where the update does not fit the message.
    """
    filling.check(update, message)
    shape = Shape(step, update, message, sources, publishes, beside)

    async def main(service: Service[Config]) -> None:
        _Interpreter(service, shape)
        service.ready()
        await service.stopped.wait()

    return run(name, schema, main)


class _Interpreter:
    """All streams of one interpreter."""

    def __init__(self, service: Service[Any], shape: Shape) -> None:
        self._service, self._shape = service, shape
        self._streams: dict[StreamName, _Stream] = {}
        self._neighbours: dict[StreamName, _Neighbour] = {}
        self._start_ns: int | None = None
        RawStreams(service, {*shape.sources, *shape.beside}, self._added, self._removed, self._found)
        SessionMember(service, self._ready, self._begin_session)
        if shape.takes("marker"):
            service.subscribe(msgs.Marker, "/study/markers", self._mark, qos.deep(qos.MARKERS), keep=True)

    def _found(self, name: StreamName) -> None:
        if name.sensor_type in self._shape.beside:
            self._neighbours[name] = _Neighbour(self._service, name, lambda event: self._pass_on(name, event))
        if name.sensor_type not in self._shape.sources:
            return
        try:
            self._streams[name] = _Stream(self._service, name, self._shape)
        except ValueError as err:
            self._service.log.error(f"{name.topic('raw')}: its features have no name: {err}")
            return
        if self._start_ns is not None:
            self._streams[name].cut_at(self._start_ns)

    def _added(self, info: StreamInfo) -> None:
        for part in self._parts(info.name):
            part.begin(info)

    def _removed(self, name: StreamName) -> None:
        for part in self._parts(name):
            part.close()
        self._streams.pop(name, None)
        self._neighbours.pop(name, None)

    def _parts(self, name: StreamName) -> "list[_Stream | _Neighbour]":
        found = (self._streams.get(name), self._neighbours.get(name))
        return [part for part in found if part is not None]

    def _pass_on(self, name: StreamName, event: Beside) -> None:
        for source, stream in self._streams.items():
            if (source.human_id, source.sensor_id) == (name.human_id, name.sensor_id) and source != name:
                stream.put(event)

    def _mark(self, message: msgs.Marker) -> None:
        for name, stream in self._streams.items():
            if message.human_id in ("", name.human_id):
                stream.put(wire.marker_of(message))

    def _ready(self, session: SessionState) -> tuple[bool, str]:
        known = {name: part.known for parts in (self._neighbours, self._streams) for name, part in parts.items()}
        learning = sorted(name for name in known if concerns(session, name) and not known[name])
        return not learning, ", ".join(f"{name.topic('raw')} is not known yet" for name in learning)

    def _begin_session(self, start_ns: int) -> None:
        self._start_ns = start_ns
        for stream in self._streams.values():
            stream.cut_at(start_ns)


class _RawInput:
    """The subscription to one raw stream: messages become chunks, what cannot be used is counted."""

    def __init__(self, service: Service[Any], name: StreamName, take: Callable[[Chunk], None]) -> None:
        self._service, self._take = service, take
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
        try:
            chunk = wire.chunk_of(message)
        except FrameError:
            self.drop()
            raise
        self._take(chunk)


class _Neighbour:
    """A stream beside others: its chunks go to them once it is known what they are."""

    def __init__(self, service: Service[Any], name: StreamName, pass_on: Callable[[Beside], None]) -> None:
        self._pass_on = pass_on
        self._info: StreamInfo | None = None
        self._waiting: list[Chunk] = []
        self._input = _RawInput(service, name, self._take)

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
        self._input.close()

    def _take(self, chunk: Chunk) -> None:
        if self._info is not None:
            self._pass_on(Beside(chunk.received_ns, self._info, chunk))
        elif len(self._waiting) < LONGEST_WAIT:
            self._waiting.append(chunk)
        else:
            self._input.drop()


class _Stream:
    """One source stream: its feed, and the topic of its features. Raises ValueError where that has no legal name."""

    def __init__(self, service: Service[Any], name: StreamName, shape: Shape) -> None:
        self._service, self._name, self._message = service, name, shape.message
        self._features = shape.features_of(name)
        self._source: list[Any] = []
        self._input = _RawInput(service, name, self._on_raw)
        self._feed = Feed(
            lambda info: shape.step(service.config, info),
            service.config.update_interval_s,
            ordered=shape.takes("marker") or shape.takes("beside"),
            refused=lambda reason: service.log.error(f"{name.topic('raw')}: cannot be interpreted: {reason}"),
            dropped=self._input.drop,
        )
        labels = {"sensor_type": self._features.sensor_type, "sensor_id": self._features.sensor_id}
        self._published = service.metrics.counter("messages", "Messages handled.", **labels, field="features")
        self._duration = service.metrics.histogram("update_duration_seconds", "Time to take one message in.", **labels)
        self._quality = service.metrics.gauge("signal_quality_ratio", "Of the newest features, 0 to 1.", **labels)
        self._publisher: Publisher = service.publisher(shape.message, self._features.topic("features"), qos.FEATURES)
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
        if self._features != self._name:
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
        self._input.close()
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
            message.header.frame_id = self._features.sensor_id
            stamps.set_time(message.header.stamp, update.received_ns)
            stamps.set_time(message.device_timestamp, update.device_ns)
            message.extra = [*message.extra, *self._source]
            self._publisher.publish(message)
            self._published.inc()
            self._quality.set(message.signal_quality)
