"""One belt: connect, ask, start, hand over force and respiration rate, always stop it again."""

import asyncio
import math
import time
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager

import numpy as np
from sense4hri import gatt
from sense4hri.arrivals import Arrivals, Silence
from sense4hri.chunk import Chunk
from sense4hri.device import Identity, Item, Reported, Samples, Status, Stream
from sense4hri.errors import ConfigError, DeviceLost, FrameError

from driver_vernier import protocol
from driver_vernier.config import RATES_HZ, Config
from driver_vernier.protocol import FORCE, RESPIRATION_RATE, Frames, Losses, Measured, Response

WRITE, NOTIFY = "f4bf14a6-c7d5-4b6d-8aa8-df1a7c83adcb", "b41e6675-a329-40e0-aa01-44d2f444babe"
ANSWER_S, STOP_S = 5.0, 3.0
SILENCE_S = 5.0
"""Measurements come several times a second."""
PACE_S, PACE_TRUST = 20.0, 0.2
"""A belt is heard for so long, and may then differ by this share from the rate that it was asked for."""
PAUSE_S = 3.0
"""A longer stall, and what has waited for its end and comes at once, tell nothing of the rate. Below PACE_TRUST."""
FIRST_COUNTER = 0xFF
NOTHING = np.empty(0)


class Device:
    """A Device of the kit over any Radio."""

    def __init__(self, config: Config, streams: Mapping[str, Stream], radio: gatt.Radio) -> None:
        self._config, self._stream, self._radio = config, streams["respiration"], radio
        if not RATES_HZ[0] <= self._stream.sampling_frequency_hz <= RATES_HZ[1]:
            raise ConfigError(
                f"parameter 'respiration.sampling_frequency_hz' is {self._stream.sampling_frequency_hz:g}, "
                f"the belt can do {RATES_HZ[0]:g} to {RATES_HZ[1]:g}"
            )

        self._period_us = round(1e6 / self._stream.sampling_frequency_hz)

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, start, and yield until the link is lost (DeviceLost); stop the belt whatever happens."""
        inbox = Arrivals[bytes]()
        async with self._radio.connect(lambda reason: inbox.fail(DeviceLost(reason))) as link:
            yield Status(rssi_dbm=link.rssi_dbm)
            if not await link.subscribe(NOTIFY, inbox.receive):
                raise ConfigError(f"{link.name} has no Go Direct service")
            belt = _Conversation(link, inbox)
            for item in await self._introduced(belt, link.name):
                yield item
            async with self._running(belt):
                frames, losses, silence = belt.frames, Losses(), Silence(["measurement"], SILENCE_S)
                pace = Pace(self._stream.sampling_frequency_hz)
                while True:
                    received_ns, notified = await silence.watch(inbox.get())
                    for frame in frames.take(notified):
                        for item in self.items(frame, losses, received_ns):
                            if isinstance(item, Samples):
                                silence.broken_by("measurement")
                                pace.came(len(item.chunk.samples) + (item.lost or 0))
                            yield item

    async def _introduced(self, belt: "_Conversation", name: str) -> list[Item]:
        """Ask what the belt is. Raises ConfigError where it is another sensor of the family, or too slow."""
        try:
            return await self._asked(belt, name)
        except FrameError as err:
            raise DeviceLost(f"{name} gave an answer that makes no sense: {err}") from err

    async def _asked(self, belt: "_Conversation", name: str) -> list[Item]:
        await belt.ask(protocol.INIT)
        status = protocol.decode_status(await belt.ask(protocol.STATUS))
        model, serial_number = protocol.decode_info(await belt.ask(protocol.DEVICE_INFO))
        available = protocol.decode_available(await belt.ask(protocol.AVAILABLE))
        if not available >> FORCE & 1:
            raise ConfigError(f"name or address: {name} ({model}) has no channel {FORCE}, so it is no respiration belt")
        force = protocol.decode_channel(await belt.ask(protocol.SENSOR_INFO + bytes([FORCE])))
        if force.unit != "N":
            raise ConfigError(
                f"name or address: {name} ({model}) measures in {force.unit!r}, so it is no respiration belt"
            )
        if self._period_us < force.fastest_period_us:
            raise ConfigError(
                f"parameter 'respiration.sampling_frequency_hz' is {self._stream.sampling_frequency_hz:g}, "
                f"{name} can do at most {1e6 / force.fastest_period_us:g}"
            )
        identity = Identity(None, model or None, serial_number or None, status.firmware, None)
        return [identity, Status(battery_percent=status.battery_percent)]

    @asynccontextmanager
    async def _running(self, belt: "_Conversation") -> AsyncIterator[None]:
        """Measure for the length of the context; do what can be done to stop where the link is gone."""
        try:
            await belt.ask(protocol.set_period(self._period_us))
            await belt.ask(protocol.start(FORCE, RESPIRATION_RATE))
            yield
        finally:
            try:
                async with asyncio.timeout(STOP_S):
                    await belt.tell(protocol.STOP)
                    await belt.tell(protocol.DISCONNECT)
            except (DeviceLost, TimeoutError):
                pass

    def items(self, frame: bytes | FrameError, losses: Losses, received_ns: int) -> Iterator[Item]:
        """Hand on what a frame says, or the error that it is; losses knows the frames before it."""
        if isinstance(frame, FrameError):
            yield frame
            return
        try:
            measured = protocol.decode(frame)
        except FrameError as err:
            yield err
            return
        if isinstance(measured, Measured):
            yield from self._measured(measured, losses, received_ns)

    def _measured(self, measured: Measured, losses: Losses, received_ns: int) -> Iterator[Item]:
        """Force as samples; the belt's own rate of respiration with the newest of them, where it knows one."""
        force = measured.values.get(FORCE, NOTHING)
        frames_lost = losses.before(measured.counter, with_force=force.size > 0)
        if force.size:
            chunk = Chunk(self._stream.channel_names, np.ascontiguousarray(force[:, None]), None, received_ns)
            yield Samples("respiration", chunk, lost=frames_lost * force.size)
        rates = measured.values.get(RESPIRATION_RATE)
        if rates is not None and rates.size and math.isfinite(rates[-1]):
            feature = gatt.feature("respiration_rate", "1/min", rates[-1])
            yield Reported("respiration", received_ns, None, (feature,))


class Pace:
    """Notices a belt that samples at another rate than it was asked for: its answer does not say so.

    What follows it, one sample asked_hz after another, would have wrong times. Checked once, over PACE_S without a
    stall of the link or of this process. clock_s: a clock of the host that nobody sets.
    """

    def __init__(self, asked_hz: float, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._asked_hz, self._clock_s = asked_hz, clock_s
        self._begun_s: float | None = None
        self._last_s, self._not_before_s = math.inf, -math.inf
        self._samples = 0
        self._told = False

    def came(self, samples: int) -> None:
        """Count samples, those that are lost among them. Raises DeviceLost with both rates where they differ."""
        now_s = self._clock_s()
        pause_s, self._last_s = now_s - self._last_s, now_s
        if pause_s > PAUSE_S:
            self._begun_s, self._samples, self._not_before_s = None, 0, now_s + PAUSE_S
        if now_s < self._not_before_s:
            return
        if self._begun_s is None:
            self._begun_s = now_s
            return
        self._samples += samples
        passed_s = now_s - self._begun_s
        if self._told or passed_s < PACE_S:
            return
        self._told, rate_hz = True, self._samples / passed_s
        if abs(rate_hz / self._asked_hz - 1) > PACE_TRUST:
            raise DeviceLost(
                f"the belt sends {rate_hz:.1f} samples per s, asked were {self._asked_hz:g}: it has kept another period"
            )


class _Conversation:
    """Sends commands, one at a time, in chunks the belt takes, and waits for their answers."""

    def __init__(self, link: gatt.Link, inbox: Arrivals[bytes]) -> None:
        self.frames = Frames()
        self._link, self._inbox, self._counter = link, inbox, FIRST_COUNTER

    async def ask(self, payload: bytes) -> bytes:
        """Return the content of the answer. Raises DeviceLost where none comes."""
        await self.tell(payload)
        try:
            async with asyncio.timeout(ANSWER_S):
                while True:
                    for frame in self.frames.take((await self._inbox.get()).value):
                        if (content := self._answer(frame, payload[0])) is not None:
                            return content
        except TimeoutError as err:
            raise DeviceLost(f"no answer to command {payload[0]:#04x} within {ANSWER_S:g} s") from err

    async def tell(self, payload: bytes) -> None:
        """Send a command."""
        self._counter = (self._counter - 1) & 0xFF
        whole = protocol.command(payload, self._counter)
        for at in range(0, len(whole), protocol.WRITE_BYTES):
            await self._link.write(WRITE, whole[at : at + protocol.WRITE_BYTES], acknowledged=False)

    def _answer(self, frame: bytes | FrameError, command: int) -> bytes | None:
        """Return the content of the answer that is waited for; anything else is from before and let pass."""
        try:
            said = None if isinstance(frame, FrameError) else protocol.decode(frame)
        except FrameError:
            return None
        fits = isinstance(said, Response) and (said.command, said.counter) == (command, self._counter)
        return said.content if fits and isinstance(said, Response) else None
