"""A driver of the SkinBox: the whole of it, beside what the bytes mean."""

import sys
import time
from collections.abc import AsyncGenerator, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from protocol import BITS, TICKS_HZ, Data, Info, Level, Pong, take
from sense4hri.arrivals import Arrival, Silence
from sense4hri.chunk import Chunk
from sense4hri.device import (
    ClockMeasurement,
    Declared,
    DriverConfig,
    Feature,
    Identity,
    Item,
    Reported,
    Samples,
    Stream,
)
from sense4hri.driver import run_driver
from sense4hri.errors import FrameError
from sense4hri.schema import parameter
from sense4hri.serial_port import ADDRESS, ADDRESS_FORM, SerialPort, linked
from sense4hri.unwrap import Unwrap, ticks_ns

SILENCE_S = 3.0


@dataclass(frozen=True, kw_only=True)
class Config(DriverConfig):
    """Parameters of the driver, beside those that every driver has."""

    port: str = parameter("/dev/ttyUSB0", help="where the box is", matches=ADDRESS, form=ADDRESS_FORM)


class SkinBox:
    """The device as the kit sees it: `stream` connects and yields until the box is gone."""

    def __init__(self, config: Config, streams: Mapping[str, Stream]) -> None:
        self._config = config
        self._unwrap = Unwrap(BITS, TICKS_HZ)
        self._asked_ns = 0

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, ask what the box measures, and yield until it is gone (DeviceLost)."""
        async with linked(self._config.port) as (port, arrivals):
            buffer, silence = bytearray(), Silence(["answer"], SILENCE_S)
            port.write(b"i")
            while True:
                arrival = await silence.watch(arrivals.get())
                silence.broken_by("answer")
                for item in self._items(arrival, buffer, port):
                    yield item

    def _items(self, arrival: Arrival[bytes], buffer: bytearray, port: SerialPort) -> Iterator[Item]:
        """Say what every frame means that is complete now; answer where the box waits for a command."""
        buffer += arrival.value
        for message in take(buffer):
            match message:
                case Info(rate_hz, serial_number):
                    yield Identity(serial_number=serial_number)
                    yield Declared(streams_of(rate_hz))
                    port.write(b"s")
                case Data(times_ms, conductance_us):
                    times_ns = np.array([self._time_ns(ms) for ms in times_ms.tolist()])
                    chunk = Chunk(("eda",), conductance_us, int(times_ns[-1]), arrival.received_ns)
                    yield Samples("eda", chunk, times_ns)
                case Level(conductance_us):
                    level = Feature("conductance_level", "uS", (conductance_us,))
                    yield Reported("eda", arrival.received_ns, None, (level,))
                    self._asked_ns = time.time_ns()
                    port.write(b"p")
                case Pong(time_ms):
                    yield self._measured(self._time_ns(time_ms), arrival.received_ns)
                case FrameError():
                    yield message

    def _time_ns(self, time_ms: int) -> int:
        return ticks_ns(self._unwrap(time_ms), TICKS_HZ)

    def _measured(self, device_ns: int, received_ns: int) -> ClockMeasurement:
        """The box read its clock between question and answer: halfway, give or take half of that time and a tick."""
        half_ns = (received_ns - self._asked_ns) // 2
        offset_ns = self._asked_ns + half_ns - device_ns
        uncertainty_s = half_ns * 1e-9 + 1 / TICKS_HZ
        return ClockMeasurement(received_ns, device_ns, offset_ns, uncertainty_s, "ping over the serial port")


def streams_of(rate_hz: int) -> dict[str, Stream]:
    """Return the one stream of a box that samples, none of a box that only reports."""
    return {"eda": Stream(rate_hz, "uS", 0.0, 655.35, 16, ("eda",))} if rate_hz else {}


if __name__ == "__main__":
    sys.exit(run_driver("skinbox", Config, lambda config: {}, SkinBox))
