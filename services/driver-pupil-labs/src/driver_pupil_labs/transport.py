"""The sockets of Pupil Capture: what it publishes, and its clock asked again and again; the only place with ZeroMQ.

One thread reads both, so that a datum is stamped as it comes, also while the clock is being asked.
"""

import re
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import zmq
from sense4hri.access import in_url
from sense4hri.device import MESSAGE_S, ClockMeasurement, Identity
from sense4hri.errors import DeviceLost
from sense4hri.stamps import SECOND_NS

from driver_pupil_labs.exchange import Asked, best
from driver_pupil_labs.protocol import MODELLED, TOPICS

ANSWER_S = 2.0  # within which Capture answers a request
EXCHANGES = 12  # quick ones, of which the shortest round trip counts
EVERY_S = 2.0  # between two measurements of the clock
LARGEST = 1 << 20  # bytes of a message
MOST_AT_ONCE = 100  # messages before the clock's answer is looked for again
ONLY_MODELS = frozenset(TOPICS) - {"pupil."} | frozenset(MODELLED)
CLOCK = (b"t",)
PORT = re.compile(r"[0-9]{1,5}")
METHOD = "best of 12 requests of Pupil time"


class Heard(NamedTuple):
    """A published message."""

    received_ns: int
    topic: str
    payload: bytes


Message = Heard | ClockMeasurement | Identity


class CaptureLink:
    """A connection to Pupil Capture; nothing waits for it but `read`.

    All but `tell` and `hear_models_only` is for one thread at a time.
    """

    def __init__(self, host: str, port: int) -> None:
        self._host, self._where = in_url(host), f"Pupil Capture at {in_url(host)}:{port}"
        self._context = zmq.Context()
        self._asking, self._hearing = self._context.socket(zmq.REQ), self._context.socket(zmq.SUB)
        self._poller = zmq.Poller()
        for socket in (self._asking, self._hearing):
            socket.linger, socket.maxmsgsize = 0, LARGEST
            socket.ipv6 = ":" in host  # of a name its IPv4 address is taken
            self._poller.register(socket, zmq.POLLIN)
        self._hearing.rcvhwm = 20_000
        self._requests: deque[tuple[bytes, ...]] = deque([(b"SUB_PORT",), (b"v",)], maxlen=100)
        self._asked: tuple[bytes, ...] = ()
        self._asked_ns, self._clock_at_s = 0, 0.0
        self._exchanges: list[Asked] = []
        self._failure: DeviceLost | None = None
        self._topics: frozenset[str] = frozenset()
        self._wanted = frozenset(TOPICS)
        self._connect(self._asking, port)

    def _connect(self, socket: "zmq.Socket[bytes]", port: int) -> None:
        try:
            socket.connect(f"tcp://{self._host}:{port}")
        except zmq.ZMQError as err:
            self.close()
            raise DeviceLost(f"{self._where}: {err}") from err

    def tell(self, parts: tuple[bytes, bytes]) -> None:
        """Let Capture publish a message; from any thread, sent soon."""
        self._requests.append(parts)

    def hear_models_only(self) -> None:
        """Leave out pictures of eyes without a 3d model soon: a third of all messages; from any thread."""
        self._wanted = ONLY_MODELS

    def read(self) -> list[Message] | None:
        """Wait a moment; return what came, stamped as it came.

        Raises DeviceLost where Capture does not answer, one read later than what came before that is returned.
        """
        if self._failure is not None:
            raise self._failure
        heard: list[Message] = []
        try:
            self._gather(heard)
        except DeviceLost as err:
            self._failure = err
        return heard or None

    def _gather(self, heard: list[Message]) -> None:
        """Add what comes within a moment. Raises DeviceLost."""
        self._subscribe()
        until_s = time.monotonic() + MESSAGE_S
        while time.monotonic() < until_s:
            self._request()
            ready = dict(self._poller.poll(round(MESSAGE_S * 1000)))
            if self._asking in ready:
                heard += self._answered(time.monotonic_ns())
            if self._hearing in ready:
                heard += self._published()
        if self._asked and time.monotonic_ns() - self._asked_ns > ANSWER_S * SECOND_NS:
            raise DeviceLost(f"{self._where} does not answer: closed, another address, or a firewall")

    def _request(self) -> None:
        """Send the next request, unless an answer is awaited."""
        if self._asked or not (self._requests or time.monotonic() >= self._clock_at_s):
            return
        self._asked = self._requests.popleft() if self._requests else CLOCK
        self._asked_ns = time.monotonic_ns()
        self._asking.send_multipart(self._asked)

    def _answered(self, answered_ns: int) -> list[Message]:
        """Take an answer; return what it tells."""
        answer = b" ".join(self._asking.recv_multipart()).decode("utf-8", "replace")
        asked, self._asked = self._asked, ()
        if asked == (b"SUB_PORT",):
            self._listen(answer)
        elif asked == (b"v",):
            return [Identity(firmware_version=f"Pupil Capture {answer[:40]}")]
        elif asked == CLOCK:
            return self._exchanged(answer, answered_ns)
        return []

    def _listen(self, port: str) -> None:
        if not (PORT.fullmatch(port) and 0 < int(port) < 1 << 16):
            raise DeviceLost(f"{self._where} says {port[:60]!r} when asked for its port: no Pupil Capture or Service")
        self._connect(self._hearing, int(port))

    def _subscribe(self) -> None:
        """Hear what is wanted; what is wanted before and after is not interrupted."""
        wanted = self._wanted
        for topic in wanted - self._topics:
            self._hearing.subscribe(topic)
        for topic in self._topics - wanted:
            self._hearing.unsubscribe(topic)
        self._topics = wanted

    def _exchanged(self, answer: str, answered_ns: int) -> list[Message]:
        try:
            device_ns = round(float(answer) * SECOND_NS)
        except (ValueError, OverflowError) as err:
            raise DeviceLost(f"{self._where} says {answer[:40]!r} when asked for its time") from err
        self._exchanges.append(Asked(self._asked_ns, answered_ns, device_ns))
        if len(self._exchanges) < EXCHANGES:
            return []
        measured, self._exchanges = best(self._exchanges, time.time_ns() - time.monotonic_ns(), METHOD), []
        self._clock_at_s = time.monotonic() + EVERY_S
        return [measured]

    def _published(self) -> Iterator[Heard]:
        """Yield what waits, each stamped as it is taken; a wait for each would cost twice as much."""
        with suppress(zmq.Again):
            for _ in range(MOST_AT_ONCE):
                topic, *rest = self._hearing.recv_multipart(zmq.NOBLOCK)
                yield Heard(time.time_ns(), topic.decode("utf-8", "replace"), rest[0] if rest else b"")

    def close(self) -> None:
        """Let go of the sockets."""
        self._context.destroy(linger=0)
