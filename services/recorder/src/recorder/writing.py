"""From the ROS thread to the disk: one queue, one thread that writes, one that calls fsync.

Messages go into the queue and never wait for the disk. The writing thread makes them a chunk and hands it to the
kernel every flush interval (a SIGKILL cannot take that); another one calls fsync (nor can a power cut). The wish to
write somewhere else stands in the same queue, so that every message is in exactly one recording.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from sense4hri.liveness import Pulse
from sense4hri_recording.rosbag2 import Channel

from recorder.account import DISK, QUEUE
from recorder.bag import RETRY_S, Bag
from recorder.disk import Disk, StartThread
from recorder.heads import Heads
from recorder.plan import Kind, Target
from recorder.queued import Queue, Turn
from recorder.space import Space, free_bytes
from recorder.split import Entry
from recorder.told import About, Limits

DESCRIBE_INTERVAL_S = 10.0
SPACE_INTERVAL_S = 1.0
CLOCK_STEP_NS = 500_000_000
NOTHING = Target(Kind.NOTHING)


class Written(NamedTuple):
    """Where things stand: what is being written, to which bag, and why not what was wished for."""

    target: Target
    bag: Bag | None
    problem: str


class Writing:
    """Writes what stands in `queue`. Any thread may fill that; all else is called by the thread that made this object.

    about: what is to be told in a new recording. opened, closed: called by the writing threads.
    """

    def __init__(
        self,
        root: Path,
        flush_interval_s: float,
        limits: Limits,
        space: Space,
        about: Callable[[Target], About],
        opened: Callable[[Bag], None],
        closed: Callable[[Bag], None],
        start_thread: StartThread,
    ) -> None:
        self._root, self._interval_s, self._limits, self.space = root, flush_interval_s, limits, space
        self._about, self._opened, self._closed = about, opened, closed
        self.queue = Queue()
        self._taken: deque[Entry | Turn] = deque()  # out of the queue, by the writing thread
        self._wake = threading.Event()
        self._stop = False
        self._heads, self._disk = Heads(), Disk(start_thread)
        self.at = Written(NOTHING, None, "")
        self._wish: Turn | None = None
        self._unwritten: Counter[Channel] = Counter()  # while a recording is wished for and none can be begun
        self._deleted = ""  # what was said of a folder that was deleted, to be said in the next one
        self._retry_at_s = self._space_at_s = 0.0
        self._described_at_s = time.monotonic()
        self._wall_minus_monotonic_ns = time.time_ns() - time.monotonic_ns()
        space.look(time.monotonic(), 0, free_bytes(root))
        self._pulse = Pulse()
        self._thread = start_thread("writing", self._loop, self._pulse)

    def turn_to(self, target: Target) -> None:
        """Write this from here on."""
        self.queue.turn_to(target)
        self._wake.set()

    def close(self) -> None:
        """Write what is queued and finish the recording."""
        if self._stop:
            return
        self.turn_to(NOTHING)
        self._stop = True
        self._wake.set()
        self._thread.join()
        self._disk.close()

    def _loop(self) -> None:
        try:
            self._write()
        except Exception as err:
            self._rescue(f"the recorder failed: {type(err).__name__}: {err}")
            raise

    def _rescue(self, why: str) -> None:
        """Before the service fails and is begun anew: end the file with everything that was received."""
        items, bag = [*self._taken, *self.queue.take()], self.at.bag
        in_hand = len(self._taken) > 0
        self.at = Written(NOTHING, None, why)
        if bag is None:
            return
        entries = [item for item in items[in_hand:] if isinstance(item, Entry)]
        if in_hand and isinstance(items[0], Entry):
            bag.accounts.lose(items[0].channel, 1, DISK)
        bag.rescue(entries, why)
        self._disk.do(lambda: self._closed(bag))

    def _write(self) -> None:
        due = time.monotonic()
        while not self._stop:
            self._wake.wait(max(due - time.monotonic(), 0.0))
            self._wake.clear()
            due = max(due + self._interval_s, time.monotonic())
            self._pulse.beat()
            self._drain()
            self._tend()
        self._drain()

    def _drain(self) -> None:
        """Write what is queued, in its order."""
        self._taken = self.queue.take()
        while self._taken:
            self._pulse.beat()
            self._handle(self._taken[0])
            self._taken.popleft()
        if self.at.bag is not None:
            self.at.bag.flush()

    def _handle(self, item: Entry | Turn) -> None:
        if isinstance(item, Turn):
            self._turn(item)
            return
        self._heads.keep(item)
        if self.at.bag is not None:
            self.at.bag.add(item)
        elif self._wish is not None:
            self._unwritten[item.channel] += 1

    def _turn(self, turn: Turn) -> None:
        """Change to another recording; where it cannot be begun, go on with this one and try again."""
        old, wish, self._wish = self.at, self._wish, None
        if wish is not None and wish.target != turn.target:
            self._unwritten.clear()  # they are no loss of what comes now
        if old.bag is not None:
            for channel, count in turn.dropped.items():
                old.bag.accounts.lose(channel, count, QUEUE)
            if turn.target == old.target:
                self.at = old._replace(problem="")
                return
        bag, problem = self._begun(turn)
        if problem and old.target.kind is Kind.BETWEEN:
            self.at = old._replace(problem=problem)
            return
        self.at = Written(turn.target if bag else NOTHING, bag, problem)
        if old.bag is not None:
            self._finish(old.bag)
        if bag is not None:
            self._tell_before(bag)
            self._opened(bag)

    def _begun(self, turn: Turn) -> tuple[Bag | None, str]:
        """The recording, None where there is to be none; or why it cannot be begun, which is tried again later."""
        if turn.target.kind is Kind.NOTHING:
            return None, ""
        try:
            return self._open(turn), ""
        except OSError as err:
            self._wish, self._retry_at_s = turn._replace(dropped=Counter()), time.monotonic() + RETRY_S
            at = f" ({err.filename})" if err.filename else ""
            return None, f"cannot record in {self._root}: {err.strerror}{at}"

    def _tell_before(self, bag: Bag) -> None:
        """Say in a new recording what came before it and is in none."""
        for channel, count in self._unwritten.items():
            bag.accounts.lose(channel, count, DISK)
        self._unwritten.clear()
        if self._deleted:
            bag.about.note(self._deleted)
            bag.about.before = self._deleted
        self._deleted = ""

    def _open(self, turn: Turn) -> Bag:
        """Raises OSError."""
        self.space.look(time.monotonic(), self._disk_bytes(), free_bytes(self._root))
        if self.space.refusal:
            raise OSError(28, self.space.refusal)
        directory = turn.target.directory(self._root, time.time())
        self._heads.forget_gone()
        return Bag(
            directory,
            self._limits,
            about=self._about(turn.target),
            heads=self._heads,
            at_ns=turn.at_ns,
            background=self._disk.do,
        )

    def _finish(self, bag: Bag) -> None:
        bag.close(*bag.about.outcome)
        self._disk.do(lambda: self._closed(bag))

    def _tend(self) -> None:
        """What is looked at now and then."""
        now_s, bag = time.monotonic(), self.at.bag
        self._watch_clock()
        if bag is not None and bag.gone:
            self._deleted = bag.refused
            self._wish = Turn(self.at.target, time.time_ns(), Counter())
            self.at = Written(NOTHING, None, bag.refused)
            self._finish(bag)
            self._retry_at_s = 0.0
        if self._wish is not None and now_s >= self._retry_at_s:
            self._turn(self._wish._replace(at_ns=time.time_ns()))
        if now_s >= self._space_at_s:
            self._space_at_s = now_s + SPACE_INTERVAL_S
            self._watch_space(now_s)
        if self.at.bag is not None and now_s >= self._described_at_s + DESCRIBE_INTERVAL_S:
            self._described_at_s = now_s
            self.at.bag.describe()

    def _watch_clock(self) -> None:
        """Note a step of the host's clock."""
        offset_ns = time.time_ns() - time.monotonic_ns()
        step_ns, self._wall_minus_monotonic_ns = offset_ns - self._wall_minus_monotonic_ns, offset_ns
        if abs(step_ns) > CLOCK_STEP_NS and self.at.bag is not None:
            self.at.bag.about.note(f"host clock stepped by {step_ns / 1e9:+.1f} s")

    def _watch_space(self, now_s: float) -> None:
        """End the file before the disk is full; go on when there is room again."""
        bag, space = self.at.bag, self.space
        space.look(now_s, self._disk_bytes(), free_bytes(self._root))
        if bag is None:
            return
        if space.must_stop and not bag.paused:
            left, needed = space.free_bytes / 1e6, space.go_on_bytes / 1e6
            bag.pause(f"{left:.0f} MB left on the disk of {self._root}, goes on once {needed:.0f} MB are free")
        elif bag.paused and space.may_go_on:
            bag.resume()

    def _disk_bytes(self) -> int:
        return self.at.bag.disk_bytes if self.at.bag is not None else 0
