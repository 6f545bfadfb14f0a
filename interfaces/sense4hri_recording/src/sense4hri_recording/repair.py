"""Makes a recording that was cut off readable by everything again.

    python -m sense4hri_recording.repair RECORDING...

RECORDING is a folder of the recorder or an `.mcap` file. The damaged file is never changed: `<name>_repaired.mcap`
is written beside it, chunk by chunk and only where the checksum is right, then read back before metadata.yaml is
pointed at it.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import yaml
from mcap import records
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from sense4hri_recording import rosbag2
from sense4hri_recording.errors import DAMAGE, LARGEST_RECORD
from sense4hri_recording.layout import REPAIRED, file_number, repaired
from sense4hri_recording.rosbag2 import Channel, Contents, File


class Repaired(NamedTuple):
    """What could be saved. stopped_at: bytes of the damaged file that were understood."""

    path: Path
    contents: Contents
    chunks: int
    damaged_chunks: int
    stopped_at: int
    size: int

    @property
    def messages(self) -> int:
        """How many messages were saved."""
        return self.contents.file.messages


def repair(damaged: Path) -> Repaired:
    """Copy every whole chunk of an MCAP file into `<name>_repaired.mcap`.

    Raises ValueError where none can be, the disk refuses or what was written cannot be read back; then nothing is left.
    """
    target = repaired(damaged)
    with damaged.open("rb") as source, target.open("xb") as sink:
        try:
            copy = _Copy(sink)
            stopped_at = _copy_chunks(source, copy)
            copy.writer.finish()
            sink.flush()
            os.fsync(sink.fileno())
            reread = _readable(target)
            if reread != copy.messages or reread == 0:
                raise ValueError(f"{copy.messages} messages were found and {reread} could be read back")
            return Repaired(target, contents(target), copy.chunks, copy.damaged, stopped_at, damaged.stat().st_size)
        except DAMAGE as err:
            target.unlink()
            raise ValueError(f"{damaged}: {err or type(err).__name__}") from err


def _readable(path: Path) -> int:
    """How many messages a reader finds that checks every checksum."""
    with path.open("rb") as file:
        return sum(1 for _ in SeekingReader(file, validate_crcs=True).iter_messages())


def contents(path: Path) -> Contents:
    """What a whole file says it holds. Raises ValueError where it has no index."""
    with path.open("rb") as file:
        try:
            summary = SeekingReader(file, validate_crcs=True).get_summary()
        except DAMAGE as err:
            raise ValueError(f"{path}: {err or type(err).__name__}") from err
    if summary is None or summary.statistics is None:
        raise ValueError(f"{path}: it has no index")
    statistics = summary.statistics
    messages = {
        Channel(
            channel.topic,
            summary.schemas[channel.schema_id].name,
            channel.metadata.get("topic_type_hash", ""),
            _qos(channel.metadata.get("offered_qos_profiles", "")),
        ): statistics.channel_message_counts.get(channel.id, 0)
        for channel in summary.channels.values()
        if channel.schema_id in summary.schemas
    }
    first_ns, last_ns = statistics.message_start_time, statistics.message_end_time
    return Contents(File(path.name, first_ns, last_ns, statistics.message_count), messages)


def _qos(text: str) -> list[dict[str, Any]]:
    """QoS as a channel carries it; none where that is damaged."""
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        return []
    return found if isinstance(found, list) else []


def point_metadata(folder: Path, found: Sequence[Contents]) -> None:
    """Make a folder's metadata.yaml describe these files; the old one is kept as metadata.yaml.damaged."""
    path, distro = folder / rosbag2.NAME, rosbag2.distro(folder)
    if path.is_file():
        path.replace(folder / f"{rosbag2.NAME}.damaged")
    rosbag2.describe(folder, found, distro)


class _Copy:
    """A new file, with schemas and channels numbered afresh."""

    def __init__(self, sink: IO[bytes]) -> None:
        self.writer = Writer(sink)
        self.writer.start(profile="ros2", library="sense4hri sense4hri_recording.repair")
        self.messages = self.chunks = self.damaged = 0
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}

    def chunk(self, chunk: records.Chunk) -> None:
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
        if isinstance(record, records.Schema) and record.id not in self._schemas:
            self._schemas[record.id] = self.writer.register_schema(record.name, record.encoding, record.data)
        elif (
            isinstance(record, records.Channel)
            and record.id not in self._channels
            and record.schema_id in self._schemas
        ):
            self._channels[record.id] = self.writer.register_channel(
                record.topic, record.message_encoding, self._schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, records.Message) and record.channel_id in self._channels:
            number = self._channels[record.channel_id]
            self.writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
            self.messages += 1


def _copy_chunks(source: IO[bytes], copy: _Copy) -> int:
    """Read until the end or to where the file makes no sense any more; returns how far that is, in bytes."""
    stream = StreamReader(source, emit_chunks=True, record_size_limit=LARGEST_RECORD).records
    understood = 0
    while True:
        try:
            record = next(stream)
        except StopIteration:
            return source.tell()
        except DAMAGE:
            return understood
        understood = source.tell()
        if isinstance(record, records.Chunk):
            copy.chunk(record)
        elif isinstance(record, records.Schema | records.Channel | records.Message):
            copy.record(record)


class Outcome(NamedTuple):
    """Of a folder: what was repaired, what went wrong, and the files that are whole now, in their order."""

    done: list[Repaired]
    failures: list[str]
    found: list[Contents]


def repair_folder(folder: Path) -> Outcome:
    """Repair every file of a recording that is not whole, and make metadata.yaml describe what there is.

    A file that was repaired before is left alone.
    """
    done: list[Repaired] = []
    failures: list[str] = []
    found: list[Contents] = []
    files = sorted(folder.glob("*.mcap"), key=lambda path: (file_number(path), path.name))
    for file in (path for path in files if not path.stem.endswith(REPAIRED)):
        copy = repaired(file)
        try:
            found.append(contents(copy if copy.exists() else file))
            continue
        except (ValueError, OSError):
            copy.unlink(missing_ok=True)  # not finished, the repair was killed too
        try:
            done.append(repair(file))
            found.append(done[-1].contents)
        except (ValueError, OSError, McapError) as err:
            failures.append(f"{file}: not repaired: {err}")
    if found:
        point_metadata(folder, found)
    return Outcome(done, failures, found)


def main(arguments: list[str] | None = None) -> int:
    """Repair what is named; 1 where something could not be saved."""
    parser = argparse.ArgumentParser(prog="sense4hri_recording.repair", description=__doc__.partition("\n")[0])
    parser.add_argument("recording", nargs="+", type=Path)
    status = 0
    for path in parser.parse_args(arguments).recording:
        if path.is_dir():
            done, failures, _ = repair_folder(path)
            if not done and not failures:
                failures = [] if any(path.glob("*.mcap")) else [f"{path}: no .mcap file here"]
        else:
            done, failures = [], []
            try:
                done.append(repair(path))
            except (ValueError, OSError, McapError) as err:
                failures.append(f"{path}: not repaired: {err}")
        for failure in failures:
            print(failure, file=sys.stderr)
            status = 1
        for one in done:
            print(
                f"{one.path}: {one.messages} messages in {one.chunks} chunks, {one.damaged_chunks} damaged, "
                f"{one.size - one.stopped_at} bytes at the end not understood"
            )
    return status


if __name__ == "__main__":
    sys.exit(main())
