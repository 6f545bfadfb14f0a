"""Bytes of the standard Heart Rate Measurement (0x2A37) to numbers; no I/O, no clock."""

from typing import NamedTuple

from sense4hri.errors import FrameError

WIDE, CONTACT, CONTACT_SUPPORTED, ENERGY, INTERVALS = 0x01, 0x02, 0x04, 0x08, 0x10


class HeartRate(NamedTuple):
    """One measurement, about once a second; the characteristic carries no device time.

    bpm: 0 while the device knows no rate. contact: None where the device cannot tell. energy_kj: None where not sent.
    rr_ms: oldest first, any number of them, not rounded (the device counts in 1/1024 s).
    """

    bpm: int
    contact: bool | None
    energy_kj: int | None
    rr_ms: tuple[float, ...]


def decode_heart_rate(value: bytes) -> HeartRate:
    """Return the measurement; raise FrameError where the fields the flags announce do not fill the value exactly."""
    flags = value[0] if value else 0
    head = 1 + (2 if flags & WIDE else 1) + (2 if flags & ENERGY else 0)
    rest = len(value) - head
    if rest < 0 or rest % 2 or (rest and not flags & INTERVALS):
        raise FrameError(f"heart rate measurement of {len(value)} bytes does not fit its flags ({value.hex()})")
    wide = 3 if flags & WIDE else 2
    return HeartRate(
        bpm=int.from_bytes(value[1:wide], "little"),
        contact=bool(flags & CONTACT) if flags & CONTACT_SUPPORTED else None,
        energy_kj=int.from_bytes(value[wide:head], "little") if flags & ENERGY else None,
        rr_ms=tuple(int.from_bytes(value[at : at + 2], "little") * 1000 / 1024 for at in range(head, len(value), 2)),
    )
