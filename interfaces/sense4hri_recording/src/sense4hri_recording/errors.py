"""The one error a reader of recordings has to expect, and what damaged bytes make the libraries raise."""

import struct

from mcap.exceptions import McapError
from zstandard import ZstdError

LARGEST_RECORD = 128 << 20  # bytes, packed and unpacked; what says that it is larger is damaged
LATEST_NS = (1 << 31) * 1_000_000_000  # no clock of ROS shows a later time
REPAIR = "`sense4hri-repair` beside it saves what is whole; the file itself is never changed"
DAMAGE = (
    McapError,
    ZstdError,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    LookupError,
    MemoryError,
    OverflowError,
    RuntimeError,
)
"""What readers and decompressors raise on damaged bytes; RecursionError among them."""


class SessionError(Exception):
    """The recording cannot be opened or exported; the text says which file, why, and what can be done."""
