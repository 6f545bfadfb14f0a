"""One writer of a folder at a time, on Linux, macOS and Windows."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from sense4hri_recording.layout import LOCK

if sys.platform == "win32":
    import msvcrt

    def _lock(fd: int) -> None:
        try:
            msvcrt.locking(fd, msvcrt.LK_NBLCK, 1)
        except PermissionError as err:
            raise BlockingIOError(err.errno, err.strerror) from err
else:
    import fcntl

    def _lock(fd: int) -> None:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)


OPEN_FILES_BAR_RENAMES = sys.platform == "win32"
"""The system renames no folder in which a file is open."""
_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)


class Lock:
    """Held by the process that writes a folder. Raises BlockingIOError where another one holds it."""

    def __init__(self, directory: Path) -> None:
        path = directory / LOCK
        self.found = path.exists()
        """The lock's file was there already."""
        self._fd = os.open(path, _FLAGS, 0o644)
        try:
            _lock(self._fd)
        except OSError:
            os.close(self._fd)
            raise

    def before_rename(self) -> None:
        """Let go where a folder with an open file keeps its name; there a writer that comes meanwhile keeps it too."""
        if OPEN_FILES_BAR_RENAMES:
            self.release()

    def release(self) -> None:
        """Let others write; the lock's file stays. May be called again."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
