"""What is to be recorded now: decided by the phase of the study's session and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from sense4hri_recording import layout
from sense4hri_recording.parts import earlier_part

IDLE, PREPARING, RECORDING, STOPPING, FAILED = range(5)  # the phases of a SessionState


class Kind(Enum):
    """Nothing is written, or what lies between sessions, or a session."""

    NOTHING = "nothing"
    BETWEEN = "between"
    SESSION = "session"


@dataclass(frozen=True)
class Session:
    """What names a session's folder."""

    session_id: str
    study: str = ""
    task: str = ""
    human_ids: tuple[str, ...] = ()


@dataclass(frozen=True)
class Target:
    """What is to be written. continued: the session was running already when the recorder heard of it."""

    kind: Kind
    session: Session = field(default_factory=lambda: Session(""))
    continued: bool = False

    def directory(self, root: Path, now_s: float) -> Path:
        """Make and return a new folder for it. Raises OSError."""
        if self.kind is not Kind.SESSION:
            return layout.new_directory(root, layout.utc(now_s))
        session = self.session
        parent = root / layout.session_parent(session.study, session.human_ids)
        name = layout.session_name(session.session_id, session.task, now_s)
        if self.continued:
            name = earlier_part(parent, session.session_id) or name
        return layout.new_directory(parent, name)


class Plan:
    """Follows the session. always: also what lies between sessions is recorded."""

    def __init__(self, always: bool) -> None:
        self._rest = Target(Kind.BETWEEN if always else Kind.NOTHING)
        self.target = self._rest
        self._finished = ""

    def hear(self, phase: int, session: Session) -> Target:
        """Return what is to be written in this phase of this session."""
        if phase not in (PREPARING, RECORDING, STOPPING):
            self._finished = ""
            self.target = self._rest
        elif session.session_id == self._finished:
            self.target = self._rest
        elif self.target.kind is not Kind.SESSION or self.target.session.session_id != session.session_id:
            self.target = Target(Kind.SESSION, session, continued=phase != PREPARING)
        return self.target

    def finish(self, session_id: str) -> Target:
        """Note that a session has all it will get, and return what is to be written instead."""
        self._finished = session_id
        self.target = self._rest
        return self.target
