"""The running session in a small file, so that a coordinator started afresh goes on with it."""

import json
import os
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

from session_coordinator.session import Phase, Session


class Kept(NamedTuple):
    """What the run before left: session, session_ids used, and how long ago it last was there."""

    session: Session
    used: tuple[str, ...]
    gone_for_s: float


class Store:
    """One JSON file, replaced as a whole; while a session runs, its time of change is the coordinator's heartbeat."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def load(self) -> Kept | None:
        """Return what was kept, None where there is no file. Raises ValueError where it is not ours."""
        try:
            text, changed_s = self._path.read_text("utf-8"), self._path.stat().st_mtime
        except FileNotFoundError:
            return None
        try:
            content = json.loads(text)
            session = Session(**{name: _frozen(value) for name, value in content["session"].items()})
            session = replace(session, phase=Phase(session.phase))
            return Kept(session, tuple(content["used"]), max(0.0, time.time() - changed_s))
        except (ValueError, TypeError, KeyError) as err:
            raise ValueError(f"{self._path} is no session of ours ({err!r}): move it away") from err

    def save(self, session: Session, used: tuple[str, ...]) -> None:
        """Keep the session; it is on the disk when this returns. Raises OSError."""
        temporary = self._path.with_name(f".{self._path.name}.new")
        with temporary.open("w", encoding="utf-8") as out:
            json.dump({"session": asdict(session), "used": used}, out, indent=1)
            out.flush()
            os.fsync(out.fileno())
        temporary.replace(self._path)

    def beat(self) -> None:
        """Say that the coordinator is there. Raises OSError."""
        os.utime(self._path)


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
