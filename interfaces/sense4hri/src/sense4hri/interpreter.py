"""Shell of every interpreter: finds every raw stream of a sensor type and publishes features beside it.

A session's common start cuts every stream at the first raw message whose `header.stamp` has reached it: the step is
made afresh, and what comes out from there on does not depend on what came before.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from sense4hri_msgs.msg import PhysioDeviceFeature, PhysioRaw, SessionState

from sense4hri import qos, stamps, wire
from sense4hri.chunk import Break, Chunk, TimedChunk
from sense4hri.discovery import RawStreams
from sense4hri.errors import FrameError
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.service import Service, run
from sense4hri.session import SessionMember, concerns
from sense4hri.stream_info import StreamInfo

Config = TypeVar("Config")
LONGEST_WAIT = 5000  # messages kept while nothing is known of a stream yet


class Update(Protocol):
    """What a step found; the kit stamps it. Both stamps are those of the last sample used."""

    @property
    def device_ns(self) -> int | None: ...
    @property
    def received_ns(self) -> int: ...


class Step(Protocol):
    """The streaming state of an interpreter for one stream. Time comes in with the data, never from a clock."""

    def push(self, timed: TimedChunk) -> list[Any]:
        """Take the next samples; return the updates that became due."""

    def device_reported(self, name: str, value: float, received_ns: int) -> None:
        """Take a value that the device computed itself (`heart_rate`, ...)."""


MakeStep = Callable[[Any, StreamInfo], Step]
Fill = Callable[[Any, Any], None]


def run_interpreter(
    name: str, schema: type[Config], sensor_type: str, make_step: MakeStep, message: type, fill: Fill
) -> int:
    """Serve every stream of sensor_type on the graph until stopped; return the exit status.

    make_step(config, info) makes the state for one stream; it raises ValueError where the stream cannot be used.
    fill(message, update) fills a features message but for its two stamps.
    """

    async def main(service: Service[Config]) -> None:
        streams: dict[StreamName, _Stream] = {}
        start_ns: int | None = None

        def found(stream: StreamName) -> None:
            streams[stream] = _Stream(service, stream, message, fill)
            if start_ns is not None:
                streams[stream].cut_at(start_ns)

        def removed(stream: StreamName) -> None:
            streams.pop(stream).close()

        def added(info: StreamInfo) -> None:
            streams[info.name].begin(info, make_step)

        def ready(session: SessionState) -> tuple[bool, str]:
            learning = [s for s in streams if concerns(session, s) and not streams[s].known]
            return not learning, ", ".join(f"{s.topic('raw')} is not known yet" for s in sorted(learning))

        def begin_session(ns: int) -> None:
            nonlocal start_ns
            start_ns = ns
            for stream in streams.values():
                stream.cut_at(ns)

        RawStreams(service, (sensor_type,), added, removed, found)
        SessionMember(service, ready, begin_session)
        service.ready()
        await service.stopped.wait()

    return run(name, schema, main)


class _Stream:
    """One stream: what comes in before its metadata is known waits for it."""

    def __init__(self, service: Service[Any], name: StreamName, message: type, fill: Fill) -> None:
        self._service, self._name, self._message, self._fill = service, name, message, fill
        self._step: Step | None = None
        self._make_step: Callable[[], Step]
        self._start_ns: int | None = None  # where the next segment begins, until it has begun
        self._segment_ns = 0  # where this one began, 0 = with the stream
        self._fresh = False
        self._early: list[PhysioDeviceFeature] = []  # what the device reported from the next segment already
        self._clock = SampleClock(0.0)
        self._waiting: list[Chunk | PhysioDeviceFeature] | None = []
        labels = {"sensor_type": name.sensor_type, "sensor_id": name.sensor_id}
        self._messages = service.metrics.counter("messages", "Messages handled.", **labels, field="raw")
        self._published = service.metrics.counter("messages", "Messages handled.", **labels, field="features")
        self._bad = service.metrics.counter("undecodable_frames", "Messages that could not be used.", **labels)
        self._duration = service.metrics.histogram("update_duration_seconds", "Time to take one message in.", **labels)
        self._publisher: Publisher = service.publisher(message, name.topic("features"), qos.FEATURES)
        self._subscriptions: list[Subscription] = [
            service.subscribe(PhysioDeviceFeature, name.topic("device"), self._on_device, qos.deep(qos.DEVICE)),
            service.subscribe(PhysioRaw, name.topic("raw"), self._on_raw, qos.deep(qos.RAW)),
        ]

    def begin(self, info: StreamInfo, make_step: MakeStep) -> None:
        """Start with what is known of the stream now."""
        waiting, self._waiting = self._waiting or [], None
        try:
            self._clock = SampleClock(info.sampling_frequency_hz)
            self._make_step = lambda: make_step(self._service.config, info)
            self._step = self._make_step()
        except ValueError as err:
            self._service.log.error(f"{self._name.topic('raw')}: cannot be interpreted: {err}")
            return
        self._service.log.info(
            f"{self._name.topic('raw')}: {info.sampling_frequency_hz:g} Hz, "
            f"unit {info.unit or 'unknown'} (from {info.source})"
        )
        for item in waiting:
            if isinstance(item, Chunk):
                self._take(item)
            else:
                self._report(item)

    @property
    def known(self) -> bool:
        """True once the stream's metadata is there."""
        return self._waiting is None

    def cut_at(self, start_ns: int) -> None:
        """Begin a new segment with the first raw message stamped start_ns or later."""
        self._start_ns = start_ns

    def close(self) -> None:
        """Leave the graph."""
        for subscription in self._subscriptions:
            self._service.unsubscribe(subscription)
        self._service.node.destroy_publisher(self._publisher)
        self._step = None
        self._service.log.info(f"{self._name.topic('raw')}: gone")

    def _on_raw(self, message: PhysioRaw) -> None:
        self._messages.inc()
        try:
            chunk = wire.chunk_of(message)
        except FrameError as err:
            self._bad.inc()
            self._service.log.warning(str(err), once=True)
            return
        if self._waiting is None:
            self._take(chunk)
        elif len(self._waiting) < LONGEST_WAIT:
            self._waiting.append(chunk)
        else:
            self._bad.inc()

    def _on_device(self, message: PhysioDeviceFeature) -> None:
        if self._waiting is None:
            self._report(message)
        elif len(self._waiting) < LONGEST_WAIT:
            self._waiting.append(message)

    def _report(self, message: PhysioDeviceFeature) -> None:
        received_ns = stamps.to_ns(message.header.stamp)
        if self._step is None or received_ns < self._segment_ns:
            return
        if self._start_ns is not None and received_ns >= self._start_ns:
            self._early.append(message)
            return
        for feature in message.features:
            for value in feature.values:
                self._step.device_reported(feature.name, float(value), received_ns)

    def _take(self, chunk: Chunk) -> None:
        if self._step is None:
            return
        started = time.perf_counter()
        if self._start_ns is not None and chunk.received_ns >= self._start_ns:
            self._begin_segment(self._start_ns)
        timed = self._clock.place(chunk)
        updates = [] if timed.break_ is Break.DUPLICATE else self._push(timed)
        for update in updates:
            message = self._message()
            message.header.frame_id = self._name.sensor_id
            stamps.set_time(message.header.stamp, update.received_ns)
            stamps.set_time(message.device_timestamp, update.device_ns)
            self._fill(message, update)
            self._publisher.publish(message)
            self._published.inc()
        self._duration.observe(time.perf_counter() - started)

    def _push(self, timed: TimedChunk) -> list[Any]:
        assert self._step is not None
        if self._fresh:
            timed, self._fresh = dataclasses.replace(timed, break_=Break.FIRST, lost=0), False
        return self._step.push(timed)

    def _begin_segment(self, start_ns: int) -> None:
        self._segment_ns, self._start_ns = start_ns, None
        self._step, self._fresh = self._make_step(), True
        self._clock.begin_segment()
        early, self._early = self._early, []
        for message in early:
            self._report(message)
