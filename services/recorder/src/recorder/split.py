"""One MCAP file that takes what is written only in whole flushes, and always ends at a whole chunk."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.writer import CompressionType, Writer
from sense4hri_recording.rosbag2 import Channel, File, qos_text

CHUNK_BYTES = 1 << 20


class Entry(NamedTuple):
    """One serialised message on its way to the file, and what is known to be missing just before it.

    log_ns: receipt. publish_ns: header stamp. sequence: the publisher's number, 0 for a message repeated at the head
    of a file. lost: numbers skipped by the middleware. missed: sent before the subscription was known to the
    publisher. dropped: messages of the topic that found the queue full.
    """

    channel: Channel
    data: bytes
    log_ns: int
    publish_ns: int
    sequence: int = 0
    lost: int = 0
    missed: int = 0
    dropped: int = 0


class Output:
    """A file where `flush` puts all that is pending on disk, or nothing."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._pending = bytearray()
        self.on_disk = 0

    def write(self, data: bytes) -> int:
        self._pending += data
        return len(data)

    def tell(self) -> int:
        return self.on_disk + len(self._pending)

    def flush(self) -> None:
        """Raises OSError with the file as it was and everything pending still."""
        view, done = memoryview(bytes(self._pending)), 0
        try:
            while done < len(view):
                done += os.pwrite(self._fd, view[done:], self.on_disk + done)
        except OSError:
            os.ftruncate(self._fd, self.on_disk)
            raise
        self.on_disk += done
        self._pending.clear()

    def deleted(self) -> bool:
        """True where the file has no name any more."""
        return os.fstat(self._fd).st_nlink == 0

    def sync(self) -> None:
        os.fsync(self._fd)

    def close(self) -> None:
        os.close(self._fd)


class _ChunkIndex(bytes):
    """A chunk's record of the file's index, as it will be written: far smaller than the object, four times a second."""

    def write(self, builder: RecordBuilder) -> None:
        builder.write(self)


class Split:
    """One file of a bag. counts: messages by channel; heads: those of them that are repeated at its head.

    unflushed: those of them not handed to the kernel yet.
    """

    def __init__(self, path: Path, compression: str) -> None:
        self.path = path
        self.output = Output(path)
        self.counts: Counter[Channel] = Counter()
        self.heads: Counter[Channel] = Counter()
        self.unflushed: Counter[Channel] = Counter()
        self.first_ns = self.last_ns = 0
        self._ended = False
        self._writer = Writer(self.output, CHUNK_BYTES, CompressionType[compression.upper()])  # type: ignore[arg-type]
        self._writer.start(profile="ros2", library="sense4hri recorder")
        self._schemas: dict[str, int] = {}
        self._channels: dict[Channel, int] = {}

    def write(self, entry: Entry) -> None:
        """Put a message into the chunk in progress."""
        channel = entry.channel
        number = self._channels.get(channel)
        if number is None:
            number = self._channels[channel] = self._register(channel)
        self._writer.add_message(number, entry.log_ns, entry.data, entry.publish_ns, entry.sequence)
        self.first_ns = min(self.first_ns or entry.log_ns, entry.log_ns)
        self.last_ns = max(self.last_ns, entry.log_ns)
        self.counts[channel] += 1
        self.unflushed[channel] += 1

    def flush(self) -> None:
        """Hand a whole chunk to the kernel, which a SIGKILL of this process cannot take from it. Raises OSError."""
        self._writer.flush()
        self._pack_index()
        self.unflushed.clear()

    def drop_chunk(self) -> Counter[Channel]:
        """Leave out the chunk in progress, which may hold half a message; returns what was in it."""
        self._writer._Writer__chunk_builder.reset()  # type: ignore[attr-defined]
        dropped, self.unflushed = self.unflushed, Counter()
        return dropped

    def finish(self) -> None:
        """Write the index. Raises OSError; then the file is whole up to the last flush, and this may be tried again."""
        if not self._ended:
            self.flush()
            self._writer.finish()
            self._ended = True
        self.output.flush()

    def about(self) -> File:
        """What metadata.yaml says about it."""
        return File(self.path.name, self.first_ns, self.last_ns, self.counts.total())

    def _pack_index(self) -> None:
        """Keep the index of the chunks so far as bytes: the writer keeps objects until the file is closed.

        mcap's writer has no public way to its index, hence the private name.
        """
        kept = self._writer._Writer__chunk_indices  # type: ignore[attr-defined]
        for i in range(len(kept) - 1, -1, -1):
            if isinstance(kept[i], _ChunkIndex):
                break
            builder = RecordBuilder()
            kept[i].write(builder)
            kept[i] = _ChunkIndex(builder.end())

    def _register(self, channel: Channel) -> int:
        schema = self._schemas.get(channel.type_name)
        if schema is None:
            text = channel.definition.encode()
            schema = self._schemas[channel.type_name] = self._writer.register_schema(channel.type_name, "ros2msg", text)
        metadata = {"offered_qos_profiles": qos_text(channel.qos), "topic_type_hash": channel.type_hash}
        return self._writer.register_channel(channel.topic, "cdr", schema, metadata)
