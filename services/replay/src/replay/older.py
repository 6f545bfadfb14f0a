"""Recordings of rosbag2 in sqlite3, or compressed as a whole, read by `rosbags`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader

from replay.recorded import Recorded, Topic, one_sentence


class OlderRecording:
    """A rosbag2 folder in sqlite3, or compressed as a whole."""

    def __init__(self, path: Path) -> None:
        self.path, self.set_back_s = path, 0.0
        self._reader = Reader(path)
        self._reader.open()
        self._topics: dict[str, Topic] = {}
        for connection in self._reader.connections:
            topic = self._topics.setdefault(connection.topic, Topic(connection.topic, connection.msgtype))
            topic.messages += connection.msgcount
            topic.type_hash = topic.type_hash or (connection.digest if connection.digest.startswith("RIHS") else "")
            if isinstance(connection.ext, ConnectionExtRosbag2):
                topic.offers += [_entry(qos) for qos in connection.ext.offered_qos_profiles]
                if connection.ext.serialization_format != "cdr":
                    topic.refused = f"its messages are {connection.ext.serialization_format!r}, not ROS 2's cdr"
            if topic.type_name != connection.msgtype:
                topic.refused = f"it was recorded as {topic.type_name} and as {connection.msgtype}"
        self.topics = list(self._topics.values())
        self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time - 1

    def messages(
        self,
        names: Collection[str],
        from_ns: int,
        until_ns: int | None = None,
        held: Mapping[str, Iterable[bytes]] | None = None,
    ) -> Iterator[Recorded]:
        connections = [connection for connection in self._reader.connections if connection.topic in names]
        if not connections:
            return
        with one_sentence(self.path):
            for connection, log_ns, data in self._reader.messages(connections, from_ns, until_ns):
                yield Recorded(self._topics[connection.topic], log_ns, bytes(data))

    def close(self) -> None:
        self._reader.close()


def _entry(qos: Any) -> dict[str, Any]:
    """A QoS of rosbags as rosbag2 spells it."""
    out: dict[str, Any] = {}
    for name, value in qos._asdict().items():
        if hasattr(value, "sec"):
            out[name] = {"sec": value.sec, "nsec": value.nsec}
        else:
            out[name] = value.name.lower() if hasattr(value, "name") else value
    return out
