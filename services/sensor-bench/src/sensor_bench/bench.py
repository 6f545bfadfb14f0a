"""All parts together: private bus, stand-in, hearts, and the virtual devices."""

import asyncio
import logging
from pathlib import Path

from bumble.link import LocalLink

from sensor_bench.ble import patient_bus
from sensor_bench.ble.adapter import DEVICE_TIMEOUT_S
from sensor_bench.ble.bus import PrivateBus
from sensor_bench.ble.controller import radio_device
from sensor_bench.ble.peripheral import BlePeripheral
from sensor_bench.ble.stand_in import BluezStandIn
from sensor_bench.clock import HostClock
from sensor_bench.config import Cast
from sensor_bench.device import VirtualDevice
from sensor_bench.kinds import BY_MODEL
from sensor_bench.room import Participant, Room
from sensor_bench.signals.detection import detect_beats
from sensor_bench.signals.hearts import Heart
from sensor_bench.signals.playback import RecordedHeart
from sensor_bench.signals.recordings import load

log = logging.getLogger(__name__)

CENTRAL_ADDRESS = "C0:FF:EE:00:00:01"


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
        self.bus = PrivateBus(socket_path)
        medium, host = LocalLink(), HostClock()
        self._central = radio_device(medium, "central", CENTRAL_ADDRESS)
        self.bluez = BluezStandIn(self._central, self.bus.address, self._rssi_of, adapter, device_timeout_s)
        self.room = Room(cast.participants, seed, host, host.now_ns(), medium, self.bluez)
        self.devices: dict[str, VirtualDevice] = {}

    def _rssi_of(self, address: str) -> int:
        on_air = (device for device in self.devices.values() if isinstance(device, BlePeripheral))
        return next((device.rssi_dbm for device in on_air if device.address == address), -90)

    async def start(self) -> None:
        await self.bus.start()
        await self._make_hearts()
        await self._central.power_on()
        for keys in self.cast.devices:
            device = self.devices[keys.sensor] = BY_MODEL[keys.model].make(self.room, keys)
            await device.start()
        await self.bluez.start()
        for keys in self.cast.devices:
            log.info("virtual %s: %s", keys.model, keys.sensor)

    async def keep_bus(self) -> None:
        """For ever: where the bus, or the connection to it, ends all is back as after a bluetoothd that fell."""
        while True:
            await self.bluez.disconnected()
            await self.bus.revive()
            try:
                await self.bluez.reconnect()
            except patient_bus.LOST as err:
                log.error("the private bus takes no connection (%r); trying again", err)

    async def stop(self) -> None:
        await self.bluez.stop()
        await asyncio.gather(*(device.stop() for device in self.devices.values()))
        await self.bus.stop()

    async def _make_hearts(self) -> None:
        for name, person in self.cast.participants.items():
            self.room.hearts[name] = await self._recorded_heart(name, person) or Heart(
                self.room.seed_of(name), person.heart_rate_bpm, person.respiration_hz
            )

    async def _recorded_heart(self, name: str, person: Participant) -> RecordedHeart | None:
        """The beats of the first ECG, else the first PPG, that a device of this participant plays."""
        played = [device.recordings() for device in self.cast.devices if device.participant == name]
        for stream, delay_s in (("ecg", 0.0), ("ppg", person.pulse_transit_s)):
            for playback in (recordings[stream] for recordings in played if stream in recordings):
                recording = load(playback, stream)
                beats_s = await detect_beats(playback, stream) - delay_s
                return RecordedHeart(beats_s, recording.values.shape[0] / recording.fs_hz, person.respiration_hz)
        return None
