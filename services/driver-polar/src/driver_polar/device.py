"""One Polar sensor: connect, start what is configured, hand over everything it sends, always stop it again."""

from collections.abc import AsyncGenerator, AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager
from enum import Enum

from sense4hri import gatt
from sense4hri.arrivals import Arrival, Arrivals, Silence
from sense4hri.device import Identity, Item, Status, Stream
from sense4hri.errors import ConfigError, DeviceLost, FrameError

from driver_polar import control, protocol, reports
from driver_polar.config import HEART_RATE, MEASUREMENTS, OFFERED_AS, PP_INTERVAL, PolarConfig
from driver_polar.control import Setting, Settings
from driver_polar.protocol import Intervals, Measurement
from driver_polar.session import PMD_CONTROL, PMD_DATA, ControlPoint, Streams

SILENCE_S = 20.0  # frames of a sampled stream come at least once a second, heart rates every 5 s
SENSOR_TYPES: dict[int, str] = {measurement: stream for stream, measurement in MEASUREMENTS.items()}


class Source(Enum):
    """Which characteristic a value came from."""

    DATA = "data"
    HEART_RATE = "heart rate"
    BATTERY = "battery"


Value = tuple[Source, bytes]


class Polar:
    """A Device of the kit over any Radio."""

    def __init__(self, config: PolarConfig, streams: Mapping[str, Stream], radio: gatt.Radio) -> None:
        self._config, self._streams, self._radio = config, streams, radio

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, start, and yield until the link is lost (DeviceLost); stop the streams whatever happens."""
        inbox, point = Arrivals[Value](), ControlPoint()

        def lost(reason: str) -> None:
            point.lose(DeviceLost(reason))
            inbox.fail(DeviceLost(reason))

        async with self._radio.connect(lost) as link:
            point.open(link)
            yield Status(rssi_dbm=link.rssi_dbm)
            yield await self._identity(link)
            yield await gatt.battery_of(link)
            async with self._running(link, point, inbox) as running:
                sampled = [SENSOR_TYPES[kind] for kind in running.factors if SENSOR_TYPES.get(kind) in self._streams]
                reported = [stream for stream in self._config.started if stream == HEART_RATE]
                silence = Silence(sampled or reported, SILENCE_S)
                while True:
                    arrival = await silence.watch(inbox.get())
                    for item in self._items(arrival, running, silence):
                        yield item

    async def _identity(self, link: gatt.Link) -> Identity:
        """Read what the device says of itself.

        The configured model stays (a Verity Sense calls itself 4J), and a configured body location, which says more.
        """
        said = await gatt.identity_of(link)
        return said._replace(model=None, body_location=None if self._config.body_location else said.body_location)

    @asynccontextmanager
    async def _running(self, link: gatt.Link, point: ControlPoint, inbox: Arrivals[Value]) -> AsyncIterator[Streams]:
        """Start everything configured for the length of the context."""
        running = Streams(point, link.name, self._config.sdk_mode)
        try:
            features = await self._features(link)
            await self._subscribe(link, point, inbox, running)
            await running.set_sdk_mode(features)
            for stream in self._config.started:
                if stream != HEART_RATE:
                    await running.start(stream, MEASUREMENTS[stream], self._wanted(stream))
            yield running
        except FrameError as err:
            raise DeviceLost(f"{link.name} gave an answer that makes no sense: {err}") from err
        finally:
            await running.stop_all()

    async def _features(self, link: gatt.Link) -> frozenset[Measurement]:
        """Return what the device measures; read before indications are on. Raises ConfigError where it lacks any."""
        value = await link.read(PMD_CONTROL)
        if value is None:
            raise ConfigError(f"model {self._config.model}: {link.name} has no Polar measurement service")
        features = control.parse_features(value)
        needed = [MEASUREMENTS[stream] for stream in self._config.started if stream != HEART_RATE]
        missing = [SENSOR_TYPES[kind] for kind in needed if kind not in features]
        if missing:
            offers = ", ".join(SENSOR_TYPES[kind] for kind in sorted(features) if kind in SENSOR_TYPES) or "nothing"
            raise ConfigError(
                f"streams {', '.join(missing)}: {link.name} is no {self._config.model} that has them, "
                f"it measures {offers}"
            )
        return features

    async def _subscribe(self, link: gatt.Link, point: ControlPoint, inbox: Arrivals[Value], running: Streams) -> None:
        def indicated(value: bytes) -> None:
            stopped = point.received(value)
            if stopped is not None and (not stopped or set(stopped) & set(running.factors)):
                kinds = ", ".join(SENSOR_TYPES.get(kind, f"measurement {kind}") for kind in stopped) or "everything"
                inbox.fail(DeviceLost(f"{link.name} stopped measuring by itself: {kinds}"))

        await link.subscribe(PMD_CONTROL, indicated)
        await link.subscribe(PMD_DATA, lambda value: inbox.receive((Source.DATA, value)))
        await gatt.subscribe_to_battery(link, lambda value: inbox.receive((Source.BATTERY, value)))
        if HEART_RATE in self._config.started and not await link.subscribe(
            gatt.HEART_RATE, lambda value: inbox.receive((Source.HEART_RATE, value))
        ):
            raise ConfigError(f"streams {HEART_RATE}: {link.name} has no heart rate service")

    def _wanted(self, stream: str) -> Settings:
        """Return the acceptable settings, best first; none for what the device computes itself."""
        if stream == PP_INTERVAL:
            return {}
        declared = self._streams[stream]
        rate_hz = declared.sampling_frequency_hz
        also = None if self._config.sdk_mode else OFFERED_AS.get((self._config.model, rate_hz))
        wanted: dict[Setting, tuple[float, ...]] = {
            Setting.SAMPLE_RATE: (rate_hz,) if also is None else (rate_hz, also),
            Setting.RESOLUTION: (declared.resolution_bits,),
        }
        if stream == "accelerometer":
            wanted[Setting.RANGE] = (self._config.accelerometer_range_g,)
        if stream == "gyroscope":
            wanted[Setting.RANGE] = (self._config.gyroscope_range_dps,)
        return wanted

    def _items(self, arrival: Arrival[Value], running: Streams, silence: Silence) -> Iterator[Item]:
        """Decode one notification; what cannot be decoded is handed on as the error that says why."""
        received_ns, (source, value) = arrival
        beside = self._config.heart_rate_under
        try:
            if source is Source.BATTERY:
                yield gatt.battery_status(value)
            elif source is Source.HEART_RATE:
                silence.broken_by(HEART_RATE)
                yield from gatt.heart_rate_items(gatt.decode_heart_rate(value), beside, received_ns)
            else:
                frame = protocol.parse(value)
                if frame.measurement not in running.factors:
                    raise FrameError(f"{frame.measurement.name} frame, though that was not started")
                if received_ns <= running.foreign_until_ns.get(frame.measurement, 0):
                    raise FrameError(f"{frame.measurement.name} frame from before it was started")
                silence.broken_by(SENSOR_TYPES.get(frame.measurement, ""))
                measured = protocol.decode(frame, running.factors[frame.measurement])
                if isinstance(measured, Intervals):
                    yield from reports.of_intervals(measured, beside, received_ns)
                else:
                    stream = SENSOR_TYPES[frame.measurement]
                    yield from reports.of_frame(measured, stream, self._streams[stream].channel_names, received_ns)
        except FrameError as err:
            yield err
