"""When samples were taken, on the wall clock: device time through clock-sync's model. Pure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.clock_model import fits, ros_ns
from sense4hri.host_clocks import HostClocks, sanitised
from sense4hri.sample_clock import SampleClock


class Model(NamedTuple):
    """The newest clock model of a device; segment: another one for each epoch of its clock."""

    reference_ns: int
    offset_ns: int
    skew_ppm: float
    segment: int = 1


class Stamping:
    """The wall clock's time of every sample or event of one stream; rate_hz: 0 = irregular."""

    def __init__(self, rate_hz: float) -> None:
        self._clock = SampleClock(rate_hz)
        self.model: Model | None = None
        self._newest_ns, self._segment = 0, 0  # of what came last: its device time, and the model's segment

    def wall_ns(self, chunk: Chunk) -> NDArray[np.int64]:
        """Return the times of a chunk's samples, shape (n,).

        Without a model that fits the last sample is at its receipt, and the others lie before it as they were taken.
        """
        times_ns = self._clock.place(chunk).times_ns
        return self._mapped(times_ns, chunk.received_ns) if self._clock.in_device_time else times_ns

    def event_ns(self, received_ns: int, device_ns: int) -> int:
        """Return when something happened; its receipt where no model fits, or device_ns is 0: not known."""
        return int(self._mapped(np.array([device_ns]), received_ns)[0]) if device_ns else received_ns

    def _mapped(self, times_ns: NDArray[np.int64], received_ns: int) -> NDArray[np.int64]:
        newest_ns = int(times_ns[-1])
        if self.model is not None and newest_ns < self._newest_ns and self.model.segment == self._segment:
            self.model = None  # it is of the clock before; clock-sync says at once what holds now
        self._newest_ns = newest_ns
        if self.model is not None:
            self._segment = self.model.segment
            mapped = ros_ns(times_ns, self.model.reference_ns, self.model.offset_ns, self.model.skew_ppm)
            if fits(int(mapped[-1]), received_ns):
                return mapped
        return times_ns + (received_ns - newest_ns)


def here_ns(times_ns: NDArray[np.int64], host: str, here: str, clocks: HostClocks) -> NDArray[np.int64]:
    """Return times of a host's wall clock, shape (n,), on that of this host; the same where they are one.

    Over the reference host's clock, as contract section 9 measures them; a host that nobody has measured counts as it.
    """
    if not host or sanitised(host) == sanitised(here):
        return times_ns
    reference_ns = clocks.reference_ns(host, times_ns)
    newest_ns = shown_ns = int(reference_ns[-1])
    for _ in range(3):  # what this host's clock shows then, by its line that is written the other way
        shown_ns = newest_ns - (clocks.reference_ns(here, shown_ns) - shown_ns)
    return reference_ns + (shown_ns - newest_ns)
