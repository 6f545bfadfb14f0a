"""Connections to the page: how many there may be, and what strangers on them leave in the log. Knows no ROS."""

import asyncio
import logging
from collections.abc import Callable, Collection

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.web_protocol import RequestHandler
from sense4hri.access import in_url

MOST_CONNECTIONS = 256
BROKEN = (HttpProcessingError, OSError, EOFError, asyncio.CancelledError)
"""What a client does: it sends no HTTP, or goes away before its answer."""


class Door(web.BaseSite):
    """Lets connections in on one address; where there are too many, the oldest that is no WebSocket makes room.

    talking: the connections that have become a browser's WebSocket.
    """

    def __init__(self, runner: web.AppRunner, host: str, port: int, talking: Collection[RequestHandler]) -> None:
        super().__init__(runner)
        self._host, self._port, self._talking = host, port, talking

    @property
    def name(self) -> str:
        """The address."""
        return f"http://{in_url(self._host)}:{self._port}"

    async def start(self) -> None:
        """Begin to listen. Raises OSError where the address cannot be used."""
        await super().start()
        self._server = await asyncio.get_running_loop().create_server(self._let_in, self._host, self._port)

    def _let_in(self) -> RequestHandler:
        server = self._runner.server
        if server is None:
            raise RuntimeError("the page is not being served")
        if len(server.connections) >= MOST_CONNECTIONS:
            waiting = [one for one in server.connections if one not in self._talking]
            waiting[0].force_close()
        return server()


def quiet_logger(on_broken: Callable[[], None]) -> logging.Logger:
    """Return the log of the HTTP server, in which a client that breaks off is one count and no line."""
    log = logging.Logger("web_gui.http")
    log.addHandler(logging.StreamHandler())

    def wanted(record: logging.LogRecord) -> bool:
        broken = record.exc_info is not None and isinstance(record.exc_info[1], BROKEN)
        if broken:
            on_broken()
        return not broken

    log.addFilter(wanted)
    return log
