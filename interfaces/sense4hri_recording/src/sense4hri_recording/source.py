"""The messages of a recording in the order in which they were written, also where a file was cut off or damaged.

Nothing is sorted by a clock: a host clock that was set back while recording must not change what came after what.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from os import SEEK_END
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema
from sense4hri.files import open_file
from sense4hri.names import ROOT

from sense4hri_recording import chunks
from sense4hri_recording.chunks import MAGIC, Budget
from sense4hri_recording.errors import DAMAGE, LARGEST_RECORD, LATEST_NS, SessionError
from sense4hri_recording.layout import find_files
from sense4hri_recording.reader import SQLITE, Part, Record
from sense4hri_recording.types import UNDECODABLE, Types

_HEAD = struct.Struct("<BQ")
_CHUNK_TIMES = struct.Struct("<QQ")
_LOG_TIME = struct.Struct("<6xQ")


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

    parts: the folders of its session that are read, this one alone or all in their order. trouble: one sentence for
    everything in the files that could not be read.
    remarks: what costs no message.
    """

    folder: Path
    files: list[Path]
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    trouble: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    first_ns: int = 0
    last_ns: int = 0
    size_bytes: int = 0
    parts: list[Part] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._types = Types()

    def messages(self) -> Iterator[tuple[Record, int]]:
        """Every ROS message as written, one chunk in memory at a time, and how many bytes of the files are read."""
        before = 0
        for file in self.files:
            yield from self._file(file, before)
            before += file.stat().st_size

    def decode(self, record: Record) -> Any:
        """The message with its fields as attributes, by the definition in the file; None where it is not of it."""
        try:
            return self._types.decode(self.topics[record.topic], record.data)
        except UNDECODABLE:
            return None

    def _file(self, file: Path, before: int) -> Iterator[tuple[Record, int]]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, RecordedTopic] = {}
        untimed = 0
        for item, at in self._records(file):
            if isinstance(item, Schema):
                schemas[item.id] = item
            elif isinstance(item, Channel):
                self._channel(item, schemas, channels)
            elif (topic := channels.get(item.channel_id)) is not None:
                if item.log_time > LATEST_NS:
                    untimed += 1
                    continue
                topic.messages += 1
                topic.first_log_ns = topic.first_log_ns or item.log_time
                topic.last_log_ns = item.log_time
                yield Record(topic.name, item.log_time, item.publish_time, item.data), before + at
        if untimed:
            self.trouble.append(f"{file.name}: {untimed} messages received when no clock of ROS shows are left out")

    def _records(self, file: Path) -> Iterator[tuple[Schema | Channel | Message, int]]:
        """Whatever can be read, and how many bytes of the file that is."""
        damaged = 0
        with open_file(file) as source, suppress(McapError):  # where it makes no sense any more; `_look` has told
            budget = Budget(chunks.size_of(source))
            for piece in chunks.pieces(source):
                try:
                    for item in chunks.records(piece, budget):
                        yield item, piece.at
                except DAMAGE:
                    damaged += 1
        if damaged:
            self.trouble.append(f"{file.name}: {damaged} damaged chunk{'s' * (damaged > 1)} could not be read")

    def _channel(self, item: Channel, schemas: dict[int, Schema], channels: dict[int, RecordedTopic]) -> None:
        schema = schemas.get(item.schema_id)
        if item.id in channels:
            return
        if schema is None or item.message_encoding != "cdr" or schema.encoding != "ros2msg":
            self._foreign(item, schema)
            return
        text = schema.data.decode("utf-8", "replace")
        topic = self.topics.setdefault(item.topic, RecordedTopic(item.topic, schema.name, text))
        if topic.type_name == schema.name:
            channels[item.id] = topic
        else:
            self.trouble.append(f"{item.topic} has two types; what came as {schema.name} is not looked at")

    def _foreign(self, item: Channel, schema: Schema | None) -> None:
        """No ROS 2 topic, or one whose type's definition is not in the file; other programs may add their own."""
        written = f"{item.message_encoding or 'no encoding'}, {schema.encoding if schema else 'no definition'}"
        sentence = (
            f"{item.topic} is not looked at: its messages are no ROS 2 messages that this file defines ({written})"
        )
        said = self.trouble if item.topic.startswith((f"{ROOT}/", "/study/")) else self.remarks
        if sentence not in said:
            said.append(sentence)


def open_source(*folders: Path) -> Source:
    """Open a recording's folder, or all those of a session, in order, as one; what cannot be read is in `trouble`.

    Raises SessionError where there is none, or none that can be read.
    """
    found: list[Source] = []
    errors: list[str] = []
    for folder in folders:
        try:
            found.append(_open(folder))
        except SessionError as err:
            errors.append(str(err))
    if not found:
        raise SessionError("; ".join(errors))
    whole = found[0] if len(folders) == 1 else _joined(folders[0], found)
    whole.trouble += errors
    return whole


def _joined(folder: Path, sources: list[Source]) -> Source:
    """Parts of a session, none of whose messages has been read, as one recording."""
    return Source(
        folder,
        [file for source in sources for file in source.files],
        trouble=[sentence for source in sources for sentence in source.trouble],
        remarks=[sentence for source in sources for sentence in source.remarks],
        first_ns=min((source.first_ns for source in sources if source.first_ns), default=0),
        last_ns=max(source.last_ns for source in sources),
        size_bytes=sum(source.size_bytes for source in sources),
        parts=[part for source in sources for part in source.parts],
    )


def _open(folder: Path) -> Source:
    if folder.is_file():
        raise SessionError(f"{folder} is a file: the report is made of, and written into, the folder around it")
    source = Source(folder, [])
    for file in find_files(folder):
        if not file.is_file():
            source.trouble.append(f"{file.name} is missing, metadata.yaml names it")
            continue
        with open_file(file) as opened:
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
    source.parts.append(Part(folder, source.files, source.first_ns, source.last_ns))
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
            if begin <= end <= LATEST_NS and end:
                source.first_ns = min(source.first_ns or begin, begin)
                source.last_ns = max(source.last_ns, end)
        opened.seek(at)
    source.size_bytes += size
    opened.seek(-len(MAGIC), SEEK_END)
    if complete and opened.read() != MAGIC:
        source.remarks.append(
            f"{file.name} was cut off behind its last message: `sense4hri-repair` makes its index again"
        )
    if not complete:
        source.trouble.append(f"{file.name} was cut off: it has no end, {size - at} bytes after its last whole chunk")
