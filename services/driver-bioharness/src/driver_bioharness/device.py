"""One BioHarness: enable its packets, keep it awake, hand over everything it sends, always switch them off again."""

import asyncio
import time
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any

from sense4hri.arrivals import Silence
from sense4hri.chunk import Chunk
from sense4hri.device import Feature, Identity, Item, Reported, Samples, Status, Stream
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.stamps import SECOND_NS

from driver_bioharness import protocol
from driver_bioharness.config import STREAMS, BioHarnessConfig
from driver_bioharness.protocol import SHAPES, Kind, Message, Packet
from driver_bioharness.transport import Linked, Port

SILENCE_S = 4.0  # every packet comes at least every 1.1 s
LIFESIGN_S = 2.0
RR_STEP_NS = 56_000_000  # from value to value of an R-R packet
SWITCHES = {Kind.ECG: Kind.SET_ECG, Kind.BREATHING: Kind.SET_BREATHING, Kind.ACCELEROMETER: Kind.SET_ACCELEROMETER}
SENSOR_TYPES = {kind: sensor_type for sensor_type, kind in STREAMS.items()}


class BioHarness:
    """A Device of the kit over any link."""

    def __init__(self, config: BioHarnessConfig, streams: Mapping[str, Stream], connect: Callable[[], Linked]) -> None:
        self._config, self._streams, self._connect = config, streams, connect
        self._newest: dict[int, tuple[int, int]] = {}  # of each kind of packet, sequence and time
        self._rr_ms, self._rr_next_ns = 0, 0  # the sign of the newest interval, and when its packet's follower begins

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, enable, and yield until the link is lost (DeviceLost); switch everything off whatever happens."""
        async with self._connect() as (port, arrivals), self._enabled(port):
            buffer, silence, alive_s = bytearray(), Silence(self._config.streams, SILENCE_S), time.monotonic()
            while True:
                arrival = await silence.watch(arrivals.get())
                buffer += arrival.value
                for message in protocol.take(buffer):
                    for item in self.items(message, arrival.received_ns):
                        if isinstance(item, Samples):
                            silence.broken_by(item.sensor_type)
                        yield item
                if time.monotonic() > alive_s + LIFESIGN_S:
                    alive_s = time.monotonic()
                    with suppress(DeviceLost):  # reading finds it again, after what has come
                        port.write(protocol.encode(Kind.LIFESIGN))

    @asynccontextmanager
    async def _enabled(self, port: Port) -> AsyncIterator[None]:
        """Have the packets sent for the length of the context."""
        switches = [SWITCHES[STREAMS[each]] for each in self._config.streams] + [Kind.SET_RR]
        try:
            port.write(protocol.encode(Kind.SERIAL_NUMBER))
            for switch in switches:
                port.write(protocol.encode(switch, b"\x01"))
            port.write(protocol.encode(Kind.SET_SUMMARY, b"\x01\x00"))
            yield
        finally:
            with suppress(DeviceLost):
                for switch in switches:
                    port.write(protocol.encode(switch, b"\x00"))
                port.write(protocol.encode(Kind.SET_SUMMARY, b"\x00\x00"))
            await asyncio.sleep(0)

    def items(self, message: Message | FrameError, received_ns: int) -> Iterator[Item]:
        """Say what one message means; what cannot be decoded is handed on as the error that says why."""
        if isinstance(message, FrameError):
            yield message
            return
        try:
            yield from self._meaning(message, received_ns)
        except FrameError as err:
            yield err

    def _meaning(self, message: Message, received_ns: int) -> Iterator[Item]:
        if message.end == protocol.REFUSED:
            raise FrameError(f"message {message.kind:02x} was refused by the device")
        if message.kind == Kind.SERIAL_NUMBER and message.content:
            yield Identity(serial_number=message.content.decode("ascii", "replace").strip("\0 "))
        if message.kind not in (*SENSOR_TYPES, Kind.RR, Kind.SUMMARY) or len(message.content) < protocol.HEAD:
            return
        kind, packet = Kind(message.kind), protocol.decode_head(message.content)
        twice = self._newest.get(kind) == (packet.sequence, packet.first_ns)
        self._newest[kind] = packet.sequence, packet.first_ns
        if kind in SENSOR_TYPES:
            yield self._samples(kind, packet, received_ns)  # a second time too: the kit counts it by its stamp
        elif twice:
            return
        elif kind is Kind.RR:
            yield from self._intervals(packet, received_ns)
        else:
            yield from self._summary(packet, received_ns)

    def _samples(self, kind: Kind, packet: Packet, received_ns: int) -> Samples:
        """The samples, stamped with the time of the last; only the first one's is sent."""
        sensor_type, shape = SENSOR_TYPES[kind], SHAPES[kind]
        names = self._streams[sensor_type].channel_names
        last_ns = packet.first_ns + round((shape.samples - 1) / shape.rate_hz * SECOND_NS)
        values = protocol.decode_samples(kind, packet.octets)
        return Samples(sensor_type, Chunk(names, values, last_ns, received_ns))

    def _intervals(self, packet: Packet, received_ns: int) -> Iterator[Reported]:
        """Report each new R-R interval: its sign has turned."""
        found: list[float] = []
        at_ns = packet.first_ns
        if abs(packet.first_ns - self._rr_next_ns) > RR_STEP_NS:
            self._rr_ms = 0  # packets are missing: when the sign turned is not known
        self._rr_next_ns = packet.first_ns + protocol.RR_SAMPLES * RR_STEP_NS
        for number, rr_ms in enumerate(protocol.decode_rr(packet.octets)):
            if self._rr_ms and rr_ms and (rr_ms < 0) != (self._rr_ms < 0):
                found.append(float(abs(rr_ms)))
                at_ns = packet.first_ns + number * RR_STEP_NS
            self._rr_ms = rr_ms or self._rr_ms
        if found:
            yield Reported("ecg", received_ns, at_ns, (Feature("rr_interval", "ms", tuple(found)),))

    def _summary(self, packet: Packet, received_ns: int) -> Iterator[Item]:
        summary = protocol.decode_summary(packet.octets)
        yield Status(battery_percent=summary.battery_percent, contact=summary.contact)
        told: dict[str, list[tuple[str, str, Any]]] = {
            "ecg": [
                ("heart_rate", "1/min", summary.heart_rate_bpm),
                ("skin_temperature", "degC", summary.skin_temperature_degc),
            ],
            "respiration": [("respiration_rate", "1/min", summary.respiration_rate_per_min)],
            "accelerometer": [
                ("posture", "deg", summary.posture_deg),
                ("activity", "g", summary.activity_g),
                ("peak_acceleration", "g", summary.peak_acceleration_g),
            ],
        }
        for sensor_type, values in told.items():
            known = tuple(Feature(name, unit, (value,)) for name, unit, value in values if value is not None)
            if known:
                yield Reported(sensor_type, received_ns, packet.first_ns, known)
