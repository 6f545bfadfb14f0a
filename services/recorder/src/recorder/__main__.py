"""Records the study's sessions, and what lies between them, until it is told to stop."""

import asyncio
import sys
import time
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from sense4hri import diagnostics, qos
from sense4hri.host_clocks import this_host
from sense4hri.memory import give_large_blocks_back
from sense4hri.recorder_status import RecorderStatus
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri_msgs.msg import SessionState
from sense4hri_recording.layout import REPORT_HTML
from sense4hri_recording.recorder_json import INTERRUPTED

from recorder import about
from recorder.account import Account
from recorder.bag import Bag
from recorder.chores import Chore, Chores
from recorder.config import Config
from recorder.folders import usable, write_pointer
from recorder.hearing import SETTLE_S
from recorder.nodes import Nodes
from recorder.plan import Kind, Plan, Session, Target
from recorder.recover import left_behind
from recorder.shown import show
from recorder.space import Space
from recorder.status import RecordedTopic, Recording, Status
from recorder.taking_part import TakingPart
from recorder.told import About, Limits
from recorder.topics import Topics
from recorder.writing import Writing

SETTLE_AT_MOST_S = 1.2
TICK_S, QUIET_ROUNDS = 0.02, 5
STOP_S, CHORES_S = 9.0, 6.5  # after a SIGTERM: Docker gives 10 s; until then reports may take
RECOVER, REPORT = "recorder.recover", "sense4hri_report"
MB = 1_000_000
MOST_NAMED = 20
THREADS = ("the hearing thread", "the writing thread")
MOST_TOLD = 5  # of the topics that are not recorded, in one sentence; the metrics have their number


class Recorder:
    """Follows the session, keeps the recording that belongs to it, and tells about it."""

    def __init__(self, service: Service[Config]) -> None:
        self._service, config = service, service.config
        self._root = usable(Path(config.directory))
        limits = Limits(config.compression, config.split_mb * MB, config.split_s, about.distro())
        space = Space(config.free_floor_mb * MB)
        self._session: dict[str, Any] = {}
        self.writing = Writing(
            self._root,
            config.flush_interval_s,
            limits,
            space,
            self._about,
            self._opened,
            self._closed,
            service.thread,
        )
        self.topics = Topics(service, self.writing.queue)
        self._plan = Plan(config.record_when == "always")
        self._target = Target(Kind.NOTHING)
        self._newest: Bag | None = None
        self._last: Bag | None = None  # of the session
        self._failure = self._space_warning = self._report = self._no_report = ""
        self.nodes = Nodes(service)
        self._chores = Chores(self._chore_done)
        self._work = service.start(self._chores.run())
        self._states = service.publisher(DiagnosticArray, diagnostics.TOPIC, qos.HEALTH)
        service.subscribe(SessionState, "/study/session", self._hear, qos.SESSION)
        TakingPart(service, self.writing, self.topics, lambda: self._last, self._finish)
        service.http.get("/recording", self.status, Recording)
        service.log.info(f"records {config.record_when}, into {self._root.resolve()}")
        service.thread("search", self._recover)
        self._turn(self._plan.target)

    def _recover(self) -> None:
        """Find what recorders left behind, on a thread of its own: where there are thousands of recordings it lasts."""
        for folder in left_behind(self._root):
            if self._service.stopped.is_set():
                return
            self._chores.add(Chore(RECOVER, folder))

    async def run(self) -> None:
        """Record until stopped, then finish the file with everything that was received by then, whatever failed."""
        service = self._service
        service.every(1.0, self._watch)
        service.ready()
        why = "the recorder failed; its log says why"
        try:
            await service.stopped.wait()
            stopped_s, why = time.monotonic(), "the recorder was stopped while the session was running"
            await self._settle()
        finally:
            self._end(why)
        left = await self._chores.finish(stopped_s + CHORES_S - time.monotonic())
        self._work.cancel()
        for chore in left:
            service.log.warning(f"no time for it, to be done by hand: {chore.command}")
        self._tell()

    def _end(self, why: str) -> None:
        """Hear nothing more, and write what was heard."""
        uncounted, at = self.topics.close(), self.writing.at
        if uncounted and at.bag is not None:
            what = f"{len(uncounted)} topics had sent more than could even be counted at the end"
            at.bag.about.note(f"{what}: {', '.join(uncounted[:MOST_NAMED])}")
        if at.bag is not None and at.target.kind is Kind.SESSION:
            at.bag.about.outcome = INTERRUPTED, why
        self.writing.close()

    def lost(self) -> int:
        """Messages that were sent while recording but are not in the file."""
        return self._newest.accounts.lost if self._newest is not None else 0

    def status(self) -> Recording:
        """What is being recorded, and what is not."""
        at, bag = self.writing.at, self._newest
        reasons = [*filter(None, (at.problem, at.bag.failure if at.bag is not None else ""))]
        reasons += [f"{refused.topic}: {refused.why}" for refused in self.topics.refused.values()]
        return Recording(
            str(bag.directory.resolve()) if bag is not None else "",
            at.bag is not None and not at.bag.refused,
            at.target.session.session_id,
            bag.accounts.messages if bag is not None else 0,
            self.lost(),
            self._rows(bag),
            tuple(sorted(self.topics.withheld)),
            tuple(reasons),
        )

    def _rows(self, bag: Bag | None) -> tuple[RecordedTopic, ...]:
        accounts = dict(bag.accounts.by_channel) if bag is not None else {}
        silent = {topic.channel: Account(0) for topic in list(self.topics.recorded.values())}
        return tuple(
            RecordedTopic(channel.topic, channel.type_name, account.messages, account.lost, account.missed)
            for channel, account in (silent | accounts).items()
        )

    def _status(self) -> Status:
        """What `/diagnostics` says."""
        at, bag, space = self.writing.at, self._newest, self.writing.space
        written = at.bag if at.bag is not None else bag
        told = RecorderStatus(
            node=self._service.node.get_name(),
            recording=at.bag is not None and not at.bag.refused,
            directory=str(written.directory.resolve()) if written is not None else "",
            session_id=at.target.session.session_id,
            messages=written.accounts.messages if written is not None else 0,
            lost=self.lost(),
            written_bytes=written.disk_bytes if written is not None else 0,
            free_bytes=space.free_bytes,
            minutes_left=space.minutes_left if at.bag is not None else None,
            report=self._report,
            behind_s=self.topics.hearing.behind_s,
            host=this_host(),
        )
        return Status(
            told,
            warn_minutes=self._service.config.warn_minutes,
            problem=self._hung() or at.problem or (at.bag.trouble if at.bag is not None else ""),
            unsafe=at.bag.unsafe if at.bag is not None else "",
            doubts=tuple(
                [*(f"not recorded: {r.topic}: {r.why}" for r in list(self.topics.refused.values())[:MOST_TOLD])]
                + ([self._no_report] if self._no_report else [])
                + ([f"no session can be recorded: {space.refusal}"] if at.bag is None and space.refusal else [])
            ),
            lost_of=bag.accounts.lost_of if bag is not None else "",
        )

    def _hung(self) -> str:
        """Which thread keeps messages from the file, empty where all turn."""
        silent = [name for name in self._service.unanswered() if name in THREADS]
        return f"no answer from {' and '.join(silent)}; the recorder is ended where it stays so" if silent else ""

    def _tell(self) -> None:
        self._states.publish(self._status().message())

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

    def _finish(self, session_id: str) -> None:
        self._turn(self._plan.finish(session_id))

    def _turn(self, target: Target) -> None:
        if target != self._target:
            self._target = target
            self._chores.session_runs(target.kind is Kind.SESSION)
            self.writing.turn_to(target)

    def _about(self, target: Target) -> About:
        """Called by the writing thread: what is told in a new recording."""
        opened_ns = time.time_ns()
        told = About(None, about.software(), lambda: self._surroundings(opened_ns))
        if target.kind is Kind.SESSION:
            told.session = dict(self._session)
            if target.continued:
                told.note("the recorder was started while the session was running; an earlier part may lie beside this")
        return told

    def _surroundings(self, opened_ns: int) -> dict[str, Any]:
        refused = [
            {"topic": refused.topic, "type": refused.type_name, "why": refused.why}
            for refused in list(self.topics.refused.values())
        ]
        return {
            "refused": refused,
            "withheld": sorted(self.topics.withheld),
            "nodes": self.nodes.since(opened_ns),
        }

    def _opened(self, bag: Bag) -> None:
        """Called by the writing thread."""
        self._newest = bag
        if bag.about.session is not None:
            self._last, self._report, self._no_report = bag, "", ""
        self._service.post(self._tell)
        write_pointer(self._root, bag.directory)
        self._service.log.info(f"recording to {bag.directory.resolve()}")

    def _closed(self, bag: Bag) -> None:
        """Called by the thread that waits for the disk."""
        if bag.failure:
            self._service.log.error(f"the recording is not whole: {bag.failure}")
        self._service.log.info(
            f"{bag.accounts.messages} messages, {bag.accounts.lost} lost, in {bag.directory.resolve()}"
        )
        self._service.post(self._tell)
        if self._service.config.reports and not bag.gone:
            self._chores.add(Chore(REPORT, bag.directory, patient=True))

    def _chore_done(self, chore: Chore, status: int, lines: list[str]) -> None:
        """Say what became of it; a recording that was recovered gets its report."""
        log, last = self._service.log, " / ".join(lines[-3:])
        own = self._last is not None and chore.directory == self._last.directory
        if status == 0:
            log.info(last)
        elif own or chore.module == RECOVER:
            log.error(f"failed: {chore.command}: {last}")
        else:  # there may be nothing to report on between sessions
            log.info(f"no report: {last}")
        if chore.module == RECOVER and status == 0 and self._service.config.reports:
            self._chores.add(Chore(REPORT, chore.directory, patient=True))
        elif chore.module == REPORT and own:
            self._report = str((chore.directory / REPORT_HTML).resolve()) if status == 0 else ""
            self._no_report = "" if status == 0 else f"no report could be made: {last}"
        self._tell()

    async def _settle(self) -> None:
        """Wait until what came before the stop is taken in: the hearing thread has looked again and found nothing."""
        hearing, begun_s = self.topics.hearing, time.monotonic()
        quiet_from, seen = hearing.rounds, self._received()
        while time.monotonic() - begun_s < SETTLE_AT_MOST_S:
            hearing.look()
            await asyncio.sleep(TICK_S)
            if (received := self._received()) != seen:
                quiet_from, seen = hearing.rounds, received
            if time.monotonic() - begun_s > SETTLE_S and hearing.rounds - quiet_from > QUIET_ROUNDS:
                break

    def _received(self) -> int:
        return sum(topic.received for topic in self.topics.recorded.values())

    def _watch(self) -> None:
        """Once a second: state, metrics, and each trouble said once."""
        status, log = self._status(), self._service.log
        self.topics.release()
        show(self._service.metrics, self._newest, self.topics, self.writing, status.told.minutes_left)
        failure = status.problem or status.unsafe
        if failure != self._failure:
            if status.problem:
                log.error(f"NOT RECORDING: {status.problem}")
            elif failure:
                log.error(f"recording, but not safely: {failure}")
            else:
                log.info(f"recording again, {self.lost()} messages were lost")
        if status.space_warning and not self._space_warning:
            log.warning(status.space_warning)
        self._failure, self._space_warning = failure, status.space_warning
        self._service.ready(not failure, failure)
        self._states.publish(status.message())


async def serve(service: Service[Config]) -> None:
    """Record until told to stop."""
    await Recorder(service).run()


def main() -> int:
    """Run until stopped; return the exit status."""
    give_large_blocks_back()
    return run("recorder", Config, serve, stop_timeout_s=STOP_S)


if __name__ == "__main__":
    sys.exit(main())
