"""The way of one stream's data into its step: waiting, order, segments, sample times. Imports no ROS.

What comes before the stream's metadata is known waits for it. A session's common start cuts the stream at the first raw
message whose receipt stamp has reached it: the step is made afresh, and what comes out from there on does not depend on
what came before. A stream that cannot be used gets an `UnusableStep`, and so does for a while one of whose numbers the
step made an error: no stream ends the interpreter of all others.
"""

import heapq
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import SECOND_NS
from sense4hri.step import Marker, Step, UnusableStep, Update
from sense4hri.stream_info import StreamInfo

LONGEST_WAIT = 5000  # messages kept while nothing is known of a stream yet
HOLD_S = 0.5  # how much later than a raw message, by stamps, one that belongs before it may arrive

AGAIN_S = 10.0  # after an error a stream is interpreted anew
ODD_NUMBERS = (ArithmeticError, ValueError, IndexError)  # what code raises that has not thought of some numbers


class Report(NamedTuple):
    """A value that the device computed itself."""

    received_ns: int
    name: str
    value: float


class Beside(NamedTuple):
    """A chunk of another stream of the same device."""

    received_ns: int
    info: StreamInfo
    chunk: Chunk


Event = Chunk | Report | Marker | Beside
_RANK: dict[type, int] = {Marker: 0, Report: 1, Beside: 2, Chunk: 3}  # among events of one stamp


class Feed:
    """Feeds one step. make_step raises ValueError where the stream cannot be used; refused(reason) is told of it.

    ordered: events are put in the order of their stamps, for which raw messages are held until one has come whose stamp
    is HOLD_S later. dropped(): called for each message that had to be dropped while waiting.
    """

    def __init__(
        self,
        make_step: Callable[[StreamInfo], Step],
        update_interval_s: float,
        *,
        ordered: bool = False,
        refused: Callable[[str], None] = lambda reason: None,
        dropped: Callable[[], None] = lambda: None,
    ) -> None:
        self._make_step, self._update_interval_s = make_step, update_interval_s
        self._refused, self._dropped = refused, dropped
        self._order = _InOrder(HOLD_S if ordered else None)
        self._info: StreamInfo | None = None
        self._waiting: list[Event] = []
        self._clock = SampleClock(0.0)
        self._beside_clocks: dict[str, SampleClock] = {}
        self._no_clock = self._said = ""  # why there are no sample times; the last reason given to refused
        self._step: Step | None = None
        self._channels: tuple[str, ...] = ()
        self._failed_ns: int | None = None  # when the step made an error
        self._start_ns: int | None = None  # where the next segment begins, until it has begun
        self._segment_ns = 0  # where this one began, 0 = with the stream
        self._fresh = False
        self._early: deque[Event] = deque(maxlen=LONGEST_WAIT)  # of the next segment, before its first raw message

    @property
    def known(self) -> bool:
        """True once the stream's metadata is there."""
        return self._info is not None

    def cut_at(self, start_ns: int) -> None:
        """Begin a new segment with the first raw message stamped start_ns or later."""
        self._start_ns = start_ns

    def know(self, info: StreamInfo) -> list[Update]:
        """Take what is known of the stream; return the updates of what has waited for it."""
        try:
            self._clock = SampleClock(info.sampling_frequency_hz)
        except ValueError as err:
            self._no_clock = str(err)
        self._info, waiting, self._waiting = info, self._waiting, []
        return [update for event in waiting for update in self.put(event)]

    def put(self, event: Event) -> list[Update]:
        """Take the next event; return the updates that became due."""
        if self._info is not None:
            return [update for ready in self._order.put(event) for update in self._deliver(ready)]
        if len(self._waiting) < LONGEST_WAIT:
            self._waiting.append(event)
        else:
            self._dropped()
        return []

    def finish(self) -> list[Update]:
        """The stream has ended: return the updates of what was held."""
        return [update for event in self._order.rest() for update in self._deliver(event)]

    def _deliver(self, event: Event) -> list[Update]:
        if isinstance(event, Chunk):
            return self._take(event)
        if event.received_ns < self._segment_ns:
            return []
        if self._step is None or (self._start_ns is not None and event.received_ns >= self._start_ns):
            self._early.append(event)
            return []
        try:
            return self._tell(self._step, event)
        except ODD_NUMBERS as err:
            self._failed(err, event.received_ns)
            return []

    def _take(self, chunk: Chunk) -> list[Update]:
        updates = []
        if self._start_ns is not None and chunk.received_ns >= self._start_ns:
            self._segment_ns, self._start_ns = self._start_ns, None
            self._clock.begin_segment()
            self._beside_clocks.clear()
            updates = self._begin(chunk)
        elif self._step is None or chunk.channels != self._channels or self._is_over(chunk.received_ns):
            updates = self._begin(chunk)
        timed = self._clock.place(chunk)
        if timed.break_ is Break.DUPLICATE or self._step is None:
            return updates
        if self._fresh:
            timed, self._fresh = timed._replace(break_=Break.FIRST, lost=0), False
        try:
            return updates + self._step.push(timed)
        except ODD_NUMBERS as err:
            return updates + self._failed(err, chunk.received_ns).push(timed)

    def _begin(self, chunk: Chunk) -> list[Update]:
        """Make a new step for the channels that really come, and give it what came early."""
        self._channels, self._fresh, self._failed_ns = chunk.channels, True, None
        self._step = self._new_step(chunk.channels)
        early = list(self._early)
        self._early.clear()
        return [update for event in early for update in self._deliver(event)]

    def _new_step(self, channels: tuple[str, ...]) -> Step:
        assert self._info is not None
        try:
            if self._info.problem or self._no_clock:
                raise ValueError(self._info.problem or self._no_clock)
            return self._make_step(replace(self._info, channel_names=channels))
        except ValueError as err:
            return self._unusable(str(err))

    def _failed(self, error: Exception, received_ns: int) -> Step:
        """An error of the step's own ends nothing but what it knew of this stream; it is told with its place."""
        place = traceback.extract_tb(error.__traceback__)[-1]
        self._failed_ns = received_ns
        where = f"{Path(place.filename).name}, line {place.lineno}"
        self._step = self._unusable(f"its samples make {type(error).__name__} in {where}: {error}")
        return self._step

    def _is_over(self, now_ns: int) -> bool:
        """Whether an error was long ago; the host's clock may have been set back since."""
        return self._failed_ns is not None and abs(now_ns - self._failed_ns) >= AGAIN_S * SECOND_NS

    def _unusable(self, reason: str) -> Step:
        if reason != self._said:
            self._said = reason
            self._refused(reason)
        return UnusableStep(self._update_interval_s, reason)

    def _tell(self, step: Step, event: Event) -> list[Update]:
        """Give the step what it has a method for."""
        if isinstance(event, Report) and (report := getattr(step, "device_reported", None)):
            report(event.name, event.value, event.received_ns)
        elif isinstance(event, Marker) and (marker := getattr(step, "marker", None)):
            marker(event)
        elif isinstance(event, Beside):
            return self._tell_beside(step, event)
        return []

    def _tell_beside(self, step: Step, event: Beside) -> list[Update]:
        rate_hz = event.info.sampling_frequency_hz
        clock = SampleClock(rate_hz if rate_hz >= 0 else 0.0)
        timed = self._beside_clocks.setdefault(event.info.name.sensor_type, clock).place(event.chunk)
        if timed.break_ is Break.DUPLICATE:
            return []
        if evidence := getattr(step, "evidence", None):
            evidence(event.info, timed)
        found: list[Update] = step.beside(event.info, timed) if hasattr(step, "beside") else []
        return found


class _InOrder:
    """Gives events in the order of their stamps; raw messages tell the time. hold_s None: as they come."""

    def __init__(self, hold_s: float | None) -> None:
        self._hold_ns = None if hold_s is None else round(hold_s * SECOND_NS)
        self._heap: list[tuple[int, int, int, Any]] = []
        self._number = count()
        self._newest_ns = -(2**63)

    def put(self, event: Event) -> list[Any]:
        """Return what may be used now. A marker without a stamp came right after the newest raw message."""
        if self._hold_ns is None:
            return [event]
        if isinstance(event, Marker) and not event.received_ns:
            event = event._replace(received_ns=max(self._newest_ns + 1, 0))
        ready = []
        if isinstance(event, Chunk):
            if event.received_ns < self._newest_ns - self._hold_ns:  # the host's clock was set back
                ready = self.rest()
            self._newest_ns = event.received_ns
        heapq.heappush(self._heap, (event.received_ns, _RANK[type(event)], next(self._number), event))
        while self._heap and (self._heap[0][0] <= self._newest_ns - self._hold_ns or len(self._heap) > LONGEST_WAIT):
            ready.append(heapq.heappop(self._heap)[-1])
        return ready

    def rest(self) -> list[Any]:
        """Return everything that was held."""
        held = [entry[-1] for entry in sorted(self._heap, key=lambda entry: entry[:3])]
        self._heap.clear()
        return held
