"""Values of characteristics that devices of many makers send, as bytes: heart rate, and SFLOAT numbers."""

import struct
from collections.abc import Sequence


def heart_rate_measurement(
    heart_rate_bpm: int,
    rr_1024: Sequence[int] = (),
    contact: bool | None = None,
    energy_kj: int | None = None,
) -> bytes:
    """Flags, rate, [energy], RR intervals in 1/1024 s; `contact` None = the device does not tell."""
    wide = heart_rate_bpm > 0xFF
    flags = wide | (energy_kj is not None) << 3 | bool(rr_1024) << 4
    if contact is not None:
        flags |= 0x04 | contact << 1
    energy = b"" if energy_kj is None else struct.pack("<H", energy_kj)
    rate = struct.pack("<H" if wide else "<B", heart_rate_bpm)
    return bytes([flags]) + rate + energy + struct.pack(f"<{len(rr_1024)}H", *rr_1024)


def sfloat(number: float | None) -> bytes:
    """A number with at most one decimal as 16 bits of IEEE 11073-20601; None = not a number."""
    if number is None:
        return b"\xff\x07"
    whole = number == round(number)
    mantissa = round(number) if whole else round(number * 10)
    return struct.pack("<H", (0x0000 if whole else 0xF000) | mantissa & 0x0FFF)
