"""The one in-process shape of sampled data."""

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Chunk(NamedTuple):
    """Consecutive samples of all channels of one stream, as they came in one frame.

    samples: float64, shape (n, channels), in the unit the stream's metadata names. Both stamps belong to the last
    sample: device_ns on the device's own clock (None = the device gives no time), received_ns on the host's.
    """

    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    device_ns: int | None
    received_ns: int


class Break(Enum):
    """Why a chunk does not continue the one before it."""

    FIRST = "first"
    GAP = "gap"
    RESET = "reset"  # the stamp went back or leapt ahead: the device started afresh, or its clock was set
    DUPLICATE = "duplicate"  # the same stamp again: these samples are known already


class TimedChunk(NamedTuple):
    """A chunk whose every sample has its time.

    times_ns: int64, shape (n,), on the event clock: the device's own, or ROS time where the device gives none.
    break_: None where the chunk continues the previous one. lost: samples missing before it, 0 where unknown.
    """

    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    times_ns: NDArray[np.int64]
    device_ns: int | None
    received_ns: int
    break_: Break | None
    lost: int

    def part(self, start: int, stop: int) -> "TimedChunk":
        """Return samples [start, stop); only a part from 0 on carries the break.

        The receipt stamp stays that of the message which brought the samples.
        """
        whole_end = stop == len(self.times_ns)
        device_ns = self.device_ns
        if device_ns is not None and not whole_end:
            device_ns = int(self.times_ns[stop - 1])
        return TimedChunk(
            self.channels,
            self.samples[start:stop],
            self.times_ns[start:stop],
            device_ns,
            self.received_ns,
            self.break_ if start == 0 else None,
            self.lost if start == 0 else 0,
        )
