"""`.withdrawal.json`: what a withdrawal that is under way needs to be finished after it was cut short."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sense4hri.files import open_file, replace_file
from sense4hri.strict_json import MOST_BYTES, parse
from sense4hri_recording.errors import SessionError

JOURNAL = ".withdrawal.json"


@dataclass(frozen=True)
class Journal:
    """human_id: who is withdrawn. ids: (kind, name) of whatever is tied to that pseudonym. also: further globs.

    report: there was one before. Where the folder belongs is found out again: no file may send it anywhere.
    """

    human_id: str
    ids: tuple[tuple[str, str], ...] = ()
    also: tuple[str, ...] = ()
    report: bool = False

    def write(self, folder: Path) -> None:
        """Put it into a recording's folder. Raises OSError."""
        replace_file(folder / JOURNAL, json.dumps(asdict(self), ensure_ascii=False))


def _content(path: Path) -> Any:
    with open_file(path, MOST_BYTES) as file:
        return parse(file.read(), JOURNAL)


def begun(folder: Path, human_id: str) -> Journal | None:
    """The withdrawal that was cut short in this folder, None where there is none.

    Raises SessionError where it is another pseudonym's, or its file is damaged.
    """
    path = folder / JOURNAL
    if not path.is_file():
        return None
    try:
        content = _content(path)
        ids = tuple((str(kind), str(name)) for kind, name in content["ids"])
        also = tuple(str(glob) for glob in content["also"])
        found = Journal(str(content["human_id"]), ids, also, bool(content["report"]))
    except (OSError, ValueError, TypeError, LookupError) as err:
        raise SessionError(f"{path} is damaged ({err}): remove it and withdraw again") from err
    if found.human_id != human_id:
        raise SessionError(f"{folder}: the withdrawal of {found.human_id} was cut short here; finish that one first")
    return found
