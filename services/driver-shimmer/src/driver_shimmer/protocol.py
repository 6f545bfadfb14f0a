"""Bytes of a Shimmer3 (LogAndStream, BtStream): commands, answers, and what stands where in a data packet; no I/O.

Every command is acknowledged with FF; what was asked for follows. Numbers are little endian unless said. Packets of
data are found by `packets.py`, what their counts mean in units is in `calibration.py`.
"""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

TICKS_HZ = 32768  # of the device's clock
CLOCK_BITS = 24  # it wraps after 512 s
ACK, NACK, IN_STREAM = 0xFF, 0xFE, 0x8A
HEAD = 4  # bytes of a packet before its channels: 00, time
SHIMMER3, BTSTREAM, LOG_AND_STREAM = 3, 1, 3
OLDEST = {BTSTREAM: (0, 7, 3), LOG_AND_STREAM: (0, 5, 4)}  # firmware that sends times of 24 bits
AUTO_RANGE = 4  # of the GSR amplifier
GAIN_1_3_GAUSS = 1  # of the LSM303DLHC's magnetometer, its most sensitive; the LSM303AHTR has one gain only
Counts = NDArray[np.int64]


class Command(IntEnum):
    """What the host sends; GET_ ones are answered."""

    INQUIRY = 0x01
    SET_RATE = 0x05
    START = 0x07
    SET_SENSORS = 0x08
    STOP = 0x20
    SET_GSR_RANGE = 0x21
    GET_CALIBRATION = 0x2C
    GET_FIRMWARE = 0x2E
    SET_MAG_GAIN = 0x37
    GET_SERIAL = 0x3E
    GET_HARDWARE = 0x3F
    SET_GYRO_RANGE = 0x49
    SET_EXPANSION_POWER = 0x5E
    SET_EXG = 0x61
    GET_EXG = 0x63
    GET_BOARD = 0x66
    GET_STATUS = 0x72
    GET_BATTERY = 0x95


STATUS, BATTERY = 0x71, 0x94
IN_STREAM_BYTES = {STATUS: 1, BATTERY: 3}
ANSWERS = {
    Command.INQUIRY: 0x02,
    Command.GET_CALIBRATION: 0x2D,
    Command.GET_FIRMWARE: 0x2F,
    Command.GET_SERIAL: 0x3D,
    Command.GET_HARDWARE: 0x25,
    Command.GET_EXG: 0x62,
    Command.GET_BOARD: 0x65,
    Command.GET_STATUS: STATUS,
    Command.GET_BATTERY: BATTERY,
}
FIXED_BYTES = {0x2D: 84, 0x2F: 6, 0x3D: 8, 0x25: 1}
COUNTED = (0x62, 0x65)  # their first byte says how many follow
INQUIRY_BYTES, CHANNEL_COUNT = 8, 6  # before the channels; where their number stands


class Refused(FrameError):
    """The device answered a command with FE."""


def take_answer(buffer: bytearray, command: Command) -> bytes | None:
    """Take the acknowledgement out of the buffer, and the answer where the command has one; None while it is not whole.

    What comes before it, and what the device says unasked of its status, is passed over. Raises Refused.
    """
    code = ANSWERS.get(command)
    while buffer:
        if buffer[0] == NACK:
            del buffer[0]
            raise Refused(f"command {command:02x} ({command.name}) was refused")
        if buffer[0] != ACK:
            del buffer[0]
        elif code is None:
            del buffer[0]
            return b""
        elif code in IN_STREAM_BYTES or buffer[1:2] != bytes([IN_STREAM]):
            return _content(buffer, code)
        else:
            if len(buffer) < 4:
                return None
            del buffer[:4]  # its status, unasked
    return None


def _content(buffer: bytearray, code: int) -> bytes | None:
    head = bytes([ACK, IN_STREAM, code] if code in IN_STREAM_BYTES else [ACK, code])
    rest = buffer[len(head) :]
    length = _length(code, rest)
    if len(buffer) < len(head) or length is None or len(rest) < length:
        return None
    if not buffer.startswith(head):
        raise FrameError(f"answer {bytes(buffer[:8]).hex()}, expected {head.hex()}")
    content = bytes(rest[:length])
    del buffer[: len(head) + length]
    return content[1:] if code in COUNTED else content


def _length(code: int, rest: bytearray) -> int | None:
    """Return how many bytes an answer has; None while that is not known."""
    if code in COUNTED:
        return 1 + rest[0] if rest else None
    if code == ANSWERS[Command.INQUIRY]:
        return INQUIRY_BYTES + rest[CHANNEL_COUNT] if len(rest) > CHANNEL_COUNT else None
    return IN_STREAM_BYTES.get(code, FIXED_BYTES.get(code))


class Firmware(NamedTuple):
    """kind: 1 BtStream, 2 SDLog, 3 LogAndStream; version: major, minor, patch."""

    kind: int
    version: tuple[int, int, int]

    @property
    def text(self) -> str:
        """As printed by Shimmer: LogAndStream 0.16.0."""
        names = {BTSTREAM: "BtStream", 2: "SDLog", LOG_AND_STREAM: "LogAndStream"}
        name = names.get(self.kind, f"firmware {self.kind}")
        return f"{name} {'.'.join(map(str, self.version))}"

    @property
    def spoken(self) -> bool:
        """True for firmware whose data packets are those of this module."""
        return self.kind in OLDEST and self.version >= OLDEST[self.kind]

    @property
    def tells_battery(self) -> bool:
        """True for firmware that answers GET_BATTERY; BtStream does not."""
        return self.kind == LOG_AND_STREAM


def decode_firmware(content: bytes) -> Firmware:
    """Return kind and version from the answer 2F."""
    major = int.from_bytes(content[2:4], "little")
    return Firmware(int.from_bytes(content[:2], "little"), (major, content[4], content[5]))


class Inquiry(NamedTuple):
    """divider: of 32768 Hz, makes the sampling rate; channels: the numbers of what a packet holds, in its order."""

    divider: int
    channels: tuple[int, ...]


def decode_inquiry(content: bytes) -> Inquiry:
    """Return what the device samples, from the answer 02."""
    return Inquiry(int.from_bytes(content[:2], "little"), tuple(content[INQUIRY_BYTES:]))


class Status(NamedTuple):
    """What the device says of itself in one byte."""

    docked: bool
    sensing: bool
    logging: bool
    streaming: bool


def decode_status(content: bytes) -> Status:
    """Return the bits of the answer 71."""
    return Status(*(bool(content[0] & bit) for bit in (0x01, 0x02, 0x08, 0x10)))


class Form(NamedTuple):
    """How a channel is written: number of bytes, little or big endian, signed or not."""

    octets: int
    big: bool = False
    signed: bool = False


_ADC, _LITTLE, _BIG, _EXG = Form(2), Form(2, signed=True), Form(2, True, True), Form(3, True, True)
FORMS: dict[int, Form] = {
    **dict.fromkeys((0x00, 0x01, 0x02, 0x03, *range(0x0D, 0x14), 0x1C, 0x27, 0x28), _ADC),
    **dict.fromkeys((0x04, 0x05, 0x06, *range(0x14, 0x1A)), _LITTLE),
    **dict.fromkeys((*range(0x07, 0x0D), *range(0x23, 0x27)), _BIG),
    0x1A: Form(2, big=True),
    0x1B: Form(3, big=True),
    0x1D: Form(1),
    0x20: Form(1),
    **dict.fromkeys((0x1E, 0x1F, 0x21, 0x22), _EXG),
}
MAGNETOMETER = (0x07, 0x08, 0x09)
CHANNELS: dict[str, tuple[int, ...]] = {
    "eda": (0x1C,),
    "ppg": (0x12,),
    "ecg": (0x1E, 0x1F, 0x22),
    "emg": (0x1E, 0x1F),
    "accelerometer": (0x00, 0x01, 0x02),
    "gyroscope": (0x0A, 0x0B, 0x0C),
    "magnetometer": MAGNETOMETER,
}
SENSORS = {  # bits of SET_SENSORS
    "eda": 0x000004,
    "ppg": 0x000100,
    "ecg": 0x000018,
    "emg": 0x000010,
    "accelerometer": 0x000080,
    "gyroscope": 0x000040,
    "magnetometer": 0x000020,
}


class Layout:
    """Where the channels of a packet stand.

    little_magnetometer: the board has an LSM303AHTR, whose counts are little endian. Raises FrameError for a channel of
    unknown width: nothing behind it could be found.
    """

    def __init__(self, channels: Sequence[int], little_magnetometer: bool = False) -> None:
        self._places: dict[int, tuple[int, Form]] = {}
        self.length = HEAD
        for channel in channels:
            if channel not in FORMS:
                raise FrameError(f"channel {channel:02x}, of which nobody knows how many bytes it has")
            form = _LITTLE if little_magnetometer and channel in MAGNETOMETER else FORMS[channel]
            self._places[channel] = self.length, form
            self.length += form.octets

    def missing(self, sensor_types: Sequence[str]) -> list[str]:
        """Return those of which a channel is not in the packet."""
        return [each for each in sensor_types if not set(CHANNELS[each]) <= set(self._places)]

    def counts(self, packets: Sequence[bytes], sensor_types: Sequence[str]) -> Mapping[str, Counts]:
        """Return by sensor type what the packets hold, shape (packets, channels)."""
        octets = np.frombuffer(b"".join(packets), np.uint8).reshape(-1, self.length).astype(np.int64)
        return {
            each: np.stack([self._channel(octets, channel) for channel in CHANNELS[each]], axis=1)
            for each in sensor_types
        }

    def _channel(self, octets: Counts, channel: int) -> Counts:
        at, form = self._places[channel]
        order = range(form.octets) if form.big else reversed(range(form.octets))
        value = np.zeros(len(octets), np.int64)
        for place in order:
            value = value << 8 | octets[:, at + place]
        half = 1 << (8 * form.octets - 1)
        return (value ^ half) - half if form.signed else value


def set_rate(divider: int) -> bytes:
    """Return the command that samples at 32768 / divider Hz."""
    return bytes([Command.SET_RATE]) + divider.to_bytes(2, "little")


def set_sensors(sensor_types: Sequence[str]) -> bytes:
    """Return the command that enables these sensors, and no others."""
    bits = sum(SENSORS[each] for each in sensor_types)
    return bytes([Command.SET_SENSORS]) + bits.to_bytes(3, "little")


def divider_of(rate_hz: float) -> int:
    """Return the divider whose rate is nearest."""
    return round(TICKS_HZ / rate_hz)
