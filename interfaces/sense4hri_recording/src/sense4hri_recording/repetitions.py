"""How a raw message that was sent once more is recognised, by the report as by the export."""

import zlib

import numpy as np
from sense4hri.cdr import RawMessage

MEMORY = 1024  # messages back


def content(raw: RawMessage) -> int:
    """Return what samples of one shape have in common only where they are the same, but for chance (CRC-32)."""
    return zlib.crc32(np.ascontiguousarray(raw.samples.T).data)


def stamps(raw: RawMessage, rate_hz: float) -> tuple[int, ...]:
    """Return what a message that was sent once more has of the first one's stamps; rate_hz: 0 = irregular.

    Of samples at a rate their time, also where it was received anew; of an irregular stream both, as two events may
    have one device time and value.
    """
    return (raw.device_ns or raw.received_ns,) if rate_hz else (raw.received_ns, raw.device_ns)
