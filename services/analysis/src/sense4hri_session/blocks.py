"""Raw messages put on the corrected timeline, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.cdr import RawMessage
from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import SampleClock

from sense4hri_session.clock_fit import ClockFit

Ints = NDArray[np.int64]


class Block(NamedTuple):
    """Samples of one message.

    time_ns: corrected ROS time of every sample, of a study on several hosts the reference's.
    device_time_ns: the device's clock, None where it gives no time.
    received_ns: header stamp of the message; the raw device stamp is the last device_time_ns. segment: epoch of the
    device clock, from 1; 0 without device time. continues: no sample is missing before this block.
    """

    time_ns: Ints
    device_time_ns: Ints | None
    received_ns: int
    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    segment: int
    continues: bool


class Timeline(NamedTuple):
    """What is known of a stream's times.

    rate_hz: 0 = irregular. delay_s: the known part of the link's delay. clock: of its device, with the stream's key in
    it; None where the device gives no time. to_reference: from the clock of the driver's host to the reference host's.
    """

    key: str
    rate_hz: float
    delay_s: float
    clock: ClockFit | None
    to_reference: Callable[[Ints], Ints] = lambda host_ns: host_ns

    def blocks(self, raws: Iterable[RawMessage]) -> Iterator[Block]:
        """Place messages, given in order of receipt; repeated ones are left out. Memory: one message."""
        samples, delay_ns = SampleClock(self.rate_hz), round(self.delay_s * 1e9)
        segment_of = self.clock.segment_of.get(self.key) if self.clock else None
        timed, number = 0, -1  # a frame without device time belongs to the segment of the one before
        for raw in raws:
            if raw.device_ns and segment_of is not None:
                number, timed = int(segment_of[timed]), timed + 1
            placed = samples.place(Chunk(raw.channels, raw.samples, raw.device_ns or None, raw.received_ns))
            if placed.break_ is Break.DUPLICATE:
                continue
            if not samples.in_device_time:
                number = -1
            if number >= 0 and self.clock is not None:
                time_ns = self.clock.segments[number].ros_ns(placed.times_ns)
                device: Ints | None = placed.times_ns
            else:
                time_ns, device = placed.times_ns - delay_ns, None
            yield Block(
                self.to_reference(time_ns),
                device,
                raw.received_ns,
                raw.channels,
                raw.samples,
                number + 1,
                placed.break_ is None,
            )
