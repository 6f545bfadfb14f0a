"""The folder that all recordings lie in, and the pointer to the newest of them."""

import os
from pathlib import Path

from sense4hri.errors import ConfigError
from sense4hri_recording.layout import POINTER


def usable(root: Path) -> Path:
    """Make the folder of the recordings. Raises ConfigError where nothing can be written there."""
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise ConfigError(f"parameter 'directory' is {str(root)!r}: {err.strerror} ({err.filename})") from err
    if not os.access(root, os.W_OK | os.X_OK):
        raise ConfigError(f"parameter 'directory' is {str(root)!r}: nothing can be written there")
    return root


def write_pointer(root: Path, directory: Path) -> None:
    """`recording` beside the recordings names the newest one."""
    temporary = root / f".recording.{os.getpid()}"
    try:
        temporary.write_text(directory.relative_to(root).as_posix() + "\n", "utf-8")
        temporary.replace(root / POINTER)
    except OSError:
        return  # a convenience; what keeps the recording from being written is said elsewhere
