"""A file that holds room for a recording's index, given back when the disk is full."""

from __future__ import annotations

import os
from pathlib import Path

from sense4hri_recording.layout import RESERVE

from recorder.space import RESERVE_BYTES


class Reserve:
    """The reserve of one recording's folder; both ways raise OSError."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / RESERVE

    def exists(self) -> bool:
        return self._path.exists()

    def take(self) -> None:
        with self._path.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)

    def give_back(self) -> None:
        self._path.unlink(missing_ok=True)
