"""What must hold of the page over HTTPS, wherever it runs."""

import http.client
import json
import socket
import ssl
from pathlib import Path

KEY = "A" * 22 + "=="
UPGRADE = f"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {KEY}"


def holds(host: str, port: int, ca: Path, token: str) -> None:
    """Fail where the page of this host at this port, certified by this CA, is not as docs/tls.md says."""
    believed = ssl.create_default_context(cafile=str(ca))
    assert _get(host, port, believed)[0] == 200
    _not_believed_by_others(host, port)
    cookie = _cookie(host, port, believed, token)
    assert {"Secure", "HttpOnly", "SameSite=Strict"} <= {part.strip() for part in cookie.split(";")[1:]}
    own, value = f"https://{host}:{port}", cookie.partition(";")[0]
    assert _upgrade(host, port, believed, own, value) == 101
    assert _upgrade(host, port, believed, own, "") == 401
    assert _upgrade(host, port, believed, "https://evil.example", value) == 403
    plain = http.client.HTTPConnection(host, port, timeout=20)
    plain.request("GET", "/")
    assert plain.getresponse().status == 400
    plain.close()


def _get(host: str, port: int, context: ssl.SSLContext) -> tuple[int, bytes]:
    connection = http.client.HTTPSConnection(host, port, timeout=20, context=context)
    try:
        connection.request("GET", "/")
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def _not_believed_by_others(host: str, port: int) -> None:
    try:
        _get(host, port, ssl.create_default_context())
    except ssl.SSLCertVerificationError:
        return
    raise AssertionError("a certificate of nobody's authority was believed")


def _cookie(host: str, port: int, context: ssl.SSLContext, token: str) -> str:
    connection = http.client.HTTPSConnection(host, port, timeout=20, context=context)
    own = {"Content-Type": "application/json", "Origin": f"https://{host}:{port}"}
    try:
        connection.request("POST", "/token", json.dumps({"token": token}), own)
        answer = connection.getresponse()
        assert answer.status == 200, answer.read()
        return answer.headers["Set-Cookie"]
    finally:
        connection.close()


def _upgrade(host: str, port: int, context: ssl.SSLContext, origin: str, cookie: str) -> int:
    """The status with which a browser's WebSocket is answered."""
    lines = [f"GET /ws HTTP/1.1\r\nHost: {host}:{port}", UPGRADE, f"Origin: {origin}"]
    lines += [f"Cookie: {cookie}"] if cookie else []
    with (
        socket.create_connection((host, port), 20) as raw,
        context.wrap_socket(raw, server_hostname=host) as connection,
    ):
        connection.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        return int(connection.recv(100).split()[1])
