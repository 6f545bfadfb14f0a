"""A SkinBox (see kit/skinbox/protocol.py) on a pseudo-terminal, with the faults a test wants."""

import os
import select
import struct
import threading
import time
import tty
from pathlib import Path

FRAME = 10


class VirtualSkinBox:
    """One box. Conductance is the number of the sample, in 0.01 uS.

    port: path under which it is plugged in. powered_ms: what its clock shows when it begins to sample. missing: numbers
    of samples that never leave the box.
    """

    def __init__(self, port: Path, rate_hz: int = 50, powered_ms: int = 0, missing: tuple[int, ...] = ()) -> None:
        self.powered_ns = time.time_ns()
        self._port, self._rate_hz, self._powered_ms, self._missing = port, rate_hz, powered_ms, missing
        self._sampling, self._sent, self._levels, self._begun_s = False, 0, 0, 0.0
        self._step_ms, self._first_ms = 1000 // rate_hz if rate_hz else 0, 0  # between samples, at the first one
        self._fd, self._own_end = os.openpty()
        tty.setraw(self._own_end)
        self._ended, self._restarted = threading.Event(), threading.Event()
        port.unlink(missing_ok=True)
        port.symlink_to(os.ttyname(self._own_end))
        self._thread = threading.Thread(target=self._run, name="skinbox")
        self._thread.start()

    def restart(self) -> None:
        """Power off and on, so fast that nobody sees the port go."""
        self._restarted.set()

    def unplug(self) -> None:
        """The port vanishes."""
        if self._ended.is_set():
            return
        self._port.unlink(missing_ok=True)
        self._ended.set()
        self._thread.join()
        os.close(self._fd)
        os.close(self._own_end)

    def _now_ms(self) -> int:
        return (time.time_ns() - self.powered_ns) // 1_000_000

    def _run(self) -> None:
        while not self._ended.is_set():
            if select.select([self._fd], [], [], 0.005)[0]:
                for command in os.read(self._fd, 100):
                    self._obey(chr(command))
            if self._restarted.is_set():
                self._restarted.clear()
                self.powered_ns, self._first_ms = time.time_ns(), -self._sent * self._step_ms
            if self._sampling:
                self._measure()

    def _obey(self, command: str) -> None:
        if command == "i":
            self._send("I", struct.pack("<H", self._rate_hz) + b"SB-7")
        if command == "s":
            self._sampling, self._begun_s = True, time.monotonic()
            self._sent, self._levels, self._first_ms = 0, 0, self._powered_ms
            self.powered_ns = time.time_ns() - self._powered_ms * 1_000_000
        if command == "p":
            self._send("P", struct.pack("<H", self._now_ms() % 65536))

    def _measure(self) -> None:
        elapsed_s = time.monotonic() - self._begun_s
        if self._rate_hz and elapsed_s > (self._sent + FRAME) / self._rate_hz:
            numbers = [n for n in range(self._sent, self._sent + FRAME) if n not in self._missing]
            samples = [struct.pack("<HH", (self._first_ms + n * self._step_ms) % 65536, n) for n in numbers]
            self._sent += FRAME
            self._send("D", b"".join(samples))
        if elapsed_s > self._levels:
            self._levels += 1
            self._send("L", struct.pack("<H", 1234))

    def _send(self, kind: str, content: bytes) -> None:
        body = bytes([ord(kind), len(content)]) + content
        os.write(self._fd, b"\xa5" + body + bytes([sum(body) % 256]))
