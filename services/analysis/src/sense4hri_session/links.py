"""Links in a recording's folder: a withdrawal would remove them, and what they lead to would stay."""

from __future__ import annotations

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
