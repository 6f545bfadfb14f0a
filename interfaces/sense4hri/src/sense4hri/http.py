"""The one HTTP port of a service: `/metrics`, `/healthz`, `/readyz`, `/openapi.json`, and the service's own routes.

What a body must be is said by a dataclass, who may ask by `sense4hri.access`. A refusal is a 4xx status with
`{"error": "one sentence", "field": "name or empty"}`.
"""

import errno
import inspect
import json
import os
import socket
import sys
import threading
from collections.abc import Callable, Coroutine, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple

from prometheus_client import Counter

from sense4hri.access import Access, Asked, Role
from sense4hri.errors import ConfigError, Refusal
from sense4hri.guesses import Guesses
from sense4hri.metrics import Metrics
from sense4hri.routes import Route, Routes, WrongMethod
from sense4hri.shapes import plain

FIRST_PORT, PORTS = 9464, 200
LARGEST_BODY, LARGEST_DRAINED = 1 << 20, 1 << 24
MOST_CONNECTIONS = 64
PATIENCE_S = 10  # with a client that says nothing
SET_UP_S = 5.0  # for so long a request waits for the routes
LONGEST_FIELD = 80
NOT_OURS = {501: 405, 505: 400}  # what http.server says to a method or version it does not know is the client's mistake
OPEN = ("/metrics", "/healthz", "/readyz")


class Answer(NamedTuple):
    """What one request is answered with."""

    status: int
    content_type: str
    body: bytes
    allow: str = ""
    """Of a 405: the methods that are answered."""


class Http:
    """Serves from `serve` to `close`, on `METRICS_HOST` (loopback unless told otherwise) and `METRICS_PORT`.

    Without `METRICS_PORT` the first free port from 9464 on is taken. run_on_main: carries a handler of the service to
    the thread in which the service lives. silent: the threads of it that do not answer. missing: what the service
    still lacks to do its work. warn: says once what keeps everybody from changing anything.
    """

    def __init__(
        self,
        service: str,
        version: str,
        metrics: Metrics,
        run_on_main: Callable[[Callable[[], Any]], Any],
        *,
        silent: Callable[[], Sequence[str]],
        missing: Callable[[], Sequence[str]],
        warn: Callable[[str], None],
    ) -> None:
        self._service, self._version, self._metrics, self._run_on_main = service, version, metrics, run_on_main
        self._silent, self._missing, self._warn = silent, missing, warn
        self._routes, self._all_served = Routes(), threading.Event()
        self.held = False
        self._warned = False
        self.get("/openapi.json", self._described, dict[str, Any])
        host = os.environ.get("METRICS_HOST", "127.0.0.1")
        self._access = Access.from_environment(host)
        self._guesses = Guesses(self._access)
        self._server = _bind(host, self._request_handler(), broken_connections(metrics).inc)
        self.port = int(self._server.server_address[1])

    def get(self, path: str, handler: Callable[..., Any], answers: Any) -> None:
        """Let handler(**parameters of the path) answer whoever may view."""
        self._routes.add(Route("GET", path, Role.VIEW, handler, None, answers))

    def post(self, path: str, handler: Callable[..., Any], takes: Any, answers: Any) -> None:
        """Let handler(body as `takes`, **parameters of the path) change something for whoever may operate.

        The handler may be a coroutine.

        takes None: nothing is taken, nothing handed over. A Refusal or other ValueError is the client's mistake.
        """
        self._routes.add(Route("POST", path, Role.OPERATE, handler, takes, answers))
        if not self._warned and (notice := self._access.notice()):
            self._warn(notice)
        self._warned = True

    def hold(self) -> None:
        """Let requests wait on: the service needs seconds to have its routes, and then calls `all_served` itself."""
        self.held = True

    def all_served(self) -> None:
        """Answer on the routes: all of them are there by now. Until then requests wait, but for probes."""
        self._all_served.set()

    def serve(self) -> None:
        """Answer requests until closed, on a thread of its own; before, they wait."""
        self._server.serve_forever()

    def close(self) -> None:
        """Stop serving and free the port."""
        self._server.shutdown()
        self._server.server_close()

    def answer(self, method: str, path: str, asked: Asked, body: bytes, source: str) -> Answer:
        """Return what a request from this address is answered."""
        try:
            if path in OPEN:
                return self._open(method, path)
            if (denied := self._guesses.denied(source, asked.tokens)) is not None:
                return refusal(*denied)
            return self._guarded(method, path, asked, body)
        except WrongMethod as err:
            return refusal(err.status, str(err))._replace(allow=err.allow)
        except Refusal as err:
            return refusal(err.status, str(err), err.field)
        except TimeoutError:
            return refusal(503, "the service did not answer in time")
        except ValueError as err:
            return refusal(400, str(err))

    def _open(self, method: str, path: str) -> Answer:
        """Answer a probe or Prometheus: whoever reaches the port."""
        if method != "GET":
            raise WrongMethod(method, ("GET",))
        if path == "/metrics":
            return Answer(200, "text/plain; version=0.0.4; charset=utf-8", self._metrics.text())
        silent = ["no answer from: " + ", ".join(names)] if (names := self._silent()) else []
        if path == "/healthz":
            return _text(503, silent[0]) if silent else _text(200, "ok")
        missing = [*silent, *self._missing()]
        return _text(503, "not ready: " + "; ".join(missing)) if missing else _text(200, "ready")

    def _guarded(self, method: str, path: str, asked: Asked, body: bytes) -> Answer:
        """Answer on a route whoever may ask it; another site's page does not even learn which there are."""
        if (stranger := self._access.stranger(asked)) is not None:
            return refusal(*stranger)
        if not self._all_served.wait(SET_UP_S):
            return refusal(503, "the service is still being set up: ask again")
        route, parameters = self._routes.find(method, path)
        if (denied := self._access.decide(route.role, asked)) is not None:
            return refusal(*denied)
        given = route.arguments(body)
        answer = self._run_on_main(lambda: _plain(route.handler(*given, **parameters)))
        return Answer(200, "application/json", json.dumps(answer, allow_nan=False).encode() + b"\n")

    def _described(self) -> dict[str, Any]:
        """This description, OpenAPI 3.1."""
        return self._routes.openapi(self._service, self._version)

    def _request_handler(self) -> type["_RequestHandler"]:
        http = self

        class RequestHandler(_RequestHandler):
            def answer(self, method: str, path: str, asked: Asked, body: bytes) -> Answer:
                return http.answer(method, path, asked, body, str(self.client_address[0]))

        return RequestHandler


class _RequestHandler(BaseHTTPRequestHandler):
    """HTTP/1.0 of one connection: reads a request, sends what `answer` says, all refusals in one form."""

    timeout = PATIENCE_S

    def answer(self, method: str, path: str, asked: Asked, body: bytes) -> Answer:
        """Return the answer to a request."""
        raise NotImplementedError

    def _serve(self) -> None:
        method = "GET" if self.command == "HEAD" else self.command
        said = self.headers.get("Content-Length") or "0"
        length = int(said.lstrip("0")[:20] or "0") if said.isdecimal() else -1  # however many digits it has
        if self.headers.get("Transfer-Encoding"):
            answer = refusal(411, "a body must come with its Content-Length")
        elif length < 0:
            answer = refusal(400, "Content-Length is no number")
        elif length > LARGEST_BODY:
            self._drain(min(length, LARGEST_DRAINED))
            answer = refusal(413, f"the body is longer than {LARGEST_BODY} bytes")
        else:
            body = self.rfile.read(length)
            if len(body) < length:
                raise ConnectionAbortedError("the client has gone before the end of its request")
            answer = self.answer(method, self.path.partition("?")[0], Asked.by(self.headers), body)
        self._send(answer)

    do_GET = do_HEAD = do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = _serve  # noqa: N815

    def _send(self, answer: Answer) -> None:
        self.send_response(answer.status)
        self.send_header("Content-Type", answer.content_type)
        self.send_header("Content-Length", str(len(answer.body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        if answer.allow:
            self.send_header("Allow", answer.allow)
        if answer.status == 401:
            self.send_header("WWW-Authenticate", "Bearer")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(answer.body)

    def _drain(self, length: int) -> None:
        """Read away a body nobody wants, so that its sender comes to read the answer."""
        while length > 0 and (part := self.rfile.read(min(length, 1 << 16))):
            length -= len(part)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer what is no HTTP request at all in the form of all refusals."""
        self.close_connection = True
        status = NOT_OURS.get(int(code), int(code))
        self._send(refusal(status, f"the request cannot be understood: {message or 'malformed'}"))

    def version_string(self) -> str:
        """Say nothing of the interpreter's version."""
        return "sense4hri"

    def log_message(self, *args: object) -> None:
        """Keep probes, and whatever else stands in a request, out of the log."""


class _Server(ThreadingHTTPServer):
    """A thread per connection, MOST_CONNECTIONS at once: the oldest makes room for the newest."""

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, address: tuple[str, int], handler: type[_RequestHandler], on_broken: Callable[[], None]) -> None:
        self.on_broken = on_broken
        self._lock = threading.Lock()
        self._connections: dict[socket.socket, None] = {}  # oldest first
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin a connection; where there are too many, end the oldest: an answer takes moments."""
        with self._lock:
            if len(self._connections) >= MOST_CONNECTIONS:
                oldest = next(iter(self._connections))
                del self._connections[oldest]
                _hang_up(oldest)
            self._connections[request] = None
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """End a connection."""
        with self._lock:
            self._connections.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Count a client that went away before its answer, as probes do: no error of the service."""
        if isinstance(sys.exception(), OSError):
            self.on_broken()
        else:
            super().handle_error(request, client_address)


def broken_connections(metrics: Metrics) -> Counter:
    """Return the one count of clients that left in the middle of a request or its answer, or sent no HTTP."""
    return metrics.counter("broken_connections", "Clients that left before their answer, or sent no HTTP.")


def refusal(status: int, error: str, field: str = "") -> Answer:
    """Return the one form of every refusal."""
    told = {"error": error, "field": field[:LONGEST_FIELD]}
    return Answer(status, "application/json", json.dumps(told).encode() + b"\n")


def _plain(answer: Any) -> Any:
    """Return an answer as JSON can carry it; of a coroutine, one that returns it so."""
    return _plain_later(answer) if inspect.iscoroutine(answer) else plain(answer)


async def _plain_later(answer: Coroutine[Any, Any, Any]) -> Any:
    return plain(await answer)


def _text(status: int, text: str) -> Answer:
    return Answer(status, "text/plain; charset=utf-8", text.encode() + b"\n")


def _hang_up(connection: socket.socket) -> None:
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        return  # it has ended by itself


def _bind(host: str, handler: type[_RequestHandler], on_broken: Callable[[], None]) -> _Server:
    wanted = os.environ.get("METRICS_PORT", "")
    if wanted and not (wanted.isdecimal() and int(wanted) < 65536):
        raise ConfigError(f"METRICS_PORT is {wanted!r}, must be a port number")
    for port in [int(wanted)] if wanted else range(FIRST_PORT, FIRST_PORT + PORTS):
        try:
            return _Server((host, port), handler, on_broken)
        except OSError as err:
            if err.errno != errno.EADDRINUSE:
                raise ConfigError(f"METRICS_PORT {port} on {host} cannot be used: {err.strerror}") from err
    raise ConfigError(f"METRICS_PORT {wanted or f'{FIRST_PORT}..{FIRST_PORT + PORTS - 1}'} is taken")
