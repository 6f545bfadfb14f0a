"""One stretch of a device clock without a reset or step, and jumps that may begin the next one."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from clock_sync.envelope import Envelope
from clock_sync.two_way import TwoWay

CONFIRM_S, CONFIRM_PACKETS = 20.0, 8  # a jump upwards is a new epoch if it has not drained by then; a stall drains
MOST_PACKETS = 5000  # of a jump, the newest


class Packet(NamedTuple):
    """The two stamps of one message."""

    stream: str
    device_ns: int
    received_ns: int


class Epoch:
    """One segment: its origin, the packets' envelope, the measurements."""

    def __init__(self, device_ns: int, received_ns: int) -> None:
        self.device_ns, self.received_ns = device_ns, received_ns
        self.envelope = Envelope()
        self.two_way = TwoWay()
        self.measured_ns: int | None = None  # stamp of the newest measurement
        self.link_delay_s = 0.0  # smallest one-way delay, as the measurements show it

    def copy(self) -> Epoch:
        """Return an independent copy."""
        twin = Epoch(self.device_ns, self.received_ns)
        twin.envelope = self.envelope.copy()
        twin.two_way.__dict__.update(self.two_way.__dict__)
        twin.measured_ns, twin.link_delay_s = self.measured_ns, self.link_delay_s
        return twin

    def move_host(self, step_ns: int) -> None:
        """The host's clock was stepped: what was stamped before lies that much earlier on it."""
        self.received_ns += step_ns
        if self.measured_ns is not None:
            self.measured_ns += step_ns

    def tau_s(self, device_ns: int) -> float:
        """Return device time since the origin, s."""
        return (device_ns - self.device_ns) * 1e-9

    def y_s(self, device_ns: int, received_ns: int) -> float:
        """Return by how much a packet's way took longer than that of the first one, s."""
        return ((received_ns - self.received_ns) - (device_ns - self.device_ns)) * 1e-9

    def above_s(self, device_ns: int, received_ns: int) -> float:
        """How far a packet lies above the envelope; 0 before the first."""
        line = self.envelope.line
        return 0.0 if line is None else self.y_s(device_ns, received_ns) - line.at(self.tau_s(device_ns))

    def gate_s(self, device_ns: int) -> float:
        """How far above the envelope the packets of the smaller delays lie at most, s."""
        return self.envelope.gate_s(self.tau_s(device_ns))


class Jump:
    """Packets since one came more than the threshold later than the one before it: a stall, or a new epoch."""

    def __init__(self, base_s: float, height_s: float, begun_ns: int) -> None:
        self.base_s, self.height_s, self._begun_ns = base_s, height_s, begun_ns
        self.packets: deque[Packet] = deque(maxlen=MOST_PACKETS)
        self.y_s: deque[float] = deque(maxlen=MOST_PACKETS)

    def drained(self) -> bool:
        """Return True where the packets are back where they were: it was a stall."""
        return self.y_s[-1] - self.base_s < 0.5 * self.height_s

    def lasts_s(self) -> float:
        """Return for how long, by receipt, the packets have been late."""
        return (self.packets[-1].received_ns - self._begun_ns) * 1e-9

    def confirmed(self) -> bool:
        """Return True where they have been late for long and evenly: it is a new epoch."""
        if len(self.packets) < CONFIRM_PACKETS or self.lasts_s() < CONFIRM_S:
            return False
        y_s, half = list(self.y_s), len(self.y_s) // 2
        early, late = min(y_s[:half]), min(y_s[half:])
        return abs(late - early) < 0.1 * self.height_s
