"""The messages of a recording in the order in which they were written, also where a file was cut off or damaged.

Nothing is sorted by a clock: a host clock that was set back while recording must not change what came after what.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from os import SEEK_END
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk
from recorder.repair import DAMAGE, LARGEST_RECORD
from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from sense4hri_session.errors import SessionError
from sense4hri_session.reader import MAGIC, SQLITE, Record, find_files

NEEDED = {
    "builtin_interfaces/msg/Time": "sec nanosec",
    "std_msgs/msg/Header": "stamp",
    "sense4hri_msgs/msg/ClockModel": "header device_reference offset_ns skew_ppm uncertainty_s latency_s segment state",
    "sense4hri_msgs/msg/Marker": "header name value source human_id session_id uncertainty_s",
    "sense4hri_msgs/msg/SensorInfo": "sensor_id sensor_type",
    "sense4hri_msgs/msg/SensorInfoArray": "sensors",
    "sense4hri_msgs/msg/SessionState": "header session_id study task metadata_json phase start_at stop_at human_ids "
    "required_streams detail",
    "sense4hri_msgs/msg/StreamHealth": "header state host realtime_minus_monotonic_ns nominal_rate_hz samples_total "
    "lost_samples_total gaps_total duplicates_total reconnects_total latency_s battery_percent rssi_dbm contact "
    "reasons",
}
"""Fields that the report cannot do without; a file carries its own definitions, of another version or damaged."""

UNREADABLE = (*DAMAGE, OverflowError)  # the last by a length of more than 63 bits

_HEAD = struct.Struct("<BQ")
_CHUNK_TIMES = struct.Struct("<QQ")
_LOG_TIME = struct.Struct("<6xQ")
_KINDS: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.CHUNK: Chunk}


class Piece(NamedTuple):
    """One record of a file, still as bytes. at: bytes from the file's start to the record's end."""

    opcode: int
    data: bytes
    at: int


@dataclass
class RecordedTopic:
    """One topic of the recording; what is counted is counted while reading."""

    name: str
    type_name: str
    definition: str
    messages: int = 0
    first_log_ns: int = 0
    last_log_ns: int = 0


@dataclass
class Source:
    """A recording's files. first_ns, last_ns: earliest and latest receipt; both 0 where there is no message.

    trouble: one sentence for everything in the files that could not be read. remarks: what costs no message.
    """

    folder: Path
    files: list[Path]
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    trouble: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    first_ns: int = 0
    last_ns: int = 0
    size_bytes: int = 0

    def __post_init__(self) -> None:
        self._types = get_typestore(Stores.EMPTY)
        self._known: set[str] = set()

    def messages(self) -> Iterator[tuple[Record, int]]:
        """Every ROS message as written, one chunk in memory at a time, and how many bytes of the files are read."""
        before = 0
        for file in self.files:
            yield from self._file(file, before)
            before += file.stat().st_size

    def decode(self, record: Record) -> Any:
        """The message with its fields as attributes, by the definition in the file; None where it is not of it."""
        topic = self.topics[record.topic]
        try:
            if topic.type_name not in self._known:
                types = get_types_from_msg(topic.definition, topic.type_name)
                _check(types)
                self._types.register({name: kind for name, kind in types.items() if name not in self._types.types})
                self._known.add(topic.type_name)
            return self._types.deserialize_cdr(record.data, topic.type_name)
        except (TypesysError, SerdeError, *UNREADABLE):
            return None

    def _file(self, file: Path, before: int) -> Iterator[tuple[Record, int]]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, RecordedTopic] = {}
        damaged = 0
        with file.open("rb") as source:
            for piece in _pieces(source):
                try:
                    records = _records(piece)
                except UNREADABLE:
                    damaged += 1
                    continue
                for item in records:
                    if isinstance(item, Message):
                        topic = channels.get(item.channel_id)
                        if topic is not None:
                            topic.messages += 1
                            topic.first_log_ns = topic.first_log_ns or item.log_time
                            topic.last_log_ns = item.log_time
                            yield Record(topic.name, item.log_time, item.publish_time, item.data), before + piece.at
                    elif isinstance(item, Schema):
                        schemas[item.id] = item
                    else:
                        self._channel(item, schemas, channels)
        if damaged:
            self.trouble.append(f"{file.name}: {damaged} damaged chunk{'s' * (damaged > 1)} could not be read")

    def _channel(self, item: Channel, schemas: dict[int, Schema], channels: dict[int, RecordedTopic]) -> None:
        schema = schemas.get(item.schema_id)
        if schema is None or item.message_encoding != "cdr" or schema.encoding != "ros2msg" or item.id in channels:
            return  # not a ROS 2 topic; other programs may add their own
        text = schema.data.decode("utf-8", "replace")
        topic = self.topics.setdefault(item.topic, RecordedTopic(item.topic, schema.name, text))
        if topic.type_name == schema.name:
            channels[item.id] = topic
        else:
            self.trouble.append(f"{item.topic} has two types; what came as {schema.name} is not looked at")


def _check(types: Typesdict) -> None:
    """Raise ValueError for a definition without a field that is needed."""
    for name, (_, fields) in types.items():
        lacking = set(NEEDED.get(name, "").split()) - {field_name for field_name, _ in fields}
        if lacking:
            raise ValueError(f"{name} has no {', '.join(sorted(lacking))}")


def open_source(folder: Path) -> Source:
    """Open a recording's folder. Raises SessionError where there is none, or none that can be read."""
    if folder.is_file():
        raise SessionError(f"{folder} is a file: the report is made of, and written into, the folder around it")
    source = Source(folder, [])
    for file in find_files(folder):
        if not file.is_file():
            source.trouble.append(f"{file.name} is missing, metadata.yaml names it")
            continue
        with file.open("rb") as opened:
            start = opened.read(len(SQLITE))
            if start.startswith(SQLITE):
                raise SessionError(f"{file} is an older rosbag2 (sqlite3): `ros2 bag convert` makes an MCAP of it")
            if not start.startswith(MAGIC):
                source.trouble.append(f"{file.name} is no MCAP file ({file.stat().st_size} bytes)")
                continue
            opened.seek(0)
            _look(source, file, opened)
        source.files.append(file)
    if not source.files:
        raise SessionError(f"{folder}: {'; '.join(source.trouble)}")
    return source


def _look(source: Source, file: Path, opened: IO[bytes]) -> None:
    """Take the range of time from the chunks' heads, and note where the file ends too early."""
    complete = False
    size = file.stat().st_size
    opened.seek(len(MAGIC))
    at = len(MAGIC)
    while len(head := opened.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        if length > LARGEST_RECORD or at + _HEAD.size + length > size:
            break
        at += _HEAD.size + length
        if opcode == Opcode.DATA_END:
            complete = True
            break
        if opcode in (Opcode.CHUNK, Opcode.MESSAGE) and length >= _CHUNK_TIMES.size:
            times = opened.read(_CHUNK_TIMES.size)
            begin, end = _CHUNK_TIMES.unpack(times) if opcode == Opcode.CHUNK else _LOG_TIME.unpack_from(times) * 2
            if end:
                source.first_ns = min(source.first_ns or begin, begin)
                source.last_ns = max(source.last_ns, end)
        opened.seek(at)
    source.size_bytes += size
    opened.seek(-len(MAGIC), SEEK_END)
    if complete and opened.read() != MAGIC:
        source.remarks.append(
            f"{file.name} was cut off behind its last message: `python -m recorder.repair` makes its index again"
        )
    if not complete:
        source.trouble.append(f"{file.name} was cut off: it has no end, {size - at} bytes after its last whole chunk")


def _pieces(source: IO[bytes]) -> Iterator[Piece]:
    """The records of the data section that matter, up to its end or to where the file makes no sense any more."""
    source.seek(len(MAGIC))
    at = len(MAGIC)
    while len(head := source.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        at += _HEAD.size + length
        if opcode == Opcode.DATA_END or length > LARGEST_RECORD:
            return
        if opcode not in _KINDS and opcode != Opcode.MESSAGE:
            source.seek(at)
            continue
        data = source.read(length)
        if len(data) < length:
            return
        yield Piece(opcode, data, at)


def _records(piece: Piece) -> list[Any]:
    stream = ReadDataStream(BytesIO(piece.data))
    if piece.opcode == Opcode.CHUNK:
        return list(breakup_chunk(Chunk.read(stream), validate_crc=True))
    if piece.opcode == Opcode.MESSAGE:
        return [Message.read(stream, len(piece.data))]
    return [_KINDS[piece.opcode].read(stream)]
