"""The recorder's Writing with a stream of numbered messages, for its tests."""

import json
import threading
from pathlib import Path

from processes import poll
from recorder.bag import Bag
from recorder.plan import Kind, Session, Target
from recorder.space import Space
from recorder.told import About, Limits
from recorder.writing import Writing
from rosbags.highlevel import AnyReader
from string_messages import START_NS, cdr_string, string_channel

ONE = Session("s1", "Prüfung 1/b", "../n-back", ("p2", "p1"))
OTHER = Session("s2")
NOTHING, BETWEEN = Target(Kind.NOTHING), Target(Kind.BETWEEN)


def started(name, work, pulse):
    thread = threading.Thread(target=work, name=name, daemon=True)
    thread.start()
    return thread


class Study:
    """A Writing, and a stream of numbered messages."""

    def __init__(self, root: Path, floor_bytes: int = 0) -> None:
        self.root, self.opened, self.closed = root, [], []
        self.channel = string_channel()
        self.written = 0
        self.writing = Writing(
            root, 0.01, Limits(), Space(floor_bytes), self._about, self.opened.append, self.closed.append, started
        )

    def _about(self, target: Target) -> About:
        return About({"session_id": target.session.session_id} if target.kind is Kind.SESSION else None)

    def put(self, count: int = 1) -> None:
        for _ in range(count):
            stamp = START_NS + self.written
            self.writing.queue.put(self.channel, cdr_string(str(self.written)), stamp, stamp, self.written + 1)
            self.written += 1

    def turn(self, target: Target) -> None:
        self.writing.turn_to(target)

    def reached(self, target: Target) -> Bag | None:
        poll(lambda: self.writing.at.target == target and not self.writing.at.problem, f"{target} is written")
        return self.writing.at.bag


def texts(directory: Path) -> list[int]:
    with AnyReader([directory]) as reader:
        return [int(reader.deserialize(raw, c.msgtype).data) for c, _, raw in reader.messages()]


def sidecar(directory: Path) -> dict:
    return json.loads((directory / "recorder.json").read_text())


def session(one: Session, continued: bool = False) -> Target:
    return Target(Kind.SESSION, one, continued)
