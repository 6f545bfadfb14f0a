"""One recording: a rosbag2 folder of MCAP files and `recorder.json`, which says what only the recorder knows.

Bytes reach a file in whole flushes only, so it always ends at a whole chunk: a write that fails, the disk being full,
is undone and tried again; what comes meanwhile is counted as lost. Used by one thread, which is never kept waiting by
an fsync: that is handed to `background`.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path

from sense4hri.files import sync
from sense4hri_recording.lock import Lock
from sense4hri_recording.recorder_json import COMPLETE, INTERRUPTED, RECORDING
from sense4hri_recording.rosbag2 import Channel

from recorder.account import DISK
from recorder.accounts import Accounts
from recorder.described import Described, Description
from recorder.heads import Heads
from recorder.reserve import Reserve
from recorder.split import Entry, Split
from recorder.told import About, Limits

RETRY_S = 2.0
SAFE = "what was written before is safe"
Job = Callable[[], None]


def _at_once(job: Job) -> None:
    job()


class Bag:
    """A recording that is being written. Raises OSError where it cannot be begun; then nothing of it is left.

    refused: why nothing can be written now; it is tried again. unsafe: why what is written may not survive a power cut.
    """

    def __init__(
        self,
        directory: Path,
        limits: Limits | None = None,
        *,
        about: About | None = None,
        heads: Heads | None = None,
        at_ns: int = 0,
        background: Callable[[Job], None] = _at_once,
    ) -> None:
        self.directory, self.about = directory, about or About()
        self._refused = self._unsynced = self._undescribed = ""
        self._refused_ns = 0
        self._kept = SAFE
        self.on_disk = 0
        self.gone = False
        """The whole folder was deleted; nothing can be written to it any more."""
        self.last_synced_ns = 0
        self.closed = False
        self._limits, self._heads, self._background = limits or Limits(), heads or Heads(), background
        opened_ns = time.time_ns()
        self.accounts = Accounts(opened_ns)
        self._described = Described(directory, self.about, self.accounts, opened_ns, self._limits.distro)
        self._reserve = Reserve(directory)
        self._number = 0
        self._split: Split | None = None
        self._split_at_s = self._retry_at_s = 0.0
        self.paused = False
        self._described_channels = 0
        self._lock = _locked(directory)
        try:
            self._reserve.take()
            self._begin_split(self._new_split(at_ns or opened_ns))
            self._described.write(self._described.now(RECORDING, self._split))
        except OSError:
            self._abandon()
            raise

    @property
    def refused(self) -> str:
        return self._refused

    @refused.setter
    def refused(self, why: str) -> None:
        """Note when writing stops and when it goes on."""
        if why and not self._refused:
            self._refused_ns = time.time_ns()
            self.about.note(f"stopped writing: {why}; {self._kept}")
        elif self._refused and not why and not self._described.closed_ns:
            self.about.note(f"goes on writing, {self.accounts.lost} messages are lost so far")
        self._refused, self._kept = why, self._kept if why else SAFE

    @property
    def trouble(self) -> str:
        """Why nothing can be written now, since when, and what that means; empty where all is well."""
        if not self._refused:
            return ""
        since = datetime.fromtimestamp(self._refused_ns / 1e9, UTC)
        return f"since {since:%H:%M:%S} UTC {self._refused}; {self._kept}, what comes now is counted"

    @property
    def missing(self) -> str:
        """What a recording that is closed lacks, in one sentence; empty where it lacks nothing."""
        return "; ".join(filter(None, (self.about.before, self.accounts.missing, self.failure)))

    @property
    def unsafe(self) -> str:
        return self._unsynced or self._undescribed

    @property
    def failure(self) -> str:
        """Why the recording is not as it should be."""
        return self.refused or self.unsafe

    @property
    def last_written_ns(self) -> int:
        """When something was last handed to the kernel; 0: nothing yet."""
        return self._described.last_written_ns

    @property
    def disk_bytes(self) -> int:
        """Bytes handed to the kernel."""
        return self.on_disk + (self._split.output.on_disk if self._split else 0)

    def write(self, channel: Channel, data: bytes, log_ns: int, publish_ns: int, sequence: int = 0) -> None:
        """Add one serialised message that nothing is known to be missing before."""
        self.add(Entry(channel, data, log_ns, publish_ns, sequence))

    def add(self, entry: Entry) -> None:
        """Add one message, or count it as lost while the disk takes none."""
        self.accounts.arrived(entry)
        if self.refused or self._split is None:
            self.accounts.lose(entry.channel, 1, DISK)
            return
        self._split.write(entry)
        self.accounts.written(entry)
        if self._is_full(self._split):
            self._next_split(entry.log_ns)

    def flush(self) -> None:
        """Hand everything to the kernel; while the disk refuses, try again now and then."""
        if self.closed or self.paused or self.gone:
            return
        if self.refused:
            self._try_again()
            return
        split = self._split
        if split is None:
            return
        if split.output.deleted():
            self._start_again(split)
            return
        if split.unflushed:
            self.refused = self._attempt(split.flush)
            if self.refused:
                self._retry_at_s = time.monotonic() + RETRY_S
                return
            self._described.last_written_ns = time.time_ns()
            self._background(lambda: self._sync(split))
        if self._described_channels != len(self.accounts.by_channel):
            self.describe()
        if self._limits.split_s and time.monotonic() - self._split_at_s > self._limits.split_s:
            self._next_split(time.time_ns())

    def describe(self) -> None:
        """Bring metadata.yaml and recorder.json up to date, in the background."""
        self._described_channels = len(self.accounts.by_channel)
        described = self._described.now(RECORDING, self._split)
        self._background(lambda: self._describe(described))

    def pause(self, why: str) -> None:
        """End the file with its index while there is room for it; what comes from now on is counted as lost."""
        self.paused, self.refused = True, why
        if self._split is not None:
            self._finish_split(self._split)
        self.describe()

    def resume(self) -> None:
        """Go on in a further file."""
        self.paused = False
        self._attempt(self._reserve.take)
        self._retry_at_s = 0.0
        self._try_again()

    def close(self, state: str = COMPLETE, why: str = "") -> None:
        """Write the index and the metadata. On a full disk the file stays readable as a stream."""
        self._described.closed_ns = time.time_ns()
        failure = self._finish_split(self._split) if self._split is not None else ""
        self._attempt(self._reserve.give_back)
        self.refused = f"{failure}; the file has no index" if failure else ""
        if self.refused:
            state, why = INTERRUPTED, why or self.refused
        described = self._described.now(state, self._split, why)
        self._background(lambda: self._settle(described))

    def rescue(self, rest: Iterable[Entry], why: str) -> None:
        """Save what can be after a failure nobody foresaw: all but the chunk in progress, and what waits behind it."""
        split = self._split
        if split is not None:
            self._withdraw(split, split.drop_chunk())
            self._finish_split(split)
            self._try_again()
        self.about.note(why)
        for entry in rest:
            self.add(entry)
        self.close(INTERRUPTED, why)

    def _new_split(self, at_ns: int) -> Split:
        """Open the next file and begin it with what still holds. Raises OSError; then no file is left."""
        path = self.directory / f"{self.directory.name}_{self._number}.mcap"
        split = Split(path, self._limits.compression)
        try:
            split.output.flush()
            for entry in self._heads.at(at_ns):
                split.write(entry)
            split.heads = split.counts.copy()
            split.flush()
        except OSError:
            split.output.close()
            path.unlink(missing_ok=True)
            raise
        return split

    def _begin_split(self, split: Split) -> None:
        self._number += 1
        self._split, self._split_at_s = split, time.monotonic()

    def _is_full(self, split: Split) -> bool:
        return 0 < self._limits.split_bytes <= split.output.tell()

    def _next_split(self, at_ns: int) -> None:
        """Change to a further file; where none can be opened, stay in this one."""
        old = self._split
        if time.monotonic() < self._retry_at_s or old is None:
            return
        try:
            new = self._new_split(at_ns)
        except OSError as err:
            self.about.note(f"no further file could be begun: {err.strerror}")
            self._retry_at_s = time.monotonic() + RETRY_S
            return
        failure = self._finish_split(old)
        if failure:
            self.about.note(f"{old.path.name} has no index: {failure}")
        self._begin_split(new)
        self.describe()

    def _finish_split(self, split: Split) -> str:
        """End a file; returns why it has no index, or nothing. What it did not take is counted as lost."""
        failure = self._attempt(split.finish)
        if failure and self._reserve.exists():
            self._attempt(self._reserve.give_back)
            failure = self._attempt(split.finish)
        if failure:
            self._withdraw(split, split.unflushed)
        self._described.finished(split)
        self.on_disk += split.output.on_disk
        self._split = None
        self._described.last_written_ns = time.time_ns()
        self._background(lambda: self._sync_and_close(split))
        return failure

    def _start_again(self, split: Split) -> None:
        """The file was deleted under the recorder: count what was in it, go on in another one."""
        received = split.counts - split.heads
        what = f"{split.path.name} was deleted under the recorder with {received.total()} messages"
        self._withdraw(split, received)
        self._background(split.output.close)
        self._split = None
        self.gone = not self.directory.is_dir()
        self._kept = "what was written to it is lost"
        self.refused = f"{self.directory}: {what}"
        self._retry_at_s = 0.0
        if not self.gone:
            self._try_again()

    def _withdraw(self, split: Split, counts: Counter[Channel]) -> None:
        """Count messages that are not in the file after all."""
        self.accounts.withdraw(split, counts)
        split.counts = split.counts - counts
        split.unflushed = Counter()

    def _try_again(self) -> None:
        if time.monotonic() < self._retry_at_s:
            return
        split = self._split
        if split is None:
            self.refused = self._attempt(lambda: self._begin_split(self._new_split(time.time_ns())))
        else:
            self.refused = self._attempt(split.output.flush)
        if self.refused:
            self._retry_at_s = time.monotonic() + RETRY_S
        else:
            if split is not None:
                split.unflushed.clear()
            self.describe()

    def _attempt(self, action: Callable[[], object]) -> str:
        """Do something with the disk; returns why it refused, or nothing."""
        try:
            action()
        except OSError as err:
            return f"{self.directory}: {err.strerror}"
        return ""

    def _sync(self, split: Split) -> None:
        """A failure stays one: the kernel says it once, and what it could not write may be gone."""
        asked_ns = time.time_ns()
        self._unsynced = self._attempt(split.output.sync) or self._unsynced
        if not self._unsynced:
            self.last_synced_ns = asked_ns

    def _sync_and_close(self, split: Split) -> None:
        self._sync(split)
        self._unsynced = self._attempt(split.output.close) or self._unsynced

    def _describe(self, described: Description) -> None:
        if not self.gone:
            self._undescribed = self._attempt(lambda: self._described.write(described))

    def _settle(self, described: Description) -> None:
        self._describe(described)
        if not self.gone:
            self._undescribed = self._attempt(lambda: sync(self.directory)) or self._undescribed
        self._lock.release()
        self.closed = True

    def _abandon(self) -> None:
        """Leave nothing of a recording that could not be begun."""
        if self._split is not None:
            self._split.output.close()
        self._lock.release()
        _remove(self.directory)


def _locked(directory: Path) -> Lock:
    """Raises OSError; a folder on a disk that has no locks is removed, one that somebody else writes is not."""
    try:
        return Lock(directory)
    except BlockingIOError:
        raise
    except OSError:
        _remove(directory)
        raise


def _remove(directory: Path) -> None:
    for path in directory.iterdir():
        path.unlink(missing_ok=True)
    directory.rmdir()
