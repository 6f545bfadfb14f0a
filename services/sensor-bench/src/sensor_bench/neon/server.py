"""The three ports of a Companion app: HTTP, RTSP with its data in the same connection, and the echo of its clock."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

from sensor_bench.clock import HostClock
from sensor_bench.neon.app import RTP_HZ, Player, VirtualApp

Talk = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]
TICK_S = 0.02
SESSION = "12345678"


class AppServer:
    """Serves a virtual app on the machine's own time while it is started. port 0: any free one."""

    def __init__(self, app: VirtualApp, host: HostClock, address: str = "127.0.0.1", port: int = 0) -> None:
        self.app, self._host, self._address, self.port = app, host, address, port
        self.starts_total = 0
        self._servers: list[asyncio.Server] = []
        self._talks: set[asyncio.Task[None]] = set()

    async def start(self) -> None:
        """Listen from now on. Raises OSError where the port is taken."""
        talks = (self._http, self._rtsp, self._echo)
        ports = (self.port, 0, 0)
        self._servers = [
            await asyncio.start_server(self._held(talk), self._address, port)
            for talk, port in zip(talks, ports, strict=True)
        ]
        self.port, self._rtsp_port, self._echo_port = (each.sockets[0].getsockname()[1] for each in self._servers)
        self.starts_total += 1

    async def stop(self) -> None:
        """Close everything, as an app that is closed."""
        for server in self._servers:
            server.close()
        for talk in list(self._talks):
            talk.cancel()
        await asyncio.gather(*self._talks, return_exceptions=True)

    def now_s(self) -> float:
        """Return the true time since the app's second 0."""
        return (self._host.now_ns() - self.app.start_ns) * 1e-9

    def _held(self, talk: Talk) -> Talk:
        """Return the conversation, ended with the server."""

        async def held(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            task = asyncio.current_task()
            assert task is not None
            self._talks.add(task)
            try:
                with suppress(ConnectionError, asyncio.IncompleteReadError, asyncio.CancelledError):
                    await talk(reader, writer)
            finally:
                self._talks.discard(task)
                writer.close()

        return held

    async def _http(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        method, path, headers = await _head(reader)
        body = await reader.readexactly(int(headers.get("content-length", 0)))
        if (method, path) == ("POST", "/api/event"):
            self.app.events.append(json.loads(body))
            result: object = json.loads(body) | {"recording_id": None}
        else:
            own = writer.get_extra_info("sockname")[0]
            result = self.app.status(own, self._rtsp_port, self._echo_port)
        octets = json.dumps({"message": "Success", "result": result}).encode()
        head = f"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: {len(octets)}\r\n"
        writer.write(head.encode() + b"Connection: close\r\n\r\n" + octets)
        await writer.drain()

    async def _echo(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            writer.write(self.app.echo(await reader.readexactly(8), self.now_s()))

    async def _rtsp(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        playing: asyncio.Task[None] | None = None
        try:
            while True:
                method, url, headers = await _head(reader)
                kind = url.rpartition("camera=")[2]
                transport = f"Session: {SESSION};timeout=60\r\nTransport: {headers.get('transport', '')}\r\n"
                extra, body = {"SETUP": transport}, b""
                if method == "DESCRIBE":
                    body = f"v=0\r\nm=application 0 RTP/AVP 96\r\na=rtpmap:96 com.pupil/{RTP_HZ}\r\n".encode()
                refused = method == "PLAY" and headers.get("session") != SESSION
                status = "454 Session Not Found" if refused else "200 OK"
                answer = f"RTSP/1.0 {status}\r\nCSeq: {headers.get('cseq', '')}\r\n{extra.get(method, '')}"
                writer.write(f"{answer}Content-Length: {len(body)}\r\n\r\n".encode() + body)
                if method == "PLAY" and not refused:
                    playing = asyncio.create_task(self._play(Player(self.app, kind, self.now_s()), writer))
        finally:
            if playing is not None:
                playing.cancel()

    async def _play(self, player: Player, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            while True:
                writer.write(player.send(self.now_s()))
                await writer.drain()
                await asyncio.sleep(TICK_S)


async def _head(reader: asyncio.StreamReader) -> tuple[str, str, dict[str, str]]:
    """Return method, address and headers of a request."""
    first, *lines = (await reader.readuntil(b"\r\n\r\n")).decode().strip().split("\r\n")
    method, address, _ = first.split()
    pairs = (line.partition(":") for line in lines)
    return method, address, {name.lower(): value.strip() for name, _, value in pairs}
