"""A stream at a constant rate, for formats that know no other: linear interpolation on the corrected timeline."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sense4hri_session.stream import GAP_PERIODS, Stream

Floats = NDArray[np.floating[Any]]
SECOND_NS = 1_000_000_000


@dataclass
class ConstantRate:
    """`pieces()` gives samples k at start_ns + k / rate_hz; afterwards `gaps` lists what was missing.

    Samples in a gap are NaN. gaps: (onset, duration) in s from start_ns. backwards: samples left out because the
    corrected time went back, the host's clock having been set back.
    """

    stream: Stream
    start_ns: int
    rate_hz: float
    gaps: list[tuple[float, float]] = field(default_factory=list)
    backwards: int = 0
    samples: int = 0

    def pieces(self) -> Iterator[Floats]:
        """Consecutive samples (n, channels); memory: one message, but for long gaps one second at a time."""
        channels = self.stream.channels
        allowed_s = GAP_PERIODS / min(self.stream.sampling_frequency_hz, self.rate_hz)
        self.gaps, self.backwards, self.samples = [], 0, 0
        last_s, last = -math.inf, np.full(len(channels), np.nan)
        for block in self.stream.blocks():
            at = (block.time_ns - self.start_ns) * 1e-9
            values = np.full((len(at), len(channels)), np.nan)
            values[:, [channels.index(name) for name in block.channels]] = block.samples
            keep = at > np.maximum.accumulate(np.concatenate([[last_s], at[:-1]]))
            self.backwards += int(np.sum(~keep))
            at, values = at[keep], values[keep]
            if not len(at):
                continue
            if math.isinf(last_s):
                if at[0] > 0.5 / self.rate_hz:
                    self.gaps.append((0.0, float(at[0])))
            else:
                at, values = np.concatenate([[last_s], at]), np.concatenate([last[None], values])
            holes = np.flatnonzero(np.diff(at) > allowed_s)
            self.gaps += [(float(at[i]), float(at[i + 1] - at[i])) for i in holes]
            yield from self._fill(at, values, holes)
            last_s, last = float(at[-1]), values[-1]

    def _fill(self, at: Floats, values: Floats, holes: NDArray[np.intp]) -> Iterator[Floats]:
        """The grid points up to the last of these samples."""
        stop = math.floor(at[-1] * self.rate_hz + 1e-6) + 1
        step = max(int(self.rate_hz), 1)
        while self.samples < stop:
            count = min(stop - self.samples, max(step, 4096))
            grid = (self.samples + np.arange(count)) / self.rate_hz
            piece = np.column_stack([np.interp(grid, at, column) for column in values.T])
            piece[grid < at[0] - 1e-6 / self.rate_hz] = np.nan
            for i in holes:
                piece[(grid > at[i] + 1e-9) & (grid < at[i + 1] - 1e-9)] = np.nan
            self.samples += count
            yield piece


def whole_rate_hz(stream: Stream) -> int:
    """The whole number of samples per second that loses nothing of a stream; 0 for an irregular one."""
    rate = stream.sampling_frequency_hz
    return 0 if not rate > 0 else max(1, math.ceil(rate - 1e-6))
