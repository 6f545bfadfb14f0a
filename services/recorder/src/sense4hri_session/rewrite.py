"""One MCAP file written anew without some of its messages, read back, and put in the old one's place."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from mcap.reader import SeekingReader
from mcap.records import Channel, Message
from mcap.summary import Summary
from mcap.writer import CompressionType, Writer

from sense4hri_session import chunks
from sense4hri_session.errors import SessionError

CHUNK_BYTES = 1 << 20
Decide = Callable[[Channel, Message], bytes | None]


def replace(
    file: Path,
    summary: Summary,
    owns_topic: Callable[[str], bool],
    decide: Decide,
    is_clean: Callable[[Channel, Message], bool],
    step: Callable[[], None],
) -> None:
    """Replace a file by one without the topics it owns and with what `decide` makes of every other message.

    decide: the message's bytes, others instead of them, or None for no message. is_clean: asked for every message of
    the new file as it is read back. step: called once for every message read. Raises SessionError with the file as it
    was where the new one does not hold exactly what it should.
    """
    temporary = file.with_name(f".{file.name}.new")
    try:
        _write(file, temporary, summary, owns_topic, decide, step)
        _verify(file, temporary, summary, owns_topic, decide, is_clean, step)
        temporary.replace(file)
        sync(file.parent)
    finally:
        temporary.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def _write(
    file: Path,
    target: Path,
    summary: Summary,
    owns_topic: Callable[[str], bool],
    decide: Decide,
    step: Callable[[], None],
) -> None:
    with file.open("rb") as source, target.open("wb") as sink:
        writer = Writer(sink, CHUNK_BYTES, CompressionType.ZSTD)
        writer.start(profile="ros2", library="sense4hri-withdraw")
        numbers: dict[int, int] = {}
        schemas: dict[int, int] = {0: 0}
        for channel in summary.channels.values():
            if owns_topic(channel.topic):
                continue
            schema = summary.schemas.get(channel.schema_id)
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            about = (channel.topic, channel.message_encoding, schemas[channel.schema_id], channel.metadata)
            numbers[channel.id] = writer.register_channel(*about)
        for channel, message in chunks.messages(source, summary):
            step()
            data = None if owns_topic(channel.topic) else decide(channel, message)
            if data is not None:
                stamps = (message.log_time, data, message.publish_time, message.sequence)
                writer.add_message(numbers[channel.id], *stamps)
        writer.finish()
        sink.flush()
        os.fsync(sink.fileno())


def _verify(
    file: Path,
    target: Path,
    summary: Summary,
    owns_topic: Callable[[str], bool],
    decide: Decide,
    is_clean: Callable[[Channel, Message], bool],
    step: Callable[[], None],
) -> None:
    with file.open("rb") as source, target.open("rb") as made:
        found_summary = SeekingReader(made, validate_crcs=True).get_summary()
        if found_summary is None:
            raise SessionError(f"{file}: what was written anew cannot be read; nothing was changed")
        found = chunks.messages(made, found_summary)
        for channel, message in chunks.messages(source, summary):
            step()
            data = None if owns_topic(channel.topic) else decide(channel, message)
            if data is None:
                continue
            made_anew = next(found, None)
            if made_anew is None or _key(*made_anew) != _key(channel, message, data):
                raise SessionError(f"{file}: reading back, a message on {channel.topic} differs; nothing was changed")
            if not is_clean(*made_anew):
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
