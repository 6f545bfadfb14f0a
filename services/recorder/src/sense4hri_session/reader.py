"""The files of a recording: rosbag2 in MCAP, read in order of receipt, checksums on, nothing ever written.

Order of receipt is the order in the files and of the files, not of the stamps: a host clock that is set back does not
shuffle what was recorded. Splits repeat the current messages of transient-local topics at their head; a repetition is
left out where the whole recording is read.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from mcap.reader import SeekingReader
from mcap.summary import Summary
from recorder.repair import DAMAGE
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from sense4hri_session import chunks
from sense4hri_session.errors import SessionError

MAGIC = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3\0"
REPAIR = "`python -m recorder.repair` beside it saves what is whole; the file itself is never changed"


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


class Reader:
    """Opens a directory of a recording, or one `.mcap` file. Raises SessionError with one clear sentence."""

    def __init__(self, path: Path, may_be_empty: bool = False) -> None:
        self.path = path
        self.files = find_files(path)
        self.topics: dict[str, Topic] = {}
        self.first_ns = self.last_ns = 0
        self.summaries: dict[Path, Summary] = {}
        self._latched: set[str] = set()
        for file in self.files:
            self._index(file)
        if not self.topics and not may_be_empty:
            raise SessionError(f"{path}: the recording is empty")
        self._types = get_typestore(Stores.EMPTY)
        self._known: set[str] = set()

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

    def decode(self, record: Record) -> Any:
        """The message with its fields as attributes, by the definition in the file."""
        topic = self.topics[record.topic]
        try:
            if topic.type_name not in self._known:
                types = get_types_from_msg(topic.definition, topic.type_name)
                known = self._types.types
                self._types.register({name: kind for name, kind in types.items() if name not in known})
                self._known.add(topic.type_name)
            return self._types.deserialize_cdr(record.data, topic.type_name)
        except (TypesysError, SerdeError, *DAMAGE) as err:
            raise SessionError(f"{self.path}: a message on {record.topic} is no {topic.type_name}: {err}") from err

    def encode(self, topic: str, message: Any) -> bytes:
        """A message, decoded before, as bytes again."""
        return bytes(self._types.serialize_cdr(message, self.topics[topic].type_name))

    def _file(self, file: Path, topics: set[str] | None) -> Iterator[Record]:
        try:
            with file.open("rb") as source:
                for channel, message in chunks.messages(source, self.summaries[file], topics):
                    if channel.topic in self.topics:
                        yield Record(channel.topic, message.log_time, message.publish_time, message.data)
        except DAMAGE as err:
            raise SessionError(f"{file} is damaged ({err or type(err).__name__}): {REPAIR}") from err

    def _index(self, file: Path) -> None:
        try:
            with file.open("rb") as source:
                start = source.read(len(SQLITE))
                if start.startswith(SQLITE):
                    raise SessionError(f"{file} is an older rosbag2 (sqlite3): `ros2 bag convert` makes an MCAP of it")
                if not start.startswith(MAGIC):
                    raise SessionError(f"{file} is no MCAP file")
                source.seek(0)
                limit = file.stat().st_size
                summary = SeekingReader(source, validate_crcs=True, record_size_limit=limit).get_summary()
        except FileNotFoundError as err:
            raise SessionError(f"{file}: metadata.yaml names it, but it is not there") from err
        except DAMAGE as err:
            raise SessionError(f"{file} was cut off or is damaged ({err or type(err).__name__}): {REPAIR}") from err
        if summary is None or summary.statistics is None:
            raise SessionError(f"{file} was cut off, it has no index: {REPAIR}")
        self.summaries[file] = summary
        statistics = summary.statistics
        if statistics.message_count:
            first = statistics.message_start_time
            self.first_ns = min(self.first_ns or first, first)
            self.last_ns = max(self.last_ns, statistics.message_end_time)
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


def _digest(record: Record) -> bytes:
    stamp = record.publish_ns.to_bytes(8, "little")
    return hashlib.blake2b(record.data, digest_size=16, key=stamp).digest()


def find_files(path: Path) -> list[Path]:
    """The MCAP files of a recording in their order. Raises SessionError where there are none."""
    if not path.exists():
        raise SessionError(f"{path}: there is no such file or directory")
    if path.is_file():
        return [path]
    named = _named(path / "metadata.yaml")
    if named:
        return named
    files = sorted(path.glob("*.mcap"), key=_place)
    repaired = {file.stem.removesuffix("_repaired") for file in files if file.stem.endswith("_repaired")}
    files = [file for file in files if file.stem not in repaired]
    if files:
        return files
    if any(path.glob("*.db3")):
        raise SessionError(f"{path} is an older rosbag2 (sqlite3): `ros2 bag convert` makes an MCAP of it")
    raise SessionError(f"{path}: no recording here, neither metadata.yaml nor an .mcap file")


def _place(file: Path) -> tuple[int, str]:
    """Splits are numbered without leading zeros."""
    found = re.search(r"_(\d+)(_repaired)?$", file.stem)
    return (int(found[1]) if found else 0, file.name)


def _named(path: Path) -> list[Path]:
    if not path.is_file():
        return []
    try:
        content = yaml.safe_load(path.read_text("utf-8"))
        names = content["rosbag2_bagfile_information"]["relative_file_paths"]
        return [path.parent / Path(str(name)).name for name in names]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError):
        return []  # a damaged metadata.yaml does not make the files beside it unreadable
