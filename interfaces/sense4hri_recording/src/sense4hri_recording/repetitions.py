"""How a raw message that was sent once more is recognised, by the report as by the export."""

import zlib

import numpy as np
from sense4hri.cdr import RawMessage

MEMORY = 1024  # messages back


def content(raw: RawMessage) -> int:
    """Return what samples of one shape have in common only where they are the same, but for chance (CRC-32)."""
    return zlib.crc32(np.ascontiguousarray(raw.samples.T).data)
