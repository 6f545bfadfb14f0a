"""One browser's WebSocket: what it asks for, and what it is sent. Knows no ROS.

A browser is never sent more than MOST_UNANSWERED messages beyond what it has acknowledged. What it missed meanwhile is
not kept: the next frame is made from the history, so a slow browser costs no memory and skips, and nobody waits for it.
"""

import asyncio
import time
from typing import Any

from aiohttp import WSCloseCode, WSMsgType, web

from web_gui.frames import encode
from web_gui.logins import Login
from web_gui.messages import Ack, Assign, Ping, Press, Start, Stop, Unfit, parse
from web_gui.page import STUDY_EVERY_S, TREND_EVERY_S, Page, as_text
from web_gui.view import Request, View

FRAMES_PER_S = 30
EMPTY_EVERY_S = 0.5  # a frame without news still tells the page what now is
MOST_UNANSWERED = 4
OLDEST_PRESS_NS = 3_600_000_000_000
FUTURE_NS = 100_000_000  # a press further ahead than this and its uncertainty comes from a wrong clock


class Browser:
    """One browser: its view, what it has ordered, and how much it still has to answer."""

    def __init__(self, page: Page, socket_: web.WebSocketResponse, login: Login) -> None:
        self._page, self._socket, self._login = page, socket_, login
        self._told = login.standing
        self._view: View | None = None
        self._sent = self._answered = 0
        self._framed_at = 0.0
        self._orders: dict[bool, asyncio.Task[None]] = {}
        """The newest to the registry (True) and to the coordinator: a session never waits for a sensor to move."""

    async def serve(self) -> None:
        """Talk to the browser until it leaves, or may see nothing any more; raises what either half raised."""
        await self._hello()
        halves = [asyncio.create_task(self._receive()), asyncio.create_task(self._send())]
        try:
            await asyncio.wait(halves, return_when=asyncio.FIRST_COMPLETED)
        finally:
            tasks = [*halves, *self._orders.values()]
            for task in tasks:
                task.cancel()
            ended = await asyncio.gather(*tasks, return_exceptions=True)
        for result in ended:
            if isinstance(result, Exception) and not isinstance(result, ConnectionError):
                raise result

    async def _hello(self) -> None:
        self._told = self._login.standing
        await self._tell(
            {
                "type": "hello",
                "marker_keys": self._page.marker_keys,
                "role": self._told.role,
                "by_token": self._told.by_token,
                "why_not_operate": self._told.why,
            }
        )

    async def _receive(self) -> None:
        async for message in self._socket:
            wall_ns = time.time_ns()  # first of all: a ping's answer is a time
            if message.type is not WSMsgType.TEXT:
                await self._refuse("only text messages are understood")
                return
            try:
                asked = parse(message.data)
            except Unfit as err:
                await self._answer(err.number, False, str(err))
                continue
            except ValueError as err:
                await self._refuse(str(err))
                return
            match asked:
                case Request():
                    self._view = View(asked)
                case Ack():
                    self._answered = max(self._answered, min(asked.number, self._sent))
                case Ping():
                    await self._tell({"type": "pong", "number": asked.number, "host_ms": wall_ns / 1e6})
                case Press() | Start() | Stop() | Assign() if why := self._login.standing.why:
                    await self._answer(asked.number, False, why)
                case Press():
                    await self._mark(asked, wall_ns)
                case Assign() if asked.fault:
                    await self._answer(asked.number, False, asked.fault)
                case Start() | Stop() | Assign():
                    await self._take_order(asked)

    async def _mark(self, press: Press, wall_ns: int) -> None:
        age_ns = wall_ns - press.at_ns
        if self._page.desk is None:
            await self._answer(press.number, False, "this page only shows")
        elif not -FUTURE_NS - press.uncertainty_s * 1e9 <= age_ns <= OLDEST_PRESS_NS:
            await self._answer(press.number, False, f"the press would be {age_ns / 1e9:.1f} s ago; marker not set")
        else:
            self._page.desk.mark(press)
            await self._answer(press.number, True, "")

    async def _take_order(self, order: Start | Stop | Assign) -> None:
        """Carry it out beside everything else: whoever is asked may take its time, signals go on."""
        whom = isinstance(order, Assign)
        before = self._orders.get(whom)
        if before is not None and not before.done():
            await self._answer(order.number, False, "the order before this one has not been answered yet")
        else:
            self._orders[whom] = asyncio.create_task(self._carry_out(order))

    async def _carry_out(self, order: Start | Stop | Assign) -> None:
        desk = self._page.desk
        if desk is None:
            await self._answer(order.number, False, "this page only shows")
            return
        match order:
            case Start():
                answer = await desk.start(order)
            case Stop():
                answer = await desk.stop(order)
            case Assign():
                answer = await desk.assign(order)
        await self._answer(order.number, answer.ok, answer.text)

    async def _answer(self, number: int, ok: bool, text: str) -> None:
        await self._tell({"type": "answer", "number": number, "ok": ok, "text": text})

    async def _tell(self, message: dict[str, Any]) -> None:
        await self._socket.send_str(as_text(message))

    async def _refuse(self, why: str) -> None:
        await self._tell({"type": "error", "text": why})
        await self._socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"refused")

    async def _send(self) -> None:
        loop = asyncio.get_running_loop()
        study_at = trend_at = 0.0
        try:
            while not self._socket.closed:
                now = loop.time()
                standing = self._login.standing
                if standing.role == "nobody":
                    return
                if standing != self._told:
                    await self._hello()
                if self._sent - self._answered < MOST_UNANSWERED:
                    if now >= study_at:
                        study_at = now + STUDY_EVERY_S
                        await self._socket.send_str(self._page.study_text())
                    if now >= trend_at:
                        trend_at = now + TREND_EVERY_S
                        await self._socket.send_str(self._page.trend_text())
                    await self._send_frame()
                await asyncio.sleep(max(0.001, now + 1 / FRAMES_PER_S - loop.time()))
        except ConnectionError:
            return  # the browser left; _receive ends as well

    async def _send_frame(self) -> None:
        if self._view is None:
            return
        frame = self._view.frame(self._page.study, self._sent + 1, self._page.now_ns())
        now = asyncio.get_running_loop().time()
        if not frame.lanes and now - self._framed_at < EMPTY_EVERY_S:
            return
        self._framed_at = now
        self._sent += 1
        self._page.frames_total += 1
        await self._socket.send_bytes(encode(frame))
