"""A recorded session as tables and arrays."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sense4hri.cdr import RawMessage, read_raw
from sense4hri.names import StreamName
from sense4hri_recording import recorder_json
from sense4hri_recording.errors import SessionError
from sense4hri_recording.parts import parts
from sense4hri_recording.reader import Reader
from tqdm import tqdm

from sense4hri_session import tables
from sense4hri_session.clock_fit import ClockFit, HostClock, Measurement, Packets, fit_clock
from sense4hri_session.stream import Seen, Stream

_STATE = re.compile(r"/humans/physiological/([^/]+)/state")
_EXPRESSION = re.compile(r"/humans/faces/([^/]+)/expression")


class Session:
    """One recording. Opening reads it once for stamps and metadata; samples are read when they are asked for."""

    def __init__(self, path: Path | str, progress: bool = False) -> None:
        self.path = Path(path)
        self.reader = Reader(self.path)
        self.sensors: dict[tuple[str, str], dict[str, Any]] = {}
        self.info: dict[str, Any] = {}
        self.recorder = recorder_json.read(self.path)
        """What only the recorder knows."""
        self.notes = [*self.recorder.doubts(self.path), *self._continued()]
        """Sentences that whoever uses this recording should read."""
        self._sessions: dict[str, dict[str, int]] = {}
        self._seen: dict[StreamName, Seen] = {}
        self._host_clock: dict[str, list[HostClock]] = {}
        self._measurements: dict[str, list[Measurement]] = {}
        self._scan(progress)
        self._take_facts()
        self.clocks = self._fit()
        self.streams: dict[str, Stream] = {"/".join(name): self._stream(name) for name in sorted(self._seen)}
        self.notes += self._changed_channels()

    def __getitem__(self, key: str) -> Stream:
        """A stream by `human/type/sensor`. Raises KeyError that names what there is."""
        try:
            return self.streams[key]
        except KeyError:
            raise KeyError(
                f"{key!r} is not in this session; it holds {', '.join(self.streams) or 'no stream'}"
            ) from None

    def __repr__(self) -> str:
        return f"<Session {self.path.name}: {', '.join(self.streams)}>"

    @property
    def start_ns(self) -> int:
        """ROS time of the first message received."""
        return self.reader.first_ns

    @property
    def end_ns(self) -> int:
        """ROS time of the last message received."""
        return self.reader.last_ns

    @property
    def humans(self) -> list[str]:
        """Pseudonyms with streams or states."""
        names = {name.human_id for name in self._seen}
        names |= {match[1] for topic in self.reader.topics if (match := _STATE.fullmatch(topic))}
        return sorted(names)

    @cached_property
    def markers(self) -> pd.DataFrame:
        """Every marker: `time_ns` is the event itself in ROS time."""
        return self.table("/study/markers", stamp="header").drop(columns=["frame_id"], errors="ignore")

    @cached_property
    def timeline(self) -> pd.DataFrame:
        """Begin and end of the session and every marker, in order: time_ns, name, value, human_id, source, ..."""
        inside = range(self.start_ns, self.end_ns + 60 * tables.SECOND_NS)
        edges = [
            {"time_ns": at, "name": name, "value": session_id, "human_id": "", "source": "session"}
            for session_id, times in self._sessions.items()
            for name, key in (("session_start", "start_at_ns"), ("session_stop", "stop_at_ns"))
            if (at := times.get(key, 0)) in inside
        ]
        return _joined([pd.DataFrame(edges), self.markers])

    @cached_property
    def states(self) -> pd.DataFrame:
        """The fused state of everyone."""
        found = [self.table(topic) for topic in self.reader.topics if _STATE.fullmatch(topic)]
        return _joined(found)

    @cached_property
    def expressions(self) -> pd.DataFrame:
        """Facial expressions, with `face_id`."""
        found = [
            self.table(topic).assign(face_id=match[1])
            for topic in self.reader.topics
            if (match := _EXPRESSION.fullmatch(topic))
        ]
        return _joined(found)

    @cached_property
    def assignments(self) -> pd.DataFrame:
        """Who wore what since when."""
        rows = [
            {"time_ns": row["time_ns"], **item}
            for row in self.table("/study/assignments").to_dict("records")
            for item in row.get("assignments") or []
        ]
        frame = pd.DataFrame(rows)
        keys = ["sensor_id", "human_id", "person_id", "since_ns"]
        return frame.drop_duplicates(subset=[k for k in keys if k in frame]).reset_index(drop=True) if rows else frame

    @cached_property
    def clock_models(self) -> pd.DataFrame:
        """The clock models published while recording; the corrected timeline uses `clocks`, fitted afterwards."""
        found = [
            self.table(topic).assign(stream="/".join(parsed[0]))
            for topic in self.reader.topics
            if (parsed := StreamName.parse(topic)) and parsed[1] == "clock"
        ]
        return _joined(found)

    def features(self, key: str) -> pd.DataFrame:
        """What the interpreter computed on one stream; times of events in corrected ROS time (`events` lists them)."""
        return self._physiological(key, "features")

    def device(self, key: str) -> pd.DataFrame:
        """What the device itself computed, one row per value."""
        rows = [
            {"time_ns": row["time_ns"], "device_time_ns": row.get("device_time_ns"), "received_ns": row["received_ns"]}
            | {"name": item["name"], "unit": item["unit"], "value": value}
            for row in self._physiological(key, "device").to_dict("records")
            for item in row["features"] or []
            for value in item["values"]
        ]
        return pd.DataFrame(rows)

    def health(self, key: str) -> pd.DataFrame:
        """The driver's account of a stream, once a second."""
        return self.table(StreamName(*key.split("/")).topic("health"))

    def events(self, key: str) -> pd.DataFrame:
        """R peaks, pulses, breaths ... of one stream: time_ns (corrected), event, and its values."""
        topic = StreamName(*key.split("/")).topic("features")
        if topic not in self.reader.topics:
            return pd.DataFrame()
        kinds = tables.EVENTS.get(self.reader.topics[topic].type_name.rpartition("/")[2], ())
        rows = [
            {"time_ns": values[0], "event": event, **dict(zip(beside, values[1:], strict=True))}
            for row in self.features(key).to_dict("records")
            for times, event, beside in kinds
            for values in zip(*(row[name] for name in (times, *beside)), strict=False)
        ]
        return pd.DataFrame(rows)

    def table(self, topic: str, stamp: str = "receipt") -> pd.DataFrame:
        """Any topic as a table. time_ns: receipt by the recorder, or the header's stamp (`header`) where it has one."""
        rows = [row for _, row in self._rows(topic, stamp)]
        return pd.DataFrame(rows)

    def raw(self, name: StreamName) -> Iterator[RawMessage]:
        """The messages of one stream; those that are no PhysioRaw are left out (counted in `Stream.seen`)."""
        for record in self.reader.messages([name.topic("raw")]):
            try:
                yield read_raw(record.data)
            except ValueError:
                continue

    def _rows(self, topic: str, stamp: str) -> Iterator[tuple[Any, dict[str, Any]]]:
        if topic not in self.reader.topics:
            return
        for record in self.reader.messages([topic]):
            message = self.reader.decode(record)
            row = tables.flatten(message)
            time_ns = record.log_ns
            if stamp == "header" and row.get("received_ns"):
                time_ns = row["received_ns"]
            yield message, {"time_ns": time_ns, **row}

    def _physiological(self, key: str, field: str) -> pd.DataFrame:
        name = StreamName(*key.split("/"))
        to_ros = self._device_to_ros(name)
        rows = []
        for message, row in self._rows(name.topic(field), "header"):
            received = row["received_ns"]
            if row.get("device_time_ns"):
                row["time_ns"] = to_ros(row["device_time_ns"], received)
            for column in [c for c in row if c.endswith("_timestamps")]:
                row[column] = [to_ros(tables.time_ns(t), received) for t in getattr(message, column)]
            rows.append(row)
        return pd.DataFrame(rows)

    def _device_to_ros(self, name: StreamName) -> Callable[[int, int], int]:
        """Event clock to ROS time, for a message with this header stamp; a derived stream has its source's clock."""
        source = name
        if name not in self._seen:
            own = [other for other in self._seen if name.sensor_id == f"{other.sensor_id}_{other.sensor_type}"]
            source = own[0] if own else name
        fit = self.clocks.get(source.sensor_id)
        segment_of = None if fit is None else fit.segment_of.get("/".join(source))
        if fit is None or segment_of is None:
            return lambda event_ns, received_ns: event_ns
        seen = self._seen[source]
        received = np.array([r for r, d in zip(seen.received_ns, seen.device_ns, strict=True) if d], np.int64)
        order = np.argsort(received, kind="stable")
        ordered, segments = received[order], segment_of[order]

        def convert(event_ns: int, received_ns: int) -> int:
            at = min(int(np.searchsorted(ordered, received_ns)), len(ordered) - 1)
            return int(fit.segments[int(segments[at])].ros_ns(np.array([event_ns], np.int64))[0])

        return convert

    def _scan(self, progress: bool) -> None:
        """One pass over the whole recording: stamps of raw messages, what the registry and the session said."""
        wanted = [topic for topic in self.reader.topics if self._is_scanned(topic)]
        total = sum(self.reader.topics[topic].messages for topic in wanted)
        with tqdm(total=total, unit=" messages", desc="reading", disable=not progress) as bar:
            for record in self.reader.messages(wanted):
                bar.update()
                parsed = StreamName.parse(record.topic)
                if parsed is not None:
                    self._scan_stream(parsed[0], parsed[1], record)
                elif record.topic == "/study/sensors":
                    for sensor in self.reader.decode(record).sensors:
                        self.sensors[sensor.sensor_id, sensor.sensor_type] = tables.flatten(sensor)
                else:
                    self._scan_session(tables.flatten(self.reader.decode(record)))

    def _is_scanned(self, topic: str) -> bool:
        parsed = StreamName.parse(topic)
        if parsed is None:
            return topic in ("/study/sensors", "/study/session")
        wanted = {"raw": "PhysioRaw", "health": "StreamHealth", "clock_measurement": "ClockMeasurement"}
        return self.reader.topics[topic].type_name == f"sense4hri_msgs/msg/{wanted.get(parsed[1])}"

    def _scan_stream(self, name: StreamName, field: str, record: Any) -> None:
        if field == "raw":
            seen = self._seen.setdefault(name, Seen())
            try:
                seen.add(read_raw(record.data))
            except ValueError:
                seen.undecodable += 1
            return
        message = self.reader.decode(record)
        stamp_ns = tables.time_ns(message.header.stamp)
        if field == "health":
            account = HostClock(stamp_ns, int(message.realtime_minus_monotonic_ns))
            if account.realtime_minus_monotonic_ns:
                self._host_clock.setdefault(name.sensor_id, []).append(account)
        else:
            device_ns = tables.time_ns(message.device_timestamp)
            measured = Measurement(device_ns, int(message.offset_ns), float(message.uncertainty_s))
            self._measurements.setdefault(name.sensor_id, []).append(measured)

    def _scan_session(self, row: dict[str, Any]) -> None:
        """Keep the newest word of the session that is not empty."""
        if not row.get("session_id"):
            return
        if row["session_id"] != self.info.get("session_id"):
            self.info = {}
        self.info |= {key: value for key, value in row.items() if value not in ("", None, [])}
        times = self._sessions.setdefault(row["session_id"], {})
        times |= {key: int(row[key]) for key in ("start_at_ns", "stop_at_ns") if row.get(key)}

    def _take_facts(self) -> None:
        """What the recorder wrote of its session goes before what was heard on /study/session."""
        known, session_id = self.recorder.session or {}, self.recorder.session_id
        if not session_id:
            return
        if session_id != self.info.get("session_id"):
            self.info = {}
        self.info |= {key: value for key, value in known.items() if value not in ("", None, [], {})}
        times = self._sessions.setdefault(session_id, {})
        times |= {key: known[key] for key in ("start_at_ns", "stop_at_ns") if isinstance(known.get(key), int)}

    def _continued(self) -> list[str]:
        others = [part for part in parts(self.path) if part != self.path] if self.path.is_dir() else []
        if not others:
            return []
        return [
            f"{self.path} is one of {len(others) + 1} folders of session {self.recorder.session_id}; "
            f"the others: {', '.join(path.name for path in others)}"
        ]

    def _changed_channels(self) -> list[str]:
        return [
            f"{key} came with {len(stream.seen.channel_sets)} sets of channels "
            f"({'; '.join(', '.join(names) for names in list(stream.seen.channel_sets)[:4])}): "
            "a channel is empty where it was not sent"
            for key, stream in self.streams.items()
            if len(stream.seen.channel_sets) > 1
        ]

    def _fit(self) -> dict[str, ClockFit]:
        """One clock per device, from the packets of all its streams."""
        devices: dict[str, dict[str, Packets]] = {}
        for name, seen in self._seen.items():
            device, received = np.array(seen.device_ns, np.int64), np.array(seen.received_ns, np.int64)
            has = device != 0
            if has.any():
                devices.setdefault(name.sensor_id, {})["/".join(name)] = Packets(device[has], received[has])
        return {
            sensor_id: fit_clock(
                packets,
                self._transport_delay_s(sensor_id),
                self._measurements.get(sensor_id, ()),
                self._host_clock.get(sensor_id, ()),
            )
            for sensor_id, packets in devices.items()
        }

    def _transport_delay_s(self, sensor_id: str) -> float:
        delays = [s["transport_delay_s"] for key, s in self.sensors.items() if key[0] == sensor_id]
        return float(delays[0]) if delays and np.isfinite(delays[0]) else 0.0

    def _stream(self, name: StreamName) -> Stream:
        metadata = self.sensors.get((name.sensor_id, name.sensor_type), {})
        return Stream(name, metadata, self._seen[name], self.clocks.get(name.sensor_id), lambda: self.raw(name))


def open(path: Path | str, progress: bool = False) -> Session:  # reads as sense4hri_session.open(path)
    """Open a recording: its directory or one `.mcap` file. Raises SessionError with a clear sentence."""
    return Session(path, progress)


def _joined(frames: list[pd.DataFrame]) -> pd.DataFrame:
    frames = [frame for frame in frames if len(frame)]
    if not frames:
        return pd.DataFrame()
    return pd.concat(frames, ignore_index=True).sort_values("time_ns", kind="stable").reset_index(drop=True)


__all__ = ["Session", "SessionError", "open"]
