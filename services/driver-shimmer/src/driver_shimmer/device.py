"""One Shimmer3: prepare it, start it, hand over everything it samples, always stop it again."""

import math
import time
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping, Sequence

import numpy as np
from sense4hri.arrivals import Arrival, Silence
from sense4hri.chunk import Chunk
from sense4hri.device import MESSAGE_S, Feature, Item, Noted, Reported, Samples, Status, Stream
from sense4hri.errors import FrameError
from sense4hri.serial_port import decoded
from sense4hri.stamps import SECOND_NS
from sense4hri.unwrap import Unwrap, ticks_ns

from driver_shimmer import calibration, protocol
from driver_shimmer.calibration import Floats
from driver_shimmer.config import ShimmerConfig
from driver_shimmer.packets import Answer, Packet, Packets
from driver_shimmer.protocol import CLOCK_BITS, TICKS_HZ, Counts
from driver_shimmer.session import Prepared, Session
from driver_shimmer.transport import Linked

SILENCE_S = 3.0  # packets come at least once a second
BATTERY_S = 60.0
CONTACT_US = 0.03  # so little is noise of the converter: nothing is between the electrodes
GATHER_S = 2 * MESSAGE_S  # that the packets of a message, of one sample each, are waited for at most


class Shimmer:
    """A Device of the kit over any link."""

    def __init__(
        self,
        config: ShimmerConfig,
        streams: Mapping[str, Stream],
        connect: Callable[[], Linked],
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._config, self._streams, self._connect = config, streams, connect
        self._unwrap = Unwrap(CLOCK_BITS, TICKS_HZ, clock_ns)
        self._range = self._contact = math.nan
        self._waiting: list[Packet] = []
        self._least = max(1, round(MESSAGE_S * TICKS_HZ / config.divider))  # packets of a message

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, prepare, start, and yield until the link is lost (DeviceLost); stop it whatever happens."""
        async with self._connect() as (port, arrivals):
            session = Session(port, arrivals, self._config)
            prepared = await session.prepare()
            yield prepared.identity
            yield Status(battery_percent=prepared.battery_percent)
            for doubt in prepared.doubts:
                yield Noted(doubt)
            packets = Packets(prepared.layout.length, self._config.divider)
            self._waiting, self._contact = [], math.nan
            async with session.streaming() as begun:
                port.gather_s = GATHER_S
                connection = Connection(self, packets, prepared)
                silence, asked_s = Silence(["packet"], SILENCE_S), time.monotonic()
                for item in connection.items(Arrival(time.time_ns(), begun)):
                    yield item
                async for item in decoded(port, arrivals, connection, silence, "packet"):
                    yield item
                    if time.monotonic() > asked_s + BATTERY_S:
                        asked_s = time.monotonic()
                        session.ask_battery()

    def items(self, found: Iterator[Packet | Answer | FrameError], prepared: Prepared) -> Iterator[Item]:
        """Say what came together: the packets' samples of each sensor, and what stood between them."""
        for each in found:
            match each:
                case Packet():
                    self._waiting.append(each)
                case Answer(code=protocol.BATTERY):
                    yield Status(battery_percent=calibration.battery_percent(each.content))
                case FrameError():
                    yield each
        if self._waiting and (len(self._waiting) >= self._least or self._waited_ns() >= GATHER_S * SECOND_NS):
            yield from self.rest(prepared)

    def wanted(self) -> int:
        """Return how many packets more make a message."""
        return self._least - len(self._waiting)

    def _waited_ns(self) -> int:
        """Return how long what waits has waited, by a clock that may be set."""
        return abs(self._waiting[-1].received_ns - self._waiting[0].received_ns)

    def rest(self, prepared: Prepared) -> Iterator[Item]:
        """Hand on what has come and waits for more."""
        packets, self._waiting = self._waiting, []
        if packets:
            yield from self._samples(packets, prepared)

    def _samples(self, packets: Sequence[Packet], prepared: Prepared) -> Iterator[Item]:
        times_ns = np.array([ticks_ns(self._unwrap(each.ticks), TICKS_HZ) for each in packets])
        counts = prepared.layout.counts([each.octets for each in packets], self._config.sampled)
        received_ns = packets[-1].received_ns
        if "eda" in counts:
            yield from self._skin(counts["eda"], times_ns, received_ns)
        for sensor_type, of_sensor in counts.items():
            names = self._streams[sensor_type].channel_names
            values = in_units(sensor_type, of_sensor, prepared)
            yield Samples(sensor_type, Chunk(names, values, int(times_ns[-1]), received_ns), times_ns)

    def _skin(self, counts: Counts, times_ns: Counts, received_ns: int) -> Iterator[Item]:
        """Report every change of the amplifier's range, and whether anything is between its electrodes."""
        ranges = calibration.gsr_ranges(counts[:, 0])
        for at in np.flatnonzero(np.diff(ranges, prepend=self._range) != 0):
            self._range = float(ranges[at])
            yield Reported("eda", received_ns, int(times_ns[at]), (Feature("gsr_range", "1", (self._range,)),))
        contact = float(calibration.conductance_us(counts[-1:, 0])[0] > CONTACT_US)
        if contact != self._contact:
            self._contact = contact
            yield Status(contact=contact)


class Connection:
    """The Decoder of one connection: from its bytes to the items of its Shimmer."""

    def __init__(self, shimmer: Shimmer, packets: Packets, prepared: Prepared) -> None:
        self._shimmer, self._packets, self._prepared = shimmer, packets, prepared

    @property
    def missing(self) -> int:
        """Bytes until there are enough for a message."""
        return self._packets.missing(self._shimmer.wanted())

    def items(self, arrival: Arrival[bytes]) -> Iterator[Item]:
        """Yield what is complete, once there is enough for a message."""
        return self._shimmer.items(self._packets.feed(arrival.value, arrival.received_ns), self._prepared)

    def rest(self) -> Iterator[Item]:
        """Yield the samples that wait for more."""
        return self._shimmer.rest(self._prepared)


def in_units(sensor_type: str, counts: Counts, prepared: Prepared) -> Floats:
    """Return counts of a sensor in its canonical unit, shape (n, channels)."""
    if sensor_type in prepared.constants:
        return prepared.constants[sensor_type].apply(counts)
    if sensor_type == "eda":
        return calibration.conductance_us(counts)
    if sensor_type in ("ecg", "emg"):
        return counts * np.array(prepared.uv_per_count)
    return counts.astype(np.float64)
