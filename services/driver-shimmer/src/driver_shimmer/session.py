"""One connection to a Shimmer3: who it is, what it shall sample, start and, without fail, stop."""

import asyncio
import math
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import NamedTuple

from sense4hri.arrivals import Arrivals
from sense4hri.device import Identity
from sense4hri.errors import ConfigError, DeviceLost, FrameError

from driver_shimmer import calibration, protocol
from driver_shimmer.calibration import Kinematic
from driver_shimmer.config import GYROSCOPE_DPS, MOTION, ShimmerConfig
from driver_shimmer.protocol import Command, Layout
from driver_shimmer.transport import Port

ANSWER_S = 2.0  # a Shimmer answers within some ms; writing to its memory takes it some more
QUIET_S, QUIET_TRIES = 0.3, 10  # so long nothing may come after a stop
STOP_S = 1.0


class Prepared(NamedTuple):
    """A Shimmer that waits for its start.

    battery_percent: NaN where the firmware does not tell it; constants: of the motion sensors sampled; uv_per_count: of
    the channels of ECG or EMG, empty where there are none; doubts: why constants that the device keeps were not taken.
    """

    identity: Identity
    battery_percent: float
    layout: Layout
    constants: dict[str, Kinematic]
    uv_per_count: tuple[float, ...]
    doubts: tuple[str, ...]


class Session:
    """Commands one at a time, each answered before the next."""

    def __init__(self, port: Port, arrivals: Arrivals[bytes], config: ShimmerConfig) -> None:
        self._port, self._arrivals, self._config = port, arrivals, config
        self._buffer, self._tells_battery = bytearray(), False

    async def prepare(self) -> Prepared:
        """Ask who it is and set what it shall sample. Raises DeviceLost; ConfigError where it is no such device."""
        with _sensible():
            await self._quiet()
            identity = await self._identify()
            battery_percent = await self._battery_percent()
            has_ahtr = calibration.has_ahtr(await self._counted(3, Command.GET_BOARD, bytes([3, 0])))
            layout = await self._configure(has_ahtr)
            kept, uv_per_count = await self._constants(has_ahtr), await self._exg()
        constants = {each: found for each, (found, _) in kept.items()}
        doubts = tuple(doubt for _, doubt in kept.values() if doubt)
        return Prepared(identity, battery_percent, layout, constants, uv_per_count, doubts)

    @asynccontextmanager
    async def streaming(self) -> AsyncIterator[bytes]:
        """Let it stream for the length of the context, and stop it; give what came with the acknowledgement.

        Raises DeviceLost.
        """
        try:
            with _sensible():
                await self._ask(Command.START)
            yield bytes(self._buffer)
        finally:
            await self._stop()

    def ask_battery(self) -> None:
        """Ask for the battery's charge while it streams, where the firmware tells it: between packets."""
        if self._tells_battery:
            self._port.write(bytes([Command.GET_BATTERY]))

    async def _quiet(self) -> None:
        """Stop what an earlier connection may have left running, and wait until nothing comes any more."""
        self._port.write(bytes([Command.STOP]))
        for _ in range(QUIET_TRIES):
            try:
                async with asyncio.timeout(QUIET_S):
                    await self._arrivals.get()
            except TimeoutError:
                self._buffer.clear()
                return
        raise DeviceLost("the device goes on sending after it was stopped; is it a Shimmer3?")

    async def _stop(self) -> None:
        with suppress(DeviceLost, TimeoutError):
            self._port.write(bytes([Command.STOP]))
            async with asyncio.timeout(STOP_S):
                while b"\xff" not in (await self._arrivals.get()).value[-1:]:
                    continue

    async def _ask(self, command: Command, arguments: bytes = b"") -> bytes:
        """Return what the command is answered with. Raises DeviceLost, FrameError."""
        self._port.write(bytes([command]) + arguments)
        try:
            async with asyncio.timeout(ANSWER_S):
                while (answer := protocol.take_answer(self._buffer, command)) is None:
                    self._buffer += (await self._arrivals.get()).value
        except TimeoutError as err:
            raise DeviceLost(
                f"no answer to command {command:02x} ({command.name}) within {ANSWER_S:g} s; is it a Shimmer3?"
            ) from err
        return answer

    async def _counted(self, length: int, command: Command, arguments: bytes) -> bytes:
        """Return an answer of as many bytes as were asked for. Raises DeviceLost, FrameError where fewer come."""
        answer = await self._ask(command, arguments)
        if len(answer) < length:
            raise FrameError(f"{command.name} answered with {len(answer)} bytes, asked were {length}")
        return answer

    async def _identify(self) -> Identity:
        hardware = (await self._ask(Command.GET_HARDWARE))[0]
        if hardware != protocol.SHIMMER3:
            raise ConfigError(f"parameter 'model': the device says hardware {hardware}, a Shimmer3 is 3")
        firmware = protocol.decode_firmware(await self._ask(Command.GET_FIRMWARE))
        if not firmware.spoken:
            raise ConfigError(f"the Shimmer has {firmware.text}; update it to LogAndStream of today with Consensys")
        self._tells_battery = firmware.tells_battery
        serial_number = (await self._ask(Command.GET_SERIAL)).hex()
        return Identity(serial_number=serial_number, firmware_version=firmware.text)

    async def _battery_percent(self) -> float:
        """Return the battery's charge; NaN where the firmware does not tell it."""
        if not self._tells_battery:
            return math.nan
        return calibration.battery_percent(await self._ask(Command.GET_BATTERY))

    async def _configure(self, has_ahtr: bool) -> Layout:
        """Set rate, sensors and ranges, and ask what a packet then holds."""
        config = self._config
        await self._ask(Command.SET_RATE, protocol.set_rate(config.divider)[1:])
        await self._ask(Command.SET_SENSORS, protocol.set_sensors(config.sampled)[1:])
        if "eda" in config.sampled:
            await self._ask(Command.SET_GSR_RANGE, bytes([protocol.AUTO_RANGE]))
        await self._ask(Command.SET_EXPANSION_POWER, bytes(["ppg" in config.sampled]))
        if "gyroscope" in config.sampled:
            await self._ask(Command.SET_GYRO_RANGE, bytes([GYROSCOPE_DPS.index(config.gyroscope_range_dps)]))
        if "magnetometer" in config.sampled and not has_ahtr:
            await self._ask(Command.SET_MAG_GAIN, bytes([protocol.GAIN_1_3_GAUSS]))
        inquiry = protocol.decode_inquiry(await self._ask(Command.INQUIRY))
        layout = Layout(inquiry.channels, has_ahtr)
        if missing := layout.missing(config.sampled):
            raise ConfigError(f"parameter 'streams': the Shimmer does not sample {', '.join(missing)}")
        if inquiry.divider != config.divider:
            raise DeviceLost(f"the rate stayed at 32768 / {inquiry.divider} Hz, asked was 32768 / {config.divider}")
        return layout

    async def _constants(self, has_ahtr: bool) -> dict[str, tuple[Kinematic, str]]:
        stored = await self._ask(Command.GET_CALIBRATION)
        usual = {
            "accelerometer": calibration.LN_PER_MS2,
            "gyroscope": calibration.GYRO_PER_DPS[self._config.gyroscope_range_dps],
            "magnetometer": calibration.AHTR_PER_GAUSS if has_ahtr else calibration.DLHC_PER_GAUSS,
        }
        return {
            each: calibration.kinematic(each, stored, usual[each]) for each in self._config.sampled if each in MOTION
        }

    async def _exg(self) -> tuple[float, ...]:
        """Set up the converters of ECG or EMG; return what a count of each channel is in uV, as they say it."""
        sampled = self._config.sampled
        if not {"ecg", "emg"} & set(sampled):
            return ()
        presets = calibration.EXG_ECG if "ecg" in sampled else calibration.EXG_EMG
        rate_hz = protocol.TICKS_HZ / self._config.divider
        factors: list[float] = []
        for chip, preset in enumerate(presets):
            registers = calibration.exg_registers(preset, rate_hz)
            await self._ask(Command.SET_EXG, bytes([chip, 0, len(registers)]) + registers)
            said = await self._counted(len(registers), Command.GET_EXG, bytes([chip, 0, len(registers)]))
            factors += calibration.exg_uv_per_count(said)
        return (factors[0], factors[1], factors[3]) if "ecg" in sampled else (factors[0], factors[1])


@contextmanager
def _sensible() -> Iterator[None]:
    """A device that refuses, or answers with what is no answer, is asked again from the beginning: DeviceLost."""
    try:
        yield
    except FrameError as err:
        raise DeviceLost(f"the device gave an answer that makes no sense: {err}") from err
