"""What keeps a withdrawal from its work and is found before anything is changed: links, folders in a file's place."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from sense4hri_recording.errors import SessionError


def refuse_links(folder: Path) -> None:
    """Raise SessionError for links in a folder or in the place of its export: what they lead to would stay."""
    beside = folder.with_name(f"{folder.name}_export")
    links = [path.name for path in sorted((*folder.iterdir(), beside)) if path.is_symlink()]
    if links:
        raise SessionError(
            f"{folder}: {', '.join(links)} {'is a link' if len(links) == 1 else 'are links'}, and what that leads to "
            "would stay: put the file itself there, or remove the link and withdraw where it led"
        )


def refuse_folders(folder: Path, names: Iterable[str]) -> None:
    """Raise SessionError where a folder has the name of a file that is written, or of its half (`.NAME`, `.NAME.new`).

    names: the files that a withdrawal writes.
    """
    taken = sorted({name for own in names for name in (own, f".{own}", f".{own}.new") if (folder / name).is_dir()})
    if taken:
        raise SessionError(f"{folder}: {', '.join(taken)} is a folder where a file is to be written: move it away")
