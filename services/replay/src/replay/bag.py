"""Reads recordings: `.mcap` files, rosbag2 folders of these, and rosbag2's older sqlite3 folders."""

from __future__ import annotations

import heapq
import struct
from collections import Counter, deque
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple, Protocol

import apsw
import yaml
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Schema, Statistics
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader, ReaderError
from zstandard import ZstdError

LARGEST_RECORD = 1 << 30
LATCHED_DEPTH = 100
_LATCHED = ("transient_local", 1)
_KNOWN_LATCHED = {"/tf_static": LATCHED_DEPTH, "/robot_description": 1}
# what damaged bytes make readers and decompressors raise
DAMAGE = (
    McapError,
    ReaderError,
    ZstdError,
    yaml.YAMLError,
    apsw.Error,
    struct.error,
    EOFError,
    ValueError,
    LookupError,
    AttributeError,
    TypeError,
    MemoryError,
    RuntimeError,
    AssertionError,
)
NOT_FINISHED = "was not finished or is cut off; python -m sense4hri_recording.repair makes a readable copy"


class BagError(ValueError):
    """A recording that cannot be played; the text is the sentence that says why."""


@dataclass
class Topic:
    """One recorded topic. offers: the publishers' QoS as rosbag2 spells it. type_hash: empty where not recorded."""

    name: str
    type_name: str
    type_hash: str = ""
    offers: list[dict[str, Any]] = field(default_factory=list)
    messages: int = 0
    refused: str = ""

    @property
    def latched(self) -> bool:
        """True where a late subscriber was given what had been said before."""
        if not self.offers:
            return self.name in _KNOWN_LATCHED
        return any(entry.get("durability") in _LATCHED for entry in self.offers)

    @property
    def latched_depth(self) -> int:
        """How many messages a late subscriber is given: as recorded, else 1 of the contract's topics, 100 of others."""
        depths = [entry["depth"] for entry in self.offers if entry.get("depth")]
        if depths:
            return int(max(depths))
        return 1 if self.name.startswith(("/humans/", "/study/")) else _KNOWN_LATCHED.get(self.name, LATCHED_DEPTH)

    @property
    def repeated(self) -> int:
        """How many messages may stand again at the head of a further file; the recorder keeps 8 of each publisher."""
        return self.latched_depth if len(self.offers) < 2 else max(self.latched_depth, 8 * len(self.offers))


class Recorded(NamedTuple):
    """One message as it was received: log_ns is the receipt in ROS time."""

    topic: Topic
    log_ns: int
    cdr: bytes


class Recording(Protocol):
    """An open recording. start_ns, end_ns: log time of its first and last message."""

    path: Path
    topics: list[Topic]
    start_ns: int
    end_ns: int

    def messages(self, names: Collection[str], from_ns: int, until_ns: int | None = None) -> Iterator[Recorded]:
        """Yield the messages of topics with these names, from_ns <= log time < until_ns, in order of log time.

        Raises BagError where the bytes make no sense.
        """

    def close(self) -> None:
        """Close the files."""


def open_recording(path: Path) -> Recording:
    """Open what path names. Raises BagError that says why it cannot be played."""
    if not path.exists():
        raise BagError(f"{path} does not exist")
    with _one_sentence(path):
        files = _mcap_files(path)
        recording: Recording = _McapRecording(path, files) if files else _OlderRecording(path)
    if not any(topic.messages for topic in recording.topics):
        recording.close()
        raise BagError(f"{path} holds no message")
    return recording


def _mcap_files(path: Path) -> list[Path]:
    """The files of an MCAP recording in their order; none where it is in another storage."""
    if path.is_file():
        if path.suffix != ".mcap":
            raise BagError(f"{path} is neither a .mcap file nor a rosbag2 folder")
        return [path]
    listed = path / "metadata.yaml"
    if not listed.is_file():
        files = _files_without_metadata(path)
        if not files:
            raise BagError(f"{path} holds neither metadata.yaml nor a .mcap file")
        return files
    about = yaml.safe_load(listed.read_text("utf-8"))["rosbag2_bagfile_information"]
    if about["storage_identifier"] != "mcap" or about.get("compression_mode"):
        return []
    # older versions of rosbag2 write the folder's name in front
    files = [path / Path(name).name for name in about["relative_file_paths"]]
    for file in files:
        if not file.is_file():
            raise BagError(f"{file}, which {listed} names, does not exist")
    return files


def _files_without_metadata(folder: Path) -> list[Path]:
    """Its files in the order of their numbers; of a damaged and a repaired one the repaired."""
    found = {file.stem: file for file in folder.glob("*.mcap")}
    kept = [file for stem, file in found.items() if f"{stem}_repaired" not in found]

    def place(file: Path) -> tuple[int, str]:
        number = file.stem.removesuffix("_repaired").rpartition("_")[2]
        return (int(number) if number.isdecimal() else -1, file.name)

    return sorted(kept, key=place)


class _McapRecording:
    """One or several MCAP files."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        self.path = path
        self._topics: dict[str, Topic] = {}
        self._streams: list[IO[bytes]] = []
        self._readers: list[SeekingReader] = []
        spans = []
        try:
            for file in files:
                self._streams.append(file.open("rb"))
                reader = SeekingReader(self._streams[-1], validate_crcs=True, record_size_limit=LARGEST_RECORD)
                statistics = self._learn(reader, file)
                self._readers.append(reader)
                if statistics.message_count:
                    spans.append((statistics.message_start_time, statistics.message_end_time))
        except (BagError, OSError, *DAMAGE):
            self.close()
            raise
        self.topics = list(self._topics.values())
        self.start_ns = min((first for first, _ in spans), default=0)
        self.end_ns = max((last for _, last in spans), default=0)

    def _learn(self, reader: SeekingReader, file: Path) -> Statistics:
        try:
            summary = reader.get_summary()
        except (McapError, OSError) as err:
            raise BagError(f"{file} {NOT_FINISHED} ({err})") from err
        if summary is None or summary.statistics is None:
            raise BagError(f"{file} {NOT_FINISHED}")
        for number, channel in summary.channels.items():
            self._add(channel, summary.schemas.get(channel.schema_id), summary.statistics, number)
        return summary.statistics

    def _add(self, channel: Channel, schema: Schema | None, statistics: Statistics, number: int) -> None:
        type_name = schema.name if schema else ""
        topic = self._topics.setdefault(channel.topic, Topic(channel.topic, type_name))
        topic.messages += statistics.channel_message_counts.get(number, 0)
        topic.type_hash = topic.type_hash or channel.metadata.get("topic_type_hash", "")
        topic.offers += yaml.safe_load(channel.metadata.get("offered_qos_profiles", "")) or []
        if channel.message_encoding != "cdr":
            topic.refused = f"its messages are {channel.message_encoding or 'unknown'!r}, not ROS 2's cdr"
        elif topic.type_name != type_name:
            topic.refused = f"it was recorded as {topic.type_name} and as {type_name}"

    def messages(self, names: Collection[str], from_ns: int, until_ns: int | None = None) -> Iterator[Recorded]:
        """Transient-local topics stand again at the head of every further file, as they were: they were said once."""
        parts = [self._part(reader, names, from_ns, until_ns) for reader in self._readers]
        said: dict[str, deque[bytes]] = {}
        with _one_sentence(self.path):
            for recorded, at_head in heapq.merge(*parts, key=lambda part: part[0].log_ns):
                topic = recorded.topic
                if topic.latched:
                    last = said.setdefault(topic.name, deque(maxlen=topic.repeated))
                    if at_head and recorded.cdr in last:
                        continue
                    last.append(recorded.cdr)
                yield recorded

    def _part(
        self, reader: SeekingReader, names: Collection[str], from_ns: int, until_ns: int | None
    ) -> Iterator[tuple[Recorded, bool]]:
        """Yield the messages of one file, each with whether it may be a repetition of what an earlier file holds.

        Repetitions come first in a file, and bear no number of a publisher's.
        """
        further, seen = reader is not self._readers[0], Counter[str]()
        for _, channel, message in reader.iter_messages(list(names), starting_at=from_ns, ending_before=until_ns):
            topic = self._topics[channel.topic]
            seen[topic.name] += 1
            at_head = further and message.sequence == 0 and seen[topic.name] <= topic.repeated
            yield Recorded(topic, message.log_time, message.data), at_head

    def close(self) -> None:
        for stream in self._streams:
            stream.close()


class _OlderRecording:
    """A rosbag2 folder in sqlite3, or compressed as a whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
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

    def messages(self, names: Collection[str], from_ns: int, until_ns: int | None = None) -> Iterator[Recorded]:
        connections = [connection for connection in self._reader.connections if connection.topic in names]
        if not connections:
            return
        with _one_sentence(self.path):
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


@contextmanager
def _one_sentence(path: Path) -> Iterator[None]:
    """Make whatever damaged bytes or a failing disk raise one sentence that names the recording."""
    try:
        yield
    except BagError:
        raise
    except OSError as err:
        raise BagError(f"{path} cannot be read: {err.strerror or err}") from err
    except DAMAGE as err:
        why = " ".join(str(err).split()) or type(err).__name__  # parsers of YAML speak in several lines
        raise BagError(f"{path} is damaged or no rosbag2 recording: {why}") from err
