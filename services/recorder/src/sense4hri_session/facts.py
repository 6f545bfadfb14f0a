"""What only the recorder knows of a recording (`recorder.json` beside its files), and folders that belong together."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

NAME = "recorder.json"
LARGEST = 64 << 20  # bytes; a damaged disk may say anything


def read(folder: Path) -> tuple[dict[str, Any], list[str]]:
    """The content, and what has to be said of it. Without the file, or where it is damaged, the content is empty."""
    path = folder / NAME
    if not path.is_file():
        return {}, []
    try:
        if path.stat().st_size > LARGEST:
            return {}, [f"{path} is larger than {LARGEST} bytes and is not read"]
        content = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as err:
        return {}, [f"{path} cannot be read ({err}): what the recorder knew of losses and versions is missing"]
    if not isinstance(content, dict):
        return {}, [f"{path} is damaged: what the recorder knew of losses and versions is missing"]
    said = []
    if content.get("state") == "recording":
        said.append(f"{folder} is still being recorded, or its recorder was killed and has not been started since")
    if content.get("state") == "interrupted":
        said.append(f"{folder} was interrupted: {content.get('why') or 'the recorder ended without closing it'}")
    return content, said


def session(content: dict[str, Any]) -> dict[str, Any]:
    """The session the recording belongs to; empty outside of sessions."""
    found = content.get("session")
    return found if isinstance(found, dict) and isinstance(found.get("session_id"), str) else {}


def continuations(folder: Path, content: dict[str, Any]) -> list[Path]:
    """The other folders of the same session, in their order: a recorder that was started anew opens `.._1`."""
    session_id = session(content).get("session_id")
    if not session_id:
        return []
    try:
        beside = [path for path in folder.resolve().parent.iterdir() if path != folder.resolve() and path.is_dir()]
    except OSError:
        return []
    parts = [path for path in beside if session(read(path)[0]).get("session_id") == session_id]
    return sorted(parts, key=lambda path: (len(path.name), path.name))
