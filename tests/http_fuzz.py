"""What strangers send to an HTTP port: malformed requests, hostile bodies, broken connections, pages of other sites."""

import json
import os
import random
import re
import socket
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from processes import poll

PATIENCE_S = 20.0
"""With an answer; a service that gives none within this time counts as dead."""
MOMENT_S = 0.2
"""Until half a request is given up; a whole one is answered, be it late."""
BROKEN = 0.15
"""Share of requests whose sender goes away, politely or not, before or in the middle of the answer."""
HUGE = "9" * 400
DEEP = "[" * 500 + "]" * 500, '{"a":' * 500 + "1" + "}" * 500
NUMBERS = [
    "0",
    "-1",
    "1",
    "2.5",
    "1e308",
    "1e999",
    "-1e999",
    "NaN",
    "Infinity",
    HUGE,
    f"-{HUGE}",
    "9223372036854775808",
]
TEXTS = [
    '""',
    '"p1"',
    '"\\ud800"',
    '"\\u0000"',
    '"../../etc/passwd"',
    '"/*/**/' + "*" * 200 + 'X/**"',
    '"' + "x" * 10_000 + '"',
]
VALUES = [*NUMBERS, *TEXTS, *DEEP, "null", "true", "[]", "{}", '[1,"a",null,{}]', '["/study/*","**"]', '{"a":1,"a":2}']
BODIES = ["", "null", "[]", "{", "\xff", "[" * 100_000, '{"a":' * 100_000, HUGE, '{"":{}}', '{"a":1,"a":1}', '"text"']
LENGTHS = ["-1", "5, 6", HUGE, "abc", "99"]
HEADERS = [
    *(f"Content-Length: {length}" for length in LENGTHS),
    *("Origin: http://evil.example", "Origin: null", "Host: evil.example", "Cookie: sense4hri_token=\xff;;="),
    *("Authorization: Bearer " + "a" * 600, "Authorization: Basic \xff", "X: " + "y" * 5000, ": nameless", "a b: c"),
    *("Transfer-Encoding: chunked", "Expect: 100-continue", "Upgrade: websocket", "Connection: upgrade"),
]
PATHS = [
    "/",
    "/metrics",
    "/healthz",
    "/readyz",
    "/openapi.json",
    "/nowhere",
    "//",
    "/../etc/passwd",
    "/%00",
    "/%ff",
    "*",
]
METHODS = ["GET", "HEAD", "PUT", "DELETE", "OPTIONS", "TRACE", "G\x00T", "POST", ""]
FORMS = ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=a", ""]
FOREIGN = ["Origin: http://evil.example", "Origin: null", "Host: evil.example"]
UPGRADE = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {}"


def told(port: int, path: str) -> tuple[int, bytes]:
    """Status and body of an ordinary GET; 0 where nothing comes."""
    request = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
    answer = exchange(port, request.encode())
    return status_of(answer), answer.partition(b"\r\n\r\n")[2]


def described(port: int) -> dict[str, Any]:
    """What the service says of its routes, as soon as the machine lets it."""
    return json.loads(poll(lambda: _ok(told(port, "/openapi.json")), "the routes are told"))


def _ok(answer: tuple[int, bytes]) -> bytes:
    status, body = answer
    assert status in (0, 200), body
    return body


def assail(port: int, count: int, seed: int, alive: Callable[[], bool] = lambda: True) -> Counter[int]:
    """Send so many requests, each over a connection of its own; count the statuses, 0 where none was waited for.

    Raises AssertionError with the request after which the service was not alive.
    """
    chance, statuses = random.Random(seed), Counter()
    for request in requests(described(port), chance, count):
        broken = chance.random() < BROKEN
        answer = exchange(port, request, chance if broken else None)
        statuses[status_of(answer)] += 1
        assert alive(), f"ended after {request[:300]!r}"
    return statuses


def requests(openapi: dict[str, Any], chance: random.Random, count: int) -> Iterator[bytes]:
    """Requests that no program of the study sends."""
    routes = [(method.upper(), path) for path, methods in openapi["paths"].items() for method in methods]
    for _ in range(count):
        kind = chance.random()
        if kind < 0.1:
            yield os.urandom(chance.randrange(1, 400)) + b"\r\n\r\n"
        elif kind < 0.3:
            paths = PATHS + [path for _, path in routes]
            yield written(
                chance.choice(METHODS), chance.choice(paths), chance.choices(HEADERS, k=chance.randrange(4)), "", chance
            )
        else:
            method, path = chance.choice(routes)
            path = re.sub(r"{\w+}", lambda _: chance.choice(["x", "%00", "..", "a" * 200, "%ff"]), path)
            headers = ["Content-Type: application/json", *chance.choices(HEADERS, k=chance.random() < 0.2)]
            yield written(method, path, headers, body_for(openapi, method, path, chance), chance)


def body_for(openapi: dict[str, Any], method: str, path: str, chance: random.Random) -> str:
    """A body for a route: its fields with values that do not belong there, or no such thing at all."""
    if method != "POST" or chance.random() < 0.2:
        return chance.choice(BODIES)
    operation = openapi["paths"].get(path, {}).get("post", {})
    fields = _fields(openapi, operation)
    chosen = [name for name in fields if chance.random() < 0.7] or fields
    return "{" + ",".join(f"{json.dumps(name)}:{chance.choice(VALUES)}" for name in chosen) + "}"


def _fields(openapi: dict[str, Any], operation: dict[str, Any]) -> list[str]:
    content = operation.get("requestBody", {}).get("content", {})
    reference = content.get("application/json", {}).get("schema", {}).get("$ref", "")
    shape = openapi["components"]["schemas"].get(reference.rpartition("/")[2], {})
    return [*shape.get("properties", {}), "nobody_asked_for_this"][: len(shape.get("properties", {})) or 1]


def written(method: str, path: str, headers: list[str], body: str, chance: random.Random) -> bytes:
    """One request as it goes over the wire, now and then with a line's end or a byte that does not belong."""
    content = body.encode("latin-1", "replace") if chance.random() < 0.1 else body.encode(errors="surrogatepass")
    own = [] if any(header.startswith("Content-Length") for header in headers) else [f"Content-Length: {len(content)}"]
    host = [] if any(header.startswith("Host") for header in headers) else ["Host: 127.0.0.1"]
    head = "\r\n".join([f"{method} {path} HTTP/1.1", *host, "Connection: close", *own, *headers]) + "\r\n\r\n"
    return head.encode("latin-1", "replace") + content


def foreign_posts(openapi: dict[str, Any]) -> Iterator[tuple[str, bytes]]:
    """What a page of the web can have a browser send: to every POST route a form, or JSON with a foreign name."""
    for path, methods in openapi["paths"].items():
        if "post" not in methods:
            continue
        for form in FORMS:
            yield f"{path} as {form!r}", _post(path, f"Content-Type: {form}")
        for header in FOREIGN:
            yield f"{path} with {header}", _post(path, f"Content-Type: application/json\r\n{header}")


def _post(path: str, headers: str) -> bytes:
    host = "" if "Host:" in headers else "Host: 127.0.0.1\r\n"
    return f"POST {path} HTTP/1.1\r\n{host}{headers}\r\nContent-Length: 2\r\nConnection: close\r\n\r\n{{}}".encode()


def exchange(port: int, request: bytes, breaks: random.Random | None = None) -> bytes:
    """Send a request, return all that comes back; with breaks the sender goes away somewhere in between.

    A service that waits for the rest of half a request is told after a moment that no more comes.
    """
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection:
        try:
            if breaks is None:
                connection.sendall(request)
                return _all_of(connection, PATIENCE_S / 2 if _whole(request) else MOMENT_S)
            connection.sendall(request[: breaks.randrange(1, len(request) + 1)])
            if breaks.random() < 0.7:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # ends with a reset
        except ConnectionError:
            pass
    return b""


def _whole(request: bytes) -> bool:
    """True where nothing of a request is still to come, as far as anybody could tell."""
    head, end, body = request.partition(b"\r\n\r\n")
    lengths = re.findall(rb"(?i)content-length:(.*)", head) or [b"0"]
    return bool(end) and b"Transfer-Encoding" not in head and lengths[0].strip() == b"%d" % len(body)


def _all_of(connection: socket.socket, moment_s: float) -> bytes:
    parts = []
    connection.settimeout(moment_s)
    try:
        while part := _part_of(connection):
            parts.append(part)
    except ConnectionError:
        pass
    return b"".join(parts)


def _part_of(connection: socket.socket) -> bytes:
    try:
        return connection.recv(1 << 16)
    except TimeoutError:
        connection.settimeout(PATIENCE_S)
        connection.shutdown(socket.SHUT_WR)
        return connection.recv(1 << 16)


def status_of(answer: bytes) -> int:
    """The status in an answer, 0 where there is none."""
    found = re.match(rb"HTTP/1\.[01] (\d{3}) ", answer)
    return int(found.group(1)) if found else 0


@contextmanager
def slow_connections(port: int, count: int) -> Iterator[list[socket.socket]]:
    """So many connections that have sent half a request and say no more."""
    with ExitStack() as stack:
        found = []
        for number in range(count):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S))
            one.sendall(b"POST /start HTTP/1.1\r\nHost: 127.0.0.1\r\nX: y"[: 5 + number % 40])
            found.append(one)
        yield found


def browser(port: int) -> tuple[int, socket.socket]:
    """The status that a browser's WebSocket is answered with (101: it may talk), and its connection."""
    connection = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
    connection.sendall(f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\n{UPGRADE.format('A' * 22 + '==')}\r\n\r\n".encode())
    return status_of(connection.recv(1000)), connection


def talk(port: int, count: int, seed: int, alive: Callable[[], bool] = lambda: True) -> None:
    """Have so many WebSockets say what no page says: broken frames, hostile messages, and then be gone."""
    chance = random.Random(seed)
    for _ in range(count):
        status, connection = browser(port)
        with connection:
            assert status == 101, "a WebSocket was refused"
            try:
                connection.sendall(b"".join(_frame(chance) for _ in range(chance.randrange(1, 5))))
            except ConnectionError:
                pass  # it was closed already, as it should be
            if chance.random() < 0.5:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        assert alive()


def _frame(chance: random.Random) -> bytes:
    if chance.random() < 0.3:
        return os.urandom(chance.randrange(1, 300))
    kind = chance.choice(["view", "ack", "ping", "start", "stop", "marker", "assign", "x"])
    names = [
        "view",
        "columns",
        "window_s",
        "lanes",
        "end_ms",
        "number",
        "study",
        "human_ids",
        "at_ms",
        "uncertainty_ms",
    ]
    fields = "".join(f',"{name}":{chance.choice(VALUES)}' for name in chance.sample(names, 5))
    text = f'{{"type":"{kind}"{fields}}}'.encode()
    length = bytes([0xFE]) + struct.pack(">H", len(text)) if len(text) > 125 else bytes([0x80 | len(text)])
    return b"\x81" + length + bytes(4) + text
