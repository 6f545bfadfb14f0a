"""A sender of LSL streams as a device of the bench: its machine, the knobs that make it fail, what really happened."""

import asyncio
import logging
import math
import os
import pickle
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sense4hri import lsl

from sensor_bench.device import Counts, DeviceKeys, Happened, Knobs, VirtualDevice, knob
from sensor_bench.lsl.feeds import Feed, FloatArray, Taken
from sensor_bench.lsl.machine import Frame, Machine
from sensor_bench.room import Room

log = logging.getLogger(__name__)

TICK_S = 0.02
REBOOT_S = 1.0
UPTIME_S = 100.0
"""What a machine's clock reads when it has been started anew."""


@dataclass(frozen=True)
class LslKnobs(Knobs):
    """The knobs of a sender."""

    loss: float | None = knob("share of the samples that the sender skips", 0, 1)
    drop: bool | None = knob("true: its program ends and is started again, under another uid")
    down: bool | None = knob("switched off")
    clock_reset: bool | None = knob("true: its machine is started again; its clock reads 100 s then")


@dataclass(frozen=True, kw_only=True)
class LslHappened(Happened):
    """Its machine's LSL clock reads `reference_device_ns` at `reference_host_ns`."""

    reference_host_ns: int
    reference_device_ns: int
    skew_ppm: float
    smallest_delay_s: float
    starts_total: int


class Sender(VirtualDevice):
    """One machine with the outlets of a feed."""

    knobs = LslKnobs

    def __init__(
        self, room: Room, keys: DeviceKeys, feed: Feed, session: str, loss: float, clock_ahead_s: float = 0.0
    ) -> None:
        super().__init__(room, keys)
        self._session = session
        self.feed, self.loss, self.down, self.connected = feed, loss, False, False
        self.ahead_s = float(math.floor(clock_ahead_s))
        """Of the machine's clock on this host's monotonic one; whole seconds, as `unshare` takes them."""
        self.counts = {name: Counts() for types in feed.types for name in types}
        self.starts_total = self.connections_total = 0
        self._random = np.random.default_rng(room.seed_of(keys.sensor))
        self._zero_s = time.monotonic() - room.now_s()  # monotonic time of the bench's start
        self._machine: asyncio.subprocess.Process | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._sent_s = 0.0

    async def start(self) -> None:
        await self._boot()
        self._tasks.append(asyncio.create_task(self._keep_sending()))

    async def stop(self) -> None:
        for task in self._tasks:
            task.cancel()
        await self._end()

    def link(self) -> tuple[bool, int]:
        return self.connected, self.connections_total

    def standing(self) -> dict[str, Any]:
        return {"loss": self.loss, "down": self.down, "heart_rate_bpm": self.heart.heart_rate_bpm}

    def streams(self) -> dict[str, Any]:
        return {name: asdict(counts) for name, counts in self.counts.items()}

    def happened(self, host_ns: int, window_s: float) -> LslHappened:
        clock_s = self._zero_s + (host_ns - self.room.start_ns) * 1e-9 + self.ahead_s
        return LslHappened(
            **vars(super().happened(host_ns, window_s)),
            reference_host_ns=host_ns,
            reference_device_ns=round(clock_s * 1e9),
            skew_ppm=0.0,
            smallest_delay_s=0.0,
            starts_total=self.starts_total,
        )

    def turns(self) -> Mapping[str, Callable[[Any], Any]]:
        return {
            **super().turns(),
            "loss": lambda value: setattr(self, "loss", value),
            "drop": lambda on: self.restart() if on else None,
            "down": self.switch,
            "clock_reset": lambda on: self.restart(UPTIME_S) if on else None,
        }

    async def switch(self, down: bool) -> None:
        """Switch the machine off or on."""
        self.down = down
        await (self._end() if down else self._boot())

    async def restart(self, clock_s: float | None = None) -> None:
        """End the program and start it again; with clock_s on a machine whose clock reads that then.

        A machine that is off, or switched off meanwhile, stays off.
        """
        await self._end()
        await asyncio.sleep(REBOOT_S if clock_s is not None else 0.0)
        if clock_s is not None:
            self.ahead_s = float(math.floor(clock_s - time.monotonic()))
        if not self.down:
            await self._boot()

    def clock_s(self) -> float:
        """What the machine's clock reads."""
        return time.monotonic() + self.ahead_s

    def taken(self, from_s: float, to_s: float) -> list[Taken]:
        """What was taken in a span of the machine's clock, stamped by it."""
        before_s = self._zero_s + self.ahead_s
        found = self.feed.taken(max(0.0, from_s - before_s), to_s - before_s)
        return [each._replace(times_s=each.times_s + before_s) for each in found]

    async def _boot(self) -> None:
        if self._machine is not None:
            return
        command = [*_with_clock(self.ahead_s), sys.executable, "-m", "sensor_bench.lsl.machine"]
        pipe = asyncio.subprocess.PIPE
        self._machine = await asyncio.create_subprocess_exec(
            *command, stdin=pipe, stdout=pipe, stderr=asyncio.subprocess.DEVNULL
        )
        self.starts_total += 1
        self._sent_s = self.clock_s()
        self._write(tuple(Machine(lsl.settings((), self._session), tuple(self.feed.outlets))))
        self._tasks = [task for task in self._tasks if not task.done()]
        self._tasks.append(asyncio.create_task(self._listen(self._machine)))

    async def _end(self) -> None:
        machine, self._machine = self._machine, None
        if machine is not None and machine.returncode is None:
            machine.kill()
            await machine.wait()
        self.connected = False

    async def _listen(self, machine: asyncio.subprocess.Process) -> None:
        """Note who listens to the machine's outlets."""
        assert machine.stdout is not None
        async for line in machine.stdout:
            listening = line.strip() == b"1"
            self.connections_total += listening and not self.connected
            self.connected = listening
        if machine is self._machine:
            log.error("%s: its machine has ended with status %s", self.keys.sensor, await machine.wait())

    async def _keep_sending(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            if self._machine is not None:
                self._send(self.clock_s())

    def _send(self, now_s: float) -> None:
        for taken in self.taken(self._sent_s, now_s):
            kept = self._random.random(len(taken.times_s)) >= self.loss
            for name in self.feed.types[taken.outlet]:
                self.counts[name].samples_sent += len(kept)
                self.counts[name].samples_lost += int(np.sum(~kept))
            self._write(tuple(Frame(taken.outlet, taken.times_s[kept], _kept(taken.rows, kept))))
        self._sent_s = now_s

    def _write(self, value: Any) -> None:
        if self._machine is not None and self._machine.stdin is not None and not self._machine.stdin.is_closing():
            self._machine.stdin.write(pickle.dumps(value))


def _kept(rows: "FloatArray | list[list[str]]", kept: NDArray[np.bool_]) -> "FloatArray | list[list[str]]":
    return list(compress(rows, kept)) if isinstance(rows, list) else rows[kept]


def _with_clock(ahead_s: float) -> list[str]:
    """What a command is started with so that its clock is ahead; needs the right to a time namespace."""
    if not ahead_s:
        return []
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    return ["unshare", *user, "--time", "--monotonic", f"{ahead_s:.0f}", "--"]
