"""Where a recording goes: folders that are new, named after what is in them, and locked while they are written."""

from __future__ import annotations

import fcntl
import json
import os
import re
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sense4hri.names import folder_name

SIDECAR = "recorder.json"
LOCK = ".lock"
NOBODY = "nobody"


def utc(now_s: float) -> str:
    """A time as part of a name: 20261121T093000Z."""
    return time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(now_s))


def session_parent(study: str, human_ids: Sequence[str]) -> Path:
    """`<study>/<participants>`, whatever characters are in them."""
    people = "-".join(folder_name(human_id) for human_id in sorted(human_ids))
    return Path(folder_name(study)) / (people[:200].rstrip("-_") or NOBODY)


def session_name(session_id: str, task: str, now_s: float) -> str:
    """`<session>_<task>_<utc>`, without the task where there is none."""
    return "_".join([folder_name(session_id), *([folder_name(task)] if task else []), utc(now_s)])


def new_directory(parent: Path, name: str) -> Path:
    """Make and return `<parent>/<name>`, with `_1`, `_2`, ... where that exists already."""
    parent.mkdir(parents=True, exist_ok=True)
    for number in range(1000):
        path = parent / (name if number == 0 else f"{name}_{number}")
        try:
            path.mkdir()
        except FileExistsError:
            continue
        return path
    raise FileExistsError(17, "exists already, and so do 999 more", f"{parent / name}_999")


class Lock:
    """Held by the process that writes a folder. Raises BlockingIOError where another one holds it."""

    def __init__(self, directory: Path) -> None:
        self._fd = os.open(directory / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._fd)
            raise

    def release(self) -> None:
        os.close(self._fd)


def recordings(root: Path) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Every folder at or below root with a recorder.json that can be read, and its content."""
    for path in sorted(root.rglob(SIDECAR)):
        try:
            content = json.loads(path.read_text("utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(content, dict):
            yield path.parent, content


def other_parts(directory: Path) -> list[Path]:
    """The other folders of the session that this folder is a part of, in their order; all of them are closed."""
    base = re.sub(r"Z_\d+$", "Z", directory.name)
    parts = [
        (about.get("opened_ns") or 0, path)
        for path, about in recordings(directory.parent)
        if path != directory and re.sub(r"Z_\d+$", "Z", path.name) == base and about.get("state") != "recording"
    ]
    return [path for _, path in sorted(parts)]


def earlier_part(parent: Path, session_id: str) -> str:
    """The name of the newest recording of a session below `<study>/<participants>`, less its `_1`; empty: none."""
    found = [
        (about.get("opened_ns") or 0, path.name)
        for path, about in recordings(parent)
        if isinstance(about.get("session"), dict) and about["session"].get("session_id") == session_id
    ]
    return re.sub(r"Z_\d+$", "Z", max(found)[1]) if found else ""
