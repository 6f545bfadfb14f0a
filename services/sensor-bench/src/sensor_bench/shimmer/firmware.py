"""LogAndStream as its host sees it: commands in; acknowledgements, answers and data packets out. No clock, no link.

| command | bytes after it | answer after FF |
|---|---|---|
| 01 inquiry | | 02, divider u16, four bytes of configuration, number of channels, buffer size, their numbers |
| 05 rate | divider u16 | |
| 07 start, 20 stop | | |
| 08 sensors | 24 bits | |
| 21 GSR range, 37 magnetometer gain, 49 gyroscope range, 5E expansion power | u8 | |
| A3 acknowledgements before answers while it streams | u8 | |
| 2C calibration | | 2D, 4 x 21 bytes |
| 2E firmware | | 2F, kind u16, major u16, minor, patch |
| 3E serial number | | 3D, 8 bytes |
| 3F hardware | | 25, u8 |
| 61 converter | chip, first, n, n registers | |
| 63 converter | chip, first, n | 62, n, registers |
| 66 board | n, first | 65, n, bytes |
| 72 status, 95 battery | | 8A 71 u8; 8A 94, counts u16, u8 |

A packet: 00, time u24 in 1/32768 s, then the channels in the order of the inquiry.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sensor_bench.shimmer.body import GAIN_CODES, LN_ACCELEROMETER, MAGNETOMETER, Body, Counts, gyroscope
from sensor_bench.signals.waveforms import FloatArray

CLOCK_HZ = 32768
ARGUMENTS = {0x05: 2, 0x08: 3, 0x21: 1, 0x37: 1, 0x49: 1, 0x5E: 1, 0x63: 3, 0x66: 2, 0xA3: 1}
SENSOR_CHANNELS = (  # bit, channels in the order in which the firmware sends them
    (0x000080, (0x00, 0x01, 0x02)),
    (0x002000, (0x03,)),
    (0x000100, (0x12,)),
    (0x000004, (0x1C,)),
    (0x000040, (0x0A, 0x0B, 0x0C)),
    (0x000020, (0x07, 0x09, 0x08)),
    (0x000010, (0x1D, 0x1E, 0x1F)),
    (0x000008, (0x20, 0x21, 0x22)),
)
BIG_ENDIAN = {0x07, 0x08, 0x09, 0x0A, 0x0B, 0x0C, 0x1E, 0x1F, 0x21, 0x22}
WIDTHS = {0x1D: 1, 0x20: 1, 0x1E: 3, 0x1F: 3, 0x21: 3, 0x22: 3}
GAUSS_COUNTS = {1: 1100.0, 2: 855.0, 3: 670.0, 4: 450.0, 5: 400.0, 6: 330.0, 7: 230.0}  # of the LSM303DLHC, by gain
BTSTREAM = 1
LONGEST_S = 1.0  # of packets made at once
Carry = Callable[..., bytes]


@dataclass
class Memory:
    """What a Shimmer keeps while it is off, with what it is delivered with."""

    serial_number: bytes = bytes.fromhex("0a1b2c3d4e5f6071")
    board: bytes = bytes([48, 2, 0])  # a GSR+ board of a revision with the LSM303DLHC
    hardware: int = 3
    firmware: tuple[int, int, int, int] = (3, 0, 16, 9)
    battery_v: float = 3.9
    divider: int = 640
    sensors: int = 0x000080
    gsr_range: int = 0
    gyro_range: int = 1
    mag_gain: int = 1
    expansion_power: int = 0
    exg: list[bytearray] = field(default_factory=lambda: [bytearray(10), bytearray(10)])

    @property
    def battery_counts(self) -> int:
        """As the converter sees it, behind a divider by two."""
        return round(self.battery_v / 2 / 3.0 * 4095)


class VirtualShimmer:
    """One Shimmer3 that has just been switched on.

    on_s: true time of that, since the bench's start. skew_ppm: what its clock gains. clock_start: ticks it shows at
    first. carry(packet, **samples of each sensor): the packet as it leaves the device, or nothing where it is lost.
    """

    def __init__(
        self,
        body: Body,
        memory: Memory,
        carry: Carry,
        on_s: float = 0.0,
        skew_ppm: float = 0.0,
        clock_start: int = 0,
    ) -> None:
        self._body, self.memory, self._carry, self._on_s = body, memory, carry, on_s
        self._rate_hz = CLOCK_HZ * (1 + skew_ppm * 1e-6)
        self._clock_start = clock_start
        self._received = bytearray()
        self._next: int | None = None  # ticks of the next sample; None while it does not stream

    @property
    def streaming(self) -> bool:
        return self._next is not None

    def ticks(self, time_s: float) -> int:
        """What its clock shows, not wrapped, time_s after it was switched on."""
        return self._clock_start + math.floor(time_s * self._rate_hz)

    def true_s(self, ticks: int) -> float:
        """True time since the bench's start at which its clock shows so many ticks, not wrapped."""
        return self._on_s + (ticks - self._clock_start) / self._rate_hz

    def receive(self, octets: bytes, time_s: float) -> bytes:
        """Obey what the host wrote; the answer."""
        self._received += octets
        said = b""
        while self._received and (length := self._length()) <= len(self._received):
            command, arguments = self._received[0], bytes(self._received[1:length])
            del self._received[:length]
            said += self._obey(command, arguments, time_s)
        return said

    def _length(self) -> int:
        """How many bytes the command has that comes now, with itself."""
        command = self._received[0]
        if command == 0x61:
            return 4 + (self._received[3] if len(self._received) > 3 else 0)
        return 1 + ARGUMENTS.get(command, 0)

    def send(self, time_s: float) -> bytes:
        """All packets whose samples have been taken since it was asked last."""
        now, said = self.ticks(time_s), b""
        while self._next is not None and self._next <= now:
            most = math.ceil(LONGEST_S * CLOCK_HZ / self.memory.divider)
            count = min(most, (now - self._next) // self.memory.divider + 1)
            ticks = self._next + self.memory.divider * np.arange(count)
            said += self._packets(ticks)
            self._next += self.memory.divider * count
        return said

    def _packets(self, ticks: Counts) -> bytes:
        times_s = self._on_s + (ticks - self._clock_start) / self._rate_hz
        columns = [np.zeros((len(ticks), 1), np.uint8), _octets(ticks % (1 << 24), 3, big=False)]
        columns += [
            _octets(self._counts(channel, times_s), WIDTHS.get(channel, 2), channel in BIG_ENDIAN)
            for channel in self._channels()
        ]
        samples = dict.fromkeys(self._sampled(), 1)
        return b"".join(self._carry(packet.tobytes(), **samples) for packet in np.hstack(columns))

    def _sampled(self) -> list[str]:
        """The sensors in a packet, by the sensor type of what they measure."""
        channels = self._channels()
        exg = ["emg" if self._muscle() else "ecg"] if 0x1E in channels else []
        return [name for name, channel in NAMES.items() if channel in channels] + exg

    def _muscle(self) -> bool:
        """True where the first converter is wired for EMG."""
        return self.memory.exg[0][3] & 0x0F == 9

    def _channels(self) -> list[int]:
        return [each for bit, channels in SENSOR_CHANNELS if self.memory.sensors & bit for each in channels]

    def _counts(self, channel: int, times_s: FloatArray) -> Counts:
        body, exg = self._body, self.memory.exg
        if channel in (0x00, 0x01, 0x02):
            return _whole(LN_ACCELEROMETER.counts(body.acceleration(times_s))[:, channel])
        if channel in (0x07, 0x08, 0x09):
            share = GAUSS_COUNTS[self.memory.mag_gain] / GAUSS_COUNTS[1]
            return _whole(share * MAGNETOMETER.counts(body.field(times_s))[:, channel - 0x07])
        if channel in (0x0A, 0x0B, 0x0C):
            return _whole(gyroscope(self.memory.gyro_range).counts(body.rotation(times_s))[:, channel - 0x0A])
        if channel == 0x1C:
            return body.gsr(times_s)
        if channel == 0x12:
            return body.optical(times_s) * (self.memory.expansion_power & 1)
        if channel in (0x1D, 0x20):
            return np.full(len(times_s), 0x80)
        if channel == 0x03:
            return np.full(len(times_s), self.memory.battery_counts)
        chip, place = (0, channel - 0x1E) if channel < 0x20 else (1, channel - 0x21)
        gain = GAIN_CODES[exg[chip][3 + place] >> 4 & 7]
        return _whole(body.exg_uv(chip, place, times_s, self._muscle()) * gain * (2**23 - 1) / 2.42e6)

    def _obey(self, command: int, arguments: bytes, time_s: float) -> bytes:
        if command == 0x95 and self.memory.firmware[0] == BTSTREAM:
            return b""  # unknown to it
        if self.streaming and command not in (0x20, 0x72, 0x95, 0x2E, 0x3F):
            return b"\xfe"
        self._set(command, arguments, time_s)
        return b"\xff" + self._answer(command, arguments)

    def _set(self, command: int, arguments: bytes, time_s: float) -> None:
        memory = self.memory
        number = int.from_bytes(arguments[:3], "little")
        if command == 0x05:
            memory.divider = number
        elif command == 0x08:
            memory.sensors = number
        elif command == 0x21:
            memory.gsr_range = number
        elif command == 0x37:
            memory.mag_gain = number
        elif command == 0x49:
            memory.gyro_range = number
        elif command == 0x5E:
            memory.expansion_power = number
        elif command == 0x61:
            chip, first, count = arguments[:3]
            memory.exg[chip][first : first + count] = arguments[3:]
        elif command == 0x07:
            self._next = self.ticks(time_s) + memory.divider
        elif command == 0x20:
            self._next = None

    def _answer(self, command: int, arguments: bytes) -> bytes:
        memory = self.memory
        if command == 0x01:
            setup = bytes([0, 0, memory.gyro_range, memory.gsr_range << 1 | memory.expansion_power])
            channels = bytes(self._channels())
            return b"\x02" + memory.divider.to_bytes(2, "little") + setup + bytes([len(channels), 1]) + channels
        if command == 0x2C:
            unset = b"\xff" * 21
            turning = gyroscope(memory.gyro_range).stored(100.0)
            return b"\x2d" + LN_ACCELEROMETER.stored() + turning + MAGNETOMETER.stored() + unset
        if command == 0x2E:
            kind, major, minor, patch = memory.firmware
            return b"\x2f" + kind.to_bytes(2, "little") + major.to_bytes(2, "little") + bytes([minor, patch])
        if command == 0x3E:
            return b"\x3d" + memory.serial_number
        if command == 0x3F:
            return bytes([0x25, memory.hardware])
        if command == 0x63:
            chip, first, count = arguments
            return bytes([0x62, count]) + memory.exg[chip][first : first + count]
        if command == 0x66:
            return bytes([0x65, arguments[0]]) + memory.board[arguments[1] :][: arguments[0]]
        if command == 0x72:
            return bytes([0x8A, 0x71, 0x12 if self.streaming else 0])
        if command == 0x95:
            return b"\x8a\x94" + memory.battery_counts.to_bytes(2, "little") + b"\x80"
        return b""


NAMES = {"eda": 0x1C, "ppg": 0x12, "accelerometer": 0x00, "gyroscope": 0x0A, "magnetometer": 0x07}


def _whole(values: FloatArray) -> Counts:
    return np.rint(values).astype(np.int64)


def _octets(values: Counts, width: int, big: bool) -> np.ndarray:
    """Each value as `width` bytes, shape (n, width)."""
    shifts = 8 * np.arange(width)[:: -1 if big else 1]
    return (np.asarray(values)[:, None] >> shifts & 0xFF).astype(np.uint8)
