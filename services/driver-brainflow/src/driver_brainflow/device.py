"""A board as the kit sees it: connects through BrainFlow, yields what it polls, always releases the session."""

import asyncio
import atexit
import os
from collections.abc import AsyncGenerator, Mapping
from dataclasses import replace
from functools import partial

from sense4hri.arrivals import Silence, from_thread, in_thread
from sense4hri.device import Declared, Identity, Item, Stream
from sense4hri.errors import DeviceLost

from driver_brainflow.config import BrainflowConfig, sources_of
from driver_brainflow.protocol import Reader
from driver_brainflow.transport import MUSES, PLAYBACK, Session, description, turns

SILENCE_S = 5.0  # BrainFlow does not say that a board is gone
MUSE_SILENCE_S = 2.0  # of its 21 packets a second; the first may take SILENCE_S
OPEN_S = 120.0  # beyond `timeout_s`; searches that fail, and boards that answer late, take up to 30 s
LOOK_S, STUCK_LOOKS = 2.0, 3  # BrainFlow's Bluetooth that did not run between so many looks never will
SLOW_S = 5.0  # releasing a Bluetooth board takes up to 4 s


class Board:
    """A Device of the kit; a file that has ended stays lost."""

    def __init__(self, config: BrainflowConfig, streams: Mapping[str, Stream]) -> None:
        self._config, self._played = config, False

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, start, and yield until the board is silent (DeviceLost); release the session whatever happens."""
        config, table = self._config, description(self._config.described)
        if self._played:
            raise DeviceLost(f"{config.file} has ended")
        session, lost = Session(config.board, config.inputs, config.all_commands, config.verbose), False
        status = 1
        try:
            rates_hz = await self._open(session)
            yield Identity(model=config.model or str(next(iter(table.values()))["name"]))
            yield self._declared(rates_hz)
            readers = {name: self._reader(name, rate_hz) for name, rate_hz in rates_hz.items()}
            silence = Silence(["samples"], SILENCE_S)
            async with from_thread(partial(session.read, tuple(readers), config.poll_s)) as arrivals:
                received_ns, fetched = await silence.watch(arrivals.get())
                silence = Silence(["samples"], MUSE_SILENCE_S if config.board in MUSES else SILENCE_S)
                self._played = config.board == PLAYBACK
                while True:
                    for preset, rows, polled_s in fetched:
                        for item in readers[preset].items(rows, received_ns, polled_s):
                            yield item
                    received_ns, fetched = await silence.watch(arrivals.get())
                    silence.broken_by("samples")
        except DeviceLost:
            lost = True
            raise
        except (asyncio.CancelledError, GeneratorExit):
            status = 0
            raise
        finally:
            closing = asyncio.ensure_future(in_thread(lambda: session.close(lost)))
            released, _ = await asyncio.wait({closing}, timeout=SLOW_S)
            if not released and not lost:
                atexit.register(os._exit, status)  # SimpleBLE's own exit handler waits for its thread, which may hang

    async def _open(self, session: Session) -> dict[str, float]:
        """Open the session; return the rate of each preset.

        Raises RuntimeError where that does not end: nobody in this process could search again.
        BrainFlow 5.23's own Bluetooth waits for itself where another device is seen just as its scan ends (SimpleBLE
        holds the callback's lock and waits for BrainFlow's, `prepare_session` the other way round).
        """
        board, limit_s = self._config.board, OPEN_S + self._config.timeout_s
        opening = asyncio.ensure_future(in_thread(lambda: session.open(self._config.presets)))
        looked, idle = turns(), 0
        try:
            async with asyncio.timeout(limit_s):
                while not (await asyncio.wait({opening}, timeout=LOOK_S))[0]:
                    before, looked = looked, turns()
                    idle = idle + 1 if looked == before is not None else 0
                    if idle == STUCK_LOOKS:
                        raise RuntimeError(f"BrainFlow's Bluetooth hangs in the search for {board}: to be started anew")
                return await opening
        except TimeoutError as err:
            raise RuntimeError(f"BrainFlow has neither found {board} nor given up in {limit_s:g} s") from err
        finally:
            opening.cancel()

    def _declared(self, rates_hz: Mapping[str, float]) -> Declared:
        """The streams at the rates that the board has: its table has what it is delivered with."""
        sources = sources_of(self._config)
        return Declared(
            {name: replace(s.stream, sampling_frequency_hz=rates_hz[s.preset]) for name, s in sources.items()}
        )

    def _reader(self, preset: str, rate_hz: float) -> Reader:
        config = self._config
        table = description(config.described)[preset] | {"sampling_rate": rate_hz}
        return Reader(config.described, preset, table, sources_of(config), config.recorded)
