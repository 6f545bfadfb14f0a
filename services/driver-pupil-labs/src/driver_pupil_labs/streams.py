"""Raw streams that are declared once their samples have told how fast they come. Pure."""

from collections.abc import Iterator

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.device import Samples, Stream
from sense4hri.stamps import SECOND_NS

from driver_pupil_labs.eyes import Row, rate_hz

LISTEN_S = 1.0  # of samples that tell the rate
FEWEST = 20  # samples
Shape = tuple[str, float, float, int, tuple[str, ...]]
"""Unit, smallest and largest value, bits and channels of a stream: all but its rate."""


class Rows:
    """Rows of one raw stream on their way out: held back until their rate is known, then handed on as they come.

    irregular: they have no rate.
    """

    def __init__(self, sensor_type: str, shape: Shape, irregular: bool = False) -> None:
        self.sensor_type, self._shape, self._irregular = sensor_type, shape, irregular
        self.stream: Stream | None = None
        """What is declared, None while the rate is not known."""
        self._rows: list[Row] = []

    def push(self, row: Row) -> None:
        """Take a row; one from before all others begins the listening anew: the device's clock was set."""
        if self.stream is None and self._rows and row.time_ns < self._rows[0].time_ns:
            self._rows.clear()
        self._rows.append(row)

    def listen(self) -> bool:
        """Return True at the moment from which on the rate is known."""
        rows = self._rows
        if self.stream is not None or len(rows) < FEWEST or rows[-1].time_ns - rows[0].time_ns < LISTEN_S * SECOND_NS:
            return False
        rate = 0.0 if self._irregular else rate_hz([row.time_ns for row in rows])
        self.stream = Stream(rate, *self._shape)
        return True

    def samples(self) -> Iterator[Samples]:
        """Yield what has come since the last time; of a stream without a rate one by one."""
        if self.stream is None or not self._rows:
            return
        rows, self._rows = self._rows, []
        size = len(rows) if self.stream.sampling_frequency_hz else 1
        for first in range(0, len(rows), size):
            yield self._chunk(rows[first : first + size])

    def _chunk(self, rows: list[Row]) -> Samples:
        assert self.stream is not None
        values = np.array([row.values for row in rows], np.float64)
        chunk = Chunk(self.stream.channel_names, values, rows[-1].time_ns, rows[-1].received_ns)
        if not self.stream.sampling_frequency_hz:
            return Samples(self.sensor_type, chunk, lost=rows[0].lost)
        return Samples(self.sensor_type, chunk, np.array([row.time_ns for row in rows]))
