"""A virtual Polar sensor: GATT services on a bumble peripheral, with control point, clock, sources and radio."""

import asyncio
import contextlib
import logging
import struct
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field

from bumble.att import Attribute
from bumble.core import AdvertisingData, BaseBumbleError
from bumble.device import Connection, Device
from bumble.gatt import Characteristic, CharacteristicValue, Service
from bumble.hci import HCI_CONNECTION_TIMEOUT_ERROR

from sensor_bench.ble.radio import Radio
from sensor_bench.clock import DeviceClock, HostClock
from sensor_bench.polar import pmd
from sensor_bench.polar.control import ControlPoint, Settings
from sensor_bench.polar.models import FRAME_BUDGET, MTU, POLAR_COMPANY_ID, Model, Stream
from sensor_bench.polar.pmd import Measurement
from sensor_bench.signals.hearts import Beat, Rhythm
from sensor_bench.signals.sources import Source, Wearing

log = logging.getLogger(__name__)

PMD_SERVICE = "FB005C80-02E7-F387-1CAD-8ACD2D8DF0C8"
PMD_CONTROL = "FB005C81-02E7-F387-1CAD-8ACD2D8DF0C8"
PMD_DATA = "FB005C82-02E7-F387-1CAD-8ACD2D8DF0C8"

ADVERTISING_INTERVAL_MS = 100.0
COMMAND_TIME_S = 0.015
"""How long the firmware thinks about a control-point command."""
HEART_RATE_INTERVAL_S = 1.0
SLOW_HEART_RATE_INTERVAL_S = 5.0
"""Heart-rate notifications while the PPI algorithm runs."""
BEAT_DELAY_S = 0.4
"""A beat is known to the firmware that long after its R peak or pulse."""
RATE_BEATS = 8
"""The reported heart rate is the mean over that many RR intervals."""
MOST_SAMPLES = 64
"""A compressed frame is sent with that many samples even if more would fit."""
LINK_END_TIMEOUT_S = 1.0
NO_CONTACT_LIMIT_S = 45.0
"""A strap taken off drops its link after that time."""


@dataclass
class Counts:
    """What became of a stream's samples since the bench's start."""

    samples_sent: int = 0
    samples_lost: int = 0
    frames_sent: int = 0
    frames_lost: int = 0


@dataclass
class Identity:
    """What a device says about itself."""

    sensor: str
    """The bench's name for it; part of HTTP paths."""
    address: str
    device_id: str
    """The eight characters at the end of the advertised name."""
    serial_number: str
    model: Model

    @property
    def name(self) -> str:
        return f"Polar {self.model.advertised} {self.device_id}"


@dataclass
class Body:
    """Who wears the device and what it measures there."""

    heart: Rhythm
    wearing: Wearing
    sources: Mapping[str, Source]
    """By the name of the stream (`ecg`, `ppg`, `accelerometer`..)."""
    pulse_delay_s: float = 0.0
    """From the R peak to the beat as this device sees it."""


@dataclass
class Peripheral:
    """One virtual sensor. Create it, `power_on`, and let it live; knobs are its public attributes and methods."""

    device: Device
    identity: Identity
    body: Body
    host: HostClock
    clock: DeviceClock
    radio: Radio
    start_ns: int
    """Host time zero of all sources."""
    rate_factor: float = 1.0
    """Real sampling rates are the nominal ones times this, in true time."""
    ppi_delay_s: float = 25.0
    rssi_dbm: int = -55
    battery_percent: int = 90
    counts: dict[str, Counts] = field(default_factory=dict)
    down: bool = False
    connection: Connection | None = None
    connections_total: int = 0
    garbled_frames: int = 0
    """So many of the next data frames are cut short."""

    def __post_init__(self) -> None:
        self.control = ControlPoint(self.identity.model)
        self._tasks: dict[object, asyncio.Task[None]] = {}
        self._command = asyncio.Lock()
        self._advertising = asyncio.Lock()
        self._rr_sent_until_s = 0.0
        readable, writeable = Characteristic.READABLE, Characteristic.WRITEABLE
        read, notify = Characteristic.Properties.READ, Characteristic.Properties.NOTIFY
        write, indicate = Characteristic.Properties.WRITE, Characteristic.Properties.INDICATE
        model = self.identity.model
        self._heart_rate = Characteristic("2A37", notify, Characteristic.Permissions(0), b"")
        self._battery: Characteristic[bytes] = Characteristic(
            "2A19", read | notify, readable, CharacteristicValue(read=lambda _: bytes([self.battery_percent]))
        )
        self._control: Characteristic[bytes] = Characteristic(
            PMD_CONTROL,
            read | write | indicate,
            readable | writeable,
            CharacteristicValue(read=lambda _: pmd.features(model.measurements), write=self._on_command),
        )
        self._data = Characteristic(PMD_DATA, notify, Characteristic.Permissions(0), b"")
        texts = {
            "2A29": "Polar Electro Oy",
            "2A24": model.model_number,
            "2A25": self.identity.serial_number,
            "2A27": "00760690.03",
            "2A26": model.firmware,
            "2A28": "3.1.1",
        }
        information = [Characteristic(uuid, read, readable, text.encode()) for uuid, text in texts.items()]
        location = Characteristic("2A38", read, readable, bytes([model.body_location]))
        self.device.add_services(
            [
                Service("180D", [self._heart_rate, location]),
                Service("180A", information),
                Service("180F", [self._battery]),
                Service(PMD_SERVICE, [self._control, self._data]),
            ]
        )
        self.device.gatt_server.max_mtu = MTU
        self.device.on("connection", self._on_connection)
        for stream in model.streams:
            self.counts.setdefault(stream.name, Counts())

    # --- life and knobs --------------------------------------------------------------------------------------------

    async def power_on(self) -> None:
        await self.device.power_on()
        await self.update_advertising()

    async def power_off(self) -> None:
        self.down = True
        await self.drop_link()
        await self.update_advertising()
        await self.device.power_off()

    async def update_advertising(self) -> None:
        """Advertise while on, worn and unconnected, and only then."""
        async with self._advertising:
            await self._update_advertising()

    async def _update_advertising(self) -> None:
        wanted = not self.down and self.body.wearing.contact and self.connection is None
        if wanted and not self.device.is_advertising:
            await self.device.start_advertising(
                advertising_data=self._advertising_data(),
                advertising_interval_min=ADVERTISING_INTERVAL_MS,
                advertising_interval_max=ADVERTISING_INTERVAL_MS,
            )
        elif not wanted and self.connection is None:
            await self.device.stop_advertising()

    def _advertising_data(self) -> bytes:
        rate = round(self.body.heart.heart_rate_bpm)
        battery_low, contact = self.battery_percent < 10, self.body.wearing.contact
        block = bytes([battery_low | contact << 1, 0, rate, rate])
        kinds = AdvertisingData.Type
        return bytes(
            AdvertisingData(
                [
                    (kinds.FLAGS, b"\x06"),
                    (kinds.COMPLETE_LIST_OF_16_BIT_SERVICE_CLASS_UUIDS, struct.pack("<H", 0x180D)),
                    (kinds.MANUFACTURER_SPECIFIC_DATA, struct.pack("<H", POLAR_COMPANY_ID) + block),
                    (kinds.COMPLETE_LOCAL_NAME, self.identity.name.encode()),
                ]
            )
        )

    async def drop_link(self) -> None:
        """The radio link breaks as if the wearer walked away for a moment."""
        if self.connection is None:
            return
        with contextlib.suppress(BaseBumbleError, TimeoutError):
            # no answer comes where the other side ends the link in the same moment
            await asyncio.wait_for(self.connection.disconnect(HCI_CONNECTION_TIMEOUT_ERROR), LINK_END_TIMEOUT_S)

    async def set_down(self, down: bool) -> None:
        """Out of range or switched off: no link, no advertising, until set back."""
        self.down = down
        if down:
            await self.drop_link()
        await self.update_advertising()

    async def set_contact(self, contact: bool) -> None:
        """Put on or take off; without contact the link is given up after 45 s and there is no advertising."""
        self.body.wearing.contact = contact
        self._cancel("no contact")
        if not contact:
            self._begin("no contact", self._give_up_link())
        await self.update_advertising()

    async def _give_up_link(self) -> None:
        await asyncio.sleep(NO_CONTACT_LIMIT_S)
        await self.drop_link()

    def set_battery(self, percent: int) -> None:
        self.battery_percent = percent
        self._notify(self._battery, bytes([percent]), self.host.now_ns())

    def running_streams(self) -> list[str]:
        """Names of the streams that are being sent."""
        return [s.name for s in self.identity.model.streams if s.measurement in self.control.running]

    def stop_stream(self, name: str) -> None:
        """The firmware ends a running stream by itself and says so."""
        stream = next(s for s in self.identity.model.streams if s.name == name)
        del self.control.running[stream.measurement]
        self._cancel(stream.measurement)
        if self.connection is not None:
            notice = self._indication(self.connection, pmd.stopped_by_device([stream.measurement]))
            self.radio.send(notice, self.host.now_ns())

    # --- link ------------------------------------------------------------------------------------------------------

    def _on_connection(self, connection: Connection) -> None:
        self.connection = connection
        self.connections_total += 1
        connection.on("disconnection", self._on_disconnection)
        self.radio.open()
        self._rr_sent_until_s = self._now_s()
        self._begin("heart rate", self._report_heart_rate())

    def _on_disconnection(self, reason: int) -> None:
        self.connection = None
        self.control.link_lost()
        self.radio.close()
        for key in [key for key in self._tasks if key != "no contact"]:
            self._cancel(key)
        self._begin("advertising", self.update_advertising())

    def _begin(self, key: object, work: Awaitable[None]) -> None:
        self._cancel(key)

        async def run() -> None:
            await work

        task = self._tasks[key] = asyncio.create_task(run())
        task.add_done_callback(lambda task: self._on_done(key, task))

    def _on_done(self, key: object, task: asyncio.Task[None]) -> None:
        if self._tasks.get(key) is task:
            del self._tasks[key]
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("%s: %s failed", self.identity.sensor, key, exc_info=error)

    def _cancel(self, key: object) -> None:
        if (task := self._tasks.pop(key, None)) is not None:
            task.cancel()

    def _notify(
        self,
        characteristic: Attribute[bytes],
        value: bytes,
        ready_ns: int,
        stream: Counts | None = None,
        samples: int = 0,
    ) -> None:
        """Send through the radio; counts go to `stream` once it is known what became of the frame."""
        connection = self.connection
        if connection is None:
            return

        async def deliver() -> None:
            await self.device.notify_subscriber(connection, characteristic, value)
            if stream is not None:
                stream.frames_sent += 1
                stream.samples_sent += samples

        def on_lost() -> None:
            if stream is not None:
                stream.frames_lost += 1
                stream.samples_lost += samples

        self.radio.send(deliver, ready_ns, on_lost, may_lose=stream is not None)

    # --- control point ---------------------------------------------------------------------------------------------

    def _on_command(self, connection: Connection, value: bytes) -> None:
        self._begin(object(), self._execute(connection, bytes(value)))

    async def _execute(self, connection: Connection, command: bytes) -> None:
        async with self._command:
            await asyncio.sleep(COMMAND_TIME_S)
            answer = self.control.answer(command, connection.att_mtu)
            for response in answer.responses:
                self.radio.send(self._indication(connection, response), self.host.now_ns())
            if answer.stopped is not None:
                self._cancel(answer.stopped.measurement)
            if answer.started is not None:
                stream = answer.started
                settings = self.control.running[stream.measurement]
                work = (
                    self._stream_ppi(stream)
                    if stream.measurement is Measurement.PPI
                    else self._stream(stream, settings)
                )
                self._begin(stream.measurement, work)

    def _indication(self, connection: Connection, value: bytes) -> Callable[[], Awaitable[None]]:
        async def deliver() -> None:
            with contextlib.suppress(TimeoutError):
                await self.device.indicate_subscriber(connection, self._control, value)

        return deliver

    # --- streams ---------------------------------------------------------------------------------------------------

    def _now_s(self) -> float:
        return (self.host.now_ns() - self.start_ns) * 1e-9

    async def _stream(self, stream: Stream, settings: Settings) -> None:
        """Sample on the device's own grid; send a frame when its last sample has been taken."""
        fs_hz = settings.rate_hz * self.rate_factor
        source = self.body.sources[stream.name]
        counts = self.counts[stream.name]
        index = int(self._now_s() * fs_hz) + 1
        while True:
            content, count = self._content(stream, source, index, fs_hz)
            last_ns = self.start_ns + round((index + count - 1) / fs_hz * 1e9)
            await self._until(last_ns)
            frame = pmd.frame(
                stream.measurement, self.clock.read_ns(last_ns), stream.frame_type, content, stream.compressed
            )
            self._notify(self._data, self._garbled(frame), last_ns, counts, count)
            index += count

    def _garbled(self, frame: bytes) -> bytes:
        if self.garbled_frames == 0:
            return frame
        self.garbled_frames -= 1
        # 13 content bytes are no whole number of samples in any raw layout, and end inside the first block of deltas
        return frame[: min(len(frame) - 1, pmd.HEADER_BYTES + 13)]

    @staticmethod
    def _content(stream: Stream, source: Source, index: int, fs_hz: float) -> tuple[bytes, int]:
        if stream.compressed:
            samples = source.read(index, MOST_SAMPLES, fs_hz)
            return pmd.fit_delta(samples, stream.sample_bytes, FRAME_BUDGET)
        samples = source.read(index, stream.frame_samples, fs_hz)
        return pmd.signed_content(samples, stream.sample_bytes), stream.frame_samples

    async def _until(self, host_ns: int) -> None:
        while (wait_ns := host_ns - self.host.now_ns()) > 0:
            await asyncio.sleep(wait_ns * 1e-9)

    def _known_beats(self, from_s: float, to_s: float) -> list[Beat]:
        """Beats that the firmware learnt of in [from_s, to_s)."""
        delay_s = self.body.pulse_delay_s + BEAT_DELAY_S
        return self.body.heart.beats(from_s - delay_s, to_s - delay_s)

    async def _report_heart_rate(self) -> None:
        """Heart Rate Measurement notifications once a second, with the RR intervals that ended since the last one."""
        model, next_ns = self.identity.model, self.host.now_ns()
        while True:
            ppi_runs = Measurement.PPI in self.control.running
            next_ns += round(1e9 * (SLOW_HEART_RATE_INTERVAL_S if ppi_runs else HEART_RATE_INTERVAL_S))
            await self._until(next_ns)
            now_s = self._now_s()
            if self.control.sdk_mode:
                continue
            contact = self.body.wearing.contact
            beats = self._known_beats(self._rr_sent_until_s, now_s) if contact else []
            self._rr_sent_until_s = now_s
            value = pmd.heart_rate_measurement(
                self._heart_rate_bpm(now_s) if contact else 0,
                [min(0xFFFF, round(beat.rr_s * 1024)) for beat in beats] if model.has_rr else [],
                contact if model.contact_supported else None,
            )
            self._notify(self._heart_rate, value, next_ns)

    def _heart_rate_bpm(self, now_s: float) -> int:
        beats = self._known_beats(now_s - 20.0, now_s)[-RATE_BEATS:]
        return round(60.0 * len(beats) / sum(beat.rr_s for beat in beats)) if beats else 0

    async def _stream_ppi(self, stream: Stream) -> None:
        """Pulse intervals in batches of about five seconds, the first after the algorithm has settled."""
        counts = self.counts[stream.name]
        next_ns = self.host.now_ns() + round(self.ppi_delay_s * 1e9)
        since_s = self._now_s() + max(0.0, self.ppi_delay_s - SLOW_HEART_RATE_INTERVAL_S)
        while True:
            await self._until(next_ns)
            now_s = (next_ns - self.start_ns) * 1e-9
            beats = self._known_beats(since_s, now_s) if self.body.wearing.contact else []
            since_s = now_s
            if beats:
                rate = self._heart_rate_bpm(now_s)
                intervals = [pmd.PulseInterval(rate, round(beat.rr_s * 1000), 10) for beat in beats]
                taken_ns = self.start_ns + round((beats[-1].time_s + self.body.pulse_delay_s) * 1e9)
                frame = pmd.frame(stream.measurement, self.clock.read_ns(taken_ns), 0, pmd.ppi_content(intervals))
                self._notify(self._data, frame, next_ns, counts, len(beats))
            next_ns += round(SLOW_HEART_RATE_INTERVAL_S * 1e9)
