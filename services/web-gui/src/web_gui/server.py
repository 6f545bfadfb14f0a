"""HTTP and WebSocket: the page, its files, and one task per browser; `entrance` says who may. Knows no ROS.

A client is never sent more than MOST_UNANSWERED messages beyond what it has acknowledged. What it missed meanwhile is
not kept: the next frame is made from the history, so a slow browser costs no memory and skips, and nobody waits for it.
"""

import asyncio
import json
import math
import os
import time
from collections.abc import Callable
from ipaddress import ip_address
from typing import Any, Protocol

from aiohttp import WSCloseCode, WSMsgType, web
from aiohttp.web_protocol import RequestHandler
from sense4hri.access import Access
from sense4hri.errors import ConfigError
from sense4hri.shapes import plain

from web_gui.config import Config
from web_gui.door import Door, quiet_logger
from web_gui.entrance import Entrance, Standing
from web_gui.frames import encode
from web_gui.messages import Ack, Assign, Ping, Press, Start, Stop, parse
from web_gui.model import Study
from web_gui.page_files import add_headers, page_files
from web_gui.problems import ProblemLog, problems
from web_gui.reports import POLICY, PREFIX, Reports
from web_gui.snapshot import study_message, trend_message
from web_gui.view import Request, View

FRAMES_PER_S = 30
STUDY_EVERY_S, TREND_EVERY_S = 0.5, 2.0
SHARED = 0.5  # share of the time between two messages during which browsers are sent the same one
EMPTY_EVERY_S = 0.5  # a frame without news still tells the page what now is
MOST_UNANSWERED = 4
MOST_CLIENTS = 32
LARGEST_MESSAGE = 64 * 1024
HEARTBEAT_S = 10.0
OLDEST_PRESS_NS = 3_600_000_000_000
FUTURE_NS = 100_000_000  # a press further ahead than this and its uncertainty comes from a wrong clock


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


class Site:
    """The page of one study. desk: without one the page only shows."""

    def __init__(
        self,
        study: Study,
        config: Config,
        desk: Desk | None = None,
        now_ns: Callable[[], int] = time.time_ns,
        access: Access | None = None,
        version: str = "",
    ) -> None:
        self.study, self.desk, self.log = study, desk, ProblemLog()
        self._entrance = Entrance(access or Access(config.host), version)
        self.marker_keys = [{"key": key, "name": name} for key, name in config.markers()]
        self.reports = Reports(config.recordings)
        self.clients = 0
        self.frames_total = 0
        self._now_ns = now_ns
        self._files = page_files()
        self.talking: set[RequestHandler] = set()
        """The connections that are a browser's WebSocket."""
        self._sockets: set[web.WebSocketResponse] = set()
        self.study_text = Shared(STUDY_EVERY_S, lambda: study_message(study, self.log, self._now_ns()))
        self.trend_text = Shared(TREND_EVERY_S, lambda: trend_message(study))

    def application(self) -> web.Application:
        """Return the aiohttp application."""
        app = web.Application(middlewares=[self._entrance.guard], client_max_size=LARGEST_MESSAGE)
        app.router.add_get("/ws", self._socket)
        self._entrance.add_to(app)
        app.router.add_get(PREFIX + "{path:.*}", self._report)
        app.router.add_get("/{path:.*}", self._file)
        app.on_response_prepare.append(add_headers)
        app.on_shutdown.append(self._close)
        return app

    def tick(self) -> None:
        """Once per second: the strip grows, the problems are looked for."""
        now_ns = self._now_ns()
        self.study.tick(now_ns)
        self.log.update(problems(self.study, now_ns), now_ns)

    async def look_for_report(self) -> None:
        """See whether the newest report can be served; the disk is asked in another thread."""
        session = self.study.session
        session.report = await asyncio.to_thread(self.reports.address, session.report_path)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        path = request.match_info["path"] or "index.html"
        if path not in self._files:
            raise web.HTTPNotFound(text="there is no such page\n")
        return web.Response(body=self._files[path].content, content_type=self._files[path].kind, charset="utf-8")

    async def _report(self, request: web.Request) -> web.StreamResponse:
        try:
            body = await asyncio.to_thread(self.reports.read, request.match_info["path"])
        except (OSError, ValueError):
            raise web.HTTPNotFound(text="there is no such report\n") from None
        policy = {"Content-Security-Policy": POLICY}
        return web.Response(body=body, content_type="text/html", charset="utf-8", headers=policy)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if self.clients >= MOST_CLIENTS:
            raise web.HTTPTooManyRequests(text=f"{MOST_CLIENTS} browsers show this page already; close one of them\n")
        socket_ = web.WebSocketResponse(max_msg_size=LARGEST_MESSAGE, heartbeat=HEARTBEAT_S, compress=False)
        if not socket_.can_prepare(request).ok:
            raise web.HTTPBadRequest(text="/ws is a WebSocket\n")
        await socket_.prepare(request)
        self.clients += 1
        self._sockets.add(socket_)
        self.talking.add(request.protocol)
        try:
            await _Client(self, socket_, self._entrance.standing(request)).serve()
        finally:
            self.talking.discard(request.protocol)
            self._sockets.discard(socket_)
            self.clients -= 1
        return socket_

    async def _close(self, app: web.Application) -> None:
        for socket_ in list(self._sockets):
            await socket_.close(code=WSCloseCode.GOING_AWAY, message=b"the server stops")

    def now_ns(self) -> int:
        """Return the wall clock."""
        return self._now_ns()


class _Client:
    """One browser: its view, what it has ordered, and how much it still has to answer."""

    def __init__(self, site: Site, socket_: web.WebSocketResponse, standing: Standing) -> None:
        self._site, self._socket, self._standing = site, socket_, standing
        self._view: View | None = None
        self._sent = self._answered = 0
        self._framed_at = 0.0
        self._orders: dict[bool, asyncio.Task[None]] = {}
        """The newest to the registry (True) and to the coordinator: a session never waits for a sensor to move."""

    async def serve(self) -> None:
        """Talk to the browser until it leaves; raises what either half raised."""
        await self._tell(
            {"type": "hello", "marker_keys": self._site.marker_keys, "why_not_operate": self._standing.why}
        )
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

    async def _receive(self) -> None:
        async for message in self._socket:
            now_ns = self._site.now_ns()  # first of all: a ping's answer is a time
            if message.type is not WSMsgType.TEXT:
                await self._refuse("only text messages are understood")
                return
            try:
                asked = parse(message.data)
            except ValueError as err:
                await self._refuse(str(err))
                return
            match asked:
                case Request():
                    self._view = View(asked)
                case Ack():
                    self._answered = max(self._answered, min(asked.number, self._sent))
                case Ping():
                    await self._tell({"type": "pong", "number": asked.number, "host_ms": now_ns / 1e6})
                case Press() | Start() | Stop() | Assign() if self._standing.why:
                    await self._answer(asked.number, False, self._standing.why)
                case Press():
                    await self._mark(asked, now_ns)
                case Assign() if asked.fault:
                    await self._answer(asked.number, False, asked.fault)
                case Start() | Stop() | Assign():
                    await self._take_order(asked)

    async def _mark(self, press: Press, now_ns: int) -> None:
        age_ns = now_ns - press.at_ns
        if self._site.desk is None:
            await self._answer(press.number, False, "this page only shows")
        elif not -FUTURE_NS - press.uncertainty_s * 1e9 <= age_ns <= OLDEST_PRESS_NS:
            await self._answer(press.number, False, f"the press would be {age_ns / 1e9:.1f} s ago; marker not set")
        else:
            self._site.desk.mark(press)
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
        desk = self._site.desk
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
                if self._sent - self._answered < MOST_UNANSWERED:
                    if now >= study_at:
                        study_at = now + STUDY_EVERY_S
                        await self._socket.send_str(self._site.study_text())
                    if now >= trend_at:
                        trend_at = now + TREND_EVERY_S
                        await self._socket.send_str(self._site.trend_text())
                    await self._send_frame()
                await asyncio.sleep(max(0.001, now + 1 / FRAMES_PER_S - loop.time()))
        except ConnectionError:
            return  # the browser left; _receive ends as well

    async def _send_frame(self) -> None:
        if self._view is None:
            return
        frame = self._view.frame(self._site.study, self._sent + 1, self._site.now_ns())
        now = asyncio.get_running_loop().time()
        if not frame.lanes and now - self._framed_at < EMPTY_EVERY_S:
            return
        self._framed_at = now
        self._sent += 1
        self._site.frames_total += 1
        await self._socket.send_bytes(encode(frame))


async def serve(site: Site, config: Config, on_broken: Callable[[], None] = lambda: None) -> tuple[web.AppRunner, int]:
    """Start to serve; return the runner and the port. Raises ConfigError where the address cannot be used.

    on_broken: called for each client that goes away before its answer, or sends no HTTP.
    """
    log = quiet_logger(on_broken)
    runner = web.AppRunner(site.application(), access_log=None, shutdown_timeout=1.0, logger=log)
    await runner.setup()
    try:
        await Door(runner, config.host, config.port, site.talking).start()
    except OSError as err:
        await runner.cleanup()
        raise ConfigError(f"port {config.port} on host {config.host!r} cannot be used: {_why(err)}") from err
    return runner, int(runner.addresses[0][1])


def as_text(message: dict[str, Any]) -> str:
    """Return a message as JSON, which no number keeps from being sent."""
    try:
        return json.dumps(message, allow_nan=False)
    except ValueError:
        return json.dumps(plain(message), allow_nan=False)


def page_address(host: str, port: int) -> str:
    """Return the address to open in a browser on this machine."""
    shown = "127.0.0.1" if host in ("0.0.0.0", "::") else host
    try:
        shown = f"[{shown}]" if ip_address(shown).version == 6 else shown
    except ValueError:
        pass
    return f"http://{shown}:{port}"


def _why(err: OSError) -> str:
    """Return the system's words for an error, without aiohttp's around them."""
    return os.strerror(err.errno) if err.errno and err.errno > 0 else str(err)
