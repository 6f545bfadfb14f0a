"""The control point of one connection: commands one at a time, streams started and, without fail, stopped."""

import asyncio
import time
from collections.abc import Mapping
from contextlib import suppress

from sense4hri.errors import ConfigError, DeviceLost, FrameError
from sense4hri.gatt import Link

from driver_polar import control
from driver_polar.config import MEASUREMENTS
from driver_polar.control import Op, Response, ResponseStatus, Setting, Settings
from driver_polar.protocol import Measurement

PMD_CONTROL = "fb005c81-02e7-f387-1cad-8acd2d8df0c8"
PMD_DATA = "fb005c82-02e7-f387-1cad-8acd2d8df0c8"
RESPONSE_TIMEOUT_S = 5.0  # SDKs wait up to 30 s; real devices answer in well under one
STOP_TIMEOUT_S = 3.0  # for all streams together: the driver must be gone 8 s after SIGTERM
NO_SDK_MODE = (
    ResponseStatus.INVALID_OP_CODE,
    ResponseStatus.INVALID_MEASUREMENT_TYPE,
    ResponseStatus.NOT_SUPPORTED,
)
UNITS = {Setting.SAMPLE_RATE: "Hz", Setting.RESOLUTION: "bit", Setting.RANGE: "", Setting.CHANNELS: "channels"}


class Refused(DeviceLost):
    """The device answered a command with an error."""

    def __init__(self, response: Response, text: str) -> None:
        super().__init__(text)
        self.status = response.status


class ControlPoint:
    """Sends commands and waits for their answers. The device handles one at a time, and so does this."""

    def __init__(self) -> None:
        self._link: Link | None = None
        self._lock = asyncio.Lock()
        self._answers: asyncio.Queue[Response | DeviceLost] = asyncio.Queue()
        self._lost: DeviceLost | None = None

    def open(self, link: Link) -> None:
        """Send over this link from now on."""
        self._link = link

    def received(self, value: bytes) -> tuple[int, ...] | None:
        """Take an indication; return the measurements the device says it has stopped by itself, if it says so.

        BlueZ repeats a value that was read as if it were an indication: what is neither answer nor notice is ignored.
        """
        if value[:1] == bytes([control.STOPPED]):
            return control.parse_stopped(value)
        try:
            self._answers.put_nowait(control.parse_response(value))
        except FrameError:
            return None
        return None

    def lose(self, err: DeviceLost) -> None:
        """The link is gone: whoever waits for an answer learns it now."""
        self._lost = err
        self._answers.put_nowait(err)

    async def request(self, op: Op, measurement: Measurement, settings: Settings | None = None) -> bytes:
        """Return the parameters of a successful answer, all its packets joined. Raises Refused or DeviceLost."""
        async with self._lock:
            if self._lost is not None or self._link is None:
                raise self._lost or DeviceLost("not connected")
            while not self._answers.empty():  # late answers to a command that was given up
                self._answers.get_nowait()
            what = f"{op.name} {measurement.name}"
            try:
                async with asyncio.timeout(RESPONSE_TIMEOUT_S):
                    await self._link.write(PMD_CONTROL, control.command(op, measurement, settings))
                    return await self._parameters(op, measurement, what, self._link.mtu)
            except TimeoutError as err:
                raise DeviceLost(f"no answer to {what} within {RESPONSE_TIMEOUT_S:.0f} s") from err

    async def _parameters(self, op: Op, measurement: Measurement, what: str, mtu: int) -> bytes:
        parameters = b""
        while True:
            answer = await self._answers.get()
            if isinstance(answer, DeviceLost):
                raise answer
            if answer.status == ResponseStatus.INVALID_MTU:  # its op byte is odd on an H10
                raise Refused(answer, f"{what}: the MTU of the link, {mtu} bytes, is too small; 232 are needed")
            if (answer.op, answer.measurement) != (op, measurement):
                continue
            if answer.status != ResponseStatus.SUCCESS:
                raise Refused(answer, f"{what} was refused: {answer.status_name}")
            parameters += answer.parameters
            if not answer.more:
                return parameters


class Streams:
    """The measurements running on one connection, each with the factor its samples are scaled by."""

    def __init__(self, control_point: ControlPoint, device: str, sdk_mode: bool) -> None:
        self.factors: dict[Measurement, float] = {}
        self.foreign_until_ns: dict[Measurement, int] = {}
        """What came until then, by the host's clock, was sent with settings that are not ours."""
        self._control, self._device, self._sdk_mode = control_point, device, sdk_mode

    async def set_sdk_mode(self, features: frozenset[Measurement]) -> None:
        """Bring the device into SDK mode, or out of it where it is known to have one; before anything is started.

        It stays as it is while something runs that a broken connection has left: that is stopped. features: what the
        device has. Raises ConfigError where the mode is wanted and the device has none.
        """
        if not self._sdk_mode and Measurement.SDK_MODE not in features:
            return
        try:
            await self._switch_sdk_mode(features)
        except Refused as err:
            if not self._sdk_mode:
                return  # it was off
            if err.status in NO_SDK_MODE:
                raise ConfigError(f"sdk_mode: {self._device} has none ({err})") from err
            raise

    async def _switch_sdk_mode(self, features: frozenset[Measurement]) -> None:
        """An earlier owner may have left it on, which would silence the heart rate."""

        async def switch() -> None:
            if self._sdk_mode:
                await self._start(Measurement.SDK_MODE, {})
            else:
                await self._control.request(Op.STOP, Measurement.SDK_MODE)

        try:
            await switch()
        except Refused as err:
            if err.status != ResponseStatus.INVALID_STATE:
                raise
            for measurement in features & set(MEASUREMENTS.values()):
                with suppress(Refused):  # it was not running
                    await self._stop_foreign(measurement)
            await switch()

    async def _stop_foreign(self, measurement: Measurement) -> None:
        """Stop what a broken connection has left running, with settings that are unknown."""
        await self._control.request(Op.STOP, measurement)
        self.foreign_until_ns[measurement] = time.time_ns()

    async def start(self, sensor_type: str, measurement: Measurement, wanted: Settings) -> None:
        """Start one measurement with the wanted settings.

        Raises ConfigError that lists the offers where the device does not offer one of them.
        """
        settings: Settings = {}
        if wanted:
            op = Op.GET_SDK_SETTINGS if self._sdk_mode else Op.GET_SETTINGS
            offered = control.parse_settings(await self._control.request(op, measurement))
            settings = choose(sensor_type, wanted, offered, self._device)
        await self._start(measurement, settings)

    async def _start(self, measurement: Measurement, settings: Settings) -> None:
        self.factors[measurement] = 1.0  # before it is started: whatever happens, it will be stopped
        try:
            parameters = await self._control.request(Op.START, measurement, settings)
        except Refused as err:
            if err.status != ResponseStatus.ALREADY_IN_STATE:
                raise
            if measurement is Measurement.SDK_MODE:
                return
            await self._stop_foreign(measurement)
            parameters = await self._control.request(Op.START, measurement, settings)
        self.factors[measurement] = control.parse_settings(parameters).get(Setting.FACTOR, (1.0,))[0]

    async def stop_all(self) -> None:
        """Stop what was started, last first: an H10 left streaming stays powered until its battery is taken out.

        Does what it can where the link is gone or the device does not answer.
        """
        try:
            async with asyncio.timeout(STOP_TIMEOUT_S):
                for measurement in reversed(list(self.factors)):
                    try:
                        await self._control.request(Op.STOP, measurement)
                    except Refused:
                        continue  # it was not running
        except (DeviceLost, TimeoutError):
            return


def choose(sensor_type: str, wanted: Settings, offered: Settings, device: str) -> Mapping[Setting, tuple[float, ...]]:
    """Return the settings to start with: one value of each kind the device offers, and of no other.

    wanted: for each kind the acceptable values, the best first; where nothing is wanted the largest offer is taken.
    Raises ConfigError that names the parameter and lists the offers.
    """
    parameters = {
        Setting.SAMPLE_RATE: f"{sensor_type}.sampling_frequency_hz",
        Setting.RESOLUTION: f"{sensor_type}.resolution_bits",
        Setting.RANGE: f"{sensor_type}_range_{'dps' if sensor_type == 'gyroscope' else 'g'}",
    }
    chosen: dict[Setting, tuple[float, ...]] = {}
    for kind, offers in offered.items():
        if kind in (Setting.FACTOR, Setting.SECURITY) or not offers:
            continue
        acceptable = [value for value in wanted.get(kind, (max(offers),)) if value in offers]
        if not acceptable:
            raise ConfigError(
                f"parameter '{parameters[kind]}' is {wanted[kind][0]:g}; "
                f"{device} offers {', '.join(f'{offer:g}' for offer in sorted(offers))} {UNITS[kind]}".rstrip()
            )
        chosen[kind] = (acceptable[0],)
    return chosen
