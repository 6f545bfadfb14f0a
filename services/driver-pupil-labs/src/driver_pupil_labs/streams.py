"""Raw streams that are declared once their samples have told how fast they come. Pure."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.device import Samples, Stream
from sense4hri.errors import FrameError
from sense4hri.stamps import SECOND_NS

from driver_pupil_labs.eyes import Row, rate_hz

FRAME_S = 0.1  # what comes within it is handed on together
LISTEN_S = 1.0  # of samples that tell the rate
FEWEST = 20  # samples
MOST = 2000  # readings within LISTEN_S; the fastest eye camera makes 400 a second
Shape = tuple[str, float, float, int, tuple[str, ...]]
"""Unit, smallest and largest value, bits and channels of a stream: all but its rate."""


def check_time_goes_on(what: str, held: list[Any]) -> None:
    """Leave out what is held of readings where it is too much. Raises FrameError with their number."""
    if len(held) >= MOST:
        held.clear()
        raise FrameError(f"{what}: {MOST} readings within {LISTEN_S:g} s of the device's time: it stands still")


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
        """Take a row; one from before all others begins the listening anew: the device's clock was set.

        Raises FrameError where so many rows tell no rate that the device's time must stand still: they are left out.
        """
        if self.stream is None and self._rows:
            if row.time_ns < self._rows[0].time_ns:
                self._rows.clear()
            check_time_goes_on(self.sensor_type, self._rows)
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
