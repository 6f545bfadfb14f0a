"""The messages of one MCAP file in the order they were written, one chunk in memory, declared sizes checked first.

The reader of `mcap` gives log time order, or loads the whole file to keep the order of the file.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import SEEK_END, BytesIO
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Message
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary

LARGEST_CHUNK = 1 << 30
RECORD_HEAD = 9  # one byte of opcode, eight of length
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data


def messages(source: IO[bytes], summary: Summary, topics: set[str] | None = None) -> Iterator[tuple[Channel, Message]]:
    """Every message of the topics (None: all). Raises what damaged bytes raise (`errors.DAMAGE`)."""
    if not summary.chunk_indexes:
        source.seek(0)
        found = NonSeekingReader(source).iter_messages(topics, log_time_order=False)
        yield from ((channel, message) for _, channel, message in found)
        return
    wanted = {number for number, channel in summary.channels.items() if topics is None or channel.topic in topics}
    for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
        if index.message_index_offsets and wanted.isdisjoint(index.message_index_offsets):
            continue
        for message in _messages_in(read(source, index), wanted):
            yield summary.channels[message.channel_id], message


def _messages_in(chunk: Chunk, wanted: set[int]) -> Iterator[Message]:
    """The messages of these channels. Several times faster than making an object of every record."""
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    data, at = stream.read(size), 0
    while at < size:
        opcode, length = _HEAD.unpack_from(data, at)
        at += RECORD_HEAD
        if at + length > size:
            raise McapError(f"a record of {length} bytes in a chunk that ends after {size - at}")
        if opcode == Opcode.MESSAGE:
            channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, at)
            if channel_id in wanted:
                yield Message(channel_id, log_time, data[at + _MESSAGE.size : at + length], publish_time, sequence)
        at += length


def read(source: IO[bytes], index: ChunkIndex) -> Chunk:
    """One chunk, its sizes believable."""
    end = source.seek(0, SEEK_END)
    if index.chunk_start_offset + index.chunk_length > end:
        raise McapError(f"the index names a chunk up to byte {index.chunk_start_offset + index.chunk_length} of {end}")
    source.seek(index.chunk_start_offset + RECORD_HEAD)
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(source.read(index.chunk_length - RECORD_HEAD))))
    except OverflowError as err:
        raise McapError(f"the chunk at byte {index.chunk_start_offset} says it is impossibly long") from err
    check(chunk)
    return chunk


def check(chunk: Chunk) -> None:
    """Raise McapError where a chunk says it unpacks to more than it can be, before anything makes room for it."""
    declared = chunk.uncompressed_size
    if chunk.compression == "zstd":
        inside = zstandard.frame_content_size(chunk.data)
    elif chunk.compression == "lz4":
        inside = lz4.frame.get_frame_info(chunk.data)["content_size"] or -1
    else:
        inside = len(chunk.data)
    if declared > LARGEST_CHUNK or inside not in (-1, declared):
        raise McapError(f"a chunk of {len(chunk.data)} bytes says that it unpacks to {max(declared, inside)}")
