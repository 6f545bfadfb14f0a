"""MCAP files record by record, to be written again with something wrong in them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import zstandard
from mcap.reader import SeekingReader
from mcap.writer import CompressionType, Writer

HEAD = struct.Struct("<BQ")
MAGIC = b"\x89MCAP0\r\n"
CHUNK, DATA_END = 0x06, 0x0F
CHUNK_BYTES = 6000


@dataclass
class Told:
    """One message and all that is said of it."""

    topic: str
    type_name: str
    definition: bytes
    log_ns: int
    publish_ns: int
    data: bytes
    encoding: str = "cdr"
    schema_encoding: str = "ros2msg"
    metadata: dict[str, str] = field(default_factory=dict)
    sequence: int = 1


def read(file: Path) -> list[Told]:
    """Every message of a whole file in its order."""
    with file.open("rb") as source:
        return [
            Told(
                c.topic, s.name, s.data, m.log_time, m.publish_time, m.data, c.message_encoding, s.encoding, c.metadata
            )
            for s, c, m in SeekingReader(source).iter_messages(log_time_order=False)
            if s is not None
        ]


def write(file: Path, messages: list[Told], chunk_bytes: int = CHUNK_BYTES) -> None:
    """Messages into a whole, indexed file. A type of no name: a channel without schema."""
    with file.open("wb") as sink:
        writer = Writer(sink, chunk_bytes, CompressionType.ZSTD)
        writer.start(profile="ros2", library="hostile")
        schemas: dict[tuple[str, bytes], int] = {("", b""): 0}
        channels: dict[tuple[str, str, str], int] = {}
        for each in messages:
            kind = (each.type_name, each.definition)
            if kind not in schemas:
                schemas[kind] = writer.register_schema(each.type_name, each.schema_encoding, each.definition)
            key = (each.topic, each.type_name, str(sorted(each.metadata.items())))
            if key not in channels:
                channels[key] = writer.register_channel(each.topic, each.encoding, schemas[kind], each.metadata)
            writer.add_message(channels[key], each.log_ns, each.data, each.publish_ns, each.sequence)
        writer.finish()


def edit(file: Path, change: Callable[[Told], Told]) -> None:
    """Write a file again with every message changed."""
    write(file, [change(each) for each in read(file)])


def records(content: bytes) -> list[tuple[int, int, int]]:
    """(opcode, first byte of the content, length) of every record of a whole file."""
    at, found = len(MAGIC), []
    while at + HEAD.size <= len(content) - len(MAGIC):
        opcode, length = HEAD.unpack_from(content, at)
        found.append((opcode, at + HEAD.size, length))
        at += HEAD.size + length
    return found


def chunk(
    packed: bytes, unpacked: int, compression: bytes = b"zstd", crc: int = 0, times: tuple[int, int] = (1, 2)
) -> bytes:
    """One chunk's record, whatever it says of itself."""
    body = struct.pack("<QQQI", *times, unpacked, crc) + struct.pack("<I", len(compression)) + compression
    body += struct.pack("<Q", len(packed)) + packed
    return HEAD.pack(CHUNK, len(body)) + body


def bomb(size: int, told: bool = True, repeat: bytes = b"") -> bytes:
    """A chunk of few bytes that unpacks to many: zeros, or records of no use. told: zstd's head says how many."""
    piece = (repeat or bytes(1)) * ((1 << 20) // max(len(repeat), 1))
    packer = zstandard.ZstdCompressor().compressobj(size=size // len(piece) * len(piece) if told else -1)
    packed = b"".join(packer.compress(piece) for _ in range(size // len(piece))) + packer.flush()
    return chunk(packed, size // len(piece) * len(piece))


def crc(data: bytes) -> int:
    """As MCAP counts it."""
    return zlib.crc32(data)


def insert_before_end(file: Path, extra: bytes) -> None:
    """Put records behind the last chunk; the index behind them no longer fits, so that it goes."""
    content = file.read_bytes()
    (at,) = [start - HEAD.size for opcode, start, _ in records(content) if opcode == DATA_END][:1]
    file.write_bytes(content[:at] + extra)


__all__ = ["Told", "bomb", "chunk", "crc", "edit", "insert_before_end", "read", "records", "replace", "write"]
