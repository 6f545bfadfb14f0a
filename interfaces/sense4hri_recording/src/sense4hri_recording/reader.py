"""The files of a recording: rosbag2 in MCAP, read in order of receipt, checksums on, nothing ever written.

Order of receipt is the order in the files and of the files, not of the stamps: a host clock that is set back does not
shuffle what was recorded. Splits repeat the current messages of transient-local topics at their head; a repetition is
left out where the whole recording is read.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import SeekingReader
from mcap.records import Statistics
from mcap.summary import Summary
from sense4hri.files import open_file

from sense4hri_recording import chunks
from sense4hri_recording.errors import DAMAGE, LARGEST_RECORD, LATEST_NS, REPAIR, SessionError
from sense4hri_recording.layout import find_files
from sense4hri_recording.types import UNDECODABLE, Types

SQLITE = b"SQLite format 3\0"


class Record(NamedTuple):
    """One message as recorded. log_ns: receipt by the recorder."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(frozen=True)
class Topic:
    """One recorded topic. definition: text of its type and every nested one."""

    name: str
    type_name: str
    definition: str
    messages: int


@dataclass
class Part:
    """A folder of a session, or one file. first_ns, last_ns: receipt of its first and last message, 0 where none."""

    path: Path
    files: list[Path]
    first_ns: int = 0
    last_ns: int = 0

    def extend(self, first_ns: int, last_ns: int) -> None:
        """Take in another file's range of time."""
        self.first_ns = min(self.first_ns or first_ns, first_ns)
        self.last_ns = max(self.last_ns, last_ns)


class Pause(NamedTuple):
    """Nothing was recorded between two parts: `before` ends at from_ns, `after` begins at to_ns."""

    before: Path
    after: Path
    from_ns: int
    to_ns: int

    @property
    def seconds(self) -> float:
        """How long, by the host's clock; below zero where that was set back meanwhile."""
        return (self.to_ns - self.from_ns) * 1e-9

    @property
    def sentence(self) -> str:
        """What it means for whoever reads both parts."""
        if self.seconds >= 0:
            return f"nothing was recorded for {self.seconds:.1f} s, between {self.before.name} and {self.after.name}"
        return (
            f"{self.after.name} begins {-self.seconds:.1f} s before {self.before.name} ends: two recorders wrote, and "
            "what is in both is twice here, or the host's clock was set back between them"
        )


def pauses(parts: list[Part]) -> list[Pause]:
    """Between each two of them that hold messages, in their order."""
    filled = [part for part in parts if part.last_ns]
    return [Pause(a.path, b.path, a.last_ns, b.first_ns) for a, b in pairwise(filled)]


class Reader:
    """Opens the parts of a recording, each a folder or one `.mcap` file, as one. Raises SessionError.

    first_ns, last_ns: receipt of the first and the last message. summaries: the index of every file.
    """

    def __init__(self, *parts: Path, may_be_empty: bool = False) -> None:
        self.path = parts[0]
        self.topics: dict[str, Topic] = {}
        self.summaries: dict[Path, Summary] = {}
        self._latched: set[str] = set()
        self.parts = [self._part(path) for path in parts]
        self.files = [file for part in self.parts for file in part.files]
        self.first_ns = min((part.first_ns for part in self.parts if part.first_ns), default=0)
        self.last_ns = max((part.last_ns for part in self.parts), default=0)
        if not self.topics and not may_be_empty:
            raise SessionError(f"{self.path}: the recording is empty")
        self._types = Types()
        self.undecodable: dict[str, str] = {}
        """By topic why messages of it were left out, in a sentence."""

    def messages(self, topics: list[str] | None = None) -> Iterator[Record]:
        """Every message of the topics (default: all) in order of receipt, one file chunk in memory at a time."""
        wanted = None if topics is None else set(topics)
        earlier: dict[str, set[bytes]] = {}
        for number, file in enumerate(self.files):
            ahead = set(self._latched) if number else set()
            for record in self._file(file, wanted):
                if record.topic in self._latched and len(self.files) > 1:
                    known = earlier.setdefault(record.topic, set())
                    digest = _digest(record)
                    if record.topic in ahead and digest in known:
                        continue
                    ahead.discard(record.topic)
                    known.add(digest)
                yield record

    @property
    def pauses(self) -> list[Pause]:
        """Where the recorder was not running between two parts, in order."""
        return pauses(self.parts)

    def decode(self, record: Record) -> Any:
        """The message with its fields as attributes, by the definition in the file."""
        topic = self.topics[record.topic]
        try:
            return self._types.decode(topic, record.data)
        except UNDECODABLE as err:
            raise SessionError(f"{self.path}: a message on {record.topic} is no {topic.type_name}: {err}") from err

    def decoded(self, record: Record) -> Any:
        """As `decode`; None for what is no message of its type, and why in `undecodable`."""
        try:
            return self.decode(record)
        except SessionError as err:
            self.undecodable.setdefault(record.topic, f"{err}; such messages are left out")
            return None

    def encode(self, topic: str, message: Any) -> bytes:
        """A message, decoded before, as bytes again."""
        return self._types.encode(self.topics[topic], message)

    def _file(self, file: Path, topics: set[str] | None) -> Iterator[Record]:
        try:
            with open_file(file) as source:
                for channel, message in chunks.messages(source, self.summaries[file], topics):
                    if channel.topic in self.topics:
                        yield Record(channel.topic, message.log_time, message.publish_time, message.data)
        except DAMAGE as err:
            raise SessionError(f"{file} is damaged ({err or type(err).__name__}): {REPAIR}") from err

    def _part(self, path: Path) -> Part:
        part = Part(path, find_files(path))
        for file in part.files:
            statistics = self._index(file)
            if statistics.message_count:
                part.extend(statistics.message_start_time, statistics.message_end_time)
        return part

    def _index(self, file: Path) -> Statistics:
        summary, statistics = read_index(file)
        self.summaries[file] = summary
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
                continue  # not a ROS 2 topic; other programs may add their own
            before = self.topics.get(channel.topic)
            if before is not None and before.type_name != schema.name:
                continue
            count = statistics.channel_message_counts.get(channel.id, 0) + (before.messages if before else 0)
            if "transient_local" in channel.metadata.get("offered_qos_profiles", ""):
                self._latched.add(channel.topic)
            text = schema.data.decode("utf-8", "replace")
            self.topics[channel.topic] = Topic(channel.topic, schema.name, text, count)
        return statistics


def read_index(file: Path) -> tuple[Summary, Statistics]:
    """What a whole file says it holds. Raises SessionError where it is none, cut off, or contradicts itself."""
    try:
        with open_file(file) as source:
            start = source.read(len(SQLITE))
            if start.startswith(SQLITE):
                raise SessionError(f"{file} is an older rosbag2 (sqlite3): `ros2 bag convert` makes an MCAP of it")
            if not start.startswith(chunks.MAGIC):
                raise SessionError(f"{file} is no MCAP file")
            source.seek(0)
            summary = SeekingReader(source, validate_crcs=True, record_size_limit=LARGEST_RECORD).get_summary()
    except FileNotFoundError as err:
        raise SessionError(f"{file}: metadata.yaml names it, but it is not there") from err
    except DAMAGE as err:
        raise SessionError(f"{file} was cut off or is damaged ({err or type(err).__name__}): {REPAIR}") from err
    if summary is None or summary.statistics is None:
        raise SessionError(f"{file} was cut off, it has no index: {REPAIR}")
    if not _agree(summary, summary.statistics):
        raise SessionError(f"{file} is damaged (its index contradicts itself): {REPAIR}")
    return summary, summary.statistics


def _agree(summary: Summary, statistics: Statistics) -> bool:
    """False where the times of the statistics are not those of the chunks, or none that a clock shows."""
    told = (statistics.message_start_time, statistics.message_end_time)
    filled = [index for index in summary.chunk_indexes if index.message_end_time]
    first_ns = min((index.message_start_time for index in filled), default=told[0])
    last_ns = max((index.message_end_time for index in filled), default=told[1])
    return told == (first_ns, last_ns) and first_ns <= last_ns <= LATEST_NS


def _digest(record: Record) -> bytes:
    stamp = record.publish_ns.to_bytes(8, "little")
    return hashlib.blake2b(record.data, digest_size=16, key=stamp).digest()
