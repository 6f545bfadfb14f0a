"""MCAP files played in order of receipt: those of a recording, and of all parts of a session."""

from __future__ import annotations

import heapq
from collections import Counter, deque
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, NamedTuple

from mcap.records import Channel, Schema, Statistics
from mcap.summary import Summary
from sense4hri.files import open_file
from sense4hri_recording import chunks, rosbag2
from sense4hri_recording.layout import find_files
from sense4hri_recording.reader import read_index

from replay.recorded import BagError, Recorded, Topic, one_sentence

BACK_NS = 1_000_000_000
"""A recorder writes what it received within so much, whatever the topic; a chunk that is older tells of a clock."""


class _File(NamedTuple):
    """One file. further: another one was recorded before. begins_part: it is the first one of its recorder."""

    source: IO[bytes]
    summary: Summary
    further: bool
    begins_part: bool


class McapRecording:
    """The files of one or several folders (or one file) as one recording, each message when it was received."""

    def __init__(self, folders: list[Path]) -> None:
        self.path = folders[0]
        self._topics: dict[str, Topic] = {}
        self._files: list[_File] = []
        self.start_ns = self.end_ns = 0
        self.set_back_s = 0.0
        with ExitStack() as opened:
            for folder in folders:
                for number, file in enumerate(find_files(folder)):
                    source = opened.enter_context(open_file(_existing(file)))
                    self._add_file(file, source, begins_part=number == 0)
            self._opened = opened.pop_all()
        self.topics = list(self._topics.values())

    def _add_file(self, file: Path, source: IO[bytes], begins_part: bool) -> None:
        summary, statistics = read_index(file)
        for number, channel in summary.channels.items():
            self._add(channel, summary.schemas.get(channel.schema_id), statistics, number)
        self._files.append(_File(source, summary, bool(self._files), begins_part))
        self._look_back(summary)
        if statistics.message_count:
            first_ns = statistics.message_start_time
            self.start_ns = min(self.start_ns or first_ns, first_ns)
            self.end_ns = max(self.end_ns, statistics.message_end_time)

    def _look_back(self, summary: Summary) -> None:
        """Find chunks, in the order of the file, that hold nothing newer than a second before the newest message."""
        newest_ns = before_ns = self.end_ns
        filled = [index for index in summary.chunk_indexes if index.message_end_time]
        for index in sorted(filled, key=lambda index: index.chunk_start_offset):
            if newest_ns - index.message_end_time > BACK_NS:
                back_ns = newest_ns - min(before_ns, index.message_start_time)
                self.set_back_s = max(self.set_back_s, back_ns / 1e9)
            newest_ns, before_ns = max(newest_ns, index.message_end_time), index.message_start_time

    def _add(self, channel: Channel, schema: Schema | None, statistics: Statistics, number: int) -> None:
        type_name = schema.name if schema else ""
        topic = self._topics.setdefault(channel.topic, Topic(channel.topic, type_name))
        topic.messages += statistics.channel_message_counts.get(number, 0)
        topic.type_hash = topic.type_hash or channel.metadata.get("topic_type_hash", "")
        topic.offers += rosbag2.offers(channel.metadata.get("offered_qos_profiles", ""))
        if channel.message_encoding != "cdr":
            topic.refused = f"its messages are {channel.message_encoding or 'unknown'!r}, not ROS 2's cdr"
        elif topic.type_name != type_name:
            topic.refused = f"it was recorded as {topic.type_name} and as {type_name}"

    def messages(
        self,
        names: Collection[str],
        from_ns: int,
        until_ns: int | None = None,
        held: Mapping[str, Iterable[bytes]] | None = None,
    ) -> Iterator[Recorded]:
        """Transient-local topics stand again at the head of every further file, as they were: they were said once."""
        parts = [self._messages_of(file, names, from_ns, until_ns) for file in self._files]
        said = {name: deque(cdrs, self._topics[name].repeated) for name, cdrs in (held or {}).items()}
        with one_sentence(self.path):
            for recorded, at_head in heapq.merge(*parts, key=lambda part: part[0].log_ns):
                topic = recorded.topic
                if topic.latched:
                    last = said.setdefault(topic.name, deque(maxlen=topic.repeated))
                    if at_head and recorded.cdr in last:
                        continue
                    last.append(recorded.cdr)
                yield recorded

    def _messages_of(
        self, file: _File, names: Collection[str], from_ns: int, until_ns: int | None
    ) -> Iterator[tuple[Recorded, bool]]:
        """Yield the messages of one file, each with whether it may be a repetition of what an earlier file holds.

        Repetitions come first in a file, and bear no number of a publisher's; but a recorder that was started again
        was told them anew by their publishers.
        """
        seen = Counter[str]()
        for channel, message in chunks.by_time(file.source, file.summary, set(names), from_ns, until_ns):
            topic = self._topics[channel.topic]
            seen[topic.name] += 1
            repeated = file.further and (message.sequence == 0 or file.begins_part)
            at_head = repeated and seen[topic.name] <= topic.repeated
            yield Recorded(topic, message.log_time, message.data), at_head

    def close(self) -> None:
        """Close the files."""
        self._opened.close()


def _existing(file: Path) -> Path:
    if not file.is_file():
        raise BagError(f"{file}, which metadata.yaml names, does not exist")
    return file
