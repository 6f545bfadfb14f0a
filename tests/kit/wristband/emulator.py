"""A wristband that exists only here, its bytes made without the codec; sensor-bench plays it.

Every channel of sample number n is n, modulo what its form holds: what is missing or comes twice shows.
"""

import struct

SERVICE, COMMAND = "a17e0001-5e45-4e0d-8f00-77726973740a", "a17e0002-5e45-4e0d-8f00-77726973740a"
SKIN, MOTION = "a17e0003-5e45-4e0d-8f00-77726973740a", "a17e0004-5e45-4e0d-8f00-77726973740a"
NOTIFIES, WRITTEN = {SKIN: "eda", MOTION: "accelerometer"}, (COMMAND,)
TICKS_HZ, BYTES = 1024, 2
SENT = {SKIN: (32, 4, "H", 1), MOTION: (64, 8, "h", 3)}
"""Rate in Hz, samples in a notification, form of a number, channels."""
BEFORE_WRAP_S = 5
"""Of sampling, before the clock goes round for the first time."""


class VirtualDevice:
    """Samples from the moment it was told to."""

    def __init__(self) -> None:
        self._taken, self._told, self._begun_s = dict.fromkeys(SENT, 0), False, 0.0

    def receive(self, characteristic: str, value: bytes) -> None:
        """Start where the host says so."""
        self._told = self._told or (characteristic, value) == (COMMAND, b"\x01")

    def send(self, time_s: float) -> list[tuple[str, bytes, int]]:
        """Return all it has notified up to this time, since the last call: characteristic, value, samples in it."""
        if not self._told:
            self._begun_s = time_s
        return [each for characteristic in SENT for each in self._notified(characteristic, time_s - self._begun_s)]

    def _notified(self, characteristic: str, sampled_s: float) -> list[tuple[str, bytes, int]]:
        rate_hz, count, form, channels = SENT[characteristic]
        values = []
        while (self._taken[characteristic] + count) / rate_hz <= sampled_s:
            first = self._taken[characteristic]
            self._taken[characteristic] += count
            numbers = [index % 0x8000 for index in range(first, first + count) for _ in range(channels)]
            ticks = ((first + count - 1) * TICKS_HZ // rate_hz - BEFORE_WRAP_S * TICKS_HZ) % (1 << 8 * BYTES)
            values.append((characteristic, notification(ticks, form, numbers), count))
        return values


def notification(ticks: int, form: str, numbers: list[int]) -> bytes:
    """Return the bytes of one notification."""
    return ticks.to_bytes(BYTES, "little") + struct.pack(f"<{len(numbers)}{form}", *numbers)
