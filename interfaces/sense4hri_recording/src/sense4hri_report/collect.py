"""One pass over a recording: everything the report is made of, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray
from sense4hri.cdr import read_raw
from sense4hri.host_account import HostAccount
from sense4hri.host_clocks import TOPIC as HOST_CLOCKS
from sense4hri.host_clocks import HostClocks, SensorHosts
from sense4hri.names import ROOT, StreamName
from sense4hri.stamps import SECOND_NS, to_ns
from sense4hri.stream_info import can_be_rate
from sense4hri_recording import recorder_json, recorder_parts
from sense4hri_recording.errors import SessionError
from sense4hri_recording.reader import Record
from sense4hri_recording.recorder_json import RecorderJson
from sense4hri_recording.source import Source, open_source
from sense4hri_recording.strange import stream_of, why_strange

from sense4hri_report.bins import Axis, Picture
from sense4hri_report.epochs import Epochs, marked_ns
from sense4hri_report.outages import Silences
from sense4hri_report.raw_findings import Placed
from sense4hri_report.sequence import RawAccount
from sense4hri_report.watch import ClockWatch, FeatureWatch, HealthWatch, HostWatch, Span
from sense4hri_report.wearers import Wearers

PHASES = ("IDLE", "PREPARING", "RECORDING", "STOPPING", "FAILED")
MOST_MARKERS = 5000
Progress = Callable[[int, int], None]


def silent(read: int, total: int) -> None:
    """Take progress that nobody watches: do nothing."""


class Marker:
    """One marker; at_ns is the event itself, of a marker without a stamp its receipt by the recorder.

    That of a sensor lies where the sensor's samples do, once `Epochs` have told (device_ns: 0 = no device time).
    on_host: until `_to_reference` has gone over it, at_ns is of the sensor's driver's host.
    """

    def __init__(self, message: Any, log_ns: int) -> None:
        self.at_ns = to_ns(message.header.stamp) or log_ns
        self.on_host = to_ns(message.header.stamp) != 0
        self.device_ns = to_ns(message.device_timestamp)
        self.name, self.value = message.name, message.value
        self.source, self.human_id = message.source, message.human_id
        self.session_id = message.session_id
        self.uncertainty_s = float(message.uncertainty_s)


@dataclass
class Phase:
    """The moment at which the session entered a phase."""

    at_ns: int
    session_id: str
    phase: str
    detail: str


@dataclass
class StreamFindings:
    """Everything about one stream; raw is None where no raw message came."""

    name: StreamName
    raw: RawAccount | None = None
    picture: Picture | None = None
    health: HealthWatch | None = None
    clock: ClockWatch | None = None
    features: FeatureWatch | None = None
    epochs: Epochs = field(default_factory=Epochs)
    sensor: Any = None


@dataclass
class Rhythm:
    """When messages of any topic came, by receipt; longest_ns: the longest silence, which began at silent_ns."""

    last_ns: int = 0
    longest_ns: int = 0
    silent_ns: int = 0


@dataclass
class Findings:
    """What one pass has found."""

    source: Source
    notes: RecorderJson
    axis: Axis
    streams: dict[StreamName, StreamFindings] = field(default_factory=dict)
    rhythms: dict[str, Rhythm] = field(default_factory=dict)
    hosts: dict[str, HostWatch] = field(default_factory=dict)
    sensor_hosts: SensorHosts = field(default_factory=lambda: SensorHosts(HostClocks(history=True)))
    """Whose clock stamps what of a sensor; all times but the recorder's receipts are led to the reference's."""
    unplaced: set[str] = field(default_factory=set)
    """Whose stamps are not: a sentence for each host of a driver."""
    markers: list[Marker] = field(default_factory=list)
    markers_total: int = 0
    phases: list[Phase] = field(default_factory=list)
    sessions: dict[str, dict[str, Any]] = field(default_factory=dict)
    undecodable: dict[str, int] = field(default_factory=dict)
    sensors: dict[tuple[str, str], Any] = field(default_factory=dict)
    """The registry's newest word on every sensor, by (sensor_id, sensor_type)."""
    wearers: Wearers = field(default_factory=Wearers)
    silences: Silences = field(default_factory=Silences)
    outages: list[Span] = field(default_factory=list)
    """When the recording itself stood still; `summarise` finds them."""


def collect(folders: Sequence[Path], progress: Progress = silent) -> Findings:
    """Read a recording's folder, or all those of a session in their order, once.

    progress: called with the bytes read so far, and those in all.

    Raises SessionError where there is nothing to report on.
    """
    try:
        return _collect(folders, progress)
    except OSError as err:
        raise SessionError(f"{err.filename or folders[0]} cannot be read: {err.strerror or err}") from err


def _collect(folders: Sequence[Path], progress: Progress) -> Findings:
    source, notes = open_source(*folders), recorder_parts.joined([recorder_json.read(folder) for folder in folders])
    found = Findings(source, notes, Axis(source.first_ns, source.last_ns))
    passing = _Pass(found)
    read = 0
    for record, position in source.messages():
        passing.take(record)
        if position != read:
            read = position
            progress(read, source.size_bytes)
    for stream in found.streams.values():
        if stream.raw is not None:
            stream.raw.finish()
            passing.learn_epoch(stream)
        if stream.picture is not None:
            stream.picture.flush()
    _to_reference(found)
    ours = any(topic.startswith((ROOT + "/", "/study/")) for topic in source.topics)
    if not ours and notes.session is None:
        what = f"{len(source.topics)} topics, none of them" if source.topics else "no message"
        raise SessionError(f"{source.folder} holds {what} under {ROOT} or /study: no recording of a study")
    return found


def _to_reference(found: Findings) -> None:
    """Lead what was found by the clock of each driver's host to the reference host's time, by all that was recorded."""
    hosts = found.sensor_hosts
    for name, stream in found.streams.items():
        if stream.raw is not None:
            ends_ns = filter(None, (stream.raw.first_ns, stream.raw.last_ns))
            found.unplaced |= set(filter(None, [hosts.doubt(name.sensor_id, ends_ns)]))
            stream.raw.move(partial(hosts.reference_ns, name.sensor_id))
    found.wearers.move(hosts.reference_ns)
    for marker in found.markers:
        if marker.on_host:
            marker.at_ns = hosts.reference_ns(marker.source, marker.at_ns)
    for host in found.hosts.values():
        if host.host != found.notes.host and hosts.clocks.knows(host.host):
            host.steps = [step.moved(partial(hosts.clocks.reference_ns, host.host)) for step in host.steps]


class _Pass:
    """Hands every message to what keeps account of it."""

    def __init__(self, found: Findings) -> None:
        self._found, self._source, self._axis = found, found.source, found.axis
        self._parsed: dict[str, tuple[StreamName, str] | None] = {}
        self._newest = HostClocks()  # places at once what is only drawn, and need not wait for what is recorded later
        self._waiting: dict[str, list[Marker]] = {}  # those that a sensor told whose clock is not known yet

    def take(self, record: Record) -> None:
        rhythm = self._found.rhythms.get(record.topic)
        if rhythm is None:
            rhythm = self._found.rhythms[record.topic] = Rhythm(record.log_ns)
        if record.log_ns - rhythm.last_ns > rhythm.longest_ns:
            rhythm.longest_ns, rhythm.silent_ns = record.log_ns - rhythm.last_ns, rhythm.last_ns
        rhythm.last_ns = record.log_ns
        self._found.silences.take(record.topic, record.log_ns)
        if record.topic not in self._parsed:
            self._parsed[record.topic] = stream_of(self._source.topics[record.topic])
        parsed = self._parsed[record.topic]
        if parsed is not None:
            self._stream(parsed[0], parsed[1], record)
        elif why_strange(self._source.topics[record.topic]):
            return
        elif record.topic == "/study/session":
            self._session(record)
        elif record.topic == "/study/markers":
            self._marker(record)
        elif record.topic == "/study/sensors":
            self._sensor_list(record)
        elif record.topic == "/study/assignments":
            self._assignments(record)
        elif record.topic == HOST_CLOCKS:
            self._host_clocks(record)

    def _stream(self, name: StreamName, field_name: str, record: Record) -> None:
        stream = self._found.streams.get(name)
        if stream is None:
            sensor = self._found.sensors.get((name.sensor_id, name.sensor_type))
            stream = self._found.streams[name] = StreamFindings(name, sensor=sensor)
        if field_name == "raw":
            self._raw(stream, record)
        elif field_name in ("health", "clock", "features"):
            message = self._decode(record)
            if message is not None:
                getattr(self, f"_{field_name}")(stream, message)

    def _raw(self, stream: StreamFindings, record: Record) -> None:
        if stream.health is not None:
            stream.health.raw_came()
        account = stream.raw
        if account is None:
            picture = stream.picture = Picture(self._axis)

            def draw(placed: Placed) -> None:
                times_ns = self._placed_ns(stream.name, placed.times_ns)
                picture.add(times_ns, placed.channels, placed.samples, placed.fresh)

            account = stream.raw = RawAccount(declared_hz(stream), draw)
        try:
            raw = read_raw(record.data)
        except ValueError:
            account.undecodable += 1
            return
        self._found.wearers.take(stream.name, account.take(raw, record.log_ns))

    def _health(self, stream: StreamFindings, message: Any) -> None:
        if stream.health is None:
            stream.health = HealthWatch(self._axis)
        self._found.sensor_hosts.told(stream.name.sensor_id, message.host)
        stream.health.take(message, self._placed_ns(stream.name, to_ns(message.header.stamp)))
        self.learn_epoch(stream)
        if stream.raw is not None and stream.raw.declared_hz is None:
            stream.raw.declared_hz = stream.health.nominal_hz
        host = self._found.hosts.setdefault(message.host, HostWatch(message.host))
        account = HostAccount(to_ns(message.header.stamp), int(message.realtime_minus_monotonic_ns))
        if (step := host.take(account)) is not None:
            for other in self._found.streams.values():
                if other.raw is not None and other.health is not None and other.health.host == message.host:
                    other.raw.host_stepped(step)

    def _clock(self, stream: StreamFindings, message: Any) -> None:
        if stream.clock is None:
            stream.clock = ClockWatch(self._axis)
        model = stream.clock.take(message, self._placed_ns(stream.name, to_ns(message.header.stamp)))
        if model is not None and stream.raw is not None:
            stream.raw.model(model)

    def _features(self, stream: StreamFindings, message: Any) -> None:
        if stream.features is None:
            stream.features = FeatureWatch(self._axis)
        stream.features.take(message, self._placed_ns(stream.name, to_ns(message.header.stamp)))

    def _sensor_list(self, record: Record) -> None:
        message = self._decode(record)
        for sensor in [] if message is None else message.sensors:
            self._found.sensors[sensor.sensor_id, sensor.sensor_type] = sensor
            self._found.sensor_hosts.registered(sensor.sensor_id, str(getattr(sensor, "host", "")))
            for name, stream in self._found.streams.items():
                if (name.sensor_id, name.sensor_type) == (sensor.sensor_id, sensor.sensor_type):
                    stream.sensor = sensor
                    if stream.raw is not None and stream.raw.declared_hz is None:
                        stream.raw.declared_hz = declared_hz(stream)

    def _assignments(self, record: Record) -> None:
        message = self._decode(record)
        for item in [] if message is None else message.assignments:
            self._found.wearers.assign(item.sensor_id, item.human_id, to_ns(item.since))

    def _marker(self, record: Record) -> None:
        message = self._decode(record)
        if message is None:
            return
        self._found.markers_total += 1
        if len(self._found.markers) < MOST_MARKERS:
            marker = Marker(message, record.log_ns)
            self._found.markers.append(marker)
            if marker.device_ns:
                self._waiting.setdefault(marker.source, []).append(marker)
                self._place_markers(marker.source)

    def learn_epoch(self, stream: StreamFindings) -> None:
        """Note how a device's clock runs now, and place the markers that waited to know."""
        if stream.raw is not None and stream.epochs.learn(stream.raw):
            self._place_markers(stream.name.sensor_id)

    def _place_markers(self, sensor_id: str) -> None:
        own = [stream for name, stream in self._found.streams.items() if name.sensor_id == sensor_id]
        known = [stream.epochs for stream in own if stream.raw is not None and stream.epochs.learn(stream.raw)]
        for marker in self._waiting.pop(sensor_id, []) if known else ():
            told_ns, marker.at_ns = marker.at_ns, marked_ns(known, marker.device_ns, marker.at_ns)
            marker.on_host |= marker.at_ns != told_ns

    def _host_clocks(self, record: Record) -> None:
        message = self._decode(record)
        if message is not None:
            self._found.sensor_hosts.clocks.take(message, record.log_ns / SECOND_NS)
            self._newest.take(message, record.log_ns / SECOND_NS)

    @overload
    def _placed_ns(self, name: StreamName, host_ns: int) -> int: ...
    @overload
    def _placed_ns(self, name: StreamName, host_ns: NDArray[np.int64]) -> NDArray[np.int64]: ...
    def _placed_ns(self, name: StreamName, host_ns: int | NDArray[np.int64]) -> int | NDArray[np.int64]:
        """Return the reference host's time of a stamp of the driver's host, by what is known so far."""
        return self._newest.reference_ns(self._found.sensor_hosts.host(name.sensor_id), host_ns)

    def _session(self, record: Record) -> None:
        message = self._decode(record)
        if message is None or not message.session_id:
            return
        phase = PHASES[message.phase] if message.phase < len(PHASES) else f"phase {message.phase}"
        phases = self._found.phases
        if not phases or (phases[-1].session_id, phases[-1].phase) != (message.session_id, phase):
            at_ns = to_ns(message.header.stamp) or record.log_ns
            phases.append(Phase(at_ns, message.session_id, phase, message.detail))
        about = self._found.sessions.setdefault(message.session_id, {})
        heard = {
            "session_id": message.session_id,
            "study": message.study,
            "task": message.task,
            "metadata_json": message.metadata_json,
            "human_ids": [str(human) for human in message.human_ids],
            "required_streams": [str(stream) for stream in message.required_streams],
            "start_at_ns": to_ns(message.start_at),
            "stop_at_ns": to_ns(message.stop_at),
        }
        about.update({key: value for key, value in heard.items() if value})

    def _decode(self, record: Record) -> Any:
        message = self._source.decode(record)
        if message is None:
            self._found.undecodable[record.topic] = self._found.undecodable.get(record.topic, 0) + 1
        return message


def declared_hz(stream: StreamFindings) -> float | None:
    """The declared rate: by the registry, else by the driver's health; None where nobody declares one."""
    for source, attribute in ((stream.sensor, "sampling_frequency_hz"), (stream.health, "nominal_hz")):
        value = getattr(source, attribute, None)
        if value is not None and can_be_rate(value):
            return float(value)
    return None
