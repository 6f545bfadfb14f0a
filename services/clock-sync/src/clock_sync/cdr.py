"""The two stamps of a serialised PhysioRaw, read without deserialising its samples."""

import struct

_LITTLE, _BIG = struct.Struct("<iII"), struct.Struct(">iII")
_LITTLE_TIME, _BIG_TIME = struct.Struct("<iI"), struct.Struct(">iI")
_ENCAPSULATION = 4


def stamps_ns(message: bytes) -> tuple[int, int]:
    """(receipt, device) stamp in ns of a message that begins `Header header; Time device_timestamp`, in CDR.

    Device 0: the device gives no time. Raises struct.error where the message is shorter than that.
    """
    little = message[1] & 1
    seconds, nanoseconds, length = (_LITTLE if little else _BIG).unpack_from(message, _ENCAPSULATION)
    at = _ENCAPSULATION + (12 + length + 3) // 4 * 4  # alignment counts from behind the encapsulation header
    device_s, device_ns = (_LITTLE_TIME if little else _BIG_TIME).unpack_from(message, at)
    return seconds * 1_000_000_000 + nanoseconds, device_s * 1_000_000_000 + device_ns
