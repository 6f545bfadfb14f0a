"""A recorded session as tables and arrays."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from sense4hri.cdr import RawMessage, read_raw
from sense4hri.names import UNASSIGNED, StreamName
from sense4hri_recording import recorder_json
from sense4hri_recording.errors import SessionError
from sense4hri_recording.parts import find
from sense4hri_recording.reader import Reader, Topic
from sense4hri_recording.strange import stream_of, why_strange
from sense4hri_report.window import Window

from sense4hri_session import doubts, event_times, tables
from sense4hri_session.kept import count, keep
from sense4hri_session.scan import Scan
from sense4hri_session.stream import Stream

_STATE = re.compile(r"/humans/physiological/([^/]+)/state")
_EXPRESSION = re.compile(r"/humans/faces/([^/]+)/expression")


class Session:
    """One session with all its parts. Opening reads it once for stamps and metadata, samples when they are asked for.

    path: any folder of the session, `<folder above>/<session_id>`, or one `.mcap` file. only_this_part: leave out the
    further folders of a session whose recorder was killed. Raises SessionError.
    """

    def __init__(self, path: Path | str, progress: bool = False, only_this_part: bool = False) -> None:
        folders = find(Path(path), only_this_part)
        self.reader = _reader(folders)
        self.path = folders[0]
        self.recorders = tuple(recorder_json.read(folder) for folder in folders)
        """What only the recorder knows, of each part."""
        self._scan = Scan(self.reader)
        self._scan.run(progress)
        self._scan.take_recorders(self.recorders)
        self.sensors, self.info = self._scan.sensors, self._scan.info
        self.clocks = self._scan.clocks()
        self.streams: dict[str, Stream] = {"/".join(name): self._stream(name) for name in sorted(self._scan.seen)}
        whys = ((topic.name, why_strange(topic)) for topic in self.reader.topics.values())
        self.strange = {topic: why for topic, why in whys if why}
        """Topics that are not what their names say, and why; `table(topic)` has what they hold."""
        self.extra_units: defaultdict[tuple[str, str], set[str]] = defaultdict(set)
        """Units that messages told of columns made of their `extra`, by topic and column, of tables that were read."""
        self._notes = list(doubts.told(self, self._scan))

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
    def notes(self) -> list[str]:
        """Sentences that whoever uses this recording should read."""
        undecodable = self.reader.undecodable.values()
        return [*self._notes, *(why.replace(str(self.reader.path), self.path.name) for why in undecodable)]

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
        """Pseudonyms with streams or states, and who took part as the session says."""
        names = {name.human_id for _, name, _ in self.fields()} | set(map(str, self.info.get("human_ids") or ()))
        names |= {match[1] for topic in self.reader.topics if (match := _STATE.fullmatch(topic))}
        return sorted(names)

    @cached_property
    def markers(self) -> pd.DataFrame:
        """Every marker: `time_ns` is the event itself in ROS time, of one that a sensor told where its samples lie."""
        frame = self._table_of("/study/markers", stamp="header").drop(columns=["frame_id"], errors="ignore")
        sensors = {stream.name.sensor_id: stream for stream in self.streams.values()}
        for sensor_id in sensors.keys() & set(frame.get("source", ())):
            stream, own = sensors[sensor_id], frame["source"] == sensor_id
            device_ns = np.array(frame.loc[own, "device_time_ns"].astype("Int64").fillna(0), np.int64)
            told_ns = np.array(frame.loc[own, "time_ns"], np.int64)
            on_host_ns = event_times.marked_ns(told_ns, device_ns, stream.clock, stream.transport_delay_s)
            frame.loc[own, "time_ns"] = self._scan.hosts.reference_ns(sensor_id, on_host_ns)
        return frame

    @cached_property
    def timeline(self) -> pd.DataFrame:
        """Begin and end of the session, changes of wearer and every marker: time_ns, name, value, human_id, source."""
        inside = range(self.start_ns, self.end_ns + 60 * tables.SECOND_NS)
        edges = [
            {"time_ns": at, "name": name, "value": session_id, "human_id": "", "source": "session"}
            for session_id, times in self._scan.edges.items()
            for name, key in (("session_start", "start_at_ns"), ("session_stop", "stop_at_ns"))
            if (at := times.get(key, 0)) in inside
        ]
        return tables.joined([pd.DataFrame([*edges, *self._moves()]), self.markers])

    def _moves(self) -> Iterator[dict[str, Any]]:
        """A row for each participant from whom, or to whom, a sensor went."""
        for move in self._scan.wearers.moves(Window(self.start_ns, self.end_ns, begins=False, ends=False)):
            at_ns = self._scan.hosts.reference_ns(move.sensor_id, move.at_ns)
            about = {"time_ns": at_ns, "value": str(move), "source": "wearer"}
            for name, human_id in (("sensor_left", move.before), ("sensor_came", move.after)):
                if human_id != UNASSIGNED:
                    yield about | {"name": name, "human_id": human_id}

    @cached_property
    def timeline_rows(self) -> list[dict[Any, Any]]:
        """The same, a dict for each row."""
        return self.timeline.to_dict("records")

    @cached_property
    def states(self) -> pd.DataFrame:
        """The fused state of everyone."""
        found = [self._table_of(topic) for topic in self.reader.topics if _STATE.fullmatch(topic)]
        return tables.joined(found)

    @cached_property
    def expressions(self) -> pd.DataFrame:
        """Facial expressions, with `face_id`."""
        found = [
            self.table(topic).assign(face_id=match[1])
            for topic in self.reader.topics
            if (match := _EXPRESSION.fullmatch(topic))
        ]
        return tables.joined(found)

    @cached_property
    def assignments(self) -> pd.DataFrame:
        """Who wore what since when."""
        rows = [
            {"time_ns": row["time_ns"], **item}
            for row in self._table_of("/study/assignments").to_dict("records")
            for item in row.get("assignments") or []
        ]
        frame = tables.frame(rows)
        keys = ["sensor_id", "human_id", "person_id", "since_ns"]
        return frame.drop_duplicates(subset=[k for k in keys if k in frame]).reset_index(drop=True) if rows else frame

    @cached_property
    def clock_models(self) -> pd.DataFrame:
        """The clock models published while recording; the corrected timeline uses `clocks`, fitted afterwards."""
        found = [
            self.table(topic.name).assign(stream="/".join(name))
            for topic, name, field in self.fields()
            if field == "clock"
        ]
        return tables.joined(found)

    @contextmanager
    def kept(self, folder: Path, advance: Callable[[int], object]) -> Iterator[dict[str, int]]:
        """Read the recording once into files in this new folder; meanwhile the streams' samples come from there.

        Yields how many samples each stream has, those of repeated messages left out.

        advance(samples): called while it is read. Raises OSError, SessionError.
        """
        own = self.streams
        self.streams, samples = keep(self.reader, own, folder, advance)
        try:
            yield samples
        finally:
            self.streams = own

    def sample_counts(self) -> dict[str, int]:
        """How many samples each stream has, by its key, those of repeated messages left out. Reads the recording."""
        return count(self.reader, self.streams)

    def fields(self) -> Iterator[tuple[Topic, StreamName, str]]:
        """Every topic of a stream, with the stream and the field (`raw`, `features`, ...)."""
        for topic in self.reader.topics.values():
            if (found := stream_of(topic)) is not None:
                yield (topic, *found)

    def topics_of(self, message: str) -> list[str]:
        """The topics of messages of this name."""
        return [topic.name for topic in self.reader.topics.values() if topic.type_name.endswith(f"/{message}")]

    def features(self, key: str) -> pd.DataFrame:
        """What the interpreter computed on one stream; times of events in corrected ROS time (`events` lists them)."""
        return self._physiological(key, "features")

    def device(self, key: str) -> pd.DataFrame:
        """What the device itself computed, one row per value; NaN where it could compute none."""
        rows = [
            {"time_ns": row["time_ns"], "device_time_ns": row.get("device_time_ns"), "received_ns": row["received_ns"]}
            | {"name": item["name"], "unit": item["unit"], "value": value}
            for row in self._physiological(key, "device").to_dict("records")
            for item in row["features"] or []
            for value in item["values"] or [math.nan]
        ]
        return tables.frame(rows)

    def health(self, key: str) -> pd.DataFrame:
        """The driver's account of a stream, once a second."""
        return self.table(StreamName(*key.split("/")).topic("health"))

    def events(self, key: str) -> pd.DataFrame:
        """R peaks, pulses, breaths ... of one stream: time_ns (corrected), event, and its values where it has some."""
        topic = StreamName(*key.split("/")).topic("features")
        if topic not in self.reader.topics:
            return pd.DataFrame()
        kinds = tables.EVENTS.get(self.reader.topics[topic].type_name.rpartition("/")[2], ())
        rows = [
            {"time_ns": at_ns, "event": event} | {name: row[name][i] for name in beside if i < len(row[name])}
            for row in self.features(key).to_dict("records")
            for times, event, beside in kinds
            for i, at_ns in enumerate(row[times])
        ]
        return tables.frame(rows)

    def table(self, topic: str, stamp: str = "receipt") -> pd.DataFrame:
        """Any topic as a table. time_ns: receipt by the recorder, or the header's stamp (`header`) where it has one."""
        rows = [row for _, row in self._rows(topic, stamp)]
        return tables.frame(rows)

    def _table_of(self, topic: str, stamp: str = "receipt") -> pd.DataFrame:
        """A topic that is known by its name, as a table; empty where it is not of the type that this says."""
        return pd.DataFrame() if topic in self.strange else self.table(topic, stamp)

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
            message = self.reader.decoded(record)
            if message is None:
                continue
            row = tables.flatten(message)
            for column, unit in tables.extra_units(message).items():
                self.extra_units[topic, column].add(unit)
            time_ns = record.log_ns
            if stamp == "header" and row.get("received_ns"):
                time_ns = row["received_ns"]
            yield message, {"time_ns": time_ns, **row}

    def _physiological(self, key: str, field: str) -> pd.DataFrame:
        name = StreamName(*key.split("/"))
        source = event_times.source_of(name, self._scan.seen)
        stream = self.streams.get("/".join(source))
        delay_s = stream.transport_delay_s if stream else 0.0
        on_host = event_times.to_ros(source, self._scan.seen, self.clocks, delay_s)
        to_reference = partial(self._scan.hosts.reference_ns, source.sensor_id)

        rows = []
        for message, row in self._rows(name.topic(field), "header"):
            stamps = row["received_ns"], row.get("device_time_ns")
            untimed_ns = row["time_ns"] - round(delay_s * tables.SECOND_NS)
            row["time_ns"] = to_reference(on_host(stamps[1], *stamps) if stamps[1] else untimed_ns)
            for column in [c for c in row if c.endswith("_timestamps") and tables.are_times(getattr(message, c, None))]:
                times = map(tables.time_ns, getattr(message, column))
                row[column] = [to_reference(on_host(event_ns, *stamps)) for event_ns in times]
            rows.append(row)
        return tables.frame(rows)

    def _stream(self, name: StreamName) -> Stream:
        metadata = self.sensors.get((name.sensor_id, name.sensor_type), {})
        seen, clock = self._scan.seen[name], self.clocks.get(name.sensor_id)
        return Stream(name, metadata, seen, clock, lambda: self.raw(name), self._scan.hosts)


def open(path: Path | str, progress: bool = False, only_this_part: bool = False) -> Session:
    """Open a session, see `Session`; it reads as `sense4hri_session.open(path)`."""
    return Session(path, progress, only_this_part)


def _reader(folders: list[Path]) -> Reader:
    try:
        return Reader(*folders)
    except SessionError as err:
        if len(folders) == 1:
            raise
        which = f"one of {len(folders)} parts of its session; --only-this-part leaves the others out"
        raise SessionError(f"{err}. It is {which}") from err


__all__ = ["Session", "SessionError", "open"]
