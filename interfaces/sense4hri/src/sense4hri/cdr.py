"""Messages as serialised bytes (CDR), read and written without generated classes: several times faster.

Four bytes of encapsulation (the second one: 0 big, 1 little endian), then the fields, aligned from there on.
"""

import struct
from collections import Counter
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sense4hri.stamps import SECOND_NS

LARGEST_NAME, MOST_CHANNELS = 4096, 10_000
_ENCAPSULATION = 4
_PLAIN_CDR = (0, 1)
_LITTLE_ENDIAN, _NUMBER, _TIME = b"\0\1\0\0", struct.Struct("<I"), struct.Struct("<iI")  # of what is written
_STRUCTS = {order: (struct.Struct(order + "I"), struct.Struct(order + "iI")) for order in "<>"}
_RAW_STRUCTS = {o: (struct.Struct(o + "I"), struct.Struct(o + "iII"), np.dtype(o + "f8")) for o in "<>"}


def header_ns(message: bytes) -> int:
    """The header stamp of a message that begins with a Header, in ns of ROS time; 0 where it has none."""
    if not _begins_plainly(message):
        return 0
    seconds, nanoseconds = _time(message).unpack_from(message, _ENCAPSULATION)
    return int(seconds) * SECOND_NS + int(nanoseconds)


def with_header_ns(message: bytes, stamp_ns: int) -> bytes:
    """A message that begins with a Header, with this ROS time in its stamp where that was zero."""
    if not _begins_plainly(message) or any(message[4:12]):
        return message
    seconds, nanoseconds = divmod(stamp_ns, SECOND_NS)
    if not 0 <= seconds < 1 << 31:
        return message
    return message[:4] + _time(message).pack(seconds, nanoseconds) + message[12:]


def stamps_ns(message: bytes) -> tuple[int, int]:
    """(receipt, device) stamp in ns of a message that begins `Header header; Time device_timestamp`.

    Device 0: the device gives no time. Raises struct.error where the message is shorter than that.
    """
    number, time = _STRUCTS["<" if message[1] & 1 else ">"]
    seconds, nanoseconds = time.unpack_from(message, _ENCAPSULATION)
    (length,) = number.unpack_from(message, _ENCAPSULATION + 8)
    device_s, device_ns = time.unpack_from(message, _ENCAPSULATION + 12 + _up(length, 4))
    return seconds * SECOND_NS + nanoseconds, device_s * SECOND_NS + device_ns


def write_raw(frame_id: str, raw: "RawMessage") -> bytes:
    """Serialise a PhysioRaw as the middleware does; what pads it is zero.

    Raises ValueError where there is no sample, a Time cannot hold a stamp, or names are more or fewer than columns.
    """
    if not len(raw.samples):
        raise ValueError("a raw message without samples")
    blank, device_at, columns_at = _blank_raw(frame_id, raw.channels, len(raw.samples))
    message, octets = bytearray(blank), 8 * len(raw.samples)
    try:
        _TIME.pack_into(message, _ENCAPSULATION, *divmod(raw.received_ns, SECOND_NS))
        _TIME.pack_into(message, device_at, *divmod(raw.device_ns, SECOND_NS))
    except struct.error as err:
        raise ValueError(f"stamps of {raw.received_ns} and {raw.device_ns} ns: a Time holds no such") from err
    columns = raw.samples.T.astype("<f8", copy=False).tobytes()  # all at once: a column alone costs as much
    for at, number in zip(columns_at, range(raw.samples.shape[1]), strict=True):
        message[at : at + octets] = columns[number * octets : (number + 1) * octets]
    return bytes(message)


@lru_cache(maxsize=256)
def _blank_raw(frame_id: str, channels: tuple[str, ...], samples: int) -> tuple[bytes, int, tuple[int, ...]]:
    """Return a PhysioRaw with zeros for stamps and samples, where its device time and where each channel begin."""
    message = bytearray(_LITTLE_ENDIAN + bytes(_TIME.size) + _string(frame_id))
    message += bytes(-len(message) % 4)
    device_at, columns_at = len(message), []
    message += bytes(_TIME.size) + _NUMBER.pack(len(channels))
    for name in channels:
        message += bytes(-len(message) % 4) + _string(name)
        message += bytes(-len(message) % 4) + _NUMBER.pack(samples)
        message += bytes((_ENCAPSULATION - len(message)) % 8)
        columns_at.append(len(message))
        message += bytes(8 * samples)
    return bytes(message), device_at, tuple(columns_at)


def _string(text: str) -> bytes:
    octets = text.encode() + b"\0"
    return _NUMBER.pack(len(octets)) + octets


class RawMessage(NamedTuple):
    """received_ns: header stamp. device_ns: 0 = no device time. samples: float64, shape (n, channels)."""

    received_ns: int
    device_ns: int
    channels: tuple[str, ...]
    samples: NDArray[np.float64]


def read_raw(message: bytes) -> RawMessage:
    """Parse `Header header; Time device_timestamp; PhysioRawChannel[] channels`.

    Where two channels have one name, against the contract, the second one is `name_2`, so that none hides another.
    Raises ValueError where the bytes are not such a message or its channels differ in length.
    """
    try:
        return _read(message)
    except (struct.error, IndexError, UnicodeDecodeError) as err:
        raise ValueError(f"not a PhysioRaw: {err}") from err


def _read(message: bytes) -> RawMessage:
    number, stamp, float64 = _RAW_STRUCTS["<" if message[1] & 1 else ">"]
    seconds, nanoseconds, length = stamp.unpack_from(message, _ENCAPSULATION)
    at = _up(_ENCAPSULATION + 12 + length, 4)
    device_s, device_ns, count = stamp.unpack_from(message, at)
    if count > MOST_CHANNELS:
        raise ValueError(f"a raw message with {count} channels, at most {MOST_CHANNELS} can be")
    at += 12
    names: list[str] = []
    columns: list[NDArray[np.float64]] = []
    for _ in range(count):
        (length,) = number.unpack_from(message, at)
        if not 0 < length < LARGEST_NAME:
            raise ValueError(f"not a PhysioRaw: a channel name of {length} bytes")
        at += 4
        names.append(message[at : at + length - 1].decode())
        at = _up(at + length, 4)
        (samples,) = number.unpack_from(message, at)
        at += 4
        if samples:
            at += (_ENCAPSULATION - at) % 8
        if at + 8 * samples > len(message):
            raise ValueError("not a PhysioRaw: it is cut short")
        columns.append(np.frombuffer(message, float64, samples, at))
        at = _up(at + 8 * samples, 4)
    lengths = {len(column) for column in columns}
    if len(lengths) != 1 or 0 in lengths:
        raise ValueError(f"a raw message with channels of {sorted(lengths)} samples")
    return RawMessage(
        seconds * SECOND_NS + nanoseconds,
        device_s * SECOND_NS + device_ns,
        tuple(names) if len(set(names)) == len(names) else _told_apart(names),
        np.array(columns, np.float64).T,
    )


def _told_apart(names: list[str]) -> tuple[str, ...]:
    found: dict[str, None] = {}
    times = Counter[str]()
    for name in names:
        own = name
        while own in found:
            times[name] += 1
            own = f"{name}_{times[name] + 1}"
        found[own] = None
    return tuple(found)


def _up(at: int, size: int) -> int:
    return at + -at % size


def _begins_plainly(message: bytes) -> bool:
    return len(message) >= 12 and message[0] == 0 and message[1] in _PLAIN_CDR


def _time(message: bytes) -> struct.Struct:
    return _STRUCTS["<" if message[1] else ">"][1]
