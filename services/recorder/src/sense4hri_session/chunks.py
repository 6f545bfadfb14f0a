"""The messages of one MCAP file in the order they were written, one chunk in memory, declared sizes checked first.

The reader of `mcap` gives log time order, or loads the whole file to keep the order of the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import SEEK_END, BytesIO
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Message
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary

LARGEST_CHUNK = 1 << 30
RECORD_HEAD = 9  # one byte of opcode, eight of length


def messages(source: IO[bytes], summary: Summary, topics: set[str] | None = None) -> Iterator[tuple[Channel, Message]]:
    """Every message of the topics (None: all). Raises what damaged bytes raise (`recorder.repair.DAMAGE`)."""
    if not summary.chunk_indexes:
        source.seek(0)
        found = NonSeekingReader(source).iter_messages(topics, log_time_order=False)
        yield from ((channel, message) for _, channel, message in found)
        return
    wanted = {number for number, channel in summary.channels.items() if topics is None or channel.topic in topics}
    for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
        if index.message_index_offsets and wanted.isdisjoint(index.message_index_offsets):
            continue
        for record in breakup_chunk(read(source, index), validate_crc=True):
            if isinstance(record, Message) and record.channel_id in wanted:
                yield summary.channels[record.channel_id], record


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
