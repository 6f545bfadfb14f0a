"""How a recording lies on the disk: names of folders and files, and a recording's files in their order.

    <recordings>/<study>/<participants>/<session>_<task>_<utc>[_<n>]/    a session, or its further parts
    <recordings>/<utc>/                                                 what lies between sessions

and in each of them `<folder>_<number>.mcap`, `metadata.yaml`, `recorder.json`, `report.json` and `report.html`.
"""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from pathlib import Path

from sense4hri.names import folder_name

from sense4hri_recording import rosbag2
from sense4hri_recording.errors import SessionError

LOCK = ".lock"
RESERVE = ".reserve"  # kept aside so that a full disk still takes the index
REPORT_JSON, REPORT_HTML = "report.json", "report.html"
POINTER = "recording"  # a file beside the recordings that names the newest one
REPAIRED = "_repaired"
NOBODY = "nobody"
_PART = re.compile(r"(?<=Z)_(\d+)$")


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


def first_name(folder: str) -> str:
    """A folder's name less the `_1`, `_2`, ... of a further part."""
    return _PART.sub("", folder)


def part_number(folder: str) -> int:
    """1, 2, ... of a further part by its folder's name, 0 of the first one."""
    found = _PART.search(folder)
    return int(found[1]) if found else 0


def file_number(path: Path) -> int:
    """The place of `<folder>_<number>.mcap` among a recording's files, repaired or not; -1 where it has none."""
    tail = path.stem.removesuffix(REPAIRED).rpartition("_")[2]
    return int(tail) if tail.isdecimal() else -1


def repaired(file: Path) -> Path:
    """Where the readable copy of a damaged file stands."""
    return file.with_name(f"{file.stem}{REPAIRED}.mcap")


def find_files(path: Path) -> list[Path]:
    """The MCAP files of a recording in their order, of a damaged and a repaired one the repaired.

    path: a recording's folder or one file. What metadata.yaml names comes first; without it, all that are there. Raises
    SessionError where there are none.
    """
    if not path.exists():
        raise SessionError(f"{path}: there is no such file or directory")
    if path.is_file():
        return [path]
    files = rosbag2.named_files(path) or _in_order(path)
    if files:
        return files
    if any(path.glob("*.db3")):
        raise SessionError(f"{path} is an older rosbag2 (sqlite3): `ros2 bag convert` makes an MCAP of it")
    raise SessionError(f"{path}: no recording here, no .mcap file and no metadata.yaml that names one")


def _in_order(folder: Path) -> list[Path]:
    found = [file for file in folder.glob("*.mcap") if not repaired(file).exists()]
    return sorted(found, key=lambda file: (file_number(file), file.name))
