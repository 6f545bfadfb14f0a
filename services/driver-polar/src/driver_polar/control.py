"""Commands, responses and settings of the PMD control point; no I/O, no clock.

A command is `op measurement [settings]`; the answer is `F0 op measurement status [more] [parameters]`. Settings are
`type count value*count`, little endian, in any order.
"""

import struct
from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from sense4hri.errors import FrameError

from driver_polar.protocol import Measurement

RESPONSE, FEATURES, STOPPED = 0xF0, 0x0F, 0x01  # first byte of what the control point holds or indicates


class Op(IntEnum):
    """Commands."""

    GET_SETTINGS = 1
    START = 2
    STOP = 3
    GET_SDK_SETTINGS = 4
    GET_MEASUREMENT_STATUS = 5
    GET_SDK_STATUS = 6


class ResponseStatus(IntEnum):
    """How the device answered."""

    SUCCESS = 0
    INVALID_OP_CODE = 1
    INVALID_MEASUREMENT_TYPE = 2
    NOT_SUPPORTED = 3
    INVALID_LENGTH = 4
    INVALID_PARAMETER = 5
    ALREADY_IN_STATE = 6
    INVALID_RESOLUTION = 7
    INVALID_SAMPLE_RATE = 8
    INVALID_RANGE = 9
    INVALID_MTU = 10
    INVALID_NUMBER_OF_CHANNELS = 11
    INVALID_STATE = 12
    DEVICE_IN_CHARGER = 13
    DISK_FULL = 14


class Setting(IntEnum):
    """Types of a setting; rate in Hz, resolution in bits, range in g, degrees/s or gauss."""

    SAMPLE_RATE = 0
    RESOLUTION = 1
    RANGE = 2
    RANGE_MILLI = 3
    CHANNELS = 4
    FACTOR = 5
    SECURITY = 6


SIZES = {
    Setting.SAMPLE_RATE: 2,
    Setting.RESOLUTION: 2,
    Setting.RANGE: 2,
    Setting.RANGE_MILLI: 4,
    Setting.CHANNELS: 1,
    Setting.FACTOR: 4,
    Setting.SECURITY: 16,
}
Settings = Mapping[Setting, tuple[float, ...]]


class Response(NamedTuple):
    """One answer of the control point. status may be a number no document names; more: another packet follows."""

    op: int
    measurement: int
    status: int
    more: bool
    parameters: bytes

    @property
    def status_name(self) -> str:
        """The status in words."""
        known = self.status in ResponseStatus._value2member_map_
        return ResponseStatus(self.status).name if known else f"status {self.status}"


def command(op: Op, measurement: Measurement, settings: Settings | None = None) -> bytes:
    """Return the bytes of a command; settings belong to START alone."""
    return bytes([op, measurement]) + b"".join(_setting(kind, values) for kind, values in (settings or {}).items())


def _setting(kind: Setting, values: tuple[float, ...]) -> bytes:
    if kind is Setting.FACTOR:
        return bytes([kind, len(values)]) + struct.pack(f"<{len(values)}f", *values)
    return bytes([kind, len(values)]) + b"".join(int(value).to_bytes(SIZES[kind], "little") for value in values)


def parse_response(value: bytes) -> Response:
    """Take an answer apart. Raises FrameError for anything that is none.

    An H10 whose link has too small an MTU answers in four bytes (F0 00 01 0A); the fifth may be missing.
    """
    if len(value) < 4 or value[0] != RESPONSE:
        raise FrameError(f"no control point response: {value.hex()}")
    return Response(value[1], value[2] & 0x3F, value[3], len(value) > 4 and value[4] != 0, value[5:])


def parse_stopped(value: bytes) -> tuple[int, ...]:
    """Return the measurements a device says it has stopped by itself; may be empty. Raises FrameError otherwise."""
    if not value or value[0] != STOPPED:
        raise FrameError(f"no notice of stopped measurements: {value.hex()}")
    return tuple(kind & 0x3F for kind in value[1:])


def parse_features(value: bytes) -> frozenset[Measurement]:
    """Return what the device can measure, from reading the control point. Raises FrameError for anything else."""
    if len(value) < 3 or value[0] != FEATURES:
        raise FrameError(f"no list of features: {value.hex()}")
    mask = int.from_bytes(value[1:3], "little")
    return frozenset(kind for kind in Measurement if mask >> kind & 1)


def parse_settings(parameters: bytes) -> dict[Setting, tuple[float, ...]]:
    """Return every setting with its values; one byte or none is a reserved byte, no setting.

    Raises FrameError where a type is unknown (its size is, too) or the bytes end early.
    """
    settings: dict[Setting, tuple[float, ...]] = {}
    at = 0
    while at < len(parameters) and len(parameters) > 1:
        if parameters[at] not in SIZES or at + 1 >= len(parameters):
            raise FrameError(f"setting at byte {at} of {parameters.hex()} is unknown or cut")
        kind, count = Setting(parameters[at]), parameters[at + 1]
        end = at + 2 + count * SIZES[kind]
        if end > len(parameters):
            raise FrameError(f"setting {kind.name} with {count} values is cut: {parameters.hex()}")
        settings[kind] = _values(kind, parameters[at + 2 : end])
        at = end
    return settings


def _values(kind: Setting, octets: bytes) -> tuple[float, ...]:
    if kind is Setting.FACTOR:
        return struct.unpack(f"<{len(octets) // 4}f", octets)
    size = SIZES[kind]
    return tuple(int.from_bytes(octets[at : at + size], "little") for at in range(0, len(octets), size))


class Activity(NamedTuple):
    """One byte of a measurement status answer: what a measurement is doing."""

    measurement: int
    online: bool
    offline: bool


def parse_activity(byte: int) -> Activity:
    """Decode one status byte: bit 6 streams online, bit 7 records offline, the rest is the measurement."""
    return Activity(byte & 0x3F, bool(byte & 0x40), bool(byte & 0x80))
