"""When samples were taken, on the wall clock: device time through clock-sync's model. Pure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.clock_model import fits, ros_ns
from sense4hri.host_clocks import HostClocks, sanitised
from sense4hri.sample_clock import SampleClock


class Model(NamedTuple):
    """The newest clock model of a device."""

    reference_ns: int
    offset_ns: int
    skew_ppm: float


class Stamping:
    """The wall clock's time of every sample of one stream; rate_hz: 0 = irregular."""

    def __init__(self, rate_hz: float) -> None:
        self._clock = SampleClock(rate_hz)
        self.model: Model | None = None
        self._newest_ns = 0

    def wall_ns(self, chunk: Chunk) -> NDArray[np.int64]:
        """Return the times of a chunk's samples, shape (n,).

        Without a model that fits the last sample is at its receipt, and the others lie before it as they were taken.
        """
        times_ns = self._clock.place(chunk).times_ns
        if times_ns[-1] < self._newest_ns:
            self.model = None  # it is of the clock before; clock-sync says at once what holds now
        self._newest_ns = int(times_ns[-1])
        if not self._clock.in_device_time:
            return times_ns
        if self.model is not None:
            mapped = ros_ns(times_ns, *self.model)
            if fits(int(mapped[-1]), chunk.received_ns):
                return mapped
        return times_ns + (chunk.received_ns - int(times_ns[-1]))


def event_ns(received_ns: int, device_ns: int, model: Model | None) -> int:
    """Return when something happened whose device time is known; its receipt where no model fits."""
    if not device_ns or model is None:
        return received_ns
    mapped_ns = ros_ns(device_ns, *model)
    return mapped_ns if fits(mapped_ns, received_ns) else received_ns


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
