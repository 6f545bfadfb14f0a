"""All parts together: private bus, stand-in, hearts, and the virtual devices on one simulated radio medium."""

import asyncio
import logging
import zlib
from datetime import UTC, datetime
from pathlib import Path

from bumble.controller import Controller
from bumble.device import Device
from bumble.hci import Address
from bumble.host import Host
from bumble.link import LocalLink
from bumble.transport.common import AsyncPipeSink

from sensor_bench.ble.adapter import DEVICE_TIMEOUT_S
from sensor_bench.ble.bus import PrivateBus
from sensor_bench.ble.radio import Radio
from sensor_bench.ble.stand_in import BluezStandIn
from sensor_bench.clock import POLAR_EPOCH_UNIX_NS, DeviceClock, HostClock
from sensor_bench.config import Cast, Participant, VirtualDevice
from sensor_bench.polar.body import Body, Identity
from sensor_bench.polar.control import ControlPoint
from sensor_bench.polar.firmware import Firmware
from sensor_bench.polar.models import MODELS, Stream
from sensor_bench.polar.peripheral import Peripheral
from sensor_bench.polar.pmd import Setting
from sensor_bench.signals.detection import detect_beats
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.playback import PlaybackSource, RecordedHeart
from sensor_bench.signals.recordings import load
from sensor_bench.signals.sources import EcgSource, MotionSource, PpgSource, Source, Wearing
from sensor_bench.signals.waveforms import Waveforms, stored

log = logging.getLogger(__name__)

CENTRAL_ADDRESS = "C0:FF:EE:00:00:01"
EARTH_FIELD_GAUSS = (0.2, 0.05, -0.42)


def seed_of(*parts: object) -> int:
    """A seed that depends on these parts alone, the same in every process."""
    return zlib.crc32(":".join(map(str, parts)).encode())


def radio_device(link: LocalLink, name: str, address: str) -> Device:
    """A bumble host with a controller of its own on the shared medium."""
    controller = Controller(name, link=link, public_address=address)
    return Device(name=name, address=Address(address), host=Host(controller, AsyncPipeSink(controller)))


def polar_ns(text: str) -> int:
    """ISO date and time on the device's own time line -> ns since 2000-01-01."""
    seconds = datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()
    return round(seconds * 1e9) - POLAR_EPOCH_UNIX_NS


class Bench:
    """`start`, use, `stop`; deterministic for a given cast and seed, but for the moment it starts.

    To be created inside a running event loop (bumble wants one).
    """

    def __init__(
        self,
        cast: Cast,
        socket_path: Path,
        seed: int = 1,
        adapter: str = "hci0",
        device_timeout_s: float = DEVICE_TIMEOUT_S,
    ) -> None:
        self.cast = cast
        self.seed = seed
        self.host = HostClock()
        self.start_ns = self.host.now_ns()
        self.bus = PrivateBus(socket_path)
        self._link = LocalLink()
        self._central = radio_device(self._link, "central", CENTRAL_ADDRESS)
        self.bluez = BluezStandIn(self._central, self.bus.address, self._rssi_of, adapter, device_timeout_s)
        self.hearts: dict[str, Heart | RecordedHeart] = {}
        self.peripherals: dict[str, Peripheral] = {}

    def _rssi_of(self, address: str) -> int:
        return next((p.rssi_dbm for p in self.peripherals.values() if p.identity.address == address), -90)

    async def start(self) -> None:
        await self.bus.start()
        waveforms = stored()
        await self._make_hearts()
        await self._central.power_on()
        for device in self.cast.devices:
            peripheral = self._peripheral(device, waveforms)
            self.peripherals[device.sensor] = peripheral
            await peripheral.power_on()
        await self.bluez.start()
        for device in self.cast.devices:
            log.info("virtual %s at %s: %s", device.model, device.address, device.sensor)

    async def keep_bus(self) -> None:
        """For ever: a bus that ends is started again, and the devices are on it as after a bluetoothd that fell."""
        while True:
            await self.bus.revive()
            await self.bluez.reconnect()

    async def stop(self) -> None:
        await self.bluez.stop()
        await asyncio.gather(*(peripheral.power_off() for peripheral in self.peripherals.values()))
        await self.bus.stop()

    async def _make_hearts(self) -> None:
        for name, person in self.cast.participants.items():
            self.hearts[name] = await self._recorded_heart(name, person) or Heart(
                seed_of(self.seed, name), person.heart_rate_bpm, person.respiration_hz
            )

    async def _recorded_heart(self, name: str, person: Participant) -> RecordedHeart | None:
        """The beats of the first ECG, else the first PPG, that a device of this participant plays."""
        devices = [device for device in self.cast.devices if device.participant == name]
        for stream, delay_s in (("ecg", 0.0), ("ppg", person.pulse_transit_s)):
            for playback in (device.play[stream] for device in devices if stream in device.play):
                recording = load(playback, stream)
                beats_s = await detect_beats(playback, stream) - delay_s
                return RecordedHeart(beats_s, recording.values.shape[0] / recording.fs_hz, person.respiration_hz)
        return None

    def _peripheral(self, device: VirtualDevice, waveforms: Waveforms) -> Peripheral:
        model = MODELS[device.model]
        person = self.cast.participants[device.participant]
        wearing = Wearing(device.contact)
        body = Body(
            self.hearts[device.participant],
            wearing,
            self._sources(device, person, wearing, waveforms),
            pulse_delay_s=0.0 if model.has_rr else person.pulse_transit_s,
        )
        firmware = Firmware(
            body,
            ControlPoint(model),
            self.host,
            DeviceClock(self.start_ns, polar_ns(device.clock_start), device.skew_ppm),
            self.start_ns,
            device.rate_factor,
            device.ppi_delay_s,
        )
        return Peripheral(
            radio_device(self._link, device.sensor, device.address),
            Identity(device.sensor, device.address, device.device_id, device.serial_number or device.device_id, model),
            firmware,
            Radio(self.host, device.link, seed_of(self.seed, device.sensor, "radio")),
            rssi_dbm=device.rssi_dbm,
            battery_percent=device.battery_percent,
            down=device.down,
        )

    def _sources(
        self, device: VirtualDevice, person: Participant, wearing: Wearing, waveforms: Waveforms
    ) -> dict[str, Source]:
        heart = self.hearts[device.participant]

        def seed(stream: str) -> int:
            return seed_of(self.seed, device.sensor, stream)

        model = MODELS[device.model]
        made: dict[str, Source] = {}
        for stream in model.streams:
            unit = stream.factor or 1.0
            if stream.name in device.play:
                made[stream.name] = self._playback(device, stream)
            elif stream.name == "ecg":
                made["ecg"] = EcgSource(heart, wearing, waveforms, seed("ecg"), device.amplitude_uv, device.noise_uv)
            elif stream.name == "ppg":
                made["ppg"] = PpgSource(heart, wearing, waveforms, seed("ppg"), person.pulse_transit_s)
            elif stream.name == "accelerometer":
                # in a compressed frame counts are g over the factor, in a raw one milli-g
                scale = 1.0 if stream.factor else 1000.0
                at_rest = tuple(scale * g for g in (-0.12, -0.95, 0.28))
                made["accelerometer"] = MotionSource(
                    heart, seed("accelerometer"), at_rest, breath=0.012 * scale, noise=0.004 * scale, unit=unit
                )
            elif stream.name == "gyroscope":
                made["gyroscope"] = MotionSource(heart, seed("gyroscope"), (0.3, -0.2, 0.1), 0.8, 0.3, unit)
            elif stream.name == "magnetometer":
                made["magnetometer"] = MotionSource(heart, seed("magnetometer"), EARTH_FIELD_GAUSS, 0.001, 0.004, unit)
        return made

    @staticmethod
    def _playback(device: VirtualDevice, stream: Stream) -> PlaybackSource:
        counts_per_unit = 1.0
        if stream.name == "accelerometer":
            counts_per_unit = 1.0 / stream.factor if stream.factor else 1000.0
        rates_hz = [rate * device.rate_factor for rate in stream.offer[Setting.RATE]]
        recording = load(device.play[stream.name], stream.name)
        return PlaybackSource(recording, counts_per_unit, stream.channels, stream.sample_bytes, rates_hz)
