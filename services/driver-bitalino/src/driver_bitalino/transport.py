"""The dialogue with a board over its link: what it is, how its battery is, start and stop."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from sense4hri.arrivals import Arrivals
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.serial_port import SerialPort, linked

from driver_bitalino import protocol
from driver_bitalino.protocol import State

QUIET_S = 0.3  # without a byte, and a board that was acquiring has stopped
ANSWER_S = 2.0
LONGEST_VERSION = 100
NAME = "BITalino"  # in every version its boards call themselves


@asynccontextmanager
async def connected(address: str) -> AsyncIterator["Board"]:
    """Connect and make the board idle, for the length of the context; stop it whatever happens. Raises DeviceLost."""
    async with linked(address) as (port, arrivals):
        board = Board(port, arrivals)
        try:
            await board.hush()
            yield board
        finally:
            with suppress(DeviceLost):
                port.write(protocol.STOP)


class Board:
    """One board on an open link."""

    def __init__(self, port: SerialPort, arrivals: Arrivals[bytes]) -> None:
        self.port, self.arrivals = port, arrivals

    async def hush(self) -> None:
        """Stop what a driver that was killed has left running, and read what was on its way. Raises DeviceLost."""
        self.port.write(protocol.STOP)
        try:
            async with asyncio.timeout(ANSWER_S):
                with suppress(TimeoutError):  # of the silence that is waited for
                    while True:
                        async with asyncio.timeout(QUIET_S):
                            await self.arrivals.get()
        except TimeoutError as err:
            raise DeviceLost(f"{self.port.address}: goes on sending after it was stopped: is it a BITalino?") from err

    async def version(self) -> str:
        """Return what the board's firmware calls itself, as in BITalino_v5.1. Raises DeviceLost."""
        self.port.write(protocol.VERSION)
        answer = b""
        while b"\n" not in answer:
            answer += await self._more("version")
            if len(answer) > LONGEST_VERSION:
                raise DeviceLost(f"{self.port.address}: is no BITalino, it answers {answer[:20]!r}")
        heard = "".join(filter(str.isprintable, answer.partition(b"\n")[0].decode("ascii", "replace"))).strip()
        _, name, number = heard.rpartition(NAME)  # before it may stand a byte that was still on its way
        if not name:
            raise DeviceLost(f"{self.port.address}: is no BITalino, it calls itself {heard!r}")
        return name + number

    async def state(self) -> State | FrameError:
        """Return what an idle board says of itself, or why that cannot be read. Raises DeviceLost."""
        self.port.write(protocol.STATE)
        answer = b""
        while len(answer) < protocol.STATE_BYTES:
            answer += await self._more("state")
        try:
            return protocol.decode_state(answer)
        except FrameError as err:
            return err

    async def _more(self, what: str) -> bytes:
        try:
            async with asyncio.timeout(ANSWER_S):
                return (await self.arrivals.get()).value
        except TimeoutError as err:
            raise DeviceLost(
                f"{self.port.address}: no answer to the question for its {what}: is it a BITalino, and switched on?"
            ) from err
