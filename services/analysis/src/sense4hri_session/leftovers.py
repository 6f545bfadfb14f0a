"""Files and folders beside a recording's own that hold what it held, and names that hold a pseudonym."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from sense4hri.files import replace_file, sync
from sense4hri_recording import layout, recorder_json, rosbag2
from sense4hri_recording.errors import SessionError

from sense4hri_session import share
from sense4hri_session.journal import JOURNAL
from sense4hri_session.traces import Traces

REPORTS = (layout.REPORT_JSON, layout.REPORT_HTML)
OURS = frozenset({rosbag2.NAME, recorder_json.NAME, layout.LOCK, JOURNAL, layout.RESERVE, *REPORTS})


def has_report(folder: Path) -> bool:
    """True where a report of the recording was made."""
    return any((folder / name).is_file() for name in REPORTS)


def leftovers(folder: Path, files: Sequence[Path]) -> list[Path]:
    """Exports, reports, damaged originals of repaired files, halves of a rewriting. files: the recording's own.

    An export of a whole session lies beside one of its folders, and is left over from each of them. Of a copy to be
    shared (`<copy>/recording/<folder>`) also the tables beside it; of a file whose renaming was cut short its old name.
    """
    exports = [path for path in folder.iterdir() if _is_export(path)]
    exports += [path for path in folder.parent.iterdir() if _is_export(path) and _is_of(path, folder)]
    own = folder.resolve()
    if own.parent.name == share.RECORDING and _is_export(shared := own.parent.parent):
        exports += [path for path in shared.iterdir() if path != own.parent]
    doubles = [path for path in folder.glob("*.mcap") if path not in files and any(map(path.samefile, files))]
    originals = [
        file.with_name(f"{file.stem.removesuffix(layout.REPAIRED)}.mcap")
        for file in files
        if file.stem.endswith(layout.REPAIRED)
    ]
    halves = [*folder.glob(".*.new"), folder / f".{rosbag2.NAME}", folder / f".{recorder_json.NAME}"]
    rest = [*halves, *folder.glob(f"{rosbag2.NAME}.damaged*"), *(folder / name for name in REPORTS)]
    return sorted({*exports, *(path for path in (*originals, *doubles, *rest) if path.is_file())})


def shared_above(folder: Path, traces: Traces) -> str:
    """Name of the folder of a copy to be shared where it holds the pseudonym; empty elsewhere."""
    own = folder.resolve()
    is_copy = own.parent.name == share.RECORDING
    return own.parent.parent.name if is_copy and traces.half_mentions(own.parent.parent.name) else ""


def strangers(folder: Path, files: Sequence[Path]) -> list[Path]:
    """Files in the folder that are neither the recording's nor left over from it."""
    known = OURS | {path.name for path in (*files, *leftovers(folder, files))}
    return [path for path in sorted(folder.iterdir()) if path.name not in known and path.is_file()]


def free_target(folder: Path, traces: Traces) -> Path:
    """Where a folder belongs without the pseudonym in its name and its parent's; never one that exists."""
    own = folder.resolve()
    people, name = traces.path_without(own.parent.name), traces.name_without(own.name)
    if (people, name) == (own.parent.name, own.name):
        return folder
    target, number = own.parent.parent / people / name, 0
    if target.parent.is_symlink():
        raise SessionError(f"{target.parent} is a link: {folder} is not moved where that leads, remove the link first")
    while target.exists():
        number += 1
        target = target.with_name(f"{name}_{number}")
    return target


def new_names(files: Sequence[Path], traces: Traces) -> dict[Path, Path]:
    """Give the files whose names hold the pseudonym a second name without it; the first ones are to be removed then."""
    renamed = {
        file: file.with_name(traces.name_without(file.name)) for file in files if traces.half_mentions(file.name)
    }
    for old, new in renamed.items():
        if new.exists() and new.samefile(old):
            continue  # cut short between this and the removal
        if new.is_symlink() or new.exists():
            raise SessionError(f"{new} exists already: call that file otherwise and withdraw again")
        os.link(old, new)
    return renamed


def move(folder: Path, target: Path) -> None:
    """Rename a recording's folder, before that in the file that names the newest one."""
    old = folder.resolve()
    target.parent.mkdir(exist_ok=True)
    for parent in list(old.parents)[:4]:
        path = parent / layout.POINTER
        if path.is_file() and old.name in (text := path.read_text("utf-8", "replace")):
            replace_file(path, text.replace(f"{old.parent.name}/{old.name}", f"{target.parent.name}/{target.name}"))
    old.rename(target)
    sync(target.parent)


def remove_empty(study: Path, traces: Traces) -> None:
    """Remove the folders of a study that are named after the pseudonym and hold nothing any more."""
    for path in study.iterdir():
        if path.is_dir() and traces.half_mentions(path.name) and not any(path.iterdir()):
            path.rmdir()


def _is_of(export: Path, folder: Path) -> bool:
    """True where an export beside a recording is called after it, or says that it was made of it; no shared copy."""
    if export.name == f"{folder.name}_export":
        return True
    if export.is_symlink() or (export / share.RECORDING).is_dir():
        return False
    try:
        made_of = {part["folder"] for part in json.loads((export / "session.json").read_text("utf-8"))["parts"]}
    except (OSError, ValueError, TypeError, LookupError, RecursionError):
        return False
    return folder.name in made_of


def _is_export(path: Path) -> bool:
    return path.is_dir() and (path / "session.json").is_file() and (path / "codebook.csv").is_file()
