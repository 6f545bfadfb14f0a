"""A page before a study that is fed without ROS: everything of the server but the graph."""

import asyncio
import threading
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Self

from gui_stage import START_S
from web_gui.config import Config
from web_gui.messages import Assign, Press, Start
from web_gui.model import Study
from web_gui.server import Site, serve

PAST_S = 60
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
