"""The header stamp inside a serialised message (CDR: 4 bytes of encapsulation, then sec and nanosec)."""

import struct

from sense4hri.stamps import SECOND_NS

_LITTLE, _BIG = struct.Struct("<iI"), struct.Struct(">iI")
_PLAIN_CDR = (0, 1)  # second byte of the encapsulation: big, little endian


def stamp_ns(cdr: bytes) -> int:
    """Return the header stamp of a message that begins with a Header, in ns of ROS time; 0 where it has none."""
    if len(cdr) < 12 or cdr[0] != 0 or cdr[1] not in _PLAIN_CDR:
        return 0
    seconds, nanoseconds = (_LITTLE if cdr[1] else _BIG).unpack_from(cdr, 4)
    return int(seconds) * SECOND_NS + int(nanoseconds)


def with_stamp(cdr: bytes, log_ns: int) -> bytes:
    """Return a message that begins with a Header, with log_ns (ROS time) in its stamp where that was zero."""
    if len(cdr) < 12 or cdr[0] != 0 or cdr[1] not in _PLAIN_CDR or any(cdr[4:12]):
        return cdr
    seconds, nanoseconds = divmod(log_ns, SECOND_NS)
    if not 0 <= seconds < 1 << 31:
        return cdr
    return cdr[:4] + (_LITTLE if cdr[1] else _BIG).pack(seconds, nanoseconds) + cdr[12:]
