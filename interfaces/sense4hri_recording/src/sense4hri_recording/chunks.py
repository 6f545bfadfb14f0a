"""What is in an MCAP file, one chunk in memory at a time, every length and size checked before it is believed.

The reader of `mcap` gives log time order, or loads the whole file to keep the order of the file; and it makes room for
whatever a file says it needs.
"""

from __future__ import annotations

import heapq
import struct
import zlib
from collections.abc import Iterator
from io import SEEK_END, BytesIO
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema
from mcap.summary import Summary

from sense4hri_recording.errors import LARGEST_RECORD, LATEST_NS

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = 9  # one byte of opcode, eight of length
USUAL_BYTES, USUAL_RATIO = 256 << 20, 1000  # a file unpacks to the first, and so many times its size, at most
USUAL_RECORDS = 1_000_000  # and besides one record for each of its bytes
DESCRIPTION = 20  # a schema or a channel takes the time of so many messages
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data
_KINDS: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.CHUNK: Chunk}


class Piece(NamedTuple):
    """One record of a file, still as bytes. at: bytes from the file's start to the record's end."""

    opcode: int
    data: bytes
    at: int


class Budget:
    """What one file may still unpack to; more is a bomb. Raises McapError where it is used up."""

    def __init__(self, file_bytes: int) -> None:
        self._bytes = USUAL_BYTES + USUAL_RATIO * file_bytes
        self._records = USUAL_RECORDS + file_bytes

    def unpack(self, chunk: Chunk) -> bytes:
        """The records of a chunk as bytes, of the size and the checksum that it says."""
        size = chunk.uncompressed_size
        self._bytes -= size
        if size > LARGEST_RECORD or self._bytes < 0:
            raise McapError(f"a chunk of {len(chunk.data)} bytes says that it unpacks to {size}")
        data = _unpacked(chunk.compression, chunk.data, size)
        if len(data) != size:
            raise McapError(f"a chunk of {len(chunk.data)} bytes does not unpack to the {size} that it says")
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise McapError(f"the checksum of a chunk of {len(chunk.data)} bytes is wrong")
        return data

    def count(self, records: int) -> None:
        """Take note of so many further records. Raises McapError for more than the bytes can hold."""
        self._records -= records
        if self._records < 0:
            raise McapError("more records than its bytes can hold")


def size_of(source: IO[bytes]) -> int:
    """Return how many bytes an open file has."""
    return source.seek(0, SEEK_END)


def messages(source: IO[bytes], summary: Summary, topics: set[str] | None = None) -> Iterator[tuple[Channel, Message]]:
    """Every message of the topics (None: all) in the order of the file. Raises one of `errors.DAMAGE`."""
    wanted = _wanted(summary, topics)
    for chunk in _chunks(source, summary, wanted):
        for message in chunk:
            yield summary.channels[message.channel_id], message


def by_time(
    source: IO[bytes], summary: Summary, topics: set[str], from_ns: int, until_ns: int | None
) -> Iterator[tuple[Channel, Message]]:
    """Messages with from_ns <= log time < until_ns in order of log time. Raises one of `errors.DAMAGE`."""
    wanted, budget = _wanted(summary, topics), Budget(size_of(source))
    waiting: list[tuple[int, int, int, ChunkIndex | Message]] = [
        (index.message_start_time, index.chunk_start_offset, -1, index)
        for index in _believed(summary)
        if _has(index, wanted) and index.message_end_time >= from_ns
    ]
    if not summary.chunk_indexes:
        found = next(_chunks(source, summary, wanted))
        waiting = [(message.log_time, 0, number, message) for number, message in enumerate(found)]
    heapq.heapify(waiting)
    while waiting:
        at_ns, place, _, item = heapq.heappop(waiting)
        if until_ns is not None and at_ns >= until_ns:
            return
        if isinstance(item, Message):
            if at_ns >= from_ns:
                yield summary.channels[item.channel_id], item
            continue
        for number, message in enumerate(_messages_in(read(source, item), wanted, budget)):
            heapq.heappush(waiting, (message.log_time, place, number, message))


def _wanted(summary: Summary, topics: set[str] | None) -> set[int]:
    return {number for number, channel in summary.channels.items() if topics is None or channel.topic in topics}


def _has(index: ChunkIndex, wanted: set[int]) -> bool:
    return not index.message_index_offsets or not wanted.isdisjoint(index.message_index_offsets)


def _believed(summary: Summary) -> list[ChunkIndex]:
    """The chunks of the index in the order of the file. Raises McapError where two are in the same place."""
    indexes = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)
    end = 0
    for index in indexes:
        if index.chunk_start_offset < end:
            raise McapError(f"the index names two chunks at byte {index.chunk_start_offset}")
        end = index.chunk_start_offset + index.chunk_length
    return indexes


def _chunks(source: IO[bytes], summary: Summary, wanted: set[int]) -> Iterator[Iterator[Message]]:
    """The messages of the index's chunks, chunk by chunk; those of a file whose index names none as one."""
    budget = Budget(size_of(source))
    if not summary.chunk_indexes:
        yield _unindexed(source, wanted, budget)
    for index in _believed(summary):
        if _has(index, wanted):
            yield _messages_in(read(source, index), wanted, budget)


def _unindexed(source: IO[bytes], wanted: set[int], budget: Budget) -> Iterator[Message]:
    for piece in pieces(source):
        for record in records(piece, budget):
            if isinstance(record, Message) and record.channel_id in wanted:
                if record.log_time > LATEST_NS:
                    raise McapError(f"a message received at {record.log_time} ns, which no clock shows")
                yield record


def _messages_in(chunk: Chunk, wanted: set[int], budget: Budget) -> Iterator[Message]:
    """The messages of these channels. Several times faster than making an object of every record."""
    data, first_ns, last_ns = budget.unpack(chunk), chunk.message_start_time, chunk.message_end_time
    for opcode, at, end in _inside(data, budget):
        if opcode == Opcode.MESSAGE:
            channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, at)
            if not first_ns <= log_time <= last_ns or log_time > LATEST_NS:
                raise McapError(f"a message received at {log_time} ns in a chunk from {first_ns} to {last_ns} ns")
            if channel_id in wanted:
                yield Message(channel_id, log_time, data[at + _MESSAGE.size : end], publish_time, sequence)


def _inside(data: bytes, budget: Budget) -> Iterator[tuple[int, int, int]]:
    """(opcode, begin, end) of every record of an unpacked chunk."""
    at, size = 0, len(data)
    while at < size:
        opcode, length = _HEAD.unpack_from(data, at)
        at += RECORD_HEAD
        if at + length > size:
            raise McapError(f"a record of {length} bytes in a chunk that ends after {size - at}")
        budget.count(1)
        yield opcode, at, at + length
        at += length


def read(source: IO[bytes], index: ChunkIndex) -> Chunk:
    """Return the chunk that an entry of the index names. Raises McapError where its place or size cannot be."""
    end = size_of(source)
    if index.chunk_start_offset + index.chunk_length > end:
        raise McapError(f"the index names a chunk up to byte {index.chunk_start_offset + index.chunk_length} of {end}")
    if index.chunk_length > LARGEST_RECORD:
        raise McapError(f"the index names a chunk of {index.chunk_length} bytes")
    source.seek(index.chunk_start_offset)
    opcode, length = _HEAD.unpack(source.read(RECORD_HEAD))
    if opcode != Opcode.CHUNK or length + RECORD_HEAD != index.chunk_length:
        raise McapError(f"there is no chunk of {index.chunk_length} bytes at byte {index.chunk_start_offset}")
    found: Chunk = _parsed(Chunk, source.read(length))
    if (found.message_start_time, found.message_end_time) != (index.message_start_time, index.message_end_time):
        raise McapError(f"the index and the chunk at byte {index.chunk_start_offset} name different times")
    return found


def pieces(source: IO[bytes]) -> Iterator[Piece]:
    """The records of the data section, those of no use here empty. Raises McapError where the file makes no sense."""
    at, size = len(MAGIC), size_of(source)
    source.seek(at)
    while len(head := source.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        at += _HEAD.size + length
        if opcode == Opcode.DATA_END:
            return
        if at > size:
            break
        if opcode not in _KINDS and opcode != Opcode.MESSAGE:
            source.seek(at)
            yield Piece(opcode, b"", at)
            continue
        if length > LARGEST_RECORD:
            break
        yield Piece(opcode, source.read(length), at)
    raise McapError("it has no end")


def records(piece: Piece, budget: Budget) -> Iterator[Schema | Channel | Message]:
    """What is in one piece, record by record. Raises one of `errors.DAMAGE`; a chunk's checksum comes first."""
    if piece.opcode not in (*_KINDS, Opcode.MESSAGE):
        return
    if piece.opcode != Opcode.CHUNK:
        budget.count(1)
        yield _record(piece.opcode, piece.data, 0, len(piece.data))
        return
    data = budget.unpack(_parsed(Chunk, piece.data))
    for opcode, at, end in _inside(data, budget):
        if opcode == Opcode.MESSAGE:
            yield _message(data, at, end)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            budget.count(DESCRIPTION)
            yield _record(opcode, data, at, end)


def _record(opcode: int, data: bytes, at: int, end: int) -> Any:
    return _message(data, at, end) if opcode == Opcode.MESSAGE else _parsed(_KINDS[opcode], data[at:end])


def _message(data: bytes, at: int, end: int) -> Message:
    if end - at < _MESSAGE.size:
        raise McapError(f"a message of {end - at} bytes")
    channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, at)
    return Message(channel_id, log_time, data[at + _MESSAGE.size : end], publish_time, sequence)


def _parsed(kind: Any, data: bytes) -> Any:
    try:
        return kind.read(ReadDataStream(BytesIO(data)))
    except OverflowError as err:
        raise McapError(f"a {kind.__name__} says it is impossibly long") from err


def _unpacked(compression: str, data: bytes, size: int) -> bytes:
    """At most one byte more than it says."""
    if compression == "zstd":
        unpacker = zstandard.ZstdDecompressor(max_window_size=LARGEST_RECORD)
        return unpacker.stream_reader(data).read(size + 1)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, size + 1))
    if compression:
        raise McapError(f"a chunk is compressed as {compression[:20]!r}")
    return data
