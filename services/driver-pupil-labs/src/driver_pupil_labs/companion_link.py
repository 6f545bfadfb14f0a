"""The network of a Companion app: status over HTTP, data over RTSP in one TCP connection each, its clock by echo."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import NamedTuple

import aiohttp
from sense4hri.access import in_url
from sense4hri.arrivals import Arrival, Arrivals
from sense4hri.device import MESSAGE_S, ClockMeasurement
from sense4hri.errors import DeviceLost, FrameError

from driver_pupil_labs import companion, rtp, stamped
from driver_pupil_labs.companion import Sensor, Status
from driver_pupil_labs.exchange import Asked, best
from driver_pupil_labs.rtp import Answer, Timeline

ANSWER_S = 4.0
ALIVE_S = 20.0  # between two signs of life that an RTSP session gets
EXCHANGES = 12
HALF_MS_NS = 500_000  # the echo tells whole milliseconds
METHOD = "best of 12 time echoes"


class Came(NamedTuple):
    """A packet: kind of sensor, UNIX time of the device, its content, and how many packets are missing before it.

    device_ns: None before the first sender report.
    """

    kind: str
    device_ns: int | None
    octets: bytes
    lost: int


@contextmanager
def link_errors(where: str) -> Iterator[None]:
    """Turn every way the network fails into DeviceLost that says what was being reached."""
    try:
        yield
    except TimeoutError as err:
        raise DeviceLost(f"{where} does not answer: another address, another network, or the app is not open") from err
    except (OSError, UnicodeError, aiohttp.ClientError, asyncio.IncompleteReadError) as err:  # UnicodeError: no name
        raise DeviceLost(f"{where}: {str(err) or type(err).__name__}") from err
    except FrameError as err:
        raise DeviceLost(f"{where}: {err}") from err


async def status(host: str, port: int) -> Status:
    """Ask the app for its status. Raises DeviceLost."""
    with link_errors(f"the Companion app at {host}:{port}"):
        timeout = aiohttp.ClientTimeout(total=ANSWER_S)
        async with aiohttp.ClientSession(timeout=timeout) as session, session.get(_url(host, port, "status")) as got:
            return companion.decode_status(await got.read())


async def send_event(host: str, port: int, name: str, device_ns: int) -> None:
    """Let the app keep an event in its recording. Raises DeviceLost."""
    with link_errors(f"the Companion app at {host}:{port}"):
        timeout = aiohttp.ClientTimeout(total=ANSWER_S)
        async with aiohttp.ClientSession(timeout=timeout) as session:
            await session.post(_url(host, port, "event"), json={"name": name, "timestamp": device_ns})


def _url(host: str, port: int, what: str) -> str:
    return f"http://{in_url(host)}:{port}/api/{what}"


async def measure(host: str, port: int) -> ClockMeasurement:
    """Ask for the clock several times; the shortest round trip counts. Raises DeviceLost."""
    with link_errors(f"the clock's echo at {host}:{port}"):
        async with asyncio.timeout(ANSWER_S):
            reader, writer = await asyncio.open_connection(host, port)
            try:
                found = [await _exchange(reader, writer) for _ in range(EXCHANGES)]
            finally:
                writer.close()
    return best(found, time.time_ns() - time.monotonic_ns(), METHOD, HALF_MS_NS)


async def _exchange(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> Asked:
    octets = (time.time_ns() // 1_000_000).to_bytes(8, "big")
    sent_ns = time.monotonic_ns()
    writer.write(octets)
    answer = await reader.readexactly(16)
    return Asked(sent_ns, time.monotonic_ns(), companion.decode_echo(octets, answer) + HALF_MS_NS)


@asynccontextmanager
async def playing(sensor: Sensor, arrivals: Arrivals[Came | FrameError]) -> AsyncIterator[Timeline]:
    """Stream one sensor into the arrivals for the length of the context; give what its packets' numbers tell."""
    where = f"{sensor.kind} at {sensor.host}:{sensor.port}"
    with link_errors(where):
        async with asyncio.timeout(ANSWER_S):
            link = await stamped.connected(sensor.host, sensor.port)
    session = RtspSession(sensor, link)
    try:
        with link_errors(where):
            async with asyncio.timeout(ANSWER_S):
                timeline = await session.begin()
        work = asyncio.create_task(session.read(arrivals, where))
        try:
            yield timeline
        finally:
            work.cancel()
            await asyncio.gather(work, return_exceptions=True)
    finally:
        link.close()


class RtspSession:
    """DESCRIBE, SETUP and PLAY of one stream whose packets come in the same TCP connection."""

    def __init__(self, sensor: Sensor, link: socket.socket) -> None:
        self._kind = sensor.kind
        self._url = f"rtsp://{in_url(sensor.host)}:{sensor.port}{sensor.path}"
        self._link, self._loop = link, asyncio.get_running_loop()
        self._buffer, self._received_ns = bytearray(), 0
        self._number = 0
        self._session = ""

    async def begin(self) -> Timeline:
        """Start the stream. Raises FrameError where the answers make no sense."""
        described = await self._ask("DESCRIBE", Accept="application/sdp")
        self._timeline = Timeline(rtp.clock_hz(described.body))
        answer = await self._ask("SETUP", Transport="RTP/AVP/TCP;unicast;interleaved=0-1")
        self._session = answer.headers.get("session", "").partition(";")[0]
        await self._ask("PLAY", Range="npt=0.000-")
        return self._timeline

    async def _ask(self, method: str, **headers: str) -> Answer:
        await self._send(method, **headers)
        while True:
            for came in rtp.take(self._buffer):
                if isinstance(came, Answer):
                    if came.status != 200:
                        raise FrameError(f"{method} was answered with {came.status}")
                    return came
            self._add(await self._loop.sock_recv(self._link, stamped.OCTETS))

    async def _send(self, method: str, **headers: str) -> None:
        self._number += 1
        lines = [f"{method} {self._url} RTSP/1.0", f"CSeq: {self._number}"]
        lines += [f"Session: {self._session}"] if self._session else []
        text = "\r\n".join([*lines, *(f"{k}: {v}" for k, v in headers.items()), "", ""])
        await self._loop.sock_sendall(self._link, text.encode())

    def _add(self, octets: bytes) -> None:
        if not octets:
            raise DeviceLost(f"{self._kind}: the app has ended the stream")
        self._buffer += octets

    async def read(self, arrivals: Arrivals[Came | FrameError], where: str) -> None:
        """Hand over what comes until the link fails; the failure is handed over too.

        All links are read at every whole MESSAGE_S: a wait for each packet costs more than all else done for it.
        """
        try:
            with link_errors(where):
                alive_s, self._received_ns = time.monotonic(), time.time_ns()
                while True:
                    for came in rtp.take(self._buffer):
                        if isinstance(came, tuple) and not isinstance(came, Answer):
                            self._packet(*came, arrivals)
                    if time.monotonic() - alive_s > ALIVE_S:
                        alive_s = time.monotonic()
                        await self._send("GET_PARAMETER")
                    await asyncio.sleep(MESSAGE_S - self._loop.time() % MESSAGE_S)
                    if (more := stamped.read(self._link)) is not None:
                        self._received_ns, octets = more
                        self._add(octets)
        except DeviceLost as err:
            arrivals.fail(err)

    def _packet(self, channel: int, octets: bytes, arrivals: Arrivals[Came | FrameError]) -> None:
        if channel % 2:
            if (newest := rtp.report(octets)) is not None:
                self._timeline.reported(newest)
            return
        try:
            packet = rtp.packet(octets)
        except FrameError as err:  # its frame was whole: the next one begins behind it
            arrivals.put(Arrival(self._received_ns, err))
            return
        lost, device_ns = self._timeline.count(packet.sequence), self._timeline.time_ns(packet.ticks)
        arrivals.put(Arrival(self._received_ns, Came(self._kind, device_ns, packet.payload, lost)))
