"""A Cyton behind a pseudo-terminal that sends what it is told, and what BrainFlow's own reader of it makes of that."""

import os
import select
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from driver_brainflow.config import BrainflowConfig
from driver_brainflow.transport import Session, description
from numpy.typing import NDArray
from processes import DEADLINE_S

GREETING = b"OpenBCI V3 8-16 channel\r\n$$$"  # BrainFlow waits for three of these signs
GREETED = b"vd"
BETWEEN = bytes(40)  # more than a packet: whatever it was, the next one is found behind it
POLL_S = 0.001


def packet(number: int) -> bytes:
    """A packet in which everything is 0 but its number."""
    return bytes([0xA0, number]) + bytes(30) + b"\xc0"


class Cyton:
    """What is sent of its packets, and BrainFlow's rows of them."""

    def __init__(self, fd: int, session: Session) -> None:
        self._fd, self._session = fd, session

    def rows(self, octets: bytes, number: int) -> NDArray[np.float64]:
        """Return BrainFlow's columns of a packet of that number, and of these bytes where it takes them for one."""
        os.write(self._fd, packet(number) + octets + BETWEEN + packet(number))
        found, until_s = np.empty((24, 0)), time.monotonic() + DEADLINE_S
        while found.shape[1] < 2 or found[0, -1] != number:
            assert time.monotonic() < until_s, f"BrainFlow has taken no packet: {found}"
            for read in self._session.read(("default",), POLL_S) or ():
                found = np.hstack([found, read.table])
        return found[:, :-1]


@contextmanager
def cyton() -> Iterator[Cyton]:
    """One that BrainFlow has started, for the length of the context."""
    fd, own_end = os.openpty()
    tty.setraw(own_end)
    config, gone = BrainflowConfig(sensor_id="it_1", board="CYTON", serial_port=os.ttyname(own_end)), threading.Event()
    answering = threading.Thread(target=_answer, args=(fd, gone), daemon=True)
    answering.start()
    description(config.board)  # loads BrainFlow without its warnings, as the driver does
    session = Session(config.board, config.inputs, config.all_commands, config.verbose)
    try:
        session.open(config.presets)
        yield Cyton(fd, session)
    finally:
        session.close(False)
        gone.set()
        answering.join()
        os.close(own_end)
        os.close(fd)


def _answer(fd: int, gone: threading.Event) -> None:
    """Greet whoever asks who it is; the other commands of BrainFlow want no answer."""
    while not gone.is_set():
        if select.select([fd], [], [], 0.01)[0] and set(os.read(fd, 64)) & set(GREETED):
            os.write(fd, GREETING)
