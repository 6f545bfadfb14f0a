"""What is done beside recording, one child process after the other, as kind to the machine as can be: repair, reports.

A child has its own session, so that the recorder decides when it ends, and stays behind everything else in priority.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

NICENESS = 15
LONGEST_S = 3600.0
FORK_TRIES, FORK_PAUSE_S = 3, 5.0  # where the machine has no memory or process left for a child


@dataclass(frozen=True)
class Chore:
    """A module of Python to be run on a recording's folder. patient: it waits while a session is being recorded."""

    module: str
    directory: Path
    patient: bool = False

    @property
    def command(self) -> str:
        """How to do it by hand."""
        return f"python -m {self.module} {self.directory}"


class Chores:
    """Done on the main thread's loop; `add` may be called from any thread.

    said(chore, status, lines): called when one has ended, with its exit status and what it printed.
    """

    def __init__(self, said: Callable[[Chore, int, list[str]], None]) -> None:
        self._said, self._loop = said, asyncio.get_running_loop()
        self._waiting: deque[Chore] = deque()
        self._now: Chore | None = None
        self._changed = asyncio.Event()
        self._session = False

    def add(self, *chores: Chore) -> None:
        """Have these done, in this order."""
        self._loop.call_soon_threadsafe(self._add, chores)

    def session_runs(self, runs: bool) -> None:
        """While a session is being recorded nothing patient is begun."""
        self._session = runs
        self._changed.set()

    async def run(self) -> None:
        """Do what is to be done, until cancelled."""
        while True:
            chore = self._next()
            if chore is None:
                await self._changed.wait()
                self._changed.clear()
                continue
            self._now = chore
            try:
                self._said(chore, *await _done(chore))
            finally:
                self._now = None
                self._changed.set()

    async def finish(self, within_s: float) -> list[Chore]:
        """Wait so long for what is waiting; return what is left undone."""
        await asyncio.sleep(0)  # what other threads have added
        self._session = False
        self._changed.set()
        deadline = self._loop.time() + within_s
        while (self._waiting or self._now) and self._loop.time() < deadline:
            await asyncio.sleep(0.02)
        return [*([self._now] if self._now else []), *self._waiting]

    def _add(self, chores: tuple[Chore, ...]) -> None:
        self._waiting.extend(chore for chore in chores if chore not in self._waiting)
        self._changed.set()

    def _next(self) -> Chore | None:
        for chore in self._waiting:
            if not (chore.patient and self._session):
                self._waiting.remove(chore)
                return chore
        return None


async def _begun(chore: Chore) -> asyncio.subprocess.Process:
    """Return the running child. Raises OSError where the machine allows none now."""
    return await asyncio.create_subprocess_exec(
        sys.executable,
        *("-m", chore.module, str(chore.directory)),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        start_new_session=True,
    )


async def _done(chore: Chore) -> tuple[int, list[str]]:
    """Run one; its exit status and the lines it printed. Whoever cancels this ends the child too."""
    for pause_s in (*[FORK_PAUSE_S] * (FORK_TRIES - 1), 0.0):
        try:
            child = await _begun(chore)
            break
        except OSError as err:
            why = f"no process could be begun for it: {err.strerror}; by hand: {chore.command}"
            await asyncio.sleep(pause_s)
    else:
        return -1, [why]
    try:
        with contextlib.suppress(ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, child.pid, NICENESS)
        try:
            async with asyncio.timeout(LONGEST_S):
                output, _ = await child.communicate()
        except TimeoutError:
            return -1, [f"not done within {LONGEST_S:.0f} s"]
        return child.returncode or 0, output.decode("utf-8", "replace").splitlines()
    finally:
        if child.returncode is None:
            child.kill()
            await child.wait()
