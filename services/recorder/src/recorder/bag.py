"""A rosbag2 directory in MCAP, written so that a crash costs at most one flush interval.

Messages go into a queue and never wait for the disk. One thread makes them a chunk and hands it to the kernel every
flush interval (a SIGKILL cannot take that), another one calls fsync (nor can a power cut). The file always ends at a
whole chunk: a write that fails, the disk being full, is undone and tried again; what comes meanwhile counts as lost.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from mcap.writer import CompressionType, Writer

CHUNK_BYTES = 1 << 20
QUEUE_BYTES = 256 << 20
RESERVE_BYTES = 4 << 20  # kept aside so that a full disk still takes the index
RETRY_S = 2.0
METADATA_INTERVAL_S = 10.0
METADATA_VERSION = 9


@dataclass
class Channel:
    """One topic of one type. qos: as rosbag2 spells it, one entry per publisher."""

    number: int
    topic: str
    type_name: str
    type_hash: str
    qos: list[dict[str, Any]]
    messages: int = 0


class _Dumper(yaml.SafeDumper):
    """YAML without anchors: equal values are written out."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


class _Entry(NamedTuple):
    channel: Channel
    data: bytes
    log_ns: int
    publish_ns: int
    sequence: int


class _Output:
    """A file that takes what is written only as a whole: `flush` puts all of it on disk, or nothing."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._pending = bytearray()
        self._on_disk = 0

    def write(self, data: bytes) -> int:
        self._pending += data
        return len(data)

    def tell(self) -> int:
        return self._on_disk + len(self._pending)

    def flush(self) -> None:
        """Raises OSError with the file as it was and everything pending still."""
        view, done = memoryview(bytes(self._pending)), 0
        try:
            while done < len(view):
                done += os.pwrite(self._fd, view[done:], self._on_disk + done)
        except OSError:
            os.ftruncate(self._fd, self._on_disk)
            raise
        self._on_disk += done
        self._pending.clear()

    def free_bytes(self) -> int:
        disk = os.fstatvfs(self._fd)
        return disk.f_bavail * disk.f_frsize

    def sync(self) -> None:
        os.fsync(self._fd)

    def close(self) -> None:
        os.close(self._fd)


@dataclass
class Counts:
    """What became of the messages. on_disk: handed to the kernel. lost: taken from the graph but not written.

    refused: why nothing can be written now. unsafe: why what is written may not survive a power cut.
    """

    messages: int = 0
    on_disk: int = 0
    payload_bytes: int = 0
    lost: int = 0
    first_ns: int = 0
    last_ns: int = 0
    refused: str = ""
    unsafe: str = ""
    queued_bytes: int = 0

    @property
    def failure(self) -> str:
        return self.refused or self.unsafe


def new_directory(parent: Path, now_s: float) -> Path:
    """Make and return `<parent>/<UTC>`, with `_1`, `_2`, ... where that exists already."""
    parent.mkdir(parents=True, exist_ok=True)
    base = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(now_s))
    for number in range(1000):
        path = parent / (base if number == 0 else f"{base}_{number}")
        try:
            path.mkdir()
        except FileExistsError:
            continue
        return path
    raise FileExistsError(f"{parent / base}_999 exists already")


class Bag:
    """One recording. `write` may be called from any thread; everything else from the one that made it."""

    def __init__(
        self, directory: Path, flush_interval_s: float, compression: str = "zstd", distro: str = "jazzy"
    ) -> None:
        self.directory = directory
        self.file = directory / f"{directory.name}_0.mcap"
        self.counts = Counts()
        self.synced_ns = 0
        """Host time up to which everything handed to `write` is on the disk."""
        self.channels: list[Channel] = []
        self._distro, self._interval_s = distro, flush_interval_s
        self._queue: deque[_Entry] = deque()
        self._lock = threading.Lock()
        self._reserve = directory / ".reserve"
        _allocate(self._reserve, RESERVE_BYTES)
        self._output = _Output(self.file)
        self._writer = Writer(self._output, CHUNK_BYTES, CompressionType[compression.upper()])  # type: ignore[arg-type]
        self._writer.start(profile="ros2", library="sense4hri recorder")
        self._schemas: dict[str, int] = {}
        self._registered: dict[int, int] = {}
        self._definitions: dict[str, str] = {}
        self._blocked_until = 0.0
        self._written_ns = 0
        self._stop, self._dirty = threading.Event(), threading.Event()
        self._output.flush()
        self._write_metadata()
        self._writing = threading.Thread(target=self._write_loop, name="bag", daemon=True)
        self._syncing = threading.Thread(target=self._sync_loop, name="fsync", daemon=True)
        self._writing.start()
        self._syncing.start()

    def channel(
        self, topic: str, type_name: str, definition: str, type_hash: str, qos: list[dict[str, Any]]
    ) -> Channel:
        """A channel to write to. definition: text of the type and all nested ones (`ros2msg`)."""
        with self._lock:
            channel = Channel(len(self.channels), topic, type_name, type_hash, qos)
            self.channels.append(channel)
            self._definitions[type_name] = definition
        return channel

    def write(self, channel: Channel, data: bytes, log_ns: int, publish_ns: int, sequence: int = 0) -> None:
        """Queue one serialised message; never waits. log_ns: receipt. publish_ns: header stamp."""
        counts = self.counts
        with self._lock:
            if counts.queued_bytes + len(data) > QUEUE_BYTES:
                counts.lost += 1
                return
            counts.queued_bytes += len(data)
            self._queue.append(_Entry(channel, data, log_ns, publish_ns, sequence))

    def close(self) -> None:
        """Write what is queued, the index and the metadata. On a full disk the file stays readable as a stream."""
        self._stop.set()
        self._writing.join()
        self._dirty.set()
        self._syncing.join()
        self._reserve.unlink(missing_ok=True)
        try:
            self._output.flush()
            self._writer.finish()
            self._output.flush()
            self._output.sync()
            self._write_metadata()
            _sync_directory(self.directory)
        except OSError as err:
            self.counts.refused = f"{self.file}: {err.strerror}; the file has no index"
        self._output.close()

    def free_bytes(self) -> int:
        """Free space of the disk."""
        return self._output.free_bytes()

    def _write_loop(self) -> None:
        due = time.monotonic()
        while not self._stop.wait(max(due - time.monotonic(), 0.0)):
            due = max(due + self._interval_s, time.monotonic())
            self._drain()
        self._blocked_until = 0.0
        self._drain()

    def _sync_loop(self) -> None:
        """Everything that may wait long for the disk."""
        described, describe_at = 0, time.monotonic() + METADATA_INTERVAL_S
        while not self._stop.is_set():
            self._dirty.wait()
            self._dirty.clear()
            written_ns = self._written_ns
            self.counts.unsafe = self._try(self._output.sync)
            if not self.counts.unsafe:
                self.synced_ns = written_ns
            if described != len(self.channels) or time.monotonic() >= describe_at:
                described, describe_at = len(self.channels), time.monotonic() + METADATA_INTERVAL_S
                self.counts.unsafe = self.counts.unsafe or self._try(self._write_metadata)

    def _drain(self) -> None:
        """Make a chunk of what is queued and put it on disk; while the disk is full, count it as lost instead."""
        with self._lock:
            drained_ns = time.time_ns()
            entries, self._queue = self._queue, deque()
            self.counts.queued_bytes = 0
        if self.counts.refused and not self._writes_again():
            self.counts.lost += len(entries)
            return
        for entry in entries:
            self._add(entry)
        if entries:
            self.counts.refused = self._try(self._flush)
            self._blocked_until = time.monotonic() + RETRY_S
            if not self.counts.refused:
                self._written_ns = drained_ns
            self._dirty.set()
        elif self.synced_ns >= self._written_ns:  # nothing has come since what is safe
            self.synced_ns = self._written_ns = drained_ns

    def _writes_again(self) -> bool:
        if time.monotonic() < self._blocked_until:
            return False
        self.counts.refused = self._try(self._output.flush)
        self._blocked_until = time.monotonic() + RETRY_S
        return not self.counts.refused

    def _flush(self) -> None:
        self._writer.flush()
        self.counts.on_disk = self.counts.messages

    def _add(self, entry: _Entry) -> None:
        channel, counts = entry.channel, self.counts
        number = self._registered.get(channel.number)
        if number is None:
            number = self._registered[channel.number] = self._register(channel)
        self._writer.add_message(number, entry.log_ns, entry.data, entry.publish_ns, entry.sequence)
        channel.messages += 1
        counts.messages += 1
        counts.payload_bytes += len(entry.data)
        counts.first_ns = min(counts.first_ns or entry.log_ns, entry.log_ns)
        counts.last_ns = max(counts.last_ns, entry.log_ns)

    def _register(self, channel: Channel) -> int:
        schema = self._schemas.get(channel.type_name)
        if schema is None:
            text = self._definitions[channel.type_name].encode()
            schema = self._schemas[channel.type_name] = self._writer.register_schema(channel.type_name, "ros2msg", text)
        metadata = {
            "offered_qos_profiles": yaml.dump(channel.qos, Dumper=_Dumper, sort_keys=False).strip(),
            "topic_type_hash": channel.type_hash,
        }
        return self._writer.register_channel(channel.topic, "cdr", schema, metadata)

    def _try(self, action: Callable[[], object]) -> str:
        """Do something with the disk; returns why it refused, or nothing."""
        try:
            action()
        except OSError as err:
            return f"{self.directory}: {err.strerror}"
        return ""

    def _write_metadata(self) -> None:
        counts = self.counts
        about = (counts.first_ns, counts.last_ns, counts.messages, self._distro)
        write_metadata(self.directory, metadata(self.file.name, list(self.channels), *about))


def metadata(
    file: str, channels: list[Channel], first_ns: int, last_ns: int, messages: int, distro: str
) -> dict[str, Any]:
    """The content of metadata.yaml, version 9, of a bag of one file."""
    start = {"nanoseconds_since_epoch": first_ns}
    duration = {"nanoseconds": max(last_ns - first_ns, 0)}
    topics = [
        {
            "topic_metadata": {
                "name": channel.topic,
                "type": channel.type_name,
                "serialization_format": "cdr",
                "offered_qos_profiles": channel.qos,
                "type_description_hash": channel.type_hash,
            },
            "message_count": channel.messages,
        }
        for channel in channels
    ]
    return {
        "rosbag2_bagfile_information": {
            "version": METADATA_VERSION,
            "storage_identifier": "mcap",
            "duration": duration,
            "starting_time": start,
            "message_count": messages,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file],
            "files": [{"path": file, "starting_time": start, "duration": duration, "message_count": messages}],
            "custom_data": None,
            "ros_distro": distro,
        }
    }


def write_metadata(folder: Path, content: dict[str, Any]) -> None:
    """Replace a folder's metadata.yaml, whole or not at all."""
    temporary = folder / ".metadata.yaml"
    with temporary.open("w", encoding="utf-8") as file:
        yaml.dump(content, file, _Dumper, sort_keys=False)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(folder / "metadata.yaml")


def _allocate(path: Path, size: int) -> None:
    with path.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, size)


def _sync_directory(path: Path) -> None:
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
