"""A virtual Polar sensor on the air: commands answered, values sent, knobs, truth."""

import asyncio
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

from bumble.core import AdvertisingData
from bumble.device import Connection
from sense4hri.errors import Refusal

from sensor_bench.ble.peripheral import BleKeys, BleKnobs, BlePeripheral
from sensor_bench.clock import POLAR_EPOCH_UNIX_NS, UNSET_CLOCK_NS
from sensor_bench.device import Happened, Shown, knob
from sensor_bench.polar import pmd
from sensor_bench.polar.body import Identity
from sensor_bench.polar.firmware import Firmware
from sensor_bench.polar.gatt import Gatt
from sensor_bench.polar.models import MTU, POLAR_COMPANY_ID
from sensor_bench.polar.pmd import Measurement
from sensor_bench.room import Room

COMMAND_TIME_S = 0.015
"""How long the firmware thinks about a control-point command."""
NO_CONTACT_LIMIT_S = 45.0
"""A strap taken off drops its link after that time."""
NO_CONTACT = "no contact"


@dataclass(frozen=True)
class PolarKnobs(BleKnobs):
    """The knobs of a Polar sensor."""

    skew_ppm: float | None = knob("how much its clock gains on the host's", -10_000, 10_000)
    clock_reset: bool | str | None = knob("true: as after an empty battery; or an ISO date and time")
    garbled_frames: float | None = knob("so many frames will be garbled", 0, 1000)
    stop_stream: str | None = knob("a stream the firmware ends by itself")


@dataclass(frozen=True)
class PolarShown(Shown):
    """A Polar sensor in `GET /devices`."""

    name: str
    address: str
    streaming: list[str]
    sdk_mode: bool


@dataclass(frozen=True)
class ClockSegment:
    """From `host_ns` on the device's clock reads `device_ns`, and gains `skew_ppm` on the host."""

    host_ns: int
    device_ns: int
    skew_ppm: float


@dataclass(frozen=True, kw_only=True)
class PolarHappened(Happened):
    """Its clock reads `reference_device_ns` at `reference_host_ns` and gains `skew_ppm` on the host.

    No packet of its link comes sooner than `smallest_delay_s`, as the link is now. `beats_*` are R peaks for a strap,
    systolic peaks of the pulse for an optical sensor. Streams have a `rate_factor` too: true rate over the nominal one.
    """

    reference_host_ns: int
    reference_device_ns: int
    skew_ppm: float
    smallest_delay_s: float
    clock_resets: int
    clock_segments: list[ClockSegment]
    beats_host_ns: list[int]
    beats_device_ns: list[int]


def polar_ns(text: str) -> int:
    """ISO date and time on the device's own time line -> ns since 2000-01-01."""
    seconds = datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()
    return round(seconds * 1e9) - POLAR_EPOCH_UNIX_NS


class Peripheral(BlePeripheral):
    """One virtual sensor."""

    knobs = PolarKnobs
    beyond_the_link = (NO_CONTACT,)

    def __init__(self, room: Room, keys: BleKeys, identity: Identity, firmware: Firmware) -> None:
        super().__init__(room, keys)
        self.identity, self.firmware = identity, firmware
        self._command = asyncio.Lock()
        self._gatt = Gatt(identity, self._on_command)
        self.serve(*self._gatt.services, mtu=MTU)

    # --- life and knobs --------------------------------------------------------------------------------------------

    def wants_to_be_seen(self) -> bool:
        return self.contact

    def advertised(self) -> Sequence[tuple[int, bytes]]:
        rate = round(self.heart.heart_rate_bpm)
        block = bytes([(self.battery_percent < 10) | self.contact << 1, 0, rate, rate])
        kinds = AdvertisingData.Type
        return (
            (kinds.COMPLETE_LIST_OF_16_BIT_SERVICE_CLASS_UUIDS, struct.pack("<H", 0x180D)),
            (kinds.MANUFACTURER_SPECIFIC_DATA, struct.pack("<H", POLAR_COMPANY_ID) + block),
            (kinds.COMPLETE_LOCAL_NAME, self.identity.name.encode()),
        )

    def shown(self) -> PolarShown:
        return PolarShown(
            **vars(super().shown()),
            name=self.identity.name,
            address=self.address,
            streaming=[kind.name.lower() for kind in self.firmware.control.running],
            sdk_mode=self.firmware.control.sdk_mode,
        )

    def standing(self) -> dict[str, Any]:
        return super().standing() | {"skew_ppm": self.firmware.clock.segments[-1].skew_ppm}

    def streams(self) -> dict[str, Any]:
        factor = self.firmware.rate_factor
        return {name: asdict(counts) | {"rate_factor": factor} for name, counts in self.firmware.counts.items()}

    def happened(self, host_ns: int, window_s: float) -> PolarHappened:
        clock, firmware = self.firmware.clock, self.firmware
        beats_ns = self.room.beats_ns(self.keys.participant, host_ns, window_s, firmware.body.pulse_delay_s)
        return PolarHappened(
            **vars(super().happened(host_ns, window_s)),
            reference_host_ns=host_ns,
            reference_device_ns=clock.read_ns(host_ns),
            skew_ppm=clock.at(host_ns).skew_ppm,
            smallest_delay_s=self.radio.quality.latency_s,
            clock_resets=clock.resets,
            clock_segments=[ClockSegment(*segment) for segment in clock.segments],
            beats_host_ns=beats_ns,
            beats_device_ns=[clock.read_ns(beat_ns) for beat_ns in beats_ns],
        )

    def check(self, wanted: Mapping[str, Any]) -> None:
        super().check(wanted)
        if "clock_reset" in wanted:
            _device_ns(wanted["clock_reset"])
        running = self._running_streams()
        if "stop_stream" in wanted and wanted["stop_stream"] not in running:
            raise Refusal(f"stop_stream: {wanted['stop_stream']!r} is not streaming; {running} are", "stop_stream")

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        clock, now_ns = self.firmware.clock, self.room.host.now_ns
        return {
            **super().turns(),
            "skew_ppm": lambda value: clock.set_skew(now_ns(), value),
            "clock_reset": lambda value: clock.reset(now_ns(), _device_ns(value)),
            "garbled_frames": lambda value: setattr(self.firmware, "garbled_frames", round(value)),
            "stop_stream": self._stop_stream,
        }

    async def set_contact(self, contact: bool) -> None:
        """Put on or take off; without contact the link is given up after 45 s and there is no advertising."""
        self.firmware.body.wearing.contact = contact
        self.cancel(NO_CONTACT)
        if not contact:
            self.begin(NO_CONTACT, self._give_up_link())
        await super().set_contact(contact)

    async def _give_up_link(self) -> None:
        await asyncio.sleep(NO_CONTACT_LIMIT_S)
        await self.drop_link()

    def _running_streams(self) -> list[str]:
        """Names of the streams that are being sent."""
        return [s.name for s in self.identity.model.streams if s.measurement in self.firmware.control.running]

    def _stop_stream(self, name: str) -> None:
        """The firmware ends a running stream by itself and says so."""
        stream = next(s for s in self.identity.model.streams if s.name == name)
        del self.firmware.control.running[stream.measurement]
        self.cancel(stream.measurement)
        self.indicate(self._gatt.control, pmd.stopped_by_device([stream.measurement]))

    # --- link and control point ------------------------------------------------------------------------------------

    def on_connected(self) -> None:
        self.begin("heart rate", self.send_all(self._gatt.heart_rate, self.firmware.heart_rates()))

    def on_disconnected(self) -> None:
        self.firmware.control.link_lost()

    def _on_command(self, connection: Connection, value: bytes) -> None:
        self.begin(object(), self._execute(connection, bytes(value)))

    async def _execute(self, connection: Connection, command: bytes) -> None:
        async with self._command:
            await asyncio.sleep(COMMAND_TIME_S)
            answer = self.firmware.control.answer(command, connection.att_mtu)
            for response in answer.responses:
                self.indicate(self._gatt.control, response)
            if answer.stopped is not None:
                self.cancel(answer.stopped.measurement)
            if answer.started is not None:
                stream = answer.started
                settings = self.firmware.control.running[stream.measurement]
                values = (
                    self.firmware.pulse_intervals(stream)
                    if stream.measurement is Measurement.PPI
                    else self.firmware.frames(stream, settings)
                )
                self.begin(stream.measurement, self.send_all(self._gatt.data, values))


def _device_ns(wanted: bool | str) -> int:
    """Return what the clock shall show. Raises Refusal."""
    if wanted is True:
        return UNSET_CLOCK_NS
    if not isinstance(wanted, str):
        raise Refusal("clock_reset is false, must be true, or an ISO date and time", "clock_reset")
    try:
        device_ns = polar_ns(wanted)
    except ValueError as err:
        raise Refusal(f"clock_reset: {err}", "clock_reset") from err
    if device_ns < 0:
        raise Refusal(f"clock_reset: {wanted!r} is before 2000-01-01, where the device's time begins", "clock_reset")
    return device_ns
