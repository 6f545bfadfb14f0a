"""How complete a recorded session is: report.json and report.html beside the recording."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

from sense4hri_session.errors import SessionError
from sense4hri_session.report.collect import collect
from sense4hri_session.report.page import page
from sense4hri_session.report.summary import summarise

JSON_NAME, HTML_NAME = "report.json", "report.html"


def make_report(folder: Path, progress: bool = False) -> dict[str, Any]:
    """Write both files into a recording's folder and return what they say.

    Raises SessionError with one clear sentence where there is nothing to report on, or it cannot be written.
    """
    found = collect(folder, progress)
    summary = summarise(found, time.time_ns())
    _replace(folder / JSON_NAME, json.dumps(summary, ensure_ascii=False, indent=1, allow_nan=False) + "\n")
    _replace(folder / HTML_NAME, page(summary, found))
    return summary


def _replace(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text(text, "utf-8")
        temporary.replace(path)
    except OSError as err:
        temporary.unlink(missing_ok=True)
        raise SessionError(f"{path} cannot be written: {err.strerror}") from err


__all__ = ["make_report"]
