"""Which folders are one session: a recorder that was killed goes on in a further folder beside the first.

The rule: two folders beside each other are parts of one session where their recorder.json names the same session_id and
the same start. Where one of them does not know the start (its recorder was killed before it was announced), their names
must be the same less the number at the end; so too where one has lost its recorder.json. A session_id that is used a
second time is another session, and a folder may be renamed.

What two recorders wrote at the same time, or a copy that lies beside, is no further part: each is the session again.
"""

from __future__ import annotations

from pathlib import Path

from sense4hri_recording import recorder_json
from sense4hri_recording.errors import SessionError
from sense4hri_recording.layout import first_name, part_number
from sense4hri_recording.recorder_json import COMPLETE, RECORDING, RecorderJson


def with_its_name(path: Path) -> Path:
    """The same by a path that ends in its name, as `.` and `..` do not."""
    return path.resolve() if path.name in ("", "..") else path


def parts(folder: Path) -> list[Path]:
    """All folders of the session that this one is a part of, in their order; this one alone outside of sessions."""
    folder = with_its_name(folder)
    about = recorder_json.read(folder)
    if about.says_session and not about.session_id:
        return [folder]
    own = folder.resolve()
    beside = [path for path in _folders(own.parent) if path != own]
    others = {folder.with_name(path.name): recorder_json.read(path) for path in beside}
    found = {folder: about}
    for path, other in sorted(others.items(), key=lambda item: _place(*item)):
        if _same(own.name, about, path.name, other) and not any(_once_more(other, part) for part in found.values()):
            found[path] = other
    return sorted(found, key=lambda path: _place(path, found[path]))


def closed_parts(folder: Path) -> list[Path]:
    """The parts that nobody is writing any more, and this one."""
    folder = with_its_name(folder)
    return [part for part in parts(folder) if part == folder or recorder_json.read(part).state != RECORDING]


def find(path: Path, only_this_part: bool = False) -> list[Path]:
    """The parts of the session that a path names: any one of its folders, or `<folder above>/<session_id>`.

    A single file, and a folder with only_this_part, is itself alone. Raises SessionError where there is no such
    session, or several have this session_id.
    """
    path = with_its_name(path)
    if path.exists():
        return [path] if only_this_part or path.is_file() else parts(path)
    if not path.parent.is_dir():
        raise SessionError(f"{path}: there is no such file or directory")
    named = [folder for folder, about in recorder_json.recordings(path.parent) if about.session_id == path.name]
    sessions = {tuple(parts(folder)) for folder in named}
    if not sessions:
        raise SessionError(f"{path}: there is no such file or directory, nor a session {path.name} below {path.parent}")
    if len(sessions) > 1:
        names = ", ".join(sorted(str(first) for first, *_ in sessions))
        raise SessionError(f"{path.name} is the session_id of {len(sessions)} sessions, name one of them: {names}")
    return list(sessions.pop())


def earlier_part(parent: Path, session_id: str) -> str:
    """The name of the newest recording of a session below `<study>/<participants>`, less its number; empty: none."""
    found = [
        (about.opened_ns or 0, path.name)
        for path, about in recorder_json.recordings(parent)
        if about.session_id == session_id
    ]
    return first_name(max(found)[1]) if found else ""


def _same(name: str, about: RecorderJson, other_name: str, other: RecorderJson) -> bool:
    if about.says_session and other.says_session:
        if about.session_id != other.session_id:
            return False
        if about.start_at_ns and other.start_at_ns:
            return about.start_at_ns == other.start_at_ns
    return first_name(name) == first_name(other_name)


def _once_more(about: RecorderJson, other: RecorderJson) -> bool:
    """True for a copy, and for two recordings of one time of which neither was cut off, so that neither goes on."""
    spans = [(told.opened_ns or 0, told.closed_ns or told.last_written_ns or 0) for told in (about, other)]
    (begin_ns, end_ns), (other_begin_ns, other_end_ns) = spans
    if not end_ns or not other_end_ns or end_ns <= other_begin_ns or other_end_ns <= begin_ns:
        return False
    return begin_ns == other_begin_ns or about.state == other.state == COMPLETE


def _place(path: Path, about: RecorderJson) -> tuple[int, int, str]:
    return part_number(path.resolve().name), about.opened_ns or 0, path.name


def _folders(parent: Path) -> list[Path]:
    """Folders with a recording in them."""
    try:
        return [path for path in parent.iterdir() if path.is_dir() and any(path.glob("*.mcap"))]
    except OSError:
        return []
