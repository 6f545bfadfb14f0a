"""The running session in a small file, so that a coordinator started afresh goes on with it."""

import json
import math
import os
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sense4hri.files import replace_file
from sense4hri.set_aside import set_aside
from sense4hri.shapes import read
from sense4hri.strict_json import parse

from session_coordinator.request import StartWish, request
from session_coordinator.session import ACTIVE, SECOND_NS, Phase, Session

LARGEST_FILE = 1 << 22
LATEST_NS = 2**31 * SECOND_NS  # of what a ROS stamp can say


class Kept(NamedTuple):
    """What the run before left: session, session_ids used, and how long ago it last was there.

    gone_for_s is NaN where by the clock, which was set back then, that is yet to come.
    """

    session: Session
    used: tuple[str, ...]
    gone_for_s: float


@dataclass(frozen=True)
class _File:
    """The fields of the file."""

    session: dict[str, Any]
    used: tuple[str, ...]


class Store:
    """One JSON file, replaced as a whole; while a session runs, its time of change is the coordinator's heartbeat."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def load(self) -> Kept | None:
        """Return what was kept, None where there is no file. Raises OSError, or ValueError where it is not ours."""
        try:
            with self._path.open("rb") as file:
                text, changed_s = file.read(LARGEST_FILE + 1), os.fstat(file.fileno()).st_mtime
        except FileNotFoundError:
            return None
        try:
            content: _File = read(_File, parse(text, "the file", LARGEST_FILE))
            gone_for_s = time.time() - changed_s
            return Kept(_session(content.session), content.used, gone_for_s if gone_for_s >= 0 else math.nan)
        except ValueError as err:
            raise ValueError(f"{self._path} holds no session of ours: {err}") from err

    def set_aside(self) -> Path:
        """Keep a file that cannot be read under another name, and return that. Raises OSError."""
        return set_aside(self._path)

    def save(self, session: Session, used: tuple[str, ...]) -> None:
        """Keep the session; it is on the disk when this returns. Raises OSError."""
        replace_file(self._path, json.dumps({"session": asdict(session), "used": used}, indent=1, ensure_ascii=False))

    def beat(self) -> None:
        """Say that the coordinator is there. Raises OSError."""
        os.utime(self._path)


def _session(content: dict[str, Any]) -> Session:
    """Return a session that a start would be granted for. Raises ValueError."""
    session: Session = read(Session, content | {"phase": Phase(content.get("phase", Phase.IDLE))}, "session")
    for name in ("start_ns", "stop_ns"):
        if not 0 <= getattr(session, name) < LATEST_NS:
            raise ValueError(f"session.{name} is {getattr(session, name)}, which is no time")
    if session.phase in ACTIVE:
        fields = ("study", "session_id", "task", "metadata_json", "human_ids", "required_streams")
        request(StartWish(**{name: getattr(session, name) for name in fields}))
    return session
