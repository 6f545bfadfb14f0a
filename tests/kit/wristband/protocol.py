"""Notifications of a wristband, an imaginary one over Bluetooth LE that measures skin and motion; no radio, no clock.

Once `START` was written to `COMMAND`, each characteristic of `LAYOUTS` notifies: ticks of the band's clock at its last
sample, then the samples, all little endian. The clock has few bits and goes round.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

SERVICE, COMMAND = "a17e0001-5e45-4e0d-8f00-77726973740a", "a17e0002-5e45-4e0d-8f00-77726973740a"
SKIN, MOTION = "a17e0003-5e45-4e0d-8f00-77726973740a", "a17e0004-5e45-4e0d-8f00-77726973740a"
START = b"\x01"
TICKS_HZ, BITS = 1024, 16


class Layout(NamedTuple):
    """What a characteristic notifies; form: of one number, as numpy writes it; scale: of one count, in the unit."""

    sensor_type: str
    rate_hz: float
    unit: str
    channels: tuple[str, ...]
    form: str
    scale: float


LAYOUTS = {
    SKIN: Layout("eda", 32.0, "uS", ("eda",), "<u2", 0.002),
    MOTION: Layout("accelerometer", 64.0, "m/s^2", ("x", "y", "z"), "<i2", 0.0025),
}


class Frame(NamedTuple):
    """ticks: of the band's clock at the last sample; samples: shape (n, channels), in the layout's unit."""

    ticks: int
    samples: NDArray[np.float64]


def decode(layout: Layout, value: bytes) -> Frame:
    """Return what a notification says. Raises FrameError where it does not hold whole samples."""
    head, width = BITS // 8, np.dtype(layout.form).itemsize * len(layout.channels)
    if len(value) <= head or (len(value) - head) % width:
        raise FrameError(f"{len(value)} bytes of {layout.sensor_type} are no samples: {value[:16].hex(' ')}")
    counts = np.frombuffer(value[head:], layout.form).reshape(-1, len(layout.channels))
    return Frame(int.from_bytes(value[:head], "little"), counts.astype(np.float64) * layout.scale)
