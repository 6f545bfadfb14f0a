"""Raw streams that are declared once their samples have told how fast they come. Pure."""

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from sense4hri.chunk import Chunk
from sense4hri.device import Declared, Samples, Stream
from sense4hri.errors import FrameError
from sense4hri.stamps import SECOND_NS

from driver_pupil_labs.eyes import Row, rate_hz

LISTEN_S = 1.0  # of samples that tell the rate
FEWEST = 20  # samples
MISSED_S = 10.0  # after the first stream of a connection, for which those of earlier connections may be missing
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


class Known:
    """The streams of one device over all its connections: a reconnect withdraws none that is only about to come.

    clock_s: a clock that nobody sets.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._before: dict[str, Stream] = {}
        self._now: dict[str, Stream] = {}
        self._first_s = 0.0  # when the first stream of this connection was known

    def connected(self) -> None:
        """Begin a new connection; what was declared before it holds on."""
        self._before |= self._now
        self._now = {}

    def news(self, rows: Iterable[Rows]) -> Iterator[Declared]:
        """Yield all streams where one is new, and where one of earlier connections has been missing for MISSED_S."""
        begun = [each for each in rows if each.listen()]
        if begun and not self._now:
            self._first_s = self._clock_s()
        self._now |= {each.sensor_type: each.stream for each in begun if each.stream}
        missed = self._before.keys() - self._now.keys()
        over = bool(self._now) and self._clock_s() - self._first_s > MISSED_S
        if over:
            self._before.clear()
        if begun or (over and missed):
            yield Declared({**self._before, **self._now})
