"""Bytes in, numbers out: no port, no clock.

A frame: time of its last sample in ms (4 bytes), then samples (2 bytes each), little endian.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

RATE_HZ = 10.0
MICROSIEMENS = 0.001  # of one count


class Frame(NamedTuple):
    """device_ns: device time of the last sample; samples: shape (n, 1), in uS."""

    device_ns: int
    samples: NDArray[np.float64]


def decode(octets: bytes) -> Frame | FrameError:
    """Return what a frame says, or the error that says what came."""
    if len(octets) < 6 or len(octets) % 2:
        return FrameError(f"{len(octets)} bytes are no frame: {octets[:16].hex()}")
    counts = np.frombuffer(octets[4:], "<u2").astype(np.float64)
    return Frame(int.from_bytes(octets[:4], "little") * 1_000_000, counts[:, None] * MICROSIEMENS)
