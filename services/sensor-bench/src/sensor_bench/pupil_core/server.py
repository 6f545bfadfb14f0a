"""Pupil Capture's two sockets: requests on one port, what it publishes on another that is asked for."""

import asyncio
import contextlib

import zmq
import zmq.asyncio
from sense4hri.access import in_url

from sensor_bench.clock import HostClock
from sensor_bench.pupil_core.capture import VirtualCapture

TICK_S = 0.01


class CaptureServer:
    """Serves a virtual Capture on the machine's own time while it is started."""

    def __init__(self, capture: VirtualCapture, host: HostClock, address: str = "127.0.0.1", port: int = 0) -> None:
        self.capture, self._host, self._address = capture, host, address
        self.port = port
        self.starts_total = 0
        self._context: zmq.asyncio.Context | None = None
        self._sockets: list[zmq.asyncio.Socket] = []
        self._work: list[asyncio.Task[None]] = []

    async def start(self) -> None:
        """Bind the sockets and publish from now on. Raises zmq.ZMQError where the port is taken."""
        context = self._context = zmq.asyncio.Context()
        self._sockets = [context.socket(zmq.REP), context.socket(zmq.PUB)]
        answers, published = self._sockets
        for socket in self._sockets:
            socket.linger, socket.ipv6 = 0, ":" in self._address
        published.sndhwm = 100_000
        answers.bind(f"tcp://{in_url(self._address)}:{self.port or '*'}")
        published.bind(f"tcp://{in_url(self._address)}:*")
        self.port = _port(answers)
        self.starts_total += 1
        self._work = [
            asyncio.create_task(self._answer(answers, str(_port(published)))),
            asyncio.create_task(self._publish(published)),
        ]

    async def stop(self) -> None:
        """Close the sockets, as a Capture that is closed."""
        for task in self._work:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
        for socket in self._sockets:
            socket.close()
        if self._context is not None:
            self._context.term()  # returns once the ports are free

    def now_s(self) -> float:
        """Return the true time since the capture's second 0."""
        return (self._host.now_ns() - self.capture.start_ns) * 1e-9

    async def _answer(self, socket: zmq.asyncio.Socket, published: str) -> None:
        while True:
            parts = await socket.recv_multipart()
            now_s = self.now_s()
            known = parts[0] in (b"SUB_PORT", b"PUB_PORT") and len(parts) == 1
            await socket.send(published.encode() if known else self.capture.answer(parts, now_s))

    async def _publish(self, socket: zmq.asyncio.Socket) -> None:
        self.capture.begin(self.now_s())
        while True:
            await asyncio.sleep(TICK_S)
            for topic, payload in self.capture.send(self.now_s()):
                await socket.send_multipart([topic, payload])


def _port(socket: zmq.asyncio.Socket) -> int:
    endpoint: bytes = socket.getsockopt(zmq.LAST_ENDPOINT)  # type: ignore[assignment]
    return int(endpoint.rpartition(b":")[2])
