"""`sense4hri-withdraw --human p1 RECORDINGS...`: everything of a pseudonym out of recorded sessions.

Every file is written anew, read back and only then put in the old one's place. A withdrawal that is cut short leaves
each file whole, old or new, and `.withdrawal.json` beside them; the same command again finishes it.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message
from sense4hri.names import ROOT, UNASSIGNED, StreamName, is_human_id
from sense4hri_recording import chunks, layout, recorder_json, repair, rosbag2
from sense4hri_recording.errors import DAMAGE, SessionError
from sense4hri_recording.files import replace_file, sync
from sense4hri_recording.lock import Lock
from sense4hri_recording.reader import Reader, Record
from sense4hri_recording.recorder_json import RecorderJson
from tqdm import tqdm

from sense4hri_session.rewrite import Change
from sense4hri_session.traces import Evidence, Node, Traces, texts

JOURNAL = ".withdrawal.json"
REPORTS = (layout.REPORT_JSON, layout.REPORT_HTML)
KNOWN = frozenset({rosbag2.NAME, recorder_json.NAME, layout.LOCK, JOURNAL, layout.RESERVE, *REPORTS})
MADE_ANEW = f"anew     {' and '.join(REPORTS)}"
MAY_SHOW = ("Image", "CompressedImage", "AudioData", "AudioDataStamped", "PointCloud2")


@dataclass
class Withdrawn:
    """What was found of a pseudonym in one folder, and removed unless it was only looked for."""

    folder: Path
    now: Path
    removed: Counter[str] = field(default_factory=Counter)
    changed: Counter[str] = field(default_factory=Counter)
    files: list[str] = field(default_factory=list)
    undecided: list[str] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.removed or self.changed or self.files or self.now != self.folder)

    def lines(self) -> Iterator[str]:
        """The account, a line each."""
        yield f"{self.folder}:"
        for topic, count in sorted(self.removed.items()):
            yield f"  removed  {count} messages of {topic}"
        for topic, count in sorted(self.changed.items()):
            yield f"  changed  {count} messages of {topic}: only what concerns the pseudonym is gone"
        yield from (f"  {line}" for line in self.files)
        if self.now != self.folder:
            yield f"  renamed  to {self.now}"
        yield from (f"  left     {line}" for line in self.undecided)


def withdraw(
    folder: Path, human_id: str, also: tuple[str, ...] = (), dry_run: bool = False, progress: bool = False
) -> Withdrawn:
    """Remove everything of a pseudonym from one recording. also: globs of topics to remove besides.

    Raises SessionError where it is being recorded, is damaged, or another pseudonym's withdrawal was cut short there.
    """
    lock, now = _lock(folder), folder
    try:
        work = _Work(folder, human_id, also, progress)
        found = work.look()
        if dry_run or not (found or work.resumed):
            return found
        work.change(found)
        now = found.now
    finally:
        lock.release()
        if not lock.found:
            (now / layout.LOCK).unlink(missing_ok=True)
    _report(found)
    return found


class _Work:
    def __init__(self, folder: Path, human_id: str, also: tuple[str, ...], progress: bool) -> None:
        self.folder, self.human_id, self.progress = folder, human_id, progress
        self.journal = _journal(folder)
        self.resumed = bool(self.journal)
        if self.resumed and self.journal["human_id"] != human_id:
            other = self.journal["human_id"]
            raise SessionError(f"{folder}: the withdrawal of {other} was cut short here; finish that one first")
        also = (*also, *(glob for glob in self.journal.get("also", ()) if glob not in also))
        self.also = also
        self.reader = Reader(folder, may_be_empty=True)
        self.about = recorder_json.read(folder)
        self.shared: set[Node] = set()
        self.traces = self._traces()
        self.counts: dict[Path, bool] = {}
        self.longer: dict[str, str] = {}

    def look(self) -> Withdrawn:
        """Find everything, change nothing."""
        found = Withdrawn(self.folder, self._target())
        total = sum(topic.messages for topic in self.reader.topics.values())
        with tqdm(total=total, unit=" messages", desc=f"{self.folder.name}: looking", disable=not self.progress) as bar:
            for file in self.reader.files:
                before = found.removed.total() + found.changed.total()
                for channel, message in self._messages(file):
                    bar.update()
                    data = None if self.traces.owns_topic(channel.topic) else self._without(channel, message)
                    if data is None:
                        found.removed[channel.topic] += 1
                    elif data is not message.data:
                        found.changed[channel.topic] += 1
                named = any(self.traces.owns_topic(channel.topic) for channel in self._channels(file))
                self.counts[file] = named or found.removed.total() + found.changed.total() > before
        self._look_at_files(found)
        found.undecided += self._undecided(found)
        return found

    def change(self, found: Withdrawn) -> None:
        """Take everything out; may be cut short anywhere and begun again."""
        ids = sorted(self.traces.ids)
        about = {"human_id": self.human_id, "ids": ids, "also": list(self.also), "target": str(found.now)}
        replace_file(self.folder / JOURNAL, json.dumps(about | {"report": self._has_report()}, ensure_ascii=False))
        for file in [file for file, has in self.counts.items() if has]:
            self._rewrite(file)
        for path in self._leftovers():
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        self._clean_about(found)
        self._clean_metadata()
        self._rename(found)
        (found.now / JOURNAL).unlink()
        sync(found.now)

    def _traces(self) -> Traces:
        evidence, humans = Evidence(), set()
        for record in self.reader.messages([topic for topic in self.reader.topics if Evidence.wanted(topic)]):
            evidence.add(record.topic, self.reader.decode(record))
        persons = set()
        for topic in self.reader.topics:
            parts = topic.split("/")
            if topic.startswith(f"{ROOT}/") and len(parts) > 3:
                humans.add(parts[3])
            if topic.startswith("/humans/persons/") and len(parts) > 4:
                persons.add(parts[3])
        humans |= set(evidence.worn) | {str(name) for name in (self.about.session or {}).get("human_ids") or []}
        humans -= {UNASSIGNED, self.human_id, ""}
        self.tied = evidence.tied()
        own, self.shared = evidence.ids_of(self.human_id, humans, persons)
        own |= {(str(kind), str(name)) for kind, name in self.journal.get("ids", ())}
        self.sensors = evidence.worn.get(self.human_id, set())
        self.sensors |= {
            p[0].sensor_id for t in self.reader.topics if (p := StreamName.parse(t)) and p[0][0] == self.human_id
        }
        return Traces(self.human_id, own, humans, self.also)

    def _messages(self, file: Path) -> Iterator[tuple[Channel, Message]]:
        try:
            with file.open("rb") as source:
                yield from chunks.messages(source, self.reader.summaries[file])
        except DAMAGE as err:
            raise SessionError(
                f"{file} is damaged ({err}): repair it first, `python -m sense4hri_recording.repair`"
            ) from err

    def _channels(self, file: Path) -> list[Channel]:
        return list(self.reader.summaries[file].channels.values())

    def _without(self, channel: Channel, message: Message) -> bytes | None:
        """The message's bytes, other ones without the pseudonym, or None where nothing of it may stay."""
        data = message.data
        if len(data) > 1 and data[1] & 1 and not self.traces.bytes.search(data):
            return data
        topic = self.reader.topics.get(channel.topic)
        if topic is None:  # not ROS 2: nothing tells where its texts are
            return None if self.traces.bytes.search(data) else data
        try:
            before = self.reader.decode(Record(channel.topic, message.log_time, message.publish_time, data))
        except SessionError:
            return None if self.traces.bytes.search(data) else data
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
            if len(self.longer) < 20 and self.traces.half_mentions(text):
                self.longer.setdefault(text, topic)

    def _is_clean(self, channel: Channel, message: Message) -> bool:
        """True where a message of the new file has no trace; numbers may by chance have the bytes of a name."""
        if not self.traces.bytes.search(message.data):
            return True
        if channel.topic not in self.reader.topics:
            return False
        record = Record(channel.topic, message.log_time, message.publish_time, message.data)
        return not self.traces.is_in(self.reader.decode(record))

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

    def _target(self) -> Path:
        """Where the folder belongs afterwards; never one that exists."""
        folder = self.folder.resolve()
        if self.journal.get("target"):
            target = Path(self.journal["target"])
            return self.folder if target in (folder, self.folder) else target
        people, name = self.traces.path_without(folder.parent.name), self.traces.name_without(folder.name)
        if (people, name) == (folder.parent.name, folder.name):
            return self.folder
        target, number = folder.parent.parent / people / name, 0
        while target.exists():
            number += 1
            target = target.with_name(f"{name}_{number}")
        return target

    def _look_at_files(self, found: Withdrawn) -> None:
        if self._about_without() != self.about:
            found.files.append(f"changed  {recorder_json.NAME}")
        if found or self.resumed:
            for path in self._leftovers():
                if path.name not in REPORTS:
                    why = "an export" if path.is_dir() else "what is in it is in a file of the recording too"
                    found.files.append(f"deleted  {path.name}: {why}")
            if self._has_report():
                found.files.append(MADE_ANEW)
        known = KNOWN | {file.name for file in self.reader.files} | {path.name for path in self._leftovers()}
        for path in sorted(self.folder.iterdir()):
            if path.name not in known and path.is_file() and self.traces.bytes.search(path.read_bytes()):
                found.undecided.append(f"{path.name}: not a file of the recording, it mentions the pseudonym")

    def _has_report(self) -> bool:
        return bool(self.journal.get("report")) or any((self.folder / name).is_file() for name in REPORTS)

    def _leftovers(self) -> list[Path]:
        """Files that hold what the recording held: exports, reports, damaged originals, halves of a rewriting."""
        folder = self.folder
        exports = [p for p in (*folder.iterdir(), folder.with_name(f"{folder.name}_export")) if _is_export(p)]
        repaired = [
            folder / f"{f.stem.removesuffix('_repaired')}.mcap" for f in self.reader.files if "_repaired" in f.stem
        ]
        halves = [*folder.glob(".*.new"), folder / f".{rosbag2.NAME}", folder / f".{recorder_json.NAME}"]
        rest = [*halves, *folder.glob(f"{rosbag2.NAME}.damaged*")]
        reports = [folder / name for name in REPORTS]
        return sorted({*exports, *(path for path in (*repaired, *rest, *reports) if path.is_file())})

    def _about_without(self) -> RecorderJson:
        """What recorder.json says, without the pseudonym."""
        traces, about = self.traces, self.about
        nodes = [item for item in about.nodes if not _is_of(item, self.human_id)]
        return replace(
            about,
            why="" if traces.mentions(about.why) else about.why,
            host="" if traces.mentions(about.host) else about.host,
            software={name: text for name, text in about.software.items() if not traces.mentions(text)},
            topics=[item for item in about.topics if not traces.is_in(item)],
            refused=[item for item in about.refused if not traces.is_in(item)],
            withheld=[item for item in about.withheld if not traces.is_in(item)],
            events=[item for item in about.events if not traces.is_in(item)],
            nodes=[traces.value_without(item) if traces.is_in(item) else item for item in nodes],
            session=self._session_without(about.session),
            more={name: value for name, value in about.more.items() if not traces.is_in(value)},
        )

    def _session_without(self, session: dict[str, Any] | None) -> dict[str, Any] | None:
        if not session:
            return session
        names = {key: session[key] for key in ("session_id", "study", "task") if isinstance(session.get(key), str)}
        kept: dict[str, Any] = self.traces.value_without(session)
        return kept | {key: self.traces.name_without(name) for key, name in names.items()}

    def _clean_about(self, found: Withdrawn) -> None:
        made = self._about_without()
        if not (self.folder / recorder_json.NAME).is_file() or (made == self.about and not found.removed):
            return
        what = f"a participant was withdrawn: {found.removed.total()} messages removed, {found.changed.total()} changed"
        made.events.append({"at_ns": time.time_ns(), "what": what})
        recorder_json.write(self.folder, made)

    def _clean_metadata(self) -> None:
        if (self.folder / rosbag2.NAME).is_file():
            distro = rosbag2.distro(self.folder)
            rosbag2.describe(self.folder, [repair.contents(file) for file in self.reader.files], distro)

    def _rename(self, found: Withdrawn) -> None:
        """The folder's own name, and its files' where they are called after it."""
        if found.now == self.folder:
            return
        target = found.now
        renamed = {
            file: file.with_name(self.traces.name_without(file.name))
            for file in self.reader.files
            if self.traces.half_mentions(file.name)
        }
        for old, new in renamed.items():
            new.unlink(missing_ok=True)
            os.link(old, new)
        if renamed:
            self.reader.files = [renamed.get(file, file) for file in self.reader.files]
            self._clean_metadata()
            for old in renamed:
                old.unlink()
        target.parent.mkdir(exist_ok=True)
        old = self.folder.resolve()
        if old.exists() and not target.exists():
            old.rename(target)
            sync(target.parent)
        _point(old, target)
        if not any(old.parent.iterdir()):
            old.parent.rmdir()

    def _undecided(self, found: Withdrawn) -> list[str]:
        """What may be the pseudonym's and cannot be told."""
        said = []
        topics = self.reader.topics.values()
        for sensor_id in sorted(self.sensors):
            own = [t for t in topics if t.name.startswith(f"{ROOT}/{UNASSIGNED}/") and f"/{sensor_id}/" in t.name]
            count = sum(t.messages for t in own)
            if count and not all(self.traces.owns_topic(t.name) for t in own):
                glob = f"'{ROOT}/{UNASSIGNED}/*/{sensor_id}/**'"
                said.append(f"{count} messages of {sensor_id} while nobody wore it; --also {glob} removes them")
        for kind, name in sorted(self.shared):
            glob = f"/humans/{kind}/{name}/**"
            if any(t.name.startswith(glob[:-2]) for t in topics):
                said.append(f"/humans/{kind}/{name} is tied to another pseudonym as well; --also '{glob}' removes it")
        loose: Counter[str] = Counter()
        for topic in topics:
            parts = topic.name.split("/")
            if len(parts) > 4 and parts[1] == "humans" and parts[2] in ("faces", "bodies", "voices", "persons"):
                node = (parts[2], parts[3])
                if node not in self.tied and not self.traces.owns_topic(topic.name):
                    loose[f"/humans/{parts[2]}/{parts[3]}/**"] += topic.messages
        said += [
            f"{n} messages of {glob}: nobody's, as far as recorded; --also '{glob}' removes them"
            for glob, n in sorted(loose.items())
        ]
        said += [
            f"{t.messages} messages of {t.name} may show or let hear anyone; --also '{t.name}' removes them"
            for t in topics
            if t.type_name.rpartition("/")[2] in MAY_SHOW and t.messages and not self.traces.owns_topic(t.name)
        ]
        said += [f"{text!r} on {topic}: a longer name with the pseudonym in it" for text, topic in self.longer.items()]
        return said


def find_folders(paths: list[Path]) -> list[Path]:
    """Every recording at or below these paths."""
    found: set[Path] = set()
    for path in paths:
        if not path.is_dir():
            raise SessionError(f"{path}: there is no such folder")
        files = [*path.rglob("*.mcap"), *path.rglob(JOURNAL)]
        found |= {file.parent for file in files}
    return sorted(found)


def _lock(folder: Path) -> Lock:
    """Hold the recorder's lock; raise SessionError where somebody else does."""
    try:
        return Lock(folder)
    except BlockingIOError as err:
        raise SessionError(f"{folder} is being recorded: stop that first") from err


def _journal(folder: Path) -> dict[str, Any]:
    path = folder / JOURNAL
    if not path.is_file():
        return {}
    try:
        return dict(json.loads(path.read_text("utf-8")))
    except (ValueError, TypeError) as err:
        raise SessionError(f"{path} is damaged ({err}): remove it and withdraw again") from err


def _is_export(path: Path) -> bool:
    return path.is_dir() and (path / "session.json").is_file() and (path / "codebook.csv").is_file()


def _is_of(node: Any, human_id: str) -> bool:
    return isinstance(node, dict) and (node.get("parameters") or {}).get("human_id") == human_id


def _point(old: Path, new: Path) -> None:
    """The recorder's `recording` file names the newest folder."""
    for parent in list(old.parents)[:4]:
        path = parent / layout.POINTER
        if path.is_file() and old.name in (text := path.read_text("utf-8", "replace")):
            path.write_text(text.replace(f"{old.parent.name}/{old.name}", f"{new.parent.name}/{new.name}"), "utf-8")


def _report(found: Withdrawn) -> None:
    """Make the report anew where there was one."""
    if MADE_ANEW not in found.files:
        return
    command = [sys.executable, "-m", "sense4hri_report", str(found.now)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        found.files.append(f"no report was made, the old one is gone: {done.stderr.strip()[-200:]}")


def main(arguments: list[str] | None = None) -> int:
    """Withdraw; 1 where a recording had to be left as it is, 2 where it was not confirmed."""
    parser = argparse.ArgumentParser(prog="sense4hri-withdraw", description=__doc__.partition("\n")[0])
    parser.add_argument("recordings", nargs="+", type=Path, help="folders of recordings, or any folder above them")
    parser.add_argument("--human", required=True, help="the pseudonym")
    parser.add_argument("--also", nargs="+", default=[], metavar="GLOB", help="topics to remove besides")
    parser.add_argument("--dry-run", action="store_true", help="only say what would be removed")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if not is_human_id(options.human) or options.human == UNASSIGNED:
        parser.error(f"{options.human!r} is no pseudonym")
    try:
        folders = find_folders(options.recordings)
    except SessionError as err:
        print(err, file=sys.stderr)
        return 1
    if not options.dry_run and not options.yes and not _confirmed(options.human, len(folders)):
        return 2
    status, hits = 0, 0
    for folder in folders:
        progress = not options.quiet and sys.stderr.isatty()
        try:
            found = withdraw(folder, options.human, tuple(options.also), options.dry_run, progress)
        except (SessionError, OSError) as err:
            print(f"not withdrawn: {err}", file=sys.stderr)
            status = 1
            continue
        if found or found.undecided:
            hits += bool(found)
            print("\n".join(found.lines()))
    verb = "hold" if options.dry_run else "held"
    print(f"{hits} of {len(folders)} recordings {verb} something of {options.human}")
    return status


def _confirmed(human_id: str, count: int) -> bool:
    """Ask; without a terminal the answer is no."""
    if not sys.stdin.isatty():
        print("nothing was done: --yes withdraws without asking, --dry-run shows what would go", file=sys.stderr)
        return False
    print(f"Everything of {human_id} in {count} recordings will be removed for good. Type the pseudonym to go on: ")
    return sys.stdin.readline().strip() == human_id


if __name__ == "__main__":
    sys.exit(main())
