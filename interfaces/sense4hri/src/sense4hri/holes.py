"""Frames of a device that numbers or stamps every sample: a hole inside one is cut out, nowhere else. Imports no ROS.

A message carries one device time, that of its last sample. Whoever read a frame with a hole inside would spread the
hole over its neighbours; so what is published has none. Irregular samples have no step in which
a hole would show: each is a message.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sense4hri.chunk import Chunk
from sense4hri.stamps import SECOND_NS

HOLE = 1.5  # sample periods between two stamps from which on a sample is missing
SHORT = 10  # samples: in so short a chunk `SampleClock` takes no lost sample for jitter


class Holes:
    """Cuts the frames of one stream where samples are missing, also between one frame and the next.

    fs_hz: rate of the stream. What follows a hole begins with a short chunk, so that even one lost sample is seen.
    """

    def __init__(self, fs_hz: float) -> None:
        if not fs_hz > 0:
            raise ValueError(f"sampling_frequency_hz is {fs_hz}; samples that have numbers have a rate above 0")
        self._period_ns = SECOND_NS / fs_hz
        self._last_ns: int | None = None

    def cut(self, chunk: Chunk, times_ns: NDArray[np.int64]) -> list[Chunk]:
        """Return the chunk in parts without a hole, each stamped with the device time of its last sample.

        times_ns: device time of every sample, shape (n,). Raises ValueError where there are more or fewer than samples.
        """
        n = _as_many(chunk, times_ns)
        steps = np.empty(n, np.int64)
        steps[0] = 0 if self._last_ns is None else times_ns[0] - self._last_ns
        np.subtract(times_ns[1:], times_ns[:-1], out=steps[1:])
        holes = ((steps > HOLE * self._period_ns) | (steps < 0)).nonzero()[0].tolist()
        self._last_ns = int(times_ns[-1])
        edges = sorted({0, n, *holes, *(min(at + SHORT, n) for at in holes)})
        return [
            Chunk(chunk.channels, chunk.samples[first:end], int(times_ns[end - 1]), chunk.received_ns)
            for first, end in pairwise(edges)
        ]


def one_by_one(chunk: Chunk, times_ns: NDArray[np.int64]) -> list[Chunk]:
    """Return irregular samples that came together as chunks of one, in their order, each with its device time.

    times_ns: shape (n,), 0 = none. Received 1 ns after each other: two at one time would look like a reset. Raises
    ValueError where there are more or fewer times than samples.
    """
    _as_many(chunk, times_ns)
    return [
        Chunk(chunk.channels, row[None], time_ns or None, chunk.received_ns + number)
        for number, (row, time_ns) in enumerate(zip(chunk.samples, times_ns.tolist(), strict=True))
    ]


def _as_many(chunk: Chunk, times_ns: NDArray[np.int64]) -> int:
    """Return the number of samples. Raises ValueError where there are more or fewer times."""
    if len(times_ns) != len(chunk.samples):
        raise ValueError(f"{len(times_ns)} times of {len(chunk.samples)} samples")
    return len(times_ns)
