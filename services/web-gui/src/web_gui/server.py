"""HTTP: the page, its files, its reports, and one task per browser; `entrance` says who may. Knows no ROS."""

import asyncio
import os
from collections.abc import Callable

from aiohttp import WSCloseCode, web
from aiohttp.web_protocol import RequestHandler
from sense4hri.access import Access, in_url
from sense4hri.errors import ConfigError

from web_gui.browser import Browser
from web_gui.config import Config
from web_gui.door import Door, quiet_logger
from web_gui.entrance import Entrance
from web_gui.model import Study
from web_gui.page import Desk, Page
from web_gui.page_files import add_headers, page_files
from web_gui.reports import POLICY, PREFIX, Reports

MOST_CLIENTS = 32
LARGEST_MESSAGE = 64 * 1024
HEARTBEAT_S = 10.0


class Site:
    """Where the page of one study is served. desk: without one the page only shows."""

    def __init__(
        self,
        study: Study,
        config: Config,
        desk: Desk | None = None,
        access: Access | None = None,
        version: str = "",
    ) -> None:
        self.page = Page(study, config.markers(), desk)
        self._entrance = Entrance(access or Access(config.host), version)
        self.reports = Reports(config.recordings)
        self.clients = 0
        self._files = page_files()
        self.talking: set[RequestHandler] = set()
        """The connections that are a browser's WebSocket."""
        self._sockets: set[web.WebSocketResponse] = set()

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

    async def look_for_report(self) -> None:
        """See whether the newest report can be served; the disk is asked in another thread."""
        session = self.page.study.session
        session.report = await asyncio.to_thread(self.reports.address, session.report_path)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        path = request.match_info["path"] or "index.html"
        if path not in self._files:
            raise web.HTTPNotFound(text="there is no such page\n")
        return web.Response(body=self._files[path].content, content_type=self._files[path].kind, charset="utf-8")

    async def _report(self, request: web.Request) -> web.StreamResponse:
        try:
            file = await asyncio.to_thread(self.reports.open, request.match_info["path"])
        except (OSError, ValueError):
            raise web.HTTPNotFound(text="there is no such report\n") from None
        policy = {"Content-Security-Policy": POLICY}
        with file:
            answer = web.Response(body=file, content_type="text/html", charset="utf-8", headers=policy)
            await answer.prepare(request)
            await answer.write_eof()  # reads it as it is sent, however slowly
        return answer

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
            await Browser(self.page, socket_, self._entrance.login(request)).serve()
        finally:
            self.talking.discard(request.protocol)
            self._sockets.discard(socket_)
            self.clients -= 1
        return socket_

    async def _close(self, app: web.Application) -> None:
        for socket_ in list(self._sockets):
            await socket_.close(code=WSCloseCode.GOING_AWAY, message=b"the server stops")


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


def page_address(host: str, port: int) -> str:
    """Return the address to open in a browser on this machine."""
    shown = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # on :: nobody listens to IPv4
    return f"http://{in_url(shown)}:{port}"


def _why(err: OSError) -> str:
    """Return the system's words for an error, without aiohttp's around them."""
    return os.strerror(err.errno) if err.errno and err.errno > 0 else str(err)
