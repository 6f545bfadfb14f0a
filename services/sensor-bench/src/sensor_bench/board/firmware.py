"""The sketch on the board: its time, its count and what its converters say, in one of several forms.

Fields: t (ticks since power-on, 32 bits), n (frames, 8 bits), gsr (hundredths of a uS), belt (10 bits), ppg (10 bits).
"""

import json
from collections.abc import Callable, Mapping
from typing import NamedTuple

from sensor_bench.signals.measures import Measure
from sensor_bench.wired import Frames

CONVERTER = 1023
SYNC = b"\xa5\x5a"
BOOT = b"# booting\r\n"


class Sample(NamedTuple):
    """What the board knows of one moment."""

    t: int
    n: int
    gsr: int
    belt: int
    ppg: int


def csv(sample: Sample) -> bytes:
    return ",".join(map(str, sample)).encode() + b"\r\n"


def pairs(sample: Sample) -> bytes:
    text = ",".join(f"{name}:{value}" for name, value in sample._asdict().items()).encode()
    check = 0
    for octet in text:
        check ^= octet
    return text + b"*%02X\r\n" % check


def jsonl(sample: Sample) -> bytes:
    return json.dumps(sample._asdict()).encode() + b"\n"


def packed(sample: Sample) -> bytes:
    """t 4 bytes, n 1, the others 2 each, little endian, and the sum of all of them."""
    words = (value.to_bytes(size, "little") for value, size in zip(sample, (4, 1, 2, 2, 2), strict=True))
    body = b"".join(words)
    return body + bytes([sum(body) % 256])


def sync(sample: Sample) -> bytes:
    return SYNC + packed(sample)


def cobs(sample: Sample) -> bytes:
    """Every stretch without a zero after the length of it, and a zero at the end."""
    return b"".join(bytes([len(part) + 1]) + part for part in packed(sample).split(b"\0")) + b"\0"


FORMATS: Mapping[str, Callable[[Sample], bytes]] = {
    "csv": csv,
    "pairs": pairs,
    "json": jsonl,
    "struct": sync,
    "cobs": cobs,
}


class Sketch:
    """One board since its power-on; it waits for `s`, and ends with `x`, unless it sends by itself.

    on_s: true time of that since the bench's start. ticks_hz, first_tick: of its clock, which gains skew_ppm.
    """

    def __init__(
        self,
        measures: Mapping[str, Measure],
        frames: Frames,
        on_s: float,
        *,
        form: str = "csv",
        rate_hz: float = 50.0,
        ticks_hz: int = 1000,
        first_tick: int = 0,
        skew_ppm: float = 0.0,
        waits: bool = True,
    ) -> None:
        self._measures, self._frames, self._on_s = measures, frames, on_s
        self._form, self._rate_hz = FORMATS[form], rate_hz
        self._ticks_hz, self._first_tick, self._skew = ticks_hz, first_tick, 1 + skew_ppm * 1e-6
        self._text = form in ("csv", "pairs", "json")
        self._sent, self._running, self._booted = 0, not waits, False

    def receive(self, octets: bytes, time_s: float) -> bytes:
        for command in octets:
            if command in b"sx":
                self._running = command == ord("s")
        return b""

    def send(self, time_s: float) -> bytes:
        boot = b"" if self._booted or not self._text else BOOT
        self._booted = True
        first, due = self._sent, int(time_s * self._rate_hz) + 1
        self._sent = max(due, first)
        if not self._running or due <= first:
            return boot
        return boot + b"".join(self._frame(number) for number in range(first, due))

    def _frame(self, number: int) -> bytes:
        return self._frames.carry(self._form(self.sample(number)), eda=1, respiration=1, ppg=1)

    def sample(self, number: int) -> Sample:
        """The sample of that number since power-on."""
        ticks = int(number * self._ticks_hz / self._rate_hz * self._skew + 1e-6) + self._first_tick
        at = round(self._on_s * self._rate_hz) + number
        eda, breath, pulse = (
            float(self._measures[name](at, 1, self._rate_hz)[0]) for name in ("eda", "breath", "pulse")
        )
        belt, ppg = round(CONVERTER * (0.5 + 0.3 * breath)), round(CONVERTER * (0.3 + 0.4 * pulse))
        return Sample(ticks % 2**32, number % 256, round(100 * eda), _limited(belt), _limited(ppg))


def _limited(counts: int) -> int:
    return min(CONVERTER, max(0, counts))
