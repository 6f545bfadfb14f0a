"""Raw messages put on the corrected timeline, one after the other."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.cdr import RawMessage
from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import SampleClock
from sense4hri_recording.repetitions import MEMORY, content, stamps

from sense4hri_session.clock_fit import ClockFit

Ints = NDArray[np.int64]
AT_ONCE = 20_000  # samples in a block, about


class Block(NamedTuple):
    """Samples of messages that follow each other, with the same channels and of one epoch of the device's clock.

    time_ns: corrected ROS time of every sample, of a study on several hosts the reference's.
    device_time_ns: the device's clock, None where it gives no time.
    received_ns: header stamp of every message; its raw device stamp is the device_time_ns of its last sample. segment:
    epoch of the device clock, from 1; 0 without device time. counts: samples of every message.
    """

    time_ns: Ints
    device_time_ns: Ints | None
    received_ns: Ints
    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    segment: int
    counts: Ints


class _Placed(NamedTuple):
    """One message and the times of its samples, by its device's clock or else by the receipt of messages."""

    raw: RawMessage
    times_ns: Ints
    segment: int

    @property
    def kind(self) -> tuple[tuple[str, ...], int]:
        return self.raw.channels, self.segment


class Timeline:
    """Places the messages of one stream in order of receipt; repeated ones are left out.

    key: of the stream. rate_hz: 0 = irregular. delay_s: the known part of the link's delay. clock: of its device, with
    the stream's key in it; None where the device gives no time. to_reference: from the clock of the driver's host to
    the reference host's.
    """

    def __init__(
        self,
        key: str,
        rate_hz: float,
        delay_s: float,
        clock: ClockFit | None,
        to_reference: Callable[[Ints], Ints] = lambda host_ns: host_ns,
    ) -> None:
        self._clock, self._delay_ns, self._to_reference = clock, round(delay_s * 1e9), to_reference
        self._samples = SampleClock(rate_hz)
        self._segment_of = clock.segment_of.get(key) if clock else None
        self._timed = 0  # messages with device time so far
        self._segment = 0  # of the newest of them; one without device time belongs to the same
        self._came: OrderedDict[tuple[int, ...], int] = OrderedDict()

    def blocks(self, raws: Iterable[RawMessage]) -> Iterator[Block]:
        """Place all messages. Memory: one block."""
        waiting: list[RawMessage] = []
        size = 0
        for raw in raws:
            waiting.append(raw)
            size += len(raw.samples)
            if size >= AT_ONCE:
                yield from self.place(waiting)
                waiting, size = [], 0
        yield from self.place(waiting)

    def place(self, raws: Iterable[RawMessage]) -> Iterator[Block]:
        """Place the messages that follow those placed before."""
        placed = (found for raw in raws if (found := self._place(raw)) is not None)
        for _, together in groupby(placed, lambda one: one.kind):
            yield self._block(list(together))

    def _place(self, raw: RawMessage) -> _Placed | None:
        if raw.device_ns and self._segment_of is not None:
            self._segment, self._timed = int(self._segment_of[self._timed]) + 1, self._timed + 1
        if self._is_repeated(raw):
            return None
        placed = self._samples.place(Chunk(raw.channels, raw.samples, raw.device_ns or None, raw.received_ns))
        if placed.break_ is Break.DUPLICATE:
            return None
        if not self._samples.in_device_time:
            self._segment = 0
        return _Placed(raw, placed.times_ns, self._segment)

    def _is_repeated(self, raw: RawMessage) -> bool:
        """True for a message that came before as it is, in this epoch of the device's clock."""
        key, sent = (self._segment, *stamps(raw, self._samples.nominal_hz)), content(raw)
        if self._came.get(key) == sent:
            return True
        self._came[key] = sent
        if len(self._came) > MEMORY:
            self._came.popitem(last=False)
        return False

    def _block(self, together: list[_Placed]) -> Block:
        raws, segment = [one.raw for one in together], together[0].segment
        times_ns = np.concatenate([one.times_ns for one in together])
        clock = self._clock.segments[segment - 1] if segment and self._clock is not None else None
        ros_ns = times_ns - self._delay_ns if clock is None else clock.ros_ns(times_ns)
        return Block(
            self._to_reference(ros_ns),
            None if clock is None else times_ns,
            np.array([raw.received_ns for raw in raws], np.int64),
            raws[0].channels,
            np.concatenate([raw.samples for raw in raws]),
            segment,
            np.array([len(raw.samples) for raw in raws], np.int64),
        )
