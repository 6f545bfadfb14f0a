"""What every browser is shown of the study, and who carries out what their readers order. Knows no ROS."""

import json
import math
import time
from collections.abc import Callable
from typing import Any, Protocol

from sense4hri.shapes import plain

from web_gui.messages import Assign, Press, Start, Stop
from web_gui.model import Study
from web_gui.problem_log import ProblemLog
from web_gui.problems import problems
from web_gui.snapshot import study_message, trend_message

STUDY_EVERY_S, TREND_EVERY_S = 0.5, 2.0
SHARED = 0.5  # share of the time between two messages during which browsers are sent the same one


class Answer(Protocol):
    """What became of an order, in words."""

    @property
    def ok(self) -> bool: ...
    @property
    def text(self) -> str: ...


class Desk(Protocol):
    """Who carries out what readers order."""

    async def start(self, wish: Start) -> Answer: ...
    async def stop(self, wish: Stop) -> Answer: ...
    async def assign(self, wish: Assign) -> Answer: ...
    def mark(self, press: Press) -> None: ...


class Shared:
    """A message made once for all browsers, as text, at most so old as each of them waits for the next."""

    def __init__(self, seconds: float, make: Callable[[], dict[str, Any]]) -> None:
        self._seconds, self._make = seconds, make
        self._text, self._made_s = "", -math.inf

    def __call__(self) -> str:
        """Return the newest."""
        now_s = time.monotonic()
        if now_s - self._made_s > SHARED * self._seconds:
            self._text, self._made_s = as_text(self._make()), now_s
        return self._text


class Page:
    """One study's page. markers: key and name of each; desk: without one the page only shows."""

    def __init__(self, study: Study, markers: list[tuple[str, str]], desk: Desk | None = None) -> None:
        self.study, self.desk, self.log, self.now_ns = study, desk, ProblemLog(), study.clock.now_ns
        self.marker_keys = [{"key": key, "name": name} for key, name in markers]
        self.frames_total = 0
        self.study_text = Shared(STUDY_EVERY_S, lambda: study_message(study, self.log, self.now_ns()))
        self.trend_text = Shared(TREND_EVERY_S, lambda: trend_message(study))

    def tick(self) -> None:
        """Once per second: the strip grows, the problems are looked for."""
        now_ns = self.now_ns()
        self.study.tick(now_ns)
        self.log.update(problems(self.study, now_ns), now_ns)


def as_text(message: dict[str, Any]) -> str:
    """Return a message as JSON, which no number keeps from being sent."""
    try:
        return json.dumps(message, allow_nan=False)
    except ValueError:
        return json.dumps(plain(message), allow_nan=False)
