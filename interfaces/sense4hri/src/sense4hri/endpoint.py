"""The one HTTP port of a service: `/metrics`, `/healthz`, `/readyz` and what the service adds (JSON)."""

import errno
import json
import os
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from sense4hri.errors import ConfigError
from sense4hri.metrics import Metrics

FIRST_PORT, PORTS = 9464, 200
LARGEST_BODY = 1 << 20
Handler = Callable[[str, bytes], tuple[int, Any]]


class HttpEndpoint:
    """Serves until closed, on `METRICS_HOST` (loopback unless told otherwise) and `METRICS_PORT`.

    Without `METRICS_PORT` the first free port from 9464 on is taken. `run_on_main` carries a handler of the service
    to the thread in which the service lives.
    """

    def __init__(self, metrics: Metrics, run_on_main: Callable[[Callable[[], Any]], Any]) -> None:
        self.ready = False
        self._metrics, self._run_on_main = metrics, run_on_main
        self._routes: list[tuple[str, str, Handler]] = []
        self._server = _bind(self._request_handler())
        self.port = int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, name="http", daemon=True).start()

    def route(self, method: str, path: str, handler: Handler) -> None:
        """Let handler(path, body) -> (status, JSON) answer `path` and, where it ends in `/`, all below it.

        A ValueError from the handler is the client's mistake: status 400 with its text.
        """
        self._routes.append((method, path, handler))

    def close(self) -> None:
        """Stop serving and free the port."""
        self._server.shutdown()
        self._server.server_close()

    def answer(self, method: str, path: str, body: bytes) -> tuple[int, str, bytes]:
        """Return (status, content type, body) of one request."""
        if method == "GET" and path == "/metrics":
            return 200, "text/plain; version=0.0.4; charset=utf-8", self._metrics.text()
        if method == "GET" and path == "/healthz":
            return 200, "text/plain", b"ok\n"
        if method == "GET" and path == "/readyz":
            return (200, "text/plain", b"ready\n") if self.ready else (503, "text/plain", b"not ready\n")
        matching = [(m, h) for m, p, h in self._routes if path == p or (p.endswith("/") and path.startswith(p))]
        if not matching:
            return _json(404, {"error": f"nothing is served at {path}"})
        for known, handler in matching:
            if known == method:
                return self._handled(handler, path, body)
        return _json(405, {"error": f"{path} answers {', '.join(m for m, _ in matching)}, not {method}"})

    def _handled(self, handler: Handler, path: str, body: bytes) -> tuple[int, str, bytes]:
        try:
            return _json(*self._run_on_main(lambda: handler(path, body)))
        except ValueError as err:
            return _json(400, {"error": str(err)})
        except TimeoutError:
            return _json(503, {"error": "the service did not answer in time"})

    def _request_handler(self) -> type[BaseHTTPRequestHandler]:
        endpoint = self

        class RequestHandler(BaseHTTPRequestHandler):
            timeout = 10

            def _serve(self) -> None:
                length = self.headers.get("Content-Length") or "0"
                if not length.isdecimal() or int(length) > LARGEST_BODY:
                    answer = _json(400, {"error": f"Content-Length {length!r}: at most {LARGEST_BODY}"})
                else:
                    path = self.path.split("?", 1)[0]
                    answer = endpoint.answer(self.command, path, self.rfile.read(int(length)))
                status, kind, body = answer
                self.send_response(status)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            do_GET = do_POST = do_PUT = do_DELETE = _serve  # noqa: N815

            def log_message(self, *args: object) -> None:
                """Keep probes out of the log."""

        return RequestHandler


def parse_json(body: bytes) -> dict[str, Any]:
    """Return a request's JSON object. Raises ValueError, which becomes status 400, for anything else."""
    try:
        value = json.loads(body)
    except ValueError as err:
        raise ValueError(f"the body is not JSON: {err}") from err
    if not isinstance(value, dict):
        raise ValueError("the body must be a JSON object")
    return value


def _json(status: int, value: Any) -> tuple[int, str, bytes]:
    return status, "application/json", json.dumps(value).encode() + b"\n"


def _bind(handler: type[BaseHTTPRequestHandler]) -> ThreadingHTTPServer:
    host, wanted = os.environ.get("METRICS_HOST", "127.0.0.1"), os.environ.get("METRICS_PORT", "")
    if wanted and not (wanted.isdecimal() and int(wanted) < 65536):
        raise ConfigError(f"METRICS_PORT is {wanted!r}, must be a port number")
    for port in [int(wanted)] if wanted else range(FIRST_PORT, FIRST_PORT + PORTS):
        try:
            return _Server((host, port), handler)
        except OSError as err:
            if err.errno != errno.EADDRINUSE:
                raise ConfigError(f"METRICS_PORT {port} on {host} cannot be used: {err.strerror}") from err
    raise ConfigError(f"METRICS_PORT {wanted or f'{FIRST_PORT}..{FIRST_PORT + PORTS - 1}'} is taken")


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that went away before its answer, as probes do, is no error of the service."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)
