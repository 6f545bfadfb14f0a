"""The outlets as one device: what they declare, their samples, events and clock."""

from collections.abc import AsyncGenerator, Iterator, Mapping
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sense4hri import lsl
from sense4hri.arrivals import Arrival, Silence, from_thread
from sense4hri.chunk import Chunk
from sense4hri.clock_model import event_ns
from sense4hri.device import ClockMeasurement, Declared, Item, Marked, Noted, Samples, Stream, number_text
from sense4hri.errors import ConfigError, FrameError
from sense4hri.intake import LONGEST_TEXT
from sense4hri.signal_files.choice import unique
from sense4hri.signal_files.units import scaled
from sense4hri.stream_info import long_s

from driver_lsl.config import LslConfig
from driver_lsl.protocol import Evenness, Outlet, Picked, left_out, parse, pick, words
from driver_lsl.transport import Measured, News, Opened, Pulled, Told, link

METHOD = "LSL time_correction"
ANOTHER_CLOCK_NS = 10_000_000_000  # stamps so far from the sender's LSL clock are of a clock that nobody measures


class LslDevice:
    """A Device of the kit: one or several outlets of one machine."""

    def __init__(self, config: LslConfig, streams: Mapping[str, Stream]) -> None:
        self._config = config

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Find the outlets, then yield what they send until one is gone: DeviceLost."""
        with closing(link(self._config)) as outlets:
            async with from_thread(outlets.read) as arrivals:
                opened = await arrivals.get()
                assert isinstance(opened.value, Opened)
                tuned = Tuned.to(opened.value.descriptions, self._config)
                for item in tuned.introduction():
                    yield item
                patience_s = tuned.patience_s(self._config.silence_s)
                silence = Silence(patience_s, patience_s)
                while True:
                    arrival: Arrival[News] = await silence.watch(arrivals.get())
                    if isinstance(arrival.value, Pulled | Told):
                        silence.broken_by(tuned.names[arrival.value.outlet])
                    for item in tuned.items(arrival):
                        yield item


class Tuned:
    """What comes of the outlets, as items of the kit; pure."""

    def __init__(self, outlets: tuple[Outlet, ...], picked: list[Picked], markers: bool, left_out: str = "") -> None:
        self._left_out = left_out
        self.outlets, self._picked, self._markers = outlets, picked, markers
        self.names = unique([outlet.name for outlet in outlets])
        self._evenness = [Evenness(outlet.rate_hz) for outlet in outlets]
        self._measured: Measured | None = None
        self._newest_ns = 0

    @classmethod
    def to(cls, descriptions: tuple[str, ...], config: LslConfig) -> "Tuned":
        """Understand the outlets' XML. Raises ConfigError."""
        outlets = tuple(parse(xml) for xml in descriptions)
        if len(hosts := sorted({outlet.host for outlet in outlets})) > 1:
            raise ConfigError(f"outlets: they are on {', '.join(hosts)}: one driver for each machine's clock")
        picked = pick(outlets, config.wanted)
        return cls(outlets, picked, config.markers, "" if config.wanted else left_out(outlets, picked))

    def patience_s(self, least_s: float) -> dict[str, float]:
        """Return how long each outlet that sends all the time may be silent, by name: so long, or as its rate asks."""
        rates = {self.names[number]: self.outlets[number].rate_hz for number in {each.outlet for each in self._picked}}
        return {name: long_s(least_s, rate_hz) for name, rate_hz in rates.items() if rate_hz}

    def introduction(self) -> Iterator[Item]:
        """Yield who the device is and what it measures."""
        yield self.outlets[0].identity
        yield Declared({picked.sensor_type: picked.stream for picked in self._picked})
        if self._left_out:
            yield Noted(self._left_out)

    def items(self, arrival: Arrival[News]) -> Iterator[Item]:
        """Yield what an arrival means."""
        match arrival.value:
            case Measured():
                self._measured = arrival.value
                yield from self._measurement(arrival.value, arrival.received_ns)
            case Told(number, rows, stamps_s):
                yield from self._events(number, rows, lsl.nanoseconds(stamps_s), arrival.received_ns)
            case Pulled(number, samples, stamps_s) if self.outlets[number].events:
                texts = [[number_text(each) for each in row] for row in samples]
                yield from self._events(number, texts, lsl.nanoseconds(stamps_s), arrival.received_ns)
            case Pulled(number, samples, stamps_s):
                yield from self._samples(number, samples, stamps_s, arrival.received_ns)

    def _samples(
        self, number: int, samples: NDArray[Any], stamps_s: NDArray[np.float64], received_ns: int
    ) -> Iterator[Samples]:
        times_ns = lsl.nanoseconds(stamps_s)
        self._newest_ns = int(times_ns[-1])
        exact = self.outlets[number].rate_hz > 0 and self._evenness[number].exact(stamps_s) and bool(times_ns.all())
        for picked in self._picked:
            if picked.outlet == number:
                values = scaled(samples[:, picked.numbers], picked.scales)
                chunk = Chunk(picked.stream.channel_names, values, int(times_ns[-1]) or None, received_ns)
                by_itself = exact or not picked.stream.sampling_frequency_hz
                yield Samples(picked.sensor_type, chunk, times_ns if by_itself else None)

    def _events(
        self, number: int, rows: list[list[str]], times_ns: NDArray[np.int64], received_ns: int
    ) -> Iterator[Marked | FrameError]:
        self._newest_ns, outlet = int(times_ns[-1]), self.outlets[number].name
        offset_ns = self._measured.offset_ns if self._measured else None
        for row, time_ns in zip(rows, [each or None for each in times_ns.tolist()], strict=True):
            name, value = words(row, outlet)
            if not name:
                yield FrameError(f"an event of {outlet!r} without any text")
            elif len(value) > LONGEST_TEXT:
                yield FrameError(f"an event of {outlet!r} with {len(value)} characters, at most {LONGEST_TEXT} can be")
            elif self._markers:
                yield Marked(event_ns(received_ns, time_ns, offset_ns), time_ns, name, value)

    def _measurement(self, measured: Measured, received_ns: int) -> Iterator[ClockMeasurement]:
        """Yield what was measured, once it is known to be the clock of the stamps."""
        if self._newest_ns and abs(self._newest_ns - measured.remote_ns) < ANOTHER_CLOCK_NS:
            yield ClockMeasurement(received_ns, measured.remote_ns, measured.offset_ns, measured.uncertainty_s, METHOD)
