"""Bytes a Polar device sends: PMD data frames, settings, control-point responses, heart-rate measurements.

Written from the tables of Polar's published documents (byte layouts, no code), independently of any decoder in this
repository. All multi-byte numbers are little endian.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]

ATT_OVERHEAD = 3
HEADER_BYTES = 10
RESPONSE = 0xF0
FEATURES = 0x0F
STOPPED_BY_DEVICE = 0x01


class Measurement(IntEnum):
    ECG = 0
    PPG = 1
    ACC = 2
    PPI = 3
    GYRO = 5
    MAG = 6
    SDK_MODE = 9


class Command(IntEnum):
    GET_SETTINGS = 1
    START = 2
    STOP = 3
    GET_SDK_SETTINGS = 4
    GET_STATUS = 5
    GET_SDK_STATUS = 6


class Status(IntEnum):
    SUCCESS = 0
    INVALID_OP = 1
    INVALID_MEASUREMENT = 2
    NOT_SUPPORTED = 3
    INVALID_LENGTH = 4
    INVALID_PARAMETER = 5
    ALREADY_IN_STATE = 6
    INVALID_RESOLUTION = 7
    INVALID_RATE = 8
    INVALID_RANGE = 9
    INVALID_MTU = 10
    INVALID_CHANNELS = 11
    INVALID_STATE = 12


class Setting(IntEnum):
    RATE = 0
    RESOLUTION = 1
    RANGE = 2
    RANGE_MILLI = 3
    CHANNELS = 4
    FACTOR = 5


SETTING_BYTES = {
    Setting.RATE: 2,
    Setting.RESOLUTION: 2,
    Setting.RANGE: 2,
    Setting.RANGE_MILLI: 4,
    Setting.CHANNELS: 1,
    Setting.FACTOR: 4,
}


class MalformedCommand(ValueError):
    """The host wrote settings that end in the middle or have an unknown type."""


# --- control point -------------------------------------------------------------------------------------------------


def features(measurements: Sequence[Measurement]) -> bytes:
    """The 17 bytes a read of the control point returns: from the second byte on, bit t says that type t is there."""
    bits = sum(1 << kind for kind in measurements)
    return bytes([FEATURES]) + bits.to_bytes(16, "little")


def response(command: int, kind: int, status: Status, parameters: bytes = b"", more: bool = False) -> bytes:
    """`F0 command type status more parameters`."""
    return bytes([RESPONSE, command, kind, status, more]) + parameters


def paged_responses(command: int, kind: int, parameters: bytes, page_bytes: int) -> list[bytes]:
    """A successful response in packets of at most `page_bytes` parameter bytes, all but the last marked `more`."""
    pages = [parameters[i : i + page_bytes] for i in range(0, len(parameters), page_bytes)] or [b""]
    last = len(pages) - 1
    return [response(command, kind, Status.SUCCESS, page, more=i < last) for i, page in enumerate(pages)]


def stopped_by_device(measurements: Sequence[Measurement]) -> bytes:
    """The unsolicited indication that the device itself ended these streams."""
    return bytes([STOPPED_BY_DEVICE, *measurements])


def settings(values: Mapping[Setting, Sequence[float]]) -> bytes:
    """Settings as `type count value*count`, in the order given."""
    parts = bytearray()
    for setting, offered in values.items():
        parts += bytes([setting, len(offered)])
        for value in offered:
            size = SETTING_BYTES[setting]
            parts += struct.pack("<f", value) if setting is Setting.FACTOR else int(value).to_bytes(size, "little")
    return bytes(parts)


def parse_settings(data: bytes) -> dict[Setting, list[int]]:
    """The settings in a start command of the host."""
    found: dict[Setting, list[int]] = {}
    at = 0
    while at < len(data):
        if len(data) - at < 2 or data[at] not in SETTING_BYTES or data[at] == Setting.FACTOR:
            raise MalformedCommand(f"settings {data.hex(' ')}: byte {at} begins no setting")
        setting, count = Setting(data[at]), data[at + 1]
        end = at + 2 + count * SETTING_BYTES[setting]
        if end > len(data):
            raise MalformedCommand(f"settings {data.hex(' ')}: {setting.name} is cut off")
        size = SETTING_BYTES[setting]
        found[setting] = [int.from_bytes(data[i : i + size], "little") for i in range(at + 2, end, size)]
        at = end
    return found


# --- data frames ---------------------------------------------------------------------------------------------------


def frame(kind: Measurement, device_ns: int, frame_type: int, content: bytes, compressed: bool = False) -> bytes:
    """A data notification; `device_ns` is the time of the last sample in it."""
    return bytes([kind]) + struct.pack("<Q", device_ns) + bytes([frame_type | (0x80 if compressed else 0)]) + content


def signed_content(samples: IntArray, size: int) -> bytes:
    """Samples (n, channels) as signed integers of `size` bytes, channels interleaved: raw ECG 0, ACC 0-2, PPG 0."""
    wide = np.ascontiguousarray(samples, dtype="<i4").view(np.uint8).reshape(-1, 4)
    limit = 1 << (8 * size - 1)
    if samples.size and not (-limit <= samples.min() and samples.max() < limit):
        raise ValueError(f"sample outside {size} signed bytes: {samples.min()}..{samples.max()}")
    return wide[:, :size].tobytes()


class Block(NamedTuple):
    """One run of deltas of equal bit width."""

    width: int
    length: int


def delta_width(deltas: IntArray) -> int:
    """The smallest two's-complement width that holds all `deltas`; 0 where all are 0, and never 1.

    Width 1 is legal, but Polar's own reference decoder reads it wrongly, so no device is likely to send it.
    """
    if not deltas.any():
        return 0
    low, high = int(deltas.min()), int(deltas.max())
    return max(2, 1 + max(high.bit_length(), (~low).bit_length() if low < 0 else 0))


def pack_deltas(deltas: IntArray, width: int) -> bytes:
    """Deltas, channels interleaved, as fields of `width` bits, least significant bit first across bytes."""
    if width == 0:
        return b""
    bits = (deltas.reshape(-1, 1) >> np.arange(width)) & 1
    return np.packbits(bits.astype(np.uint8).ravel(), bitorder="little").tobytes()


def delta_content(samples: IntArray, reference_bytes: int, blocks: Sequence[Block]) -> bytes:
    """Samples (1 + sum of block lengths, channels): the first one in full, then blocks of deltas.

    With 4 reference bytes the arithmetic is that of wrapping 32-bit integers.
    """
    steps = np.diff(samples, axis=0)
    if reference_bytes == 4:
        steps = steps.astype(np.int32).astype(np.int64)
    parts = bytearray(b"".join(int(v).to_bytes(reference_bytes, "little", signed=True) for v in samples[0]))
    at = 0
    for width, length in blocks:
        parts += bytes([width, length]) + pack_deltas(steps[at : at + length], width)
        at += length
    return bytes(parts)


def fit_delta(samples: IntArray, reference_bytes: int, budget: int, block_length: int = 16) -> tuple[bytes, int]:
    """As many of `samples` (n, channels) as fit `budget` bytes of delta content, in blocks of their smallest width.

    Returns the content and the number of samples in it (at least one).
    """
    steps = np.diff(samples, axis=0)
    channels = samples.shape[1]
    left = budget - channels * reference_bytes
    blocks: list[Block] = []
    at = 0
    while at < len(steps):
        count = min(block_length, len(steps) - at)
        width = delta_width(steps[at : at + count])
        if 2 + math.ceil(width * count * channels / 8) > left:
            count = (left - 2) * 8 // (width * channels) if width else 0
            if count < 1:
                break
            blocks.append(Block(width, count))
            at += count
            break
        blocks.append(Block(width, count))
        left -= 2 + math.ceil(width * count * channels / 8)
        at += count
    return delta_content(samples[: at + 1], reference_bytes, blocks), at + 1


class PulseInterval(NamedTuple):
    """One sample of the PPI stream."""

    heart_rate_bpm: int
    interval_ms: int
    error_ms: int
    blocked: bool = False
    contact: bool = True
    contact_supported: bool = True


def ppi_content(intervals: Sequence[PulseInterval]) -> bytes:
    """Six bytes per interval: rate, interval, error estimate, flags."""
    return b"".join(
        struct.pack(
            "<BHHB",
            x.heart_rate_bpm,
            x.interval_ms,
            x.error_ms,
            x.blocked | x.contact << 1 | x.contact_supported << 2,
        )
        for x in intervals
    )


# --- Heart Rate Measurement, characteristic 2A37 ----------------------------------------------------------------------
