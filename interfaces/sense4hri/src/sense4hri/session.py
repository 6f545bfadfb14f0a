"""How a service takes part in a session: it hears `/study/session` and acknowledges every phase on `/study/ack`.

A service listed in `waiting_for` says again what it has to say every half second, so that neither a coordinator that
was started afresh nor a lost acknowledgement leaves anybody waiting.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Any

from sense4hri_msgs.msg import SessionAck, SessionState

from sense4hri import qos
from sense4hri.names import UNASSIGNED, StreamName
from sense4hri.patterns import Patterns
from sense4hri.service import Service
from sense4hri.stamps import from_ns, to_ns
from sense4hri.strict_json import parse
from sense4hri.waiting import waits_for

POLL_S = 0.1
REPEAT_S = 0.5
ASKING = (SessionState.PREPARING, SessionState.STOPPING)
"""In which what a service answers may change of itself."""
Answer = tuple[bool, str]
"""Ready or done, and one line for the operator."""


def _at_once(state: SessionState) -> Answer:
    return True, ""


class SessionMember:
    """The part of one service in the study's sessions; calls back on the main thread.

    ready(state): asked in PREPARING, again and again, until RECORDING; False comes with what is missing.
    begin(start_ns): told once per session, the common start in ROS time; it lies ahead unless the service came late.
    finish(state): asked in STOPPING until it is done; the stop is in state.stop_at.
    directory(state): where the recording of this session lies, for a recorder; empty where it has none yet.
    """

    def __init__(
        self,
        service: Service[Any],
        ready: Callable[[SessionState], Answer] = _at_once,
        begin: Callable[[int], None] = lambda start_ns: None,
        finish: Callable[[SessionState], Answer] = _at_once,
        directory: Callable[[SessionState], str] = lambda state: "",
    ) -> None:
        self._service, self._name = service, service.node.get_name()
        self._ready, self._begin, self._finish, self._directory = ready, begin, finish, directory
        self.state = SessionState()
        """The session as last heard; IDLE at first."""
        self._said: Answer | None = None
        self._said_at_s = 0.0
        self._begun: tuple[str, int] | None = None
        self._acks = service.publisher(SessionAck, "/study/ack", qos.ACK)
        service.subscribe(SessionState, "/study/session", self._hear, qos.SESSION)
        self._asked = asyncio.Event()
        service.start(self._keep_looking())

    def _hear(self, state: SessionState) -> None:
        if (state.session_id, state.phase) != (self.state.session_id, self.state.phase):
            self._said = None
        self.state = state
        if state.phase == SessionState.PREPARING:
            self._begun = None  # also of a session that is replayed once more
        begun = state.session_id, to_ns(state.start_at)
        if state.phase == SessionState.RECORDING and begun != self._begun:
            self._begun = begun
            self._begin(begun[1])
        self._look()
        if state.phase in ASKING or waits_for(state.waiting_for, self._name):
            self._asked.set()
        else:
            self._asked.clear()

    async def _keep_looking(self) -> None:
        """Look again and again for as long as a session asks; for the rest of the time it costs nothing."""
        while await self._asked.wait() and not self._service.stopped.is_set():
            self._look()
            await asyncio.sleep(POLL_S)

    def _look(self) -> None:
        state = self.state
        if state.phase == SessionState.IDLE:
            return
        answer = self._answer(state)
        repeat = waits_for(state.waiting_for, self._name) and time.monotonic() - self._said_at_s >= REPEAT_S
        if answer != self._said or repeat:
            self._acknowledge(state, answer)

    def _answer(self, state: SessionState) -> Answer:
        if state.phase == SessionState.PREPARING:
            return self._ready(state)
        return self._finish(state) if state.phase == SessionState.STOPPING else (True, "")

    def _acknowledge(self, state: SessionState, answer: Answer) -> None:
        self._said, self._said_at_s = answer, time.monotonic()
        ack = SessionAck(session_id=state.session_id, service=self._name, phase=state.phase)
        ack.header.stamp = from_ns(time.time_ns())
        ack.ok, ack.detail = answer
        ack.directory = self._directory(state)
        self._acks.publish(ack)


def warmup_allowed(state: SessionState) -> bool:
    """True where the session may begin before every clock is locked: `"allow_warmup": true` in its metadata_json."""
    try:
        metadata = parse(state.metadata_json, "metadata_json")
    except ValueError:
        return False
    return isinstance(metadata, dict) and metadata.get("allow_warmup") is True


def concerns(state: SessionState, name: StreamName) -> bool:
    """True where a stream belongs to a session: its wearer takes part, or it is required.

    A session that names nobody concerns every stream that somebody wears.
    """
    if name.human_id in state.human_ids or Patterns(state.required_streams).match(name.topic("raw")):
        return True
    return not state.human_ids and name.human_id != UNASSIGNED


def required(state: SessionState) -> set[StreamName]:
    """Return the raw streams that a session requires by their full names; a glob names none."""
    parsed = map(StreamName.parse, state.required_streams)
    return {found[0] for found in parsed if found is not None and found[1] == "raw"}
