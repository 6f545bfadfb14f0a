"""One withdrawal from one folder: looking for a pseudonym in all that is there, and taking it out."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message
from sense4hri.files import open_file, sync
from sense4hri.names import ROOT, UNASSIGNED, StreamName
from sense4hri_recording import chunks, recorder_json, repair, rosbag2
from sense4hri_recording.errors import DAMAGE, REPAIR, SessionError
from sense4hri_recording.reader import Reader, Record
from tqdm import tqdm

from sense4hri_session import journal, undecided
from sense4hri_session.journal import JOURNAL, Journal
from sense4hri_session.leftovers import (
    OURS,
    REPORTS,
    free_target,
    has_report,
    leftovers,
    move,
    new_names,
    remove_empty,
    shared_above,
    strangers,
)
from sense4hri_session.links import refuse_folders, refuse_links
from sense4hri_session.recorder_without import without
from sense4hri_session.rewrite import Change
from sense4hri_session.traces import Evidence, Node, Traces, texts
from sense4hri_session.withdrawn import MADE_ANEW, Withdrawn

MOST_LONGER = 20  # names told of, in which the pseudonym is a part


class Withdrawal:
    """Looks first, then changes. also: globs of topics to remove besides. progress: show a bar.

    resumed: one that was cut short here is gone on with. Raises SessionError where the recording is damaged, holds
    links or folders in its files' places, or another pseudonym's withdrawal was cut short here.
    """

    def __init__(self, folder: Path, human_id: str, also: tuple[str, ...], progress: bool) -> None:
        self.folder, self.human_id, self.progress = folder, human_id, progress
        refuse_links(folder)
        begun = journal.begun(folder, human_id)
        self.resumed = begun is not None
        self.journal = begun or Journal(human_id)
        self.also = (*also, *(glob for glob in self.journal.also if glob not in also))
        self.reader = Reader(folder, may_be_empty=True)
        refuse_folders(folder, (*OURS, *(file.name for file in self.reader.files)))
        self.about = recorder_json.read(folder)
        self.shared: set[Node] = set()
        self.unread: dict[str, str] = {}  # topics that would tell who belongs to whom, and why they do not
        self.traces = self._traces()
        self.affected: dict[Path, bool] = {}
        self.longer: dict[str, str] = {}

    def look(self) -> Withdrawn:
        """Find everything, change nothing."""
        found = Withdrawn(self.folder, free_target(self.folder, self.traces))
        total = sum(topic.messages for topic in self.reader.topics.values())
        with tqdm(total=total, unit=" messages", desc=f"{self.folder.name}: looking", disable=not self.progress) as bar:
            for file in self.reader.files:
                self.affected[file] = self._look_into(file, found, bar)
        self._look_at_files(found)
        found.undecided += self._undecided()
        return found

    def change(self, found: Withdrawn, before_rename: Callable[[], None]) -> None:
        """Take everything out; may be cut short anywhere and begun again. before_rename: called before the folder's."""
        ids = tuple(sorted(self.traces.ids))
        Journal(self.human_id, ids, self.also, self._has_report()).write(self.folder)
        for file in [file for file, has in self.affected.items() if has]:
            self._rewrite(file)
        for path in leftovers(self.folder, self.reader.files):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        self._clean_about(found)
        self._clean_metadata()
        if found.now != self.folder:
            self._rename_files()
            before_rename()
            move(self.folder, found.now)
        if found.now != self.folder or self.resumed:
            remove_empty(found.now.parent.parent, self.traces)
        (found.now / JOURNAL).unlink()
        sync(found.now)

    def _traces(self) -> Traces:
        evidence = Evidence()
        for record in self.reader.messages([topic for topic in self.reader.topics if Evidence.wanted(topic)]):
            message = self.reader.decoded(record)
            try:
                if message is not None:
                    evidence.add(record.topic, message)
            except (AttributeError, TypeError) as err:
                self.unread[record.topic] = f"it is not of the type its name says ({err})"
        self.unread |= self.reader.undecodable
        humans = self._named(f"{ROOT}/", 3) | set(evidence.worn)
        humans |= {str(name) for name in (self.about.session or {}).get("human_ids") or []}
        humans -= {UNASSIGNED, self.human_id, ""}
        self.tied = evidence.tied()
        own, self.shared = evidence.ids_of(self.human_id, humans, self._named("/humans/persons/", 3))
        parsed = [found for topic in self.reader.topics if (found := StreamName.parse(topic))]
        self.sensors = evidence.worn.get(self.human_id, set())
        self.sensors |= {name.sensor_id for name, _ in parsed if name.human_id == self.human_id}
        return Traces(self.human_id, own | set(self.journal.ids), humans, self.also)

    def _named(self, beginning: str, place: int) -> set[str]:
        """The parts at one place of all topics that begin so."""
        split = [topic.split("/") for topic in self.reader.topics if topic.startswith(beginning)]
        return {parts[place] for parts in split if len(parts) > place + 1}

    def _look_into(self, file: Path, found: Withdrawn, bar: Any) -> bool:
        """Count what is in one file; True where it has to be written anew."""
        before = found.removed.total() + found.changed.total()
        for channel, message in self._messages(file):
            bar.update()
            data = None if self.traces.owns_topic(channel.topic) else self._without(channel, message)
            if data is None:
                found.removed[channel.topic] += 1
            elif data is not message.data:
                found.changed[channel.topic] += 1
        channels = self.reader.summaries[file].channels.values()
        named = any(self.traces.owns_topic(channel.topic) for channel in channels)
        return named or found.removed.total() + found.changed.total() > before

    def _messages(self, file: Path) -> Iterator[tuple[Channel, Message]]:
        try:
            with file.open("rb") as source:
                yield from chunks.messages(source, self.reader.summaries[file])
        except DAMAGE as err:
            raise SessionError(f"{file} is damaged ({err}): {REPAIR}") from err

    def _without(self, channel: Channel, message: Message) -> bytes | None:
        """The message's bytes, other ones without the pseudonym, or None where nothing of it may stay."""
        data = message.data
        if len(data) > 1 and data[1] & 1 and not self.traces.may_be_in(data):
            return data
        topic = self.reader.topics.get(channel.topic)
        if topic is None:  # not ROS 2: nothing tells where its texts are
            return None if self.traces.may_be_in(data) else data
        try:
            before = self.reader.decode(Record(channel.topic, message.log_time, message.publish_time, data))
        except SessionError:
            return None if self.traces.may_be_in(data) else data
        after = self.traces.without(before, topic.type_name)
        if after is None:
            return None
        if after is before:
            self._note(channel.topic, before)
            return data
        return self.reader.encode(channel.topic, after)

    def _note(self, topic: str, message: Any) -> None:
        """Remember where the pseudonym is only a part of a longer name."""
        for text in texts(message):
            if len(self.longer) < MOST_LONGER and self.traces.half_mentions(text):
                self.longer.setdefault(text, topic)

    def _is_clean(self, channel: Channel, message: Message) -> bool:
        """True where a message of the new file has no trace; numbers may by chance have the bytes of a name."""
        if not self.traces.may_be_in(message.data):
            return True
        topic = self.reader.topics.get(channel.topic)
        if topic is None:
            return False
        record = Record(channel.topic, message.log_time, message.publish_time, message.data)
        return not self.traces.is_in(self.reader.decode(record), topic.type_name)

    def _rewrite(self, file: Path) -> None:
        summary = self.reader.summaries[file]
        count = summary.statistics.message_count if summary.statistics else 0
        about = {"total": 2 * count, "unit": " messages", "desc": file.name, "disable": not self.progress}
        with tqdm(**about) as bar:
            change = Change(self.traces.owns_topic, self._without, self._is_clean, bar.update)
            try:
                change.replace(file, summary)
            except OSError as err:
                raise SessionError(f"{file} was not changed: {err.strerror or err}") from err

    def _has_report(self) -> bool:
        return self.journal.report or has_report(self.folder)

    def _look_at_files(self, found: Withdrawn) -> None:
        if without(self.about, self.traces) != self.about:
            found.files.append(f"changed  {recorder_json.NAME}")
        if not (found or self.resumed):
            return
        for path in leftovers(self.folder, self.reader.files):
            if path.name not in REPORTS:
                why = "an export" if path.is_dir() else "what is in it is in a file of the recording too"
                found.files.append(f"deleted  {path.name}: {why}")
        if self._has_report():
            found.files.append(MADE_ANEW)

    def _undecided(self) -> Iterator[str]:
        """What may be the pseudonym's and cannot be told."""
        for path in strangers(self.folder, self.reader.files):
            if _mentions(path, self.traces):
                yield f"{path.name}: not a file of the recording, it mentions the pseudonym"
        if above := shared_above(self.folder, self.traces):
            yield f"{above}: the folder of a copy to be shared is called after the pseudonym; rename it"
        path = self.folder / recorder_json.NAME
        if self.about.trouble and not self.about.state and path.is_file() and _mentions(path, self.traces):
            yield f"{path.name}: it is damaged, and mentions the pseudonym"
        topics = self.reader.topics.values()
        yield from undecided.while_unassigned(topics, self.traces, self.sensors)
        yield from undecided.of_several(topics, self.shared)
        yield from undecided.of_nobody(topics, self.traces, self.tied)
        yield from undecided.of_anyone(topics, self.traces)
        yield from undecided.of_unread(self.unread, self.traces)
        for text, topic in self.longer.items():
            yield f"{text!r} on {topic}: a longer name with the pseudonym in it"

    def _clean_about(self, found: Withdrawn) -> None:
        made = without(self.about, self.traces)
        if not (self.folder / recorder_json.NAME).is_file() or (made == self.about and not found.removed):
            return
        what = f"a participant was withdrawn: {found.removed.total()} messages removed, {found.changed.total()} changed"
        made.events.append({"at_ns": time.time_ns(), "what": what})
        recorder_json.write(self.folder, made)

    def _clean_metadata(self) -> None:
        if (self.folder / rosbag2.NAME).is_file():
            distro = rosbag2.distro(self.folder)
            rosbag2.describe(self.folder, [repair.contents(file) for file in self.reader.files], distro)

    def _rename_files(self) -> None:
        """Those that are called after the folder."""
        renamed = new_names(self.reader.files, self.traces)
        if renamed:
            self.reader.files = [renamed.get(file, file) for file in self.reader.files]
            self._clean_metadata()
            for old in renamed:
                old.unlink()


def _mentions(path: Path, traces: Traces) -> bool:
    """True where a file may mention the pseudonym, looked at piece by piece."""
    before = b""
    with open_file(path) as file:
        while piece := file.read(1 << 20):
            if traces.may_be_in(before + piece):
                return True
            before = piece[-1000:]
    return False
