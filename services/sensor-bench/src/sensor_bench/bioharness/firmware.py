"""A BioHarness as its host sees it: messages in, packets of its wearer's heart and chest out. No clock, no link.

| packet | every | content behind number, date and ms of the day |
|---|---|---|
| 21 breathing | 1008 ms | 18 samples of 10 bits, one each 56 ms |
| 22 ECG | 252 ms | 63 samples of 10 bits |
| 24 R-R | 1008 ms | 18 int16, one each 56 ms: the newest interval in ms, its sign turned at each beat |
| 25 acceleration | 400 ms | 20 x 3 samples of 10 bits around 512, 20.75 each g |
| 2B summary | 1000 ms | version 2, then values of the last second |
"""

import datetime
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor_bench.signals.hearts import Rhythm
from sensor_bench.signals.sources import EcgSource, Wearing
from sensor_bench.signals.waveforms import FloatArray, Waveforms

STX, ETX, ACK, NAK = b"\x02", b"\x03", b"\x06", b"\x15"
SWITCHES = {0x15: 0x21, 0x16: 0x22, 0x19: 0x24, 0x1E: 0x25, 0xBD: 0x2B}
EVERY_MS = {0x21: 1008, 0x22: 252, 0x24: 1008, 0x25: 400, 0x2B: 1000}
STEP_MS = {0x21: 56, 0x22: 4, 0x24: 56, 0x25: 20}
STREAMS = {0x21: ("respiration", 18), 0x22: ("ecg", 63), 0x25: ("accelerometer", 20)}
LINK_TIMEOUT_S = 10.0
UV_PER_COUNT = 12.0


@dataclass
class Worn:
    """What a hand may change."""

    battery_percent: int = 80
    level: int = 0
    """0 worn well .. 3 not worn."""


def checksum(octets: bytes) -> int:
    """CRC-8, x^8 + x^5 + x^4 + 1, lowest bit first, by long division."""
    rest = 0
    for octet in octets:
        for bit in range(8):
            mixed = (rest ^ octet >> bit) & 1
            rest = rest >> 1 ^ 0x8C * mixed
    return rest


def message(number: int, content: bytes, end: bytes = ETX) -> bytes:
    """A whole message."""
    return STX + bytes([number, len(content)]) + content + bytes([checksum(content)]) + end


def packed(counts: list[int]) -> bytes:
    """Values of 10 bits one after the other, the lowest bit first."""
    whole = sum(value << 10 * place for place, value in enumerate(counts))
    return whole.to_bytes(math.ceil(len(counts) * 10 / 8), "little")


class VirtualBioHarness:
    """One strap that has just been switched on.

    on_s: true time of that, since the bench's start. begins: what its calendar shows then. skew_ppm: what it gains.
    carry(packet, **samples): the packet as it leaves the device, or nothing where it is lost.
    """

    def __init__(
        self,
        heart: Rhythm,
        waveforms: Waveforms,
        worn: Worn,
        carry: Callable[..., bytes],
        begins: datetime.datetime,
        on_s: float = 0.0,
        skew_ppm: float = 0.0,
        serial_number: str = "BHT000001",
    ) -> None:
        self._heart, self._worn, self._carry, self._begins = heart, worn, carry, begins
        self._ecg = EcgSource(heart, Wearing(), waveforms, 1)
        self._on_s, self._pace = on_s, 1 + skew_ppm * 1e-6
        self._serial_number = serial_number
        self._next_ms: dict[int, int] = {}  # by packet, ms since it was switched on of its first sample
        self._sequence: dict[int, int] = {}
        self._heard_s = 0.0

    @property
    def sending(self) -> list[int]:
        """The packets that are enabled."""
        return sorted(self._next_ms)

    def true_s(self, device_ns: int) -> float:
        """True time since the bench's start at which its calendar shows so many ns since 1970."""
        begins_ns = round((self._begins - datetime.datetime(1970, 1, 1)) / datetime.timedelta(milliseconds=1)) * 10**6
        return self._on_s + (device_ns - begins_ns) * 1e-9 / self._pace

    def receive(self, octets: bytes, time_s: float) -> bytes:
        """Obey whole messages; the answers."""
        said, self._heard_s = b"", time_s
        while len(octets) >= 5:
            size = octets[2] + 5
            said += self._obey(octets[1], octets[3 : size - 2], time_s)
            octets = octets[size:]
        return said

    def _obey(self, number: int, content: bytes, time_s: float) -> bytes:
        if number == 0x23:
            return b""
        if number == 0x0B:
            return message(number, self._serial_number.encode().ljust(12, b"\0"), ACK)
        if number not in SWITCHES:
            return message(number, b"", NAK)
        packet = SWITCHES[number]
        if any(content):
            every = EVERY_MS[packet]
            self._next_ms.setdefault(packet, (int(time_s * self._pace * 1000) // every + 1) * every)
        else:
            self._next_ms.pop(packet, None)
        return message(number, b"", ACK)

    def send(self, time_s: float) -> bytes:
        """Everything whose last sample has been taken, in the order in which it was."""
        if time_s > self._heard_s + LINK_TIMEOUT_S:
            self._next_ms.clear()
        now_ms, said = time_s * self._pace * 1000, b""
        while due := [(at + EVERY_MS[each] - STEP_MS.get(each, 0), each) for each, at in self._next_ms.items()]:
            last_ms, packet = min(due)
            if last_ms > now_ms:
                break
            said += self._packet(packet, self._next_ms[packet])
            self._next_ms[packet] += EVERY_MS[packet]
        return said

    def _packet(self, packet: int, first_ms: int) -> bytes:
        self._sequence[packet] = (self._sequence.get(packet, -1) + 1) % 256
        shown = self._begins + datetime.timedelta(milliseconds=first_ms)
        midnight = shown.replace(hour=0, minute=0, second=0, microsecond=0)
        of_day_ms = round((shown - midnight) / datetime.timedelta(milliseconds=1))
        head = struct.pack("<BHBBI", self._sequence[packet], shown.year, shown.month, shown.day, of_day_ms)
        samples = dict([STREAMS[packet]]) if packet in STREAMS else {}
        return self._carry(message(packet, head + self._content(packet, first_ms)), **samples)

    def _content(self, packet: int, first_ms: int) -> bytes:
        if packet == 0x2B:
            return self._summary(self._true(np.array([first_ms]))[0])
        count = EVERY_MS[packet] // STEP_MS[packet]
        times_s = self._true(first_ms + STEP_MS[packet] * np.arange(count))
        if packet == 0x24:
            return struct.pack("<18h", *(self._interval(at_s) for at_s in times_s.tolist()))
        return packed(np.clip(self.counts(packet, times_s), 0, 1023).reshape(-1).tolist())

    def _true(self, of_device_ms: NDArray[np.int64]) -> FloatArray:
        return np.asarray(self._on_s + of_device_ms / 1000 / self._pace)

    def counts(self, packet: int, times_s: FloatArray) -> NDArray[np.int64]:
        """What the converter sees at these true times, shape (n, channels)."""
        breath = self._heart.breathing(times_s)
        if packet == 0x21:
            return np.rint(512 + 200 * breath).astype(np.int64)[:, None]
        if packet == 0x22:
            return np.rint(512 + self._ecg.at(times_s) / UV_PER_COUNT).astype(np.int64)[:, None]
        gravity = np.array([0.95, 0.05, -0.25]) + breath[:, None] * np.array([0.01, 0.0, 0.03])
        return np.rint(512 + 20.75 * gravity).astype(np.int64)

    def _interval(self, at_s: float) -> int:
        """The newest R-R interval in ms, its sign turned with each beat."""
        beats = self._heart.beats(at_s - 4, at_s)
        if not beats:
            return 0
        number = len(self._heart.beats(0.0, at_s)) if at_s > 0 else 0
        return round(beats[-1].rr_s * 1000) * (1 if number % 2 else -1)

    def _summary(self, at_s: float) -> bytes:
        beats = self._heart.beats(at_s - 10, at_s)
        rate = round(60 * len(beats) / sum(beat.rr_s for beat in beats)) if beats else 0
        unworn = self._worn.level == 3
        values = struct.pack("<BHHhhHH", 2, 0 if unworn else rate, 150, 335, 2, 12, 25)
        battery = struct.pack("<HB", 3900, self._worn.battery_percent)
        status = bytes([(0x70 if unworn else 0) | self._worn.level, 0])
        return (values + battery).ljust(47, b"\0") + status + bytes(13)
