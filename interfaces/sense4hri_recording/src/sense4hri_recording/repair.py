"""Makes a recording that was cut off readable by everything again.

    sense4hri-repair RECORDING...

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
from typing import IO, NamedTuple

from mcap import records
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import Writer
from sense4hri.files import open_file
from sense4hri.plain_text import plain

from sense4hri_recording import chunks, rosbag2
from sense4hri_recording.chunks import Budget, Piece
from sense4hri_recording.errors import DAMAGE, LATEST_NS, SessionError
from sense4hri_recording.layout import REPAIRED, file_number, repaired
from sense4hri_recording.reader import read_index
from sense4hri_recording.rosbag2 import Channel, Contents, File

NAMELESS = "its name is no UTF-8, so that metadata.yaml cannot name it: rename it"


class Repaired(NamedTuple):
    """What could be saved. stopped_at: bytes of the damaged file that were understood.

    untimed: messages left out because no clock of ROS shows the time at which they were received.
    """

    path: Path
    contents: Contents
    chunks: int
    damaged_chunks: int
    stopped_at: int
    size: int
    untimed: int

    @property
    def messages(self) -> int:
        """How many messages were saved."""
        return self.contents.file.messages

    @property
    def told(self) -> str:
        """What could be saved and what could not, in words."""
        lost = f", {self.untimed} messages left out that were received when no clock shows" if self.untimed else ""
        return (
            f"{self.messages} messages saved in {self.chunks} chunks, {self.damaged_chunks} damaged, "
            f"{self.size - self.stopped_at} bytes at the end not understood{lost}"
        )


def repair(damaged: Path) -> Repaired:
    """Copy every whole chunk of an MCAP file into `<name>_repaired.mcap`.

    Raises ValueError where none can be, the disk refuses or what was written cannot be read back; then nothing is left.
    """
    target = repaired(damaged)
    with open_file(damaged) as source, target.open("xb") as sink:
        try:
            copy = _Copy(sink)
            stopped_at = _copy_chunks(source, copy)
            copy.writer.finish()
            sink.flush()
            os.fsync(sink.fileno())
            reread = _readable(target)
            if reread != copy.messages or reread == 0:
                raise ValueError(f"{copy.messages} messages were found and {reread} could be read back")
            size = damaged.stat().st_size
            return Repaired(target, contents(target), copy.chunks, copy.damaged, stopped_at, size, copy.untimed)
        except (*DAMAGE, SessionError) as err:
            target.unlink()
            raise ValueError(f"{damaged}: {err or type(err).__name__}") from err


def _readable(path: Path) -> int:
    """How many messages a reader finds that checks every checksum."""
    with path.open("rb") as file:
        return sum(1 for _ in chunks.messages(file, read_index(path)[0]))


def contents(path: Path) -> Contents:
    """What a whole file says it holds. Raises ValueError where it has no index."""
    try:
        summary, statistics = read_index(path)
    except SessionError as err:
        raise ValueError(str(err)) from err
    messages = {
        Channel(
            channel.topic,
            summary.schemas[channel.schema_id].name,
            channel.metadata.get("topic_type_hash", ""),
            rosbag2.offers(channel.metadata.get("offered_qos_profiles", "")),
        ): statistics.channel_message_counts.get(channel.id, 0)
        for channel in summary.channels.values()
        if channel.schema_id in summary.schemas
    }
    first_ns, last_ns = statistics.message_start_time, statistics.message_end_time
    return Contents(File(path.name, first_ns, last_ns, statistics.message_count), messages)


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
        self.messages = self.chunks = self.damaged = self.untimed = 0
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}

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
            if record.log_time > LATEST_NS:
                self.untimed += 1
                return
            number = self._channels[record.channel_id]
            self.writer.add_message(number, record.log_time, record.data, record.publish_time, record.sequence)
            self.messages += 1


def _copy_chunks(source: IO[bytes], copy: _Copy) -> int:
    """Read until the end or to where the file makes no sense any more; returns how far that is, in bytes."""
    budget, understood = Budget(chunks.size_of(source)), 0
    try:
        for piece in chunks.pieces(source):
            understood = piece.at
            _copy_piece(piece, budget, copy)
    except McapError:
        return understood
    return chunks.size_of(source)


def _copy_piece(piece: Piece, budget: Budget, copy: _Copy) -> None:
    """Take every record of one piece over, or none of it where it is damaged."""
    is_chunk = piece.opcode == Opcode.CHUNK
    try:
        found = list(chunks.records(piece, budget))
    except DAMAGE:
        copy.damaged += is_chunk
        return
    copy.chunks += is_chunk
    for record in found:
        copy.record(record)


def _is_utf8(name: str) -> bool:
    return name == name.encode("utf-8", "ignore").decode()


class Outcome(NamedTuple):
    """Of a folder: what was repaired, what went wrong, and the files that are whole now, in their order."""

    done: list[Repaired]
    failures: list[str]
    found: list[Contents]


def repair_folder(folder: Path) -> Outcome:
    """Repair every file of a recording that is not whole, and make metadata.yaml describe what there is.

    A file that was repaired before is left alone. Raises OSError where metadata.yaml cannot be written.
    """
    done: list[Repaired] = []
    failures: list[str] = []
    found: list[Contents] = []
    files = sorted(folder.glob("*.mcap"), key=lambda path: (file_number(path), path.name))
    for file in (path for path in files if not path.stem.endswith(REPAIRED)):
        copy = repaired(file)
        try:
            found.append(contents(copy if copy.is_file() else file))
            continue
        except (ValueError, OSError):
            pass
        try:
            copy.unlink(missing_ok=True)  # not finished, the repair was killed too
            done.append(repair(file))
            found.append(done[-1].contents)
        except (ValueError, OSError, McapError) as err:
            failures.append(f"{file}: not repaired: {err}")
    if found:
        point_metadata(folder, found)
    failures += [f"{folder / each.file.name}: {NAMELESS}" for each in found if not _is_utf8(each.file.name)]
    return Outcome(done, failures, found)


def main(arguments: list[str] | None = None) -> int:
    """Repair what is named; 1 where something could not be saved."""
    parser = argparse.ArgumentParser(prog="sense4hri-repair", description=__doc__.partition("\n")[0])
    parser.add_argument("recording", nargs="+", type=Path, help="folder of a recording, or one .mcap file")
    status = 0
    for path in parser.parse_args(arguments).recording:
        try:
            done, failures, _ = repair_folder(path) if path.is_dir() else Outcome([repair(path)], [], [])
        except (ValueError, OSError, McapError) as err:
            done, failures = [], [f"{path}: not repaired: {err}"]
        if path.is_dir() and not any(path.glob("*.mcap")):
            failures.append(f"{path}: no .mcap file here")
        for failure in failures:
            print(plain(failure), file=sys.stderr)
            status = 1
        for one in done:
            print(plain(f"{one.path}: {one.told}"))
    return status


if __name__ == "__main__":
    sys.exit(main())
