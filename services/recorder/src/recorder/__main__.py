"""Records the study's sessions, and what lies between them, until it is told to stop."""

import asyncio
import os
import sys
import time
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sense4hri import qos
from sense4hri.errors import ConfigError
from sense4hri.patterns import Patterns
from sense4hri.service import Service, run
from sense4hri.session import SessionMember
from sense4hri_msgs.msg import SessionState

from recorder import about
from recorder.bag import INTERRUPTED, About, Bag, Limits
from recorder.config import Config
from recorder.plan import Kind, Plan, Session, Target
from recorder.space import Space
from recorder.topics import Topics
from recorder.writing import Writing

POLL_S, FAST_POLL_S, FAST_POLLS = 0.05, 0.02, 500
SETTLE_S, SETTLE_AT_MOST_S = 0.25, 1.2
TICK_S, QUIET_ROUNDS = 0.02, 5
MB = 1_000_000


class Recorder:
    """Follows the session, keeps the recording that belongs to it, and tells about it."""

    def __init__(self, service: Service[Config]) -> None:
        self._service, config = service, service.config
        self._root = _usable(Path(config.directory))
        limits = Limits(config.compression, config.split_mb * MB, config.split_s, about.distro())
        space = Space(config.free_floor_mb * MB)
        self._session: dict[str, Any] = {}
        self.writing = Writing(
            self._root, config.flush_interval_s, limits, space, self._about, self._opened, self._closed
        )
        self.topics = Topics(service.node, config, self.writing)
        self._plan = Plan(config.record_when == "always")
        self._target = Target(Kind.NOTHING)
        self._newest: Bag | None = None
        self._last: Bag | None = None  # of the session
        self._alone = ("", 0.0)  # the session for which all others have finished, and since when
        self._failure = ""
        service.subscribe(SessionState, "/study/session", self._hear, qos.SESSION)
        SessionMember(service, self._may_begin, finish=self._finished, directory=self._directory)
        service.http.route("GET", "/recording", lambda path, body: (200, self.status()))
        service.log.info(f"records {config.record_when}, into {self._root.resolve()}")
        self._turn(self._plan.target)

    async def run(self) -> None:
        """Record until stopped, then finish the file with everything that was received by then."""
        service = self._service
        service.every(1.0, self._watch)
        service.ready()
        polls = 0
        while not service.stopped.is_set():
            self.topics.poll()
            polls += 1
            await asyncio.sleep(FAST_POLL_S if polls < FAST_POLLS else POLL_S)
        await self._settle()
        self.topics.close()
        at = self.writing.at
        if at.bag is not None and at.target.kind is Kind.SESSION:
            at.bag.about.outcome = INTERRUPTED, "the recorder was stopped while the session was running"
        self.writing.close()

    def lost(self) -> int:
        """Messages that were sent while recording but are not in the file."""
        return self._newest.lost if self._newest is not None else 0

    def status(self) -> dict[str, Any]:
        """What `GET /recording` answers."""
        at, bag = self.writing.at, self._newest
        reasons = [*filter(None, (at.problem, at.bag.failure if at.bag is not None else ""))]
        reasons += [f"{refused.topic}: {refused.why}" for refused in self.topics.refused.values()]
        return {
            "directory": str(bag.directory.resolve()) if bag is not None else "",
            "recording": at.bag is not None and not at.bag.refused,
            "session_id": at.target.session.session_id,
            "messages": bag.messages if bag is not None else 0,
            "lost": self.lost(),
            "topics": [
                {
                    "topic": topic.channel.topic,
                    "type": topic.channel.type_name,
                    "messages": topic.received,
                    "lost": topic.losses.lost,
                    "missed_at_start": topic.losses.missed,
                }
                for topic in self.topics.recorded.values()
            ],
            "withheld": sorted(self.topics.withheld),
            "reasons": reasons,
        }

    def _hear(self, state: SessionState) -> None:
        """Follow the session."""
        bag = self._last
        if state.phase in (SessionState.PREPARING, SessionState.RECORDING, SessionState.STOPPING):
            self._session = about.session(state)
            if bag is not None and bag.about.session and bag.about.session["session_id"] == state.session_id:
                bag.about.session.update(self._session)
        elif bag is not None and self.writing.at.bag is bag and self._target.kind is Kind.SESSION:
            failed = state.phase == SessionState.FAILED
            why = f"the session failed: {state.detail}" if failed else "the session ended without being stopped"
            bag.about.outcome = INTERRUPTED, why
        session = Session(state.session_id, state.study, state.task, tuple(state.human_ids))
        self._turn(self._plan.hear(state.phase, session))

    def _turn(self, target: Target) -> None:
        if target != self._target:
            self._target = target
            self.writing.turn_to(target)

    def _about(self, target: Target) -> About:
        """Called by the writing thread: what is told in a new recording."""
        told = About(None, about.software(), self._surroundings)
        if target.kind is Kind.SESSION:
            told.session = dict(self._session)
            if target.continued:
                told.note("the recorder was started while the session was running; an earlier part may lie beside this")
        return told

    def _surroundings(self) -> dict[str, Any]:
        refused = [
            {"topic": refused.topic, "type": refused.type_name, "why": refused.why}
            for refused in list(self.topics.refused.values())
        ]
        return {"refused": refused, "withheld": sorted(self.topics.withheld)}

    def _opened(self, bag: Bag) -> None:
        """Called by the writing thread."""
        self._newest = bag
        if bag.about.session is not None:
            self._last = bag
        _write_pointer(self._root, bag.directory)
        self._service.log.info(f"recording to {bag.directory.resolve()}")

    def _closed(self, bag: Bag) -> None:
        """Called by the thread that waits for the disk."""
        if bag.failure:
            self._service.log.error(f"the recording is not whole: {bag.failure}")
        self._service.log.info(f"{bag.messages} messages, {bag.lost} lost, in {bag.directory.resolve()}")

    async def _settle(self) -> None:
        """Wait until the ROS thread has handed over what had arrived before the stop.

        A timer on that thread tells that it has been round all its subscriptions, however busy the machine is.
        """
        rounds = 0

        def went_round() -> None:
            nonlocal rounds
            rounds += 1

        timer = self._service.node.create_timer(TICK_S, went_round, clock=Clock(clock_type=ClockType.STEADY_TIME))
        begun, quiet_from, seen = time.monotonic(), 0, self._received()
        while time.monotonic() - begun < SETTLE_AT_MOST_S:
            await asyncio.sleep(TICK_S)
            received = self._received()
            if received != seen:
                quiet_from, seen = rounds, received
            if time.monotonic() - begun > SETTLE_S and rounds - quiet_from > QUIET_ROUNDS:
                break
        self._service.node.destroy_timer(timer)

    def _received(self) -> int:
        return sum(topic.received for topic in self.topics.recorded.values())

    def _watch(self) -> None:
        """Once a second: metrics, and each trouble said once."""
        at, bag = self.writing.at, self._newest
        log, gauge = self._service.log, self._service.metrics.gauge
        gauge("recorder_written_messages", "Messages in the file.").set(bag.messages if bag else 0)
        gauge("recorder_written_bytes", "Payload in the file.").set(bag.payload_bytes if bag else 0)
        gauge("recorder_lost_messages", "Messages sent while recording that are not in the file.").set(self.lost())
        gauge("recorder_refused_topics", "Topics whose type is not installed.").set(len(self.topics.refused))
        gauge("recorder_topics", "Topics in the file.").set(len(self.topics.recorded))
        gauge("recorder_disk_free_bytes", "Free space of the disk.").set(self.writing.space.free_bytes)
        refused = at.problem or (at.bag.refused if at.bag is not None else "")
        failure = refused or (at.bag.unsafe if at.bag is not None else "")
        if failure != self._failure:
            if refused:
                log.error(f"NOT RECORDING: {refused}; what was written before is safe, the rest is being lost")
            elif failure:
                log.error(f"recording, but not safely: {failure}")
            else:
                log.info(f"recording again, {self.lost()} messages were lost")
        self._failure = failure
        self._service.ready(not failure)

    def _directory(self) -> str:
        return str(self._last.directory.resolve()) if self._last is not None else ""

    def _may_begin(self, session: SessionState) -> tuple[bool, str]:
        """Say whether a session may begin: its file is open, and what it requires is being heard."""
        at = self.writing.at
        if at.target.session.session_id != session.session_id or at.bag is None:
            return False, at.problem or "opening the file"
        if at.bag.failure:
            return False, at.bag.failure
        required = Patterns(session.required_streams)
        refused = [r for r in self.topics.refused.values() if required.match(r.topic)]
        if refused:
            return False, f"{refused[0].topic}: {refused[0].why}"
        deaf = self.topics.unmatched()
        return not deaf, f"not connected yet to {', '.join(deaf)}" if deaf else ""

    def _finished(self, session: SessionState) -> tuple[bool, str]:
        """Say whether all of a session is on the disk; after everybody else, whose last messages are its end."""
        others = [entry for entry in session.waiting_for if entry.partition(":")[0] != self._service.node.get_name()]
        if others:
            return False, "waits for the others"
        if self._alone[0] != session.session_id:
            self._alone = session.session_id, time.monotonic()
        if time.monotonic() < self._alone[1] + SETTLE_S:
            return False, "writing"
        self._turn(self._plan.finish(session.session_id))
        bag = self._last
        if bag is None or bag.about.session is None or bag.about.session["session_id"] != session.session_id:
            return False, "no file of this session was written"
        if not bag.closed:
            return False, "writing"
        return not bag.failure, bag.failure


def _usable(root: Path) -> Path:
    """Make the folder of the recordings. Raises ConfigError where nothing can be written there."""
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise ConfigError(f"parameter 'directory' is {str(root)!r}: {err.strerror} ({err.filename})") from err
    if not os.access(root, os.W_OK | os.X_OK):
        raise ConfigError(f"parameter 'directory' is {str(root)!r}: nothing can be written there")
    return root


def _write_pointer(root: Path, directory: Path) -> None:
    """`recording` beside the recordings names the newest one."""
    temporary = root / f".recording.{os.getpid()}"
    try:
        temporary.write_text(directory.relative_to(root).as_posix() + "\n", "utf-8")
        temporary.replace(root / "recording")
    except OSError:
        return  # a convenience; what keeps the recording from being written is said elsewhere


async def serve(service: Service[Config]) -> None:
    """Record until told to stop."""
    await Recorder(service).run()


def main() -> int:
    """Run until stopped."""
    return run("recorder", Config, serve)


if __name__ == "__main__":
    sys.exit(main())
