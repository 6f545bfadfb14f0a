"""Makes a recording that was cut off readable by everything again.

    python -m recorder.repair RECORDING...

RECORDING is a folder of the recorder or an `.mcap` file. The damaged file is never changed: `<name>_repaired.mcap`
is written beside it, chunk by chunk and only where the checksum is right, then read back before metadata.yaml is
pointed at it.
"""

from __future__ import annotations

import argparse
import struct
import sys
from pathlib import Path
from typing import IO, NamedTuple

import yaml
import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from recorder import bag

LARGEST_RECORD = 1 << 30
# what damaged bytes make the reader and the decompressors raise
DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    LookupError,
    MemoryError,
    RuntimeError,
)


class Repaired(NamedTuple):
    """What could be saved. stopped_at: bytes of the damaged file that were understood."""

    path: Path
    messages: int
    chunks: int
    damaged_chunks: int
    stopped_at: int
    size: int
    channels: list[bag.Channel]
    first_ns: int
    last_ns: int


def repair(damaged: Path) -> Repaired:
    """Copy every whole chunk of an MCAP file into `<name>_repaired.mcap`. Raises ValueError where none can be."""
    target = damaged.with_name(f"{damaged.stem}_repaired.mcap")
    with damaged.open("rb") as source, target.open("xb") as sink:
        copy = _Copy(sink)
        stopped_at = _copy_chunks(source, copy)
        copy.writer.finish()
    with target.open("rb") as file:
        reread = sum(1 for _ in SeekingReader(file, validate_crcs=True).iter_messages())
    if reread != copy.messages or reread == 0:
        target.unlink()
        raise ValueError(f"{damaged}: {copy.messages} messages were found and {reread} could be read back")
    return Repaired(
        target,
        copy.messages,
        copy.chunks,
        copy.damaged,
        stopped_at,
        damaged.stat().st_size,
        list(copy.channels.values()),
        copy.first_ns,
        copy.last_ns,
    )


class _Copy:
    """A new file, with schemas and channels numbered afresh."""

    def __init__(self, sink: IO[bytes]) -> None:
        self.writer = Writer(sink)
        self.writer.start(profile="ros2", library="sense4hri recorder.repair")
        self.messages = self.chunks = self.damaged = self.first_ns = self.last_ns = 0
        self.channels: dict[int, bag.Channel] = {}
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        self._types: dict[int, str] = {}

    def chunk(self, chunk: Chunk) -> None:
        """Take every record of one chunk over, or none of it where it is damaged."""
        try:
            records = breakup_chunk(chunk, validate_crc=True)
        except DAMAGE:
            self.damaged += 1
            return
        self.chunks += 1
        for record in records:
            self.record(record)

    def record(self, record: object) -> None:
        if isinstance(record, Schema) and record.id not in self._schemas:
            self._types[record.id] = record.name
            self._schemas[record.id] = self.writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in self._channels and record.schema_id in self._schemas:
            qos = yaml.safe_load(record.metadata.get("offered_qos_profiles", "")) or []
            type_hash = record.metadata.get("topic_type_hash", "")
            type_name = self._types.get(record.schema_id, "")
            self.channels[record.id] = bag.Channel(record.id, record.topic, type_name, type_hash, qos)
            self._channels[record.id] = self.writer.register_channel(
                record.topic, record.message_encoding, self._schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, Message) and record.channel_id in self._channels:
            number = self._channels[record.channel_id]
            self.writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
            self.channels[record.channel_id].messages += 1
            self.messages += 1
            self.first_ns = min(self.first_ns or record.log_time, record.log_time)
            self.last_ns = max(self.last_ns, record.log_time)


def _copy_chunks(source: IO[bytes], copy: _Copy) -> int:
    """Read until the end or to where the file makes no sense any more; returns how far that is, in bytes."""
    records = StreamReader(source, emit_chunks=True, record_size_limit=LARGEST_RECORD).records
    understood = 0
    while True:
        try:
            record = next(records)
        except StopIteration:
            return source.tell()
        except DAMAGE:
            return understood
        understood = source.tell()
        if isinstance(record, Chunk):
            copy.chunk(record)
        elif isinstance(record, Schema | Channel | Message):
            copy.record(record)


def point_metadata(folder: Path, repaired: Repaired) -> None:
    """Make a folder's metadata.yaml describe the repaired file; the old one is kept as metadata.yaml.damaged."""
    path = folder / "metadata.yaml"
    distro = "jazzy"
    if path.is_file():
        old = yaml.safe_load(path.read_text("utf-8")) or {}
        distro = old.get("rosbag2_bagfile_information", {}).get("ros_distro", distro)
        path.rename(folder / "metadata.yaml.damaged")
    about = (repaired.first_ns, repaired.last_ns, repaired.messages, distro)
    bag.write_metadata(folder, bag.metadata(repaired.path.name, repaired.channels, *about))


def main(arguments: list[str] | None = None) -> int:
    """Repair what is named; 1 where something could not be saved."""
    parser = argparse.ArgumentParser(prog="recorder.repair", description=__doc__.partition("\n")[0])
    parser.add_argument("recording", nargs="+", type=Path)
    status = 0
    for path in parser.parse_args(arguments).recording:
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        damaged = [file for file in files if not file.stem.endswith("_repaired")]
        if not damaged:
            print(f"{path}: no .mcap file here", file=sys.stderr)
            status = 1
        for file in damaged:
            try:
                done = repair(file)
            except (ValueError, OSError, McapError) as err:
                print(f"{file}: not repaired: {err}", file=sys.stderr)
                status = 1
                continue
            if path.is_dir() and len(damaged) == 1:
                point_metadata(path, done)
            print(
                f"{done.path}: {done.messages} messages in {done.chunks} chunks, {done.damaged_chunks} damaged, "
                f"{done.size - done.stopped_at} bytes at the end not understood"
            )
    return status


if __name__ == "__main__":
    sys.exit(main())
