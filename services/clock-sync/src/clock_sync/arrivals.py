"""The newest packet of every stream of a device, and how the next one arrives by it."""

from __future__ import annotations

from typing import NamedTuple

from clock_sync.epoch import Packet

JUMP_S, JUMP_JITTERS = 1.0, 5.0


class Arrival(NamedTuple):
    """How a packet arrived: by later_s later than the device's clock ran since the one before it of its stream.

    late, early: by more than jump_s, what jitters or waits for a radio being within that; of a stream's first packet
    nobody knows, and it may be early.
    """

    later_s: float
    jump_s: float
    late: bool
    early: bool


class Newest:
    """packets: the newest one of each stream in this segment."""

    def __init__(self) -> None:
        self.packets: dict[str, Packet] = {}
        self._interval_s: dict[str, float] = {}  # usual device time between two packets of a stream

    def __contains__(self, stream: str) -> bool:
        return stream in self.packets

    def has(self, packet: Packet) -> bool:
        """True where the stream's newest packet has the same device time: it was sent twice."""
        known = self.packets.get(packet.stream)
        return known is not None and packet.device_ns == known.device_ns

    def went_back(self, packet: Packet) -> bool:
        """True where the device's clock shows less than it did at the stream's newest packet: it begins anew."""
        known = self.packets.get(packet.stream)
        return known is not None and packet.device_ns < known.device_ns

    def arrival(self, packet: Packet, jitter_s: float) -> Arrival:
        """Return how a packet arrived, which is the newest of its stream from now on."""
        known = self.packets.get(packet.stream)
        self.packets[packet.stream] = packet
        if known is None:
            return Arrival(0.0, JUMP_S, late=False, early=True)
        ran_s = (packet.device_ns - known.device_ns) * 1e-9
        later_s = (packet.received_ns - known.received_ns) * 1e-9 - ran_s
        jump_s = max(JUMP_S, JUMP_JITTERS * jitter_s)
        usual_s = self._interval_s.get(packet.stream, ran_s)
        self._interval_s[packet.stream] = usual_s + 0.1 * (min(ran_s, 2 * usual_s) - usual_s)
        early = later_s < -jump_s and ran_s > jump_s + 2 * usual_s
        return Arrival(later_s, jump_s, later_s > jump_s, early)

    def move_host(self, step_ns: int) -> None:
        """The host's clock was stepped: what was stamped before lies that much earlier on it."""
        moved = self.packets.items()
        self.packets = {stream: known._replace(received_ns=known.received_ns + step_ns) for stream, known in moved}
