"""Connections to the page: how many there may be, and what strangers on them leave in the log. Knows no ROS."""

import asyncio
import logging
import socket
from collections.abc import Callable, Collection

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.web_protocol import RequestHandler
from sense4hri.access import in_url

MOST_CONNECTIONS = 256
UNREAD_S = 30  # for so long a client may leave unread what it is sent
BROKEN = (HttpProcessingError, web.RequestPayloadError, OSError, EOFError, asyncio.CancelledError)
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
        loop = asyncio.get_running_loop()
        server = await loop.create_server(self._let_in, self._host, self._port, start_serving=False)
        for listening in server.sockets:  # their connections inherit it
            listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 1000 * UNREAD_S)
        await server.start_serving()
        self._server = server

    def _let_in(self) -> RequestHandler:
        server = self._runner.server
        if server is None:
            raise RuntimeError("the page is not being served")
        there = {one: one.transport for one in server.connections if one.transport and not one.transport.is_closing()}
        waiting = [transport for one, transport in there.items() if one not in self._talking]
        for transport in waiting[: max(0, len(there) + 1 - MOST_CONNECTIONS)]:
            transport.abort()  # at once, also where it has not read its answer
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
