"""A page before a study that is fed without ROS: everything of the server but the graph."""

import asyncio
import threading
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Self

import numpy as np
from gui_stage import START_S
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from web_gui.config import Config
from web_gui.messages import Assign, Press, Start
from web_gui.model import Study
from web_gui.server import Site, serve
from web_gui.stream import Info, Stream

PAST_S, RATE_HZ = 60, 100.0
HEALTH = {"state": 2, "lost_samples_total": 0, "reconnects_total": 0, "contact": 1.0, "host": "lab", "reasons": []}


@dataclass
class Desk:
    """Notes what is ordered."""

    assigned: list[tuple[str, str]] = field(default_factory=list)
    started: list[Start] = field(default_factory=list)
    pressed: list[Press] = field(default_factory=list)

    async def start(self, wish: Start) -> SimpleNamespace:
        self.started.append(wish)
        return SimpleNamespace(ok=False, text="not here")

    async def stop(self, wish: object) -> SimpleNamespace:
        return SimpleNamespace(ok=False, text="not here")

    async def assign(self, wish: Assign) -> SimpleNamespace:
        self.assigned.append((wish.sensor_id, wish.human_id))
        return SimpleNamespace(ok=True, text=f"{wish.sensor_id} is assigned to {wish.human_id}")

    def mark(self, press: Press) -> None:
        self.pressed.append(press)


def times_s(at_ns: int, seconds: float) -> NDArray[np.float64]:
    """Return the times of so many seconds of samples that end at a time."""
    return at_ns / 1e9 + np.arange(-round(seconds * RATE_HZ) + 1, 1) / RATE_HZ


def waves(at_ns: int, seconds: float, channels: int) -> NDArray[np.float64]:
    """Return sines of 400, one of another frequency for each channel, shape (n, channels)."""
    return 400 * np.sin(2 * np.pi * np.outer(times_s(at_ns, seconds) % 3600, 1 + np.arange(channels) / 4))


class Lab(ABC):
    """A study that has run for a minute and goes on; the page is at `address`."""

    def __init__(self) -> None:
        self.desk, self.study = Desk(), Study(600.0)
        self.site = Site(self.study, Config(port=0), self.desk)
        self.study.session.coordinator = True
        self.address, self._told, self._ended = "", threading.Event(), threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()))

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._told.wait(START_S)
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()

    @abstractmethod
    def feed(self, at_ns: int, seconds: float) -> None:
        """Let so much of everybody's signal end at a time."""

    def give(
        self, name: StreamName, unit: str, channels: tuple[str, ...], samples: NDArray[np.float64], at_ns: int
    ) -> Stream:
        """Let samples of a stream, shape (n, channels), end at a time; return the stream."""
        stream = self.study.stream(name, at_ns)
        if stream.info is None:
            stream.learn(Info(RATE_HZ, unit, {}))
        stream.raw(Chunk(channels, samples, None, at_ns), at_ns)
        return stream

    async def _run(self) -> None:
        runner, port = await serve(self.site, Config(port=0))
        self.address = f"http://127.0.0.1:{port}"
        begun_ns = time.time_ns()
        for second in range(PAST_S, 0, -1):
            self.feed(begun_ns - second * 10**9, 1.0)
        self._told.set()
        fed_ns = begun_ns - 10**9
        while not self._ended.is_set():
            fed_ns += 250_000_000
            self.feed(fed_ns, 0.25)
            self.site.page.tick()
            await asyncio.sleep(max(0.0, (fed_ns - time.time_ns()) / 1e9))
        await runner.cleanup()
