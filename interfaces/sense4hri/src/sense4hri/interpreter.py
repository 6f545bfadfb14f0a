"""Shell of every interpreter: finds every raw stream of its sources and publishes features beside it."""

from collections.abc import Callable
from typing import Any, TypeVar

import sense4hri_msgs.msg as msgs
from sense4hri_msgs.msg import SessionState

from sense4hri import filling, qos, wire
from sense4hri.discovery import RawStreams
from sense4hri.feed import Beside
from sense4hri.interpreter_config import InterpreterConfig
from sense4hri.interpreter_streams import Neighbour, Shape, Stream
from sense4hri.names import StreamName
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.session import SessionMember, concerns, required
from sense4hri.step import Step
from sense4hri.stream_info import StreamInfo

Config = TypeVar("Config", bound=InterpreterConfig)


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
        self._streams: dict[StreamName, Stream] = {}
        self._neighbours: dict[StreamName, Neighbour] = {}
        self._nameless: set[StreamName] = set()  # whose features can have no name
        self._start_ns: int | None = None
        RawStreams(service, {*shape.sources, *shape.beside}, self._added, self._removed, self._found)
        SessionMember(service, self._ready, self._begin_session)
        if shape.takes("marker"):
            service.subscribe(msgs.Marker, "/study/markers", self._mark, qos.deep(qos.MARKERS), keep=True)

    def _found(self, name: StreamName) -> None:
        if name.sensor_type in self._shape.beside:
            self._neighbours[name] = Neighbour(self._service, name, lambda event: self._pass_on(name, event))
        if name.sensor_type not in self._shape.sources:
            return
        try:
            self._streams[name] = Stream(self._service, name, self._shape)
        except ValueError as err:
            self._nameless.add(name)
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
        stream = self._streams.pop(name, None)
        self._neighbours.pop(name, None)
        self._nameless.discard(name)
        if not any(name[1:] == other[1:] for other in (*self._streams, *self._neighbours)):  # it is on nobody else
            for gone in {name, name if stream is None else stream.features}:
                self._service.metrics.gone(sensor_type=gone.sensor_type, sensor_id=gone.sensor_id)

    def _parts(self, name: StreamName) -> "list[Stream | Neighbour]":
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
        """Say whether a session may begin: all that is interpreted is known, and what it requires is being heard."""
        needed = {name for name in required(session) if self._shape.serves(name)} - self._nameless
        concerned = {name for name in (*self._streams, *self._neighbours) if concerns(session, name)}
        lacking = {name: why for name in needed | concerned if (why := self._lacking(name, name in needed))}
        return not lacking, ", ".join(f"{name.topic('raw')} {lacking[name]}" for name in sorted(lacking))

    def _lacking(self, name: StreamName, needed: bool) -> str:
        parts = self._parts(name)
        if not parts:
            return "is not seen yet"
        if not all(part.known for part in parts):
            return "is not known yet"
        return "" if all(part.input.heard for part in parts) or not needed else "is not heard yet"

    def _begin_session(self, start_ns: int) -> None:
        self._start_ns = start_ns
        for stream in self._streams.values():
            stream.cut_at(start_ns)
