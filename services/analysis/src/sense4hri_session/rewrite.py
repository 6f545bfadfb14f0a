"""One MCAP file written anew without some of its messages; read back, and put in the old one's place."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.reader import SeekingReader
from mcap.records import Channel, Message
from mcap.summary import Summary
from mcap.writer import CompressionType, Writer
from sense4hri.files import new_file, sync
from sense4hri_recording import chunks
from sense4hri_recording.errors import SessionError

CHUNK_BYTES = 1 << 20


class Named(NamedTuple):
    """What a channel is called in a new file."""

    topic: str
    metadata: dict[str, str]


def write_anew(
    file: Path,
    target: Path,
    summary: Summary,
    library: str,
    named: Callable[[Channel], Named | None],
    data: Callable[[Channel, Message], bytes | None],
) -> None:
    """Write a file's messages into a new file `target`. named, data: None for a channel, or a message, that goes."""
    with file.open("rb") as source, new_file(target) as sink:
        writer = Writer(sink, CHUNK_BYTES, CompressionType.ZSTD)
        writer.start(profile="ros2", library=library)
        numbers = _register(writer, summary, named)
        for channel, message in chunks.messages(source, summary):
            kept = data(channel, message)
            if kept is not None and channel.id in numbers:
                stamps = (message.log_time, kept, message.publish_time, message.sequence)
                writer.add_message(numbers[channel.id], *stamps)
        writer.finish()
        sink.flush()
        os.fsync(sink.fileno())


def _register(writer: Writer, summary: Summary, named: Callable[[Channel], Named | None]) -> dict[int, int]:
    """Number of every channel that stays in the new file, by its number in the old one."""
    numbers: dict[int, int] = {}
    schemas: dict[int, int] = {0: 0}
    for channel in summary.channels.values():
        name = named(channel)
        if name is None:
            continue
        schema = summary.schemas.get(channel.schema_id)
        if schema is not None and schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
        about = (name.topic, channel.message_encoding, schemas[channel.schema_id], name.metadata)
        numbers[channel.id] = writer.register_channel(*about)
    return numbers


@dataclass(frozen=True)
class Change:
    """What is done to the messages of a file.

    owns_topic: the topic goes, its channel too. decide: the bytes of any other message, or None where it goes.
    is_clean: asked of every message of the new file as it is read back. step: called once for every message read.
    """

    owns_topic: Callable[[str], bool]
    decide: Callable[[Channel, Message], bytes | None]
    is_clean: Callable[[Channel, Message], bool]
    step: Callable[[], None]

    def replace(self, file: Path, summary: Summary) -> None:
        """Put a changed file in the place of this one; SessionError, and the file as it was, where that goes wrong."""
        temporary = file.with_name(f".{file.name}.new")
        try:
            write_anew(file, temporary, summary, "sense4hri-withdraw", self._named, self._data)
            self._verify(file, temporary, summary)
            temporary.replace(file)
            sync(file.parent)
        finally:
            temporary.unlink(missing_ok=True)

    def _named(self, channel: Channel) -> Named | None:
        return None if self.owns_topic(channel.topic) else Named(channel.topic, channel.metadata)

    def _data(self, channel: Channel, message: Message) -> bytes | None:
        self.step()
        return None if self.owns_topic(channel.topic) else self.decide(channel, message)

    def _kept(self, source: BinaryIO, summary: Summary) -> Iterator[tuple[Channel, Message, bytes]]:
        for channel, message in chunks.messages(source, summary):
            data = self._data(channel, message)
            if data is not None:
                yield channel, message, data

    def _verify(self, file: Path, target: Path, summary: Summary) -> None:
        with file.open("rb") as source, target.open("rb") as made:
            found_summary = SeekingReader(made, validate_crcs=True).get_summary()
            if found_summary is None:
                raise SessionError(f"{file}: what was written anew cannot be read; nothing was changed")
            found = chunks.messages(made, found_summary)
            for channel, message, data in self._kept(source, summary):
                made_anew = next(found, None)
                if made_anew is None or _key(*made_anew) != _key(channel, message, data):
                    raise SessionError(
                        f"{file}: reading back, a message on {channel.topic} differs; nothing was changed"
                    )
                if not self.is_clean(*made_anew):
                    raise SessionError(f"{file}: a message on {channel.topic} still has a trace; nothing was changed")
            if next(found, None) is not None:
                raise SessionError(f"{file}: reading back, there is more than was written; nothing was changed")


def _key(channel: Channel, message: Message, data: bytes | None = None) -> tuple[str, int, int, int, bytes]:
    return (
        channel.topic,
        message.log_time,
        message.publish_time,
        message.sequence,
        message.data if data is None else data,
    )
