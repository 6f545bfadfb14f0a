"""The last minutes of one raw stream, on the page's time axis, and their minima and maxima per pixel column.

Pure numpy. Samples are kept with their time on the event clock and on the axis (ROS time). The axis time comes from
the clock model; until there is one, from the smallest difference seen between receipt and device stamp. When a better
model moves what is stored by more than TOLERANCE_NS, all of it is moved and `version` rises; so it does where time goes
back by more than BELIEVABLE_NS, and what is stored is forgotten. Of samples beyond MOST_BYTES the older ones are folded
into buckets of minima and maxima (`coarse.py`): a high rate takes no more memory.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Break, TimedChunk
from sense4hri.clock_model import ros_ns
from sense4hri.stamps import SECOND_NS

from web_gui.coarse import Coarse
from web_gui.columns import Columns, Times, lifted, reduced

TOLERANCE_NS = 1_000_000  # a smaller shift is not worth sending everything again: 0.1 pixel in a 10 s window
BELIEVABLE_NS = 5 * SECOND_NS  # a model that puts a sample further than this from its receipt is of another epoch
MOST_BYTES = 10_000_000  # of one stream's samples and their times, whatever its rate; older ones are folded
TIMES_BYTES = 16  # of one row
EXACT = 1e5  # from there on single precision holds less than two decimals: samples are kept in double precision
FIRST_ROWS = 1024
POINTS_PER_COLUMN = 2  # up to this many samples per pixel column are sent as they are
SPACING_ROWS = 64  # newest rows that tell how dense a stream is


class Clock(NamedTuple):
    """Event clock to ROS time (contract, section 3); segment None = provisional, made here from receipt stamps."""

    reference_ns: int
    offset_ns: int
    skew_ppm: float
    segment: int | None

    def ros_ns(self, event_ns: Times) -> Times:
        """Return ROS times in ns of event times in ns, shape (n,)."""
        return ros_ns(event_ns, self.reference_ns, self.offset_ns, self.skew_ppm)


ROS_CLOCK = Clock(0, 0, 0.0, None)  # of a stream whose device gives no time


@dataclass
class _Run:
    """Samples from row number `start` on, of event times first_ns to last_ns, placed by one clock."""

    start: int
    clock: Clock
    first_ns: int
    last_ns: int

    def covers(self, event_ns: Times) -> NDArray[np.bool_]:
        return (self.first_ns <= event_ns) & (event_ns <= self.last_ns + BELIEVABLE_NS)


class History:
    """Ring of one stream's samples with lookup by axis time.

    channels: their names; span_s: how much time is kept; device_time: whether the event clock is a device's own.
    to_reference: to axis time from that of the driver's host, which is the event clock where no device has one; what is
    pushed has been through it.
    """

    def __init__(
        self,
        channels: tuple[str, ...],
        span_s: float,
        device_time: bool,
        to_reference: Callable[[Times], Times] = lambda host_ns: host_ns,
    ) -> None:
        self.channels, self.device_time, self._to_reference = channels, device_time, to_reference
        self.version = 0
        self.samples_total = 0
        self.begun = 0
        """`samples_total` when time went back last: of what came before nothing is left."""
        self._span_ns = round(span_s * SECOND_NS)
        self._model: Clock | None = None
        self._ended: _Run | None = None  # by a break; until a newer model comes, those of its segment are not believed
        self._runs: list[_Run] = []
        self._breaks: list[int] = []  # row numbers that a hole ends at
        self._base = 0  # number of the row at index _first
        self._first = self._end = 0  # rows of the buffers that are in use
        self._older = Coarse(len(channels), self._span_ns)
        self._precision: type[np.floating] = np.float32
        self._allocate(FIRST_ROWS)

    @property
    def newest_ns(self) -> int | None:
        """Axis time of the newest sample; None while there is none."""
        return int(self._ros[self._end - 1]) if self._end > self._first else None

    @property
    def oldest_ns(self) -> int | None:
        """Axis time of the oldest sample kept; None while there is none."""
        newest = int(self._ros[self._first]) if self._end > self._first else None
        return newest if self._older.oldest_ns is None else self._older.oldest_ns

    @property
    def provisional(self) -> bool:
        """True while the samples are placed by their arrival, because no clock model fits them."""
        return bool(self._runs) and self.device_time and self._runs[-1].clock.segment is None

    def push(self, timed: TimedChunk) -> None:
        """Append a chunk; one that repeats the previous stamp is left out."""
        if timed.break_ is Break.DUPLICATE:
            return
        self._begin_run(timed)
        n = len(timed.times_ns)
        if self._precision is np.float32 and np.any(np.abs(timed.samples) > EXACT):
            self._widen()
        self._reserve(n)
        rows = slice(self._end, self._end + n)
        run = self._runs[-1]
        run.last_ns = int(timed.times_ns[-1])
        ros = run.clock.ros_ns(timed.times_ns)
        if (newest := self.newest_ns) is not None and ros[-1] < newest - BELIEVABLE_NS:
            self._begin_anew()
        elif newest is not None:
            ros = np.maximum(ros, newest)  # lookup needs order; a run that starts too early is squeezed, not reordered
        self._event[rows], self._ros[rows], self._values[rows] = timed.times_ns, ros, timed.samples
        self._end += n
        self.samples_total += n

    @property
    def kept_bytes(self) -> int:
        """Memory that the samples and their times take."""
        return len(self._ros) * self._row_bytes + self._older.kept_bytes

    def halve(self) -> None:
        """Forget the older half of the samples and all before them, and give their memory back."""
        self._older.clear()
        self._drop((self._end - self._first) // 2)
        self._to_front(max(FIRST_ROWS, self._end - self._first))

    def _begin_anew(self) -> None:
        """Forget everything: what comes is earlier, as of a replay sought back or a host whose clock was set back."""
        self._older.clear()
        self._drop(self._end - self._first)
        self._ended = None
        self.begun = self.samples_total
        self.version += 1

    @property
    def _row_bytes(self) -> int:
        return TIMES_BYTES + self._values.itemsize * len(self.channels)

    def set_model(self, model: Clock) -> None:
        """Take the newest clock model of the stream's device."""
        self._model = model
        if self._ended and not (self._is_of_ended(model) and self._ended.covers(np.array([model.reference_ns])).all()):
            self._ended = None  # its number may come again: a clock-sync that is started anew counts from 1
        if not self._runs or not self.device_time or not self._fits(model):
            return
        run = self._runs[-1]
        if run.clock.segment is None or run.clock.segment == model.segment:
            self._move(run, model)

    def axis_times(self, event_ns: Times, heard: NDArray[np.int64] | None = None) -> Times:
        """Return the axis times of events, shape (n,): by the clock of the newest run that covers each, or the last.

        heard: `samples_total` when each was told of, at least 1. A device whose clock begins anew says the same times
        again: what was told before is of no run that began after it.
        """
        clock = self._runs[-1].clock if self._runs else self._model
        if not self.device_time or clock is None:
            return event_ns if self.device_time else self._to_reference(event_ns)
        placed = clock.ros_ns(event_ns)
        for run in self._runs:
            covered = run.covers(event_ns) & (True if heard is None else run.start < heard)
            placed[covered] = run.clock.ros_ns(event_ns[covered])
        return placed

    def gaps(self, start_ns: int, end_ns: int) -> list[tuple[int, int]]:
        """Return (last sample before, first sample after) of every hole that touches the range."""
        touching = [(a, b) for a, b in self._holes(self._breaks) if a <= end_ns and b >= start_ns]
        return self._older.gaps(start_ns, end_ns) + touching

    def _holes(self, numbers: list[int]) -> list[tuple[int, int]]:
        """Return the axis times of the samples before and after the hole, if it lasts, that ends at each row."""
        rows = [self._row(number) for number in numbers]
        return [(int(self._ros[row - 1]), int(self._ros[row])) for row in rows if self._ros[row] > self._ros[row - 1]]

    def columns(self, start_ns: int, end_ns: int, column_ns: int, channels: list[int]) -> Columns:
        """Return the line of the chosen channels in [start_ns, end_ns): samples, or min and max per column.

        column_ns: width of a pixel column; columns begin at whole multiples of it. Few samples per column are
        returned as they are; many as one row per column, at the middle of the column.
        """
        ros = self._ros[self._first : self._end]
        a, b = (int(i) for i in np.searchsorted(ros, (start_ns, end_ns)))
        values = self._values[self._first + a : self._first + b]
        line = Columns(ros[a:b], values, values).of(channels)
        holes = np.array([n - self._base - a for n in self._breaks if a <= n - self._base < b], np.int64)
        at = holes
        if a < b and self._spacing_ns() * POINTS_PER_COLUMN < column_ns:
            line, begins = reduced(line, column_ns)
            visible = holes[ros[a + holes] - ros[a + holes - 1] > column_ns]
            at = np.flatnonzero(np.isin(begins, visible))
        line = lifted(line, at)
        if not len(ros) or start_ns >= ros[0]:
            return line
        return self._older.columns(start_ns, min(end_ns, int(ros[0])), column_ns, channels).then(line)

    def _spacing_ns(self) -> float:
        newest = self._ros[max(self._first, self._end - SPACING_ROWS) : self._end]
        return float(np.median(np.diff(newest))) if len(newest) > 1 else float("inf")

    @property
    def _number(self) -> int:
        """Number that the next row gets; rows are numbered from the stream's start."""
        return self._base + self._end - self._first

    def _row(self, number: int) -> int:
        return self._first + number - self._base

    def _begin_run(self, timed: TimedChunk) -> None:
        run = self._runs[-1] if self._runs else None
        if run is None or timed.break_ in (Break.FIRST, Break.RESET) or self._astray(timed, run.clock):
            self._ended = run
            self._start(timed, self._clock_for(timed))
        elif not self.device_time:
            pass
        elif self._model and self._believes(self._model, timed) and run.clock.segment != self._model.segment:
            if run.clock.segment is None:
                self._move(run, self._model)
            else:
                self._start(timed, self._model)
        elif run.clock.segment is None:
            self._improve(run, timed)
        if timed.break_ is not None and self._number > self._base:
            self._breaks.append(self._number)

    def _start(self, timed: TimedChunk, clock: Clock) -> None:
        self._runs.append(_Run(self._number, clock, int(timed.times_ns[0]), int(timed.times_ns[-1])))

    def _clock_for(self, timed: TimedChunk) -> Clock:
        if not self.device_time:
            return ROS_CLOCK
        if self._model and self._believes(self._model, timed):
            return self._model
        last_ns = int(timed.times_ns[-1])
        return Clock(last_ns, timed.received_ns - last_ns, 0.0, None)

    def _believes(self, model: Clock, timed: TimedChunk) -> bool:
        return not self._is_of_ended(model) and not self._astray(timed, model)

    def _is_of_ended(self, model: Clock) -> bool:
        return self._ended is not None and model.segment == self._ended.clock.segment

    def _astray(self, timed: TimedChunk, clock: Clock) -> bool:
        if not self.device_time:
            return False
        placed_ns = int(clock.ros_ns(timed.times_ns[-1:])[0])
        return abs(placed_ns - timed.received_ns) > BELIEVABLE_NS

    def _fits(self, model: Clock) -> bool:
        if self._is_of_ended(model) or self._end == self._first:
            return False
        placed_ns = int(model.ros_ns(self._event[self._end - 1 : self._end])[0])
        return abs(placed_ns - int(self._ros[self._end - 1])) < BELIEVABLE_NS

    def _improve(self, run: _Run, timed: TimedChunk) -> None:
        """A provisional clock follows the fastest delivery seen: the least delayed frame knows best."""
        last_ns = int(timed.times_ns[-1])
        if timed.received_ns - last_ns < run.clock.offset_ns:
            self._move(run, Clock(last_ns, timed.received_ns - last_ns, 0.0, None))

    def _move(self, run: _Run, clock: Clock) -> None:
        """Place a run's samples by another clock, where that is visible."""
        rows = slice(self._row(max(run.start, self._base)), self._end)
        if rows.start >= rows.stop:
            run.clock = clock
            return
        ends = self._event[[rows.start, rows.stop - 1]]
        shift = np.abs(clock.ros_ns(ends) - run.clock.ros_ns(ends)).max()
        if shift <= TOLERANCE_NS and run.clock.segment is not None:
            return
        run.clock = clock
        if shift <= TOLERANCE_NS:
            return
        floor = self._ros[rows.start - 1] if rows.start > self._first else np.int64(0)
        self._ros[rows] = np.maximum(clock.ros_ns(self._event[rows]), floor)
        self.version += 1

    def _allocate(self, rows: int) -> None:
        self._event = np.empty(rows, np.int64)
        self._ros = np.empty(rows, np.int64)
        self._values = np.empty((rows, len(self.channels)), self._precision)

    def _widen(self) -> None:
        """Keep samples in double precision from now on."""
        used, single = slice(self._first, self._end), self._values
        self._precision, self._values = np.float64, np.empty(single.shape, np.float64)
        self._values[used] = single[used]

    def _reserve(self, n: int) -> None:
        """Make room for n rows: forget what is older than the span, move the rest to the front, grow if need be."""
        if self._end + n <= len(self._ros):
            return
        self._forget(n)
        kept = self._end - self._first
        self._to_front(2 * (kept + n) if 2 * (kept + n) > len(self._ros) else len(self._ros))

    def _to_front(self, rows: int) -> None:
        """Move what is kept to the front of buffers of so many rows."""
        kept, used = self._end - self._first, slice(self._first, self._end)
        event, ros, values = self._event[used].copy(), self._ros[used].copy(), self._values[used].copy()
        if rows != len(self._ros):
            self._allocate(rows)
        self._event[:kept], self._ros[:kept], self._values[:kept] = event, ros, values
        self._first, self._end = 0, kept

    def _forget(self, coming: int) -> None:
        ros = self._ros[self._first : self._end]
        outdated = int(np.searchsorted(ros, ros[-1] - self._span_ns)) if len(ros) else 0
        room = max(0, MOST_BYTES // self._row_bytes - coming)
        self._fold(max(0, len(ros) - room - outdated), outdated)
        self._drop(max(outdated, len(ros) - room))

    def _fold(self, count: int, first: int) -> None:
        """Hand so many rows, from row `first` of those in use, to the buckets."""
        rows = slice(self._first + first, self._first + first + count)
        numbers = [n for n in self._breaks if rows.start < self._row(n) <= rows.stop and self._row(n) < self._end]
        line = Columns(self._ros[rows], self._values[rows], self._values[rows])
        self._older.fold(line, self._holes(numbers))

    def _drop(self, dropped: int) -> None:
        """Forget so many of the oldest rows."""
        self._first += dropped
        self._base += dropped
        self._breaks = [number for number in self._breaks if number > self._base]
        while len(self._runs) > 1 and self._runs[1].start <= self._base:
            del self._runs[0]
