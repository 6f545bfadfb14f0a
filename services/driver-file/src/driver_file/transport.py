"""Opens the recording, whatever its format. One that is not there is a device that is away; what is none, is told."""

import csv
import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

from sense4hri.errors import ConfigError, DeviceLost
from sense4hri.signal_files.content import SignalFile, UnreadableFileError
from sense4hri.signal_files.polar_logger import is_polar_logger, open_polar_logger
from sense4hri.signal_files.wfdb import open_wfdb, shortfall

from driver_file.brainvision import open_brainvision
from driver_file.columns import open_plain
from driver_file.config import FileConfig
from driver_file.edf import open_edf
from driver_file.embrace_plus import open_embrace_plus
from driver_file.empatica import open_empatica
from driver_file.eyelink import open_eyelink
from driver_file.protocol import Recorded, choose
from driver_file.xdf import open_xdf


def _open_wfdb(path: Path) -> SignalFile:
    missing = shortfall(path)
    return SignalFile(open_wfdb(path), notes=(missing,) if missing else ())


FORMATS: Mapping[str, Callable[[Path], SignalFile]] = {
    ".hea": _open_wfdb,
    ".dat": _open_wfdb,
    ".edf": open_edf,
    ".bdf": open_edf,
    ".vhdr": open_brainvision,
    ".xdf": open_xdf,
    ".xdfz": open_xdf,
    ".asc": open_eyelink,
    ".zip": open_empatica,
    ".avro": open_embrace_plus,
}

DAMAGES = (
    ValueError,
    ArithmeticError,
    LookupError,
    RuntimeError,
    struct.error,
    zlib.error,
    csv.Error,
    EOFError,
    MemoryError,
)
"""What readers, ours and others', raise of bytes that nobody foresaw."""


def read(config: FileConfig) -> tuple[list[Recorded], SignalFile]:
    """Return the streams of the configured recording, and everything that is in it.

    Raises DeviceLost where it is not there, ConfigError where it cannot be read or lacks what is asked for.
    """
    path = Path(config.file)
    try:
        if not path.exists():
            raise DeviceLost(f"{path} is not there")
        if not path.is_file() and not path.is_dir():
            raise ConfigError(f"file: {path} is neither a file nor a folder")
        content = _open(path, config)
        return choose(path, content, config.wanted), content
    except UnreadableFileError as err:
        raise ConfigError(f"file: {err}") from err
    except OSError as err:
        raise DeviceLost(f"{path} cannot be read: {err}") from err
    except DAMAGES as err:
        raise ConfigError(f"file: {path}: damaged: {type(err).__name__} {err}".replace("\n", " ")) from err


def _open(path: Path, config: FileConfig) -> SignalFile:
    if path.is_dir():
        return open_empatica(path)
    is_columns = path.suffix.lower() == ".dat" and not path.with_suffix(".hea").exists() and not is_binary(path)
    if not is_columns and (opened := FORMATS.get(path.suffix.lower())):
        return opened(path)
    if is_binary(path):
        raise UnreadableFileError(f"{path}: none of {', '.join(FORMATS)}, and not columns of numbers")
    if is_polar_logger(path):
        return SignalFile((open_polar_logger(path),))
    return open_plain(path, config)


def is_binary(path: Path) -> bool:
    """True for a file that is no text."""
    with path.open("rb") as file:
        return b"\0" in file.read(65536)
