"""One board: connect, hand over every field as a sample of its stream, with the board's own time or count."""

from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping

import numpy as np
from sense4hri.arrivals import Arrival, Silence
from sense4hri.chunk import Chunk
from sense4hri.device import MESSAGE_S, Declared, Identity, Item, Samples, Stream
from sense4hri.errors import FrameError
from sense4hri.intake import LARGEST
from sense4hri.serial_port import OCTETS, decoded
from sense4hri.stamps import LATEST_NS, SECOND_NS
from sense4hri.unwrap import Unwrap, ticks_ns

from driver_serial.config import SerialConfig
from driver_serial.description import TICKS_HZ, Counter, Described, Description, Time, load
from driver_serial.protocol import Fields, Frames
from driver_serial.transport import connected

GATHER_S = 2 * MESSAGE_S  # that the samples of a message are waited for at most
LATE_S = 1.0  # a clock that takes no longer for a round cannot wait: nobody would know how many have passed
SILENCE_S = 5.0
PERIODS = 20.0  # without a frame before a slow board counts as silent


class Board:
    """A Device of the kit. Raises ConfigError where its file describes nothing."""

    def __init__(self, config: SerialConfig, streams: Mapping[str, Stream]) -> None:
        self._config = config
        self._clock: Clock | None = None  # goes on while the link is away
        self._started = False  # before, and maybe never stopped

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, declare what the file describes, and yield until the board is gone (DeviceLost)."""
        described = load(self._config.board)
        if self._clock is None or self._clock.time != described.time:
            self._clock = Clock(described.time) if described.time else None
        async with connected(self._config.port, described) as (port, arrivals):
            yield Identity(vendor=described.vendor or None, model=described.model or None)
            yield Declared({name: described.stream(name) for name in described.streams})
            decoder, silence = Decoder(described, self._clock, self._started), silence_of(described)
            self._started = True
            if decoder.patient:
                port.gather_s = GATHER_S
            async for item in decoded(port, arrivals, decoder, silence):
                yield item


def silence_of(described: Description) -> Silence:
    """Watch for frames as often as the fastest stream needs them; where all are irregular nothing is silent."""
    fastest_hz = max(own.rate_hz for own in described.streams.values())
    if not fastest_hz:
        return Silence([], SILENCE_S)
    return Silence(["frame"], max(SILENCE_S, PERIODS / fastest_hz))


class Clock:
    """The board's time in ns, without its wraps; a board that was reset begins anew."""

    def __init__(self, time: Time, clock_ns: Callable[[], int] | None = None) -> None:
        self.time, self._field, self._ticks_hz = time, time.field, TICKS_HZ[time.unit]
        self.round_s = (1 << time.bits) / self._ticks_hz
        self._unwrap = Unwrap(time.bits, self._ticks_hz, *([clock_ns] if clock_ns else []))

    @property
    def restarts_total(self) -> int:
        """How often the board has begun anew."""
        return self._unwrap.restarts_total

    def __call__(self, fields: Fields) -> int:
        """Return the time of a frame. Raises FrameError where it has none, or one of too many bits."""
        try:
            whole, part = divmod(fields[self._field], 1)  # the wraps are of whole ticks
            time_ns = ticks_ns(self._unwrap(int(whole)), self._ticks_hz) + round(part * SECOND_NS / self._ticks_hz)
        except (KeyError, ValueError, OverflowError) as err:
            raise FrameError(f"time field {self._field!r}: {err}") from err
        if time_ns >= LATEST_NS:
            raise FrameError(f"time field {self._field!r}: {time_ns // SECOND_NS} s are more than a stamp holds")
        return time_ns


class Losses:
    """Frames missing by a counter; None where the board has none. A jump of over half a round is a board reset."""

    def __init__(self, counter: Counter | None) -> None:
        self._counter, self._last = counter, -1

    def begin(self) -> None:
        """The board was reset: whatever it counts now, nothing is missing."""
        self._last = -1

    def before(self, fields: Fields) -> int | None:
        """Return how many frames are missing before this one. Raises FrameError where it does not count."""
        if self._counter is None:
            return None
        try:
            count = int(fields[self._counter.field]) % (1 << self._counter.bits)
        except (KeyError, ValueError, OverflowError) as err:
            raise FrameError(f"counter field {self._counter.field!r}: {err}") from err
        last, self._last = self._last, count
        missing = (count - last - 1) % (1 << self._counter.bits)
        return 0 if last < 0 or missing >= 1 << (self._counter.bits - 1) else missing


class Pending:
    """Samples of one stream that wait for a message."""

    def __init__(self, sensor_type: str, own: Described) -> None:
        self._sensor_type, self._own = sensor_type, own
        self.rate_hz, self.taken = own.rate_hz, 0
        self._least = max(1, round(MESSAGE_S * own.rate_hz))
        self.rows: list[list[float]] = []
        self.times_ns: list[int] = []
        self.lost: int | None = 0
        self._received_ns = self._newest_ns = 0  # what was read last, and its newest sample

    def row(self, fields: Fields) -> list[float] | None:
        """Return what a frame has of this stream; a frame without all of its fields is none of its samples.

        Raises FrameError for a number that no message may hold.
        """
        if not all(channel.field in fields for channel in self._own.channels.values()):
            return None
        row = [fields[each.field] * each.scale + each.offset for each in self._own.channels.values()]
        if any(abs(value) > LARGEST for value in row):
            raise FrameError(f"{self._sensor_type} of {row}: beyond {LARGEST:g}")
        return row

    def add(self, row: list[float] | None, time_ns: int | None, lost: int | None) -> None:
        """Take a sample.

        From a frame on that is none nobody knows which of the missing frames were samples of this stream.
        """
        self.lost = None if lost is None or self.lost is None or row is None else self.lost + lost
        if row is not None:
            self.taken += 1
            self.rows.append(row)
            if time_ns is not None:
                self.times_ns.append(time_ns)

    @property
    def missing(self) -> int:
        """Samples until there are enough for a message."""
        return self._least - len(self.rows)

    def messages(self, received_ns: int) -> Iterator[Samples]:
        """Yield the samples once there are enough for a message."""
        if len(self.rows) >= self._least:
            yield from self.rest(received_ns)

    def rest(self, received_ns: int) -> Iterator[Samples]:
        """Yield what waits; of an irregular stream with the time of each, 0 = none: the kit makes messages of one.

        What was read together with what came before is stamped 1 ns later: two at one time would look like a reset.
        """
        if not self.rows:
            return
        again, self._received_ns = received_ns == self._received_ns, received_ns
        received_ns = self._newest_ns + 1 if again else received_ns
        self._newest_ns = received_ns if self._own.rate_hz else received_ns + len(self.rows) - 1
        times_ns = np.array(self.times_ns or [0] * len(self.rows), np.int64)
        newest_ns = self.times_ns[-1] if self.times_ns else None
        coarse = np.diff(times_ns).min(initial=1) == 0  # two samples in one tick: a step of two ticks is no loss
        timed = times_ns if not self._own.rate_hz or (self.times_ns and not coarse) else None
        chunk = Chunk(tuple(self._own.channels), np.array(self.rows, np.float64), newest_ns, received_ns)
        yield Samples(self._sensor_type, chunk, timed, self.lost)
        self.lost = None if self.lost is None else 0
        self.rows, self.times_ns = [], []


class Decoder:
    """From what arrives of one connection to what the kit publishes; pure. running: the board may send already."""

    def __init__(self, described: Description, clock: Clock | None, running: bool = False) -> None:
        self._frames, self._clock, self._losses = Frames(described, running), clock, Losses(described.counter)
        self._pending = [Pending(name, own) for name, own in described.streams.items()]
        self._fastest = max(self._pending, key=lambda each: each.rate_hz)
        regular = all(each.rate_hz for each in self._pending)
        self.patient = regular and (clock is None or clock.round_s > LATE_S)
        """Whether bytes may wait until there are enough for a message."""
        self._buffer = bytearray()
        self._fed = 0  # bytes, since the beginning
        self._arrived: deque[tuple[int, int]] = deque()  # bytes until then, and when

    def items(self, arrival: Arrival[bytes]) -> Iterator[Item]:
        """Yield samples and errors of all frames that are complete, once there are enough for a message."""
        self._buffer += arrival.value
        self._fed += len(arrival.value)
        self._arrived.append((self._fed, arrival.received_ns))
        for fields in self._frames.take(self._buffer):
            try:
                self._take(fields)
            except FrameError as err:
                yield err
        for pending in self._pending:
            yield from pending.messages(self._received_ns())

    def rest(self) -> Iterator[Item]:
        """Yield the samples that wait for more, of a board that is gone."""
        for pending in self._pending if self._arrived else ():
            yield from pending.rest(self._received_ns())

    @property
    def missing(self) -> int:
        """Bytes until the fastest stream has enough for a message, by what a sample of it has taken so far."""
        if not self.patient:
            return OCTETS
        octets = self._fed / max(1, self._fastest.taken)
        return max(1, round(self._fastest.missing * octets) - len(self._buffer))

    def _received_ns(self) -> int:
        """Return when the last byte of the newest frame came; a struct may have waited for the one behind it."""
        while self._arrived[0][0] < self._fed - len(self._buffer):
            self._arrived.popleft()
        return self._arrived[0][1]

    def _take(self, fields: Fields | FrameError) -> None:
        if isinstance(fields, FrameError):
            raise fields
        rows = [pending.row(fields) for pending in self._pending]
        time_ns = self._time_ns(fields)
        lost = self._losses.before(fields)  # of frames that are taken: one that is refused is missing before the next
        for pending, row in zip(self._pending, rows, strict=True):
            pending.add(row, time_ns, lost)

    def _time_ns(self, fields: Fields) -> int | None:
        if self._clock is None:
            return None
        before, time_ns = self._clock.restarts_total, self._clock(fields)
        if self._clock.restarts_total > before:
            self._losses.begin()
        return time_ns
