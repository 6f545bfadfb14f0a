"""A service that does one thing, named by its parameters, and says in its log what came of it."""

import asyncio
import json
import signal
import socket
import socketserver
import sys
import time
from dataclasses import dataclass

from rclpy.qos import QoSProfile
from sense4hri import qos, wire
from sense4hri.graph import ask_parameters, follow
from sense4hri.liveness import Pulse
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.topics import Topic
from sense4hri_msgs.msg import PhysioRaw
from std_msgs.msg import String


@dataclass(frozen=True)
class Config:
    """follow: a glob. raw: a topic of raw messages. ask: full name of a node.

    fault: `thread` fails on a thread, `ros`, `http`, `liveness` on the kit's own of that name; `name` looks a name up
    for longer than anybody waits.

    SIGUSR1: the main thread hangs; SIGUSR2: the thread `round`, which turns until then. SIGHUP: with `ends` it ends by
    itself.
    """

    follow: str = ""
    raw: str = ""
    ask: str = ""
    names: tuple[str, ...] = ()
    fault: str = ""
    ends: bool = False


class Toy:
    """Writes down what it hears."""

    def __init__(self, service: Service[Config]) -> None:
        self._service = service
        self.pulse, self.stuck = Pulse(), False

    def stick(self) -> None:
        self.stuck = True

    def heard(self, topic: Topic, message: String) -> None:
        self._service.log.info(f"heard {message.data} on {topic.name}")

    def decode(self, message: bytes) -> None:
        self._service.log.info(f"decoded {wire.chunk_of(message).channels}")

    def gone(self, topic: Topic) -> None:
        self._service.log.info(f"gone: {topic.name}")

    def publishers(self, topic: Topic, profile: QoSProfile) -> None:
        self._service.log.info(f"{len(topic.publishers)} on {topic.name}, {profile.reliability.name}")

    def turn(self) -> None:
        """Beat until the wheel is stuck."""
        while not self._service.stopped.is_set():
            self.pulse.beat()
            time.sleep(1000.0 if self.stuck else 0.02)

    def fail(self) -> None:
        raise OSError(5, "the toy's disk is broken")


async def main(service: Service[Config]) -> None:
    toy, config = Toy(service), service.config
    if config.follow:
        follow(service, [config.follow], toy.heard, toy.gone, on_publishers=toy.publishers, types=[String])
    if config.raw:
        service.subscribe(PhysioRaw, config.raw, toy.decode, qos.RAW, raw=True)
    if config.ask:
        values = await ask_parameters(service, config.ask, config.names or None)
        service.log.info(f"told {json.dumps(values, sort_keys=True)}")
    if config.fault == "thread":
        service.thread("worker", toy.fail)
    if config.fault == "ros":
        service.ros.do(toy.fail)
    if config.fault == "http":
        socketserver.BaseServer.service_actions = lambda server: toy.fail()
    if config.fault == "liveness":
        service.liveness.tick = lambda *how: toy.fail()
    if config.fault == "name":
        socket.getaddrinfo = lambda *_: time.sleep(1000.0)
        service.start(asyncio.get_running_loop().getaddrinfo("sensor", 80))
    service.thread("round", toy.turn, toy.pulse)
    signal.signal(signal.SIGUSR2, lambda number, frame: toy.stick())
    signal.signal(signal.SIGUSR1, lambda number, frame: time.sleep(1000.0))
    service.ready(False, "the toy is not wound up")
    over = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, over.set)
    await (over if config.ends else service.stopped).wait()


if __name__ == "__main__":
    sys.exit(run("toy_service", Config, main))
