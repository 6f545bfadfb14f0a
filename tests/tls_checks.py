"""What must hold of the page over HTTPS, wherever it runs."""

import http.client
import json
import socket
import ssl
from pathlib import Path

KEY = "A" * 22 + "=="
UPGRADE = f"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {KEY}"


def holds(port: int, ca: Path, token: str) -> None:
    """Fail where the page of 127.0.0.1 at this port, certified by this CA, is not as docs/tls.md says."""
    believed = ssl.create_default_context(cafile=str(ca))
    assert _get(port, believed)[0] == 200
    _not_believed_by_others(port)
    cookie = _cookie(port, believed, token)
    assert {"Secure", "HttpOnly", "SameSite=Strict"} <= {part.strip() for part in cookie.split(";")[1:]}
    own, value = f"https://127.0.0.1:{port}", cookie.partition(";")[0]
    assert _upgrade(port, believed, own, value) == 101
    assert _upgrade(port, believed, own, "") == 401
    assert _upgrade(port, believed, "https://evil.example", value) == 403
    plain = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    plain.request("GET", "/")
    assert plain.getresponse().status == 400
    plain.close()


def _get(port: int, context: ssl.SSLContext) -> tuple[int, bytes]:
    connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=20, context=context)
    try:
        connection.request("GET", "/")
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def _not_believed_by_others(port: int) -> None:
    try:
        _get(port, ssl.create_default_context())
    except ssl.SSLCertVerificationError:
        return
    raise AssertionError("a certificate of nobody's authority was believed")


def _cookie(port: int, context: ssl.SSLContext, token: str) -> str:
    connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=20, context=context)
    own = {"Content-Type": "application/json", "Origin": f"https://127.0.0.1:{port}"}
    try:
        connection.request("POST", "/token", json.dumps({"token": token}), own)
        answer = connection.getresponse()
        assert answer.status == 200, answer.read()
        return answer.headers["Set-Cookie"]
    finally:
        connection.close()


def _upgrade(port: int, context: ssl.SSLContext, origin: str, cookie: str) -> int:
    """The status with which a browser's WebSocket is answered."""
    lines = [f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}", UPGRADE, f"Origin: {origin}"]
    lines += [f"Cookie: {cookie}"] if cookie else []
    with (
        socket.create_connection(("127.0.0.1", port), 20) as raw,
        context.wrap_socket(raw, server_hostname="127.0.0.1") as connection,
    ):
        connection.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        return int(connection.recv(100).split()[1])
