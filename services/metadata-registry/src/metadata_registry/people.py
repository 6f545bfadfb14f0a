"""Participants, sessions and what was, over HTTP; the sessions are heard on `/study/session`."""

import sqlite3
import time
from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.subscription import Subscription
from sense4hri import qos
from sense4hri.errors import Refusal
from sense4hri.names import is_human_id
from sense4hri.recorder_status import RecorderStatus
from sense4hri.schema import parameter
from sense4hri.service import Service
from sense4hri.session import SessionMember
from sense4hri.stamps import to_ns
from sense4hri_msgs.msg import SessionState

from metadata_registry.config import Config
from metadata_registry.deserted import LOOK_EVERY_S, Deserted
from metadata_registry.participants import RUNS, Everything, Participant, Participants
from metadata_registry.past import Reading, Removed, Session, Worn
from metadata_registry.registry import Registry
from metadata_registry.store import Store

MOST_HUMANS, LONGEST_NOTES = 100, 1 << 16
SESSION_TOPIC = "/study/session"
TOLD_EVERY_S = 60.0
_RUNS = (SessionState.RECORDING, SessionState.STOPPING)


@dataclass(frozen=True)
class Farewell:
    """Who is taken out: the pseudonym once more, for it cannot be undone."""

    confirm: str = parameter(help="the same pseudonym as in the address")


class People:
    """The routes about participants. worn_by: sensors that one wears or is to wear now; publish: tell the graph."""

    def __init__(
        self,
        service: Service[Config],
        store: Store,
        registry: Registry,
        worn_by: Callable[[str], set[str]],
        publish: Callable[[], None],
    ) -> None:
        self._service, self._past, self._worn_by, self._publish = service, store.past, worn_by, publish
        self._participants = Participants(store, registry)
        self._preparing: Session | None = None
        self._deserted = Deserted(service.config.session_over_after_s)
        self._recorders: Subscription | None = None  # heard while a session runs that nobody conducts
        service.subscribe(SessionState, SESSION_TOPIC, self._hear, qos.SESSION)
        SessionMember(service)  # who hears of sessions is waited for, so it answers
        service.every(LOOK_EVERY_S, self._look)
        service.http.get("/history", self._past.worn, list[Worn])
        service.http.get("/readings", self._past.readings, list[Reading])
        service.http.get("/sessions", self._past.sessions, list[Session])
        service.http.get("/participants", self._participants.all, list[Participant])
        service.http.get("/participants/{human_id}", self._participants.of, Everything)
        service.http.post("/participants/{human_id}/delete", self._delete, Farewell, Removed)

    def _delete(self, farewell: Farewell, human_id: str) -> Removed:
        """Take everything about one participant out of the registry, for ever."""
        if farewell.confirm != human_id:
            raise Refusal("confirm must be the pseudonym in the address: this cannot be undone", "confirm")
        removed = self._participants.remove(human_id, self._worn_by(human_id), self._to_come(), self._runs())
        self._service.log.info("a participant was taken out of the registry")
        if removed.in_log:
            self._service.log.warning(
                "another program reads the database, or the disk is full: start the registry anew to empty its log"
            )
        self._publish()
        return removed

    def _to_come(self) -> Session | None:
        """The session that is being prepared; none where nobody is left on the graph who prepares it."""
        return self._preparing if self._is_conducted() else None

    def _runs(self) -> str:
        """What is said of a session that runs."""
        if self._is_conducted():
            return RUNS
        return self._deserted.why_not(self._past.running(), time.monotonic())

    def _is_conducted(self) -> bool:
        return self._service.node.count_publishers(SESSION_TOPIC) > 0

    def _look(self) -> None:
        """End a session that runs no more, though nobody is left to say so."""
        running = "" if self._is_conducted() else self._past.running()
        if not running:
            self._deserted.conducted()
            self._hear_no_recorders()
            return
        if self._recorders is None:
            self._recorders = self._service.hear_diagnostics(self._hear_recorders)
        self._deserted.looked(now_s := time.monotonic())
        if self._deserted.is_over(running, now_s):
            self._end(running)

    def _end(self, session_id: str) -> None:
        """Call a session that nobody conducts any more what its coordinator would: failed."""
        log, config = self._service.log, self._service.config
        try:
            self._past.end("failed")
        except sqlite3.Error as err:
            trouble = f"session '{session_id}' is over, which cannot be kept in {config.database}: {err}"
            log.warning_at_times(trouble, TOLD_EVERY_S)
            return
        gone = f"no session-coordinator has been on the graph for {config.session_over_after_s:g} s"
        log.warning(f"session '{session_id}' is over: {gone}, and no recorder records it")

    def _hear_recorders(self, told: DiagnosticArray) -> None:
        for status in told.status:
            if recorder := RecorderStatus.parse(status):
                self._deserted.heard(recorder, time.monotonic())

    def _hear_no_recorders(self) -> None:
        if self._recorders is not None:
            self._service.unsubscribe(self._recorders)
            self._recorders = None

    def _hear(self, state: SessionState) -> None:
        self._preparing = session_of(state) if state.phase == SessionState.PREPARING else None
        try:
            self._keep(state)
        except sqlite3.Error as err:
            self._service.log.error(
                f"session '{state.session_id}' cannot be kept in {self._service.config.database}: {err}"
            )

    def _keep(self, state: SessionState) -> None:
        if state.phase in _RUNS and to_ns(state.start_at):
            self._past.begin(session_of(state))
        elif state.phase not in _RUNS:
            self._past.end("failed" if state.phase == SessionState.FAILED else "ended")


def session_of(state: SessionState) -> Session:
    """Return a session as it is kept: who is no pseudonym is left out, and so are notes of unusual length."""
    humans = tuple(name for name in state.human_ids[:MOST_HUMANS] if is_human_id(name))
    notes = state.metadata_json if len(state.metadata_json) <= LONGEST_NOTES else "{}"
    times = to_ns(state.start_at), to_ns(state.stop_at)
    about = state.study, state.task, state.directory, notes or "{}"
    return Session(state.session_id, *times, "running", *about, humans)
