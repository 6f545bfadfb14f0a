"""What packed files may unpack to, told before it is in memory."""

import gzip
from pathlib import Path

from sense4hri.signal_files.content import UnreadableFileError

MOST_BYTES = 1 << 30  # a day of an Empatica E4 has some 60 MB
PIECE_BYTES = 1 << 20


def check_unpacked(path: Path, size_bytes: int) -> None:
    """Raise UnreadableFileError where that is too much."""
    if size_bytes > MOST_BYTES:
        raise UnreadableFileError(f"{path}: unpacks to more than {MOST_BYTES} bytes")


def unpacked(path: Path) -> gzip.GzipFile:
    """Open a gzip, unpacked to nowhere once. Raises UnreadableFileError: too much; OSError: no gzip."""
    size_bytes = 0
    with gzip.open(path) as file:
        while piece := file.read(PIECE_BYTES):
            size_bytes += len(piece)
            check_unpacked(path, size_bytes)
    return gzip.GzipFile(path)
