"""The recorder in the handshake of a session: whether it may begin, and whether all of it is on the disk."""

from __future__ import annotations

import time
from collections.abc import Callable

from sense4hri.service import Service
from sense4hri.session import SessionMember
from sense4hri.stamps import to_ns
from sense4hri.waiting import Waited
from sense4hri_msgs.msg import SessionState

from recorder import about
from recorder.bag import Bag
from recorder.config import Config
from recorder.hearing import SETTLE_S
from recorder.topics import Topics
from recorder.writing import Writing


class TakingPart:
    """last(): the newest recording of a session. finish(session_id): stop recording it."""

    def __init__(
        self,
        service: Service[Config],
        writing: Writing,
        topics: Topics,
        last: Callable[[], Bag | None],
        finish: Callable[[str], None],
    ) -> None:
        self._name, self._writing, self._topics = service.node.get_name(), writing, topics
        self._last, self._finish = last, finish
        self._told_of: Bag | None = None
        self._lacking = ""  # to the one told of
        self._alone = ("", 0, 0.0)  # the session for which all others have finished, its stop, and since when
        SessionMember(service, self._may_begin, finish=self._finished, directory=self._directory)

    def _bag(self, session: SessionState) -> Bag | None:
        """The file of this session; None while another one's is the newest."""
        bag = self._last()
        own = bag is not None and (bag.about.session or {}).get("session_id") == session.session_id
        return bag if own else None

    def _directory(self, session: SessionState) -> str:
        bag = self._bag(session)
        return str(bag.directory.resolve()) if bag is not None else ""

    def _may_begin(self, session: SessionState) -> tuple[bool, str]:
        """Say whether a session may begin: its file is open, and what it requires is being heard."""
        at = self._writing.at
        if at.target.session.session_id != session.session_id or at.bag is None:
            return False, at.problem or "opening the file"
        if at.bag.failure:
            return False, at.bag.failure
        if refused := self._topics.unheard(session.required_streams):
            return False, f"{refused.topic}: {refused.why}"
        deaf = self._topics.unmatched()
        return not deaf, f"not connected yet to {', '.join(deaf)}" if deaf else ""

    def _finished(self, session: SessionState) -> tuple[bool, str]:
        """Say whether all of a session is on the disk; after everybody else, whose last messages are its end."""
        others = [entry for entry in session.waiting_for if Waited.parse(entry).who != self._name]
        if others:
            return False, "waits for the others"
        stop = session.session_id, to_ns(session.stop_at)  # an id may come again after a stop that came too early
        if self._alone[:2] != stop:
            self._alone = *stop, time.monotonic()
        if time.monotonic() < self._alone[2] + SETTLE_S:
            return False, "writing"
        if (behind_s := self._topics.hearing.behind_s) > SETTLE_S:
            return False, f"takes in what was sent, {behind_s:.1f} s behind"
        self._finish(session.session_id)
        bag = self._bag(session)
        if bag is None:
            return False, "no file of this session was written"
        if not bag.closed:
            return False, "writing"
        if self._told_of is not bag:
            self._told_of, self._lacking = bag, "; ".join(filter(None, (about.away_before(bag.directory), bag.missing)))
        return True, self._lacking
