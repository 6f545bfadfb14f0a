"""Reports of recorded sessions: `report.html` files below one directory, and nothing else of it."""

import os
import stat
from pathlib import Path, PurePosixPath
from typing import BinaryIO
from urllib.parse import quote

NAME = "report.html"
PREFIX = "/reports/"
# a report is one file with its style and pictures inside; it runs no script and reaches nothing
POLICY = (
    "sandbox allow-downloads; default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class Reports:
    """The reports below a directory; an empty directory serves none."""

    def __init__(self, directory: str) -> None:
        self._root = Path(directory).resolve() if directory else None

    def address(self, path: str) -> str:
        """Return the address on this server of the report at path, "" where it is not there to be served."""
        if self._root is None or not path:
            return ""
        try:
            relative = PurePosixPath(path).relative_to(self._root)
        except ValueError:
            return ""
        try:
            os.close(self._open(str(relative)))
        except (OSError, ValueError):
            return ""
        return PREFIX + quote(str(relative))

    def open(self, relative: str) -> BinaryIO:
        """Return a report to be read. Raises ValueError or OSError where the path is none or leads elsewhere."""
        return os.fdopen(self._open(relative), "rb")

    def _open(self, relative: str) -> int:
        """Open a report step by step, so that no `..` and no symbolic link leads out of the directory."""
        parts = relative.split("/")
        if self._root is None or parts[-1] != NAME or any(p in ("", ".", "..") or "\0" in p for p in parts):
            raise ValueError("not a report")
        folder = os.open(self._root, os.O_RDONLY | os.O_DIRECTORY)
        try:
            for part in parts[:-1]:
                inner = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=folder)
                os.close(folder)
                folder = inner
            file = os.open(NAME, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
        finally:
            os.close(folder)
        if not stat.S_ISREG(os.fstat(file).st_mode):
            os.close(file)
            raise ValueError("not a report")
        return file
