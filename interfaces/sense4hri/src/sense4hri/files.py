"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import sys
from pathlib import Path
from typing import BinaryIO

_NOT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


def replace_file(path: Path, text: str) -> None:
    """Write a file anew so that after a crash it is the old or the new one, never a part. Raises OSError.

    A link of this name is replaced; what it leads to stays as it is.
    """
    temporary = path.with_name(f".{path.name}")
    try:
        with new_file(temporary) as file:
            file.write(text.encode("utf-8", "backslashreplace"))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def open_file(path: Path, most_bytes: int | None = None) -> BinaryIO:
    """Open a file for reading. Raises OSError, also for a pipe, a device or a folder, and for more than most_bytes."""
    fd = os.open(path, os.O_RDONLY | _NOT_WAITING)
    try:
        found = os.fstat(fd)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "is no file", str(path))
        if most_bytes is not None and found.st_size > most_bytes:
            raise OSError(errno.EFBIG, f"is larger than {most_bytes} bytes", str(path))
        return os.fdopen(fd, "rb")
    except OSError:
        os.close(fd)
        raise


def new_file(path: Path) -> BinaryIO:
    """Open a file that nobody else has made, in the place of one left over. Follows no link. Raises OSError."""
    path.unlink(missing_ok=True)
    return path.open("xb")


def sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk. Windows syncs no folders and needs none."""
    if sys.platform == "win32" and path.is_dir():
        return
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
