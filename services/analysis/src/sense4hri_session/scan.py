"""One pass over a session: stamps of raw messages, what is known of the sensors, and of the session itself."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from sense4hri.cdr import read_raw
from sense4hri.host_account import HostAccount
from sense4hri.host_clocks import TOPIC as HOST_CLOCKS
from sense4hri.host_clocks import HostClocks, SensorHosts
from sense4hri.names import StreamName
from sense4hri.stamps import SECOND_NS
from sense4hri_recording.reader import Reader, Record
from sense4hri_recording.recorder_json import RecorderJson
from sense4hri_recording.strange import stream_of, why_strange
from sense4hri_report.wearers import Wearers
from tqdm import tqdm

from sense4hri_session import tables
from sense4hri_session.clock_curve import Measurement
from sense4hri_session.clock_fit import ClockFit, Packets, fit_clock
from sense4hri_session.seen import Seen

STUDY = ("/study/sensors", "/study/session", "/study/assignments", HOST_CLOCKS)
FIELDS = ("raw", "health", "clock_measurement")
NOTHING: tuple[Any, ...] = ("", None, [], {})


@dataclass
class Scan:
    """What the pass has found.

    sensors: the registry's newest word by (sensor_id, sensor_type). info: the session's, as in recorder.json, else as
    last heard. edges: `start_at_ns` and `stop_at_ns` by session_id. host_accounts, measurements: by sensor_id.
    hosts: of drivers, with the clocks of a study on several. wearers: who wore what when. units: those that
    the registry told of a sensor whose driver was there, and since when, where they changed.
    """

    reader: Reader
    seen: dict[StreamName, Seen] = field(default_factory=dict)
    sensors: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    info: dict[str, Any] = field(default_factory=dict)
    edges: dict[str, dict[str, int]] = field(default_factory=dict)
    host_accounts: dict[str, list[HostAccount]] = field(default_factory=dict)
    measurements: dict[str, list[Measurement]] = field(default_factory=dict)
    hosts: SensorHosts = field(default_factory=lambda: SensorHosts(HostClocks(history=True)))
    wearers: Wearers = field(default_factory=Wearers)
    units: dict[tuple[str, str], list[tuple[int, str]]] = field(default_factory=dict)

    def run(self, progress: bool) -> None:
        """Read the recording once. Raises SessionError where it is damaged."""
        parsed = {name: stream_of(topic) for name, topic in self.reader.topics.items()}
        wanted = [topic for topic, found in parsed.items() if self._is_wanted(topic, found)]
        total = sum(self.reader.topics[topic].messages for topic in wanted)
        with tqdm(total=total, unit=" messages", desc="reading", disable=not progress) as bar:
            for record in self.reader.messages(wanted):
                bar.update()
                self._take(record, parsed[record.topic])

    def take_recorders(self, recorders: Iterable[RecorderJson]) -> None:
        """What the recorder wrote of its session, part after part, goes before what was heard on /study/session."""
        for recorder in recorders:
            if recorder.session_id:
                self._know(recorder.session_id, recorder.session or {})

    def clocks(self) -> dict[str, ClockFit]:
        """One clock per device, fitted to the packets of all its streams, by sensor_id."""
        devices: dict[str, dict[str, Packets]] = {}
        for name, seen in self.seen.items():
            device, received = np.array(seen.device_ns, np.int64), np.array(seen.received_ns, np.int64)
            has = device != 0
            if has.any():
                devices.setdefault(name.sensor_id, {})["/".join(name)] = Packets(device[has], received[has])
        return {sensor_id: self._fit(sensor_id, packets) for sensor_id, packets in devices.items()}

    def _fit(self, sensor_id: str, packets: dict[str, Packets]) -> ClockFit:
        measured, hosts = self.measurements.get(sensor_id, ()), self.host_accounts.get(sensor_id, ())
        return fit_clock(packets, self._transport_delay_s(sensor_id), measured, hosts)

    def _transport_delay_s(self, sensor_id: str) -> float:
        delays = [about["transport_delay_s"] for key, about in self.sensors.items() if key[0] == sensor_id]
        return float(delays[0]) if delays and np.isfinite(delays[0]) else 0.0

    def _is_wanted(self, topic: str, parsed: tuple[StreamName, str] | None) -> bool:
        return parsed[1] in FIELDS if parsed else topic in STUDY and not why_strange(self.reader.topics[topic])

    def _take(self, record: Record, parsed: tuple[StreamName, str] | None) -> None:
        if parsed is not None and parsed[1] == "raw":
            self._take_raw(parsed[0], record)
        elif (message := self.reader.decoded(record)) is None:
            return
        elif parsed is not None and parsed[1] == "health":
            self._take_health(parsed[0].sensor_id, message)
        elif parsed is not None:
            self._take_measurement(parsed[0].sensor_id, message)
        elif record.topic == HOST_CLOCKS:
            self.hosts.clocks.take(message, record.log_ns / SECOND_NS)
        elif record.topic == "/study/sensors":
            for sensor in message.sensors:
                self._take_sensor(sensor, record.log_ns)
        elif record.topic == "/study/assignments":
            for item in message.assignments:
                self.wearers.assign(item.sensor_id, item.human_id, tables.time_ns(item.since))
        else:
            self._take_session(tables.flatten(message))

    def _take_sensor(self, sensor: Any, log_ns: int) -> None:
        key = sensor.sensor_id, sensor.sensor_type
        self.sensors[key] = tables.flatten(sensor)
        self.hosts.registered(sensor.sensor_id, str(getattr(sensor, "host", "")))
        told = self.units.setdefault(key, [])
        if sensor.online and sensor.unit and (not told or told[-1][1] != sensor.unit):
            told.append((log_ns, sensor.unit))

    def _take_raw(self, name: StreamName, record: Record) -> None:
        seen = self.seen.setdefault(name, Seen())
        try:
            raw = read_raw(record.data)
        except ValueError:
            seen.undecodable += 1
            return
        seen.add(raw, record.log_ns)
        self.wearers.take(name, seen.received_ns[-1])

    def _take_health(self, sensor_id: str, message: Any) -> None:
        self.hosts.told(sensor_id, message.host)
        account = HostAccount(tables.time_ns(message.header.stamp), int(message.realtime_minus_monotonic_ns))
        if account.realtime_minus_monotonic_ns:
            self.host_accounts.setdefault(sensor_id, []).append(account)

    def _take_measurement(self, sensor_id: str, message: Any) -> None:
        device_ns = tables.time_ns(message.device_timestamp)
        measured = Measurement(device_ns, int(message.offset_ns), float(message.uncertainty_s))
        self.measurements.setdefault(sensor_id, []).append(measured)

    def _take_session(self, row: dict[str, Any]) -> None:
        if row.get("session_id"):
            self._know(row["session_id"], row)

    def _know(self, session_id: str, told: dict[str, Any]) -> None:
        """Keep the newest word of a session that is not empty."""
        if session_id != self.info.get("session_id"):
            self.info = {}
        self.info |= {key: value for key, value in told.items() if value not in NOTHING}
        at = self.edges.setdefault(session_id, {})
        at |= {key: int(ns) for key in ("start_at_ns", "stop_at_ns") if isinstance(ns := told.get(key), int) and ns}
