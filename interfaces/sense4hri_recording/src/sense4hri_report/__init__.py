"""How complete a recorded session is: report.json and report.html beside the recording, in each of its folders."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from sense4hri.files import replace_file
from sense4hri_recording.errors import SessionError
from sense4hri_recording.layout import REPORT_HTML, REPORT_JSON
from sense4hri_recording.parts import closed_parts, with_its_name
from sense4hri_recording.recorder_json import DEEPEST, plain

from sense4hri_report.collect import Progress, collect, silent
from sense4hri_report.page import page
from sense4hri_report.summary import summarise


def make_report(folder: Path, progress: Progress = silent, only_this_part: bool = False) -> dict[str, Any]:
    """Write both files into every folder of a session and return what report.json says.

    folder: any one of the session. Those that are still being recorded are left out, but for this one; with
    only_this_part all others are. progress: told how many bytes of how many have been read.

    Raises SessionError with one clear sentence where there is nothing to report on, or it cannot be written.
    """
    found = collect([with_its_name(folder)] if only_this_part else closed_parts(folder), progress)
    summary: dict[str, Any] = plain(summarise(found, time.time_ns()), DEEPEST + 8)
    text, drawn = json.dumps(summary, ensure_ascii=False, indent=1, allow_nan=False) + "\n", page(summary, found)
    for part in found.source.parts:
        _replace(part.path / REPORT_JSON, text)
        _replace(part.path / REPORT_HTML, drawn)
    return summary


def _replace(path: Path, text: str) -> None:
    try:
        replace_file(path, text)
    except OSError as err:
        raise SessionError(f"{path} cannot be written: {err.strerror}") from err


__all__ = ["make_report"]
