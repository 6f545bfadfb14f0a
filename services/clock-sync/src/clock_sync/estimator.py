"""The clock of one device against the clock of its host, from message stamps alone.

    estimator = ClockEstimator()
    for device_ns, received_ns in packets:
        estimator.packet("ecg", device_ns, received_ns)
    estimator.model().ros_ns(device_ns)

No ROS, no wall clock: a notebook gets from a recording what the service got live.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from clock_sync.arrivals import JUMP_S, Newest
from clock_sync.envelope import Envelope
from clock_sync.epoch import Epoch, Jump, Packet
from clock_sync.host_steps import STEP_NS, Accounts, HostStep
from clock_sync.model import Model, State
from clock_sync.two_way import TwoWay

SECOND_NS = 1_000_000_000
STALL_S = 3.0
LONGEST_HOLD_S = 900.0  # a queue that stands for so long is the link's new delay
LOCK_S, LOCK_UNCERTAINTY_S, LOCK_ANYWAY_S = 20.0, 5e-3, 60.0
TWO_WAY_FRESH_S = 60.0
FOREIGN_MEASUREMENT_S = 10.0  # a measurement further from the packets than this is of another epoch
REPLAYED_PACKETS = 5000


class _Checkpoint(NamedTuple):
    """All that is known, copied when the host told of its clock and no packet contradicted it.

    newest_of: each stream's newest packet. account_ns: what the host told.
    """

    epoch: Epoch
    newest_of: dict[str, Packet]
    newest: tuple[int, int]
    account_ns: int | None


class ClockEstimator:
    """Offset, skew and uncertainty of one device clock; every stream of the device feeds the same one.

    transport_delay_s: the known part of the link's delay; it is subtracted from the offset of one-way packets.
    """

    def __init__(self, transport_delay_s: float = 0.0) -> None:
        self.transport_delay_s = transport_delay_s
        self.segment = 0
        self.duplicates = self.strays = 0
        self._epoch: Epoch | None = None
        self._old: Epoch | None = None
        self._newest_of = Newest()
        self._jump: Jump | None = None
        self._newest = (0, 0)
        self._delays = (0.0, 0)  # sum and number since the last model
        self._checkpoint: _Checkpoint | None = None
        self._step: HostStep | None = None  # of the host's clock, not shown yet by the packets since the checkpoint
        self._since: deque[Packet] = deque(maxlen=REPLAYED_PACKETS)
        self._accounts = Accounts()
        self._begun_ns: int | None = None  # account of a host that says it was started anew, until the next packet

    @property
    def known(self) -> bool:
        """True once there is a model."""
        return self._epoch is not None

    def packet(self, stream: str, device_ns: int, received_ns: int) -> bool:
        """Take one packet in: device time of its newest sample and receipt stamp. True where it opened a new segment.

        stream: any name that tells apart the streams of the device; device time may go back from one to another.
        """
        packet = Packet(stream, device_ns, received_ns)
        began = self._judge_start(packet)
        if self._checkpoint is not None:
            self._since.append(packet)
        began = self._take(packet) or began
        return self._judge_step() or began

    def _take(self, packet: Packet) -> bool:
        epoch, (_, device_ns, received_ns) = self._epoch, packet
        if epoch is None or self._newest_of.went_back(packet):
            self._open(packet)
            return True
        if self._is_unusable(packet, epoch):
            return False
        arrival = self._newest_of.arrival(packet, epoch.envelope.jitter_s)
        above_s = epoch.above_s(device_ns, received_ns)
        if above_s < -arrival.jump_s and arrival.early:
            self._open(packet)
            return True
        if self._jump is None and above_s > arrival.jump_s and arrival.late:
            self._jump = Jump(epoch.y_s(device_ns, received_ns) - arrival.later_s, arrival.later_s, received_ns)
        if self._jump is not None and self._follow_jump(self._jump, packet):
            return True
        self._feed(packet)
        if epoch.envelope.held_s() > LONGEST_HOLD_S:
            self._open(packet)
            return True
        return False

    def _is_unusable(self, packet: Packet, epoch: Epoch) -> bool:
        """Count a packet that says nothing of this epoch's line; False where it is to be used."""
        if self._newest_of.has(packet):
            self.duplicates += 1
            return True
        if self._step is not None and self._step.sets_aside(packet.device_ns, packet.received_ns):
            self.strays += 1
            return True
        if self._is_of_old(packet, epoch):
            self.strays += 1
            return True
        return False

    def _is_of_old(self, packet: Packet, epoch: Epoch) -> bool:
        """True where it was still on its way when another stream of the device had begun the new epoch."""
        if self._old is None or packet.stream in self._newest_of:
            return False
        above_s, above_old_s = (each.above_s(packet.device_ns, packet.received_ns) for each in (epoch, self._old))
        return abs(above_s) > JUMP_S and abs(above_old_s) < JUMP_S

    def measurement(self, stamp_ns: int, device_ns: int, offset_ns: int, uncertainty_s: float) -> bool:
        """Take a two-way measurement in: ROS time = device time + offset at device_ns. True where a segment began.

        It comes once beside every stream of the device and counts once, or it would seem surer than it is.
        """
        epoch = self._epoch
        if epoch is None or stamp_ns < epoch.received_ns - SECOND_NS:
            return False
        back_ns = -1 if epoch.measured_ns is None else epoch.measured_ns - stamp_ns
        if 0 <= back_ns <= TWO_WAY_FRESH_S * SECOND_NS:
            return False
        tau, y = epoch.tau_s(device_ns), epoch.y_s(device_ns, device_ns + offset_ns)
        line = epoch.envelope.line
        assert line is not None
        if abs(y - line.at(tau)) > FOREIGN_MEASUREMENT_S:
            self.strays += 1
            return False
        if back_ns > 0:
            epoch.two_way = TwoWay()  # what was measured last is of a time that has not come
        stepped = epoch.two_way.add(tau, y, uncertainty_s)
        if stepped:
            fresh = Epoch(epoch.device_ns, epoch.received_ns)
            fresh.envelope.add(tau, y)
            fresh.two_way.add(tau, y, uncertainty_s)
            fresh.measured_ns = stamp_ns
            self._replace(fresh)
            return True
        epoch.measured_ns = stamp_ns
        epoch.link_delay_s = max(line.at(tau) - epoch.two_way.at(tau), 0.0)
        return False

    def host_started(self, realtime_minus_monotonic_ns: int) -> None:
        """The host was started anew, or the driver runs on another one: the next packet begins a segment."""
        self._begun_ns = realtime_minus_monotonic_ns

    def host_clock(self, realtime_minus_monotonic_ns: int) -> bool:
        """Follow the host's account of its clock. True: it was stepped, `host_step` is due for each of its devices."""
        if self._begun_ns is not None:
            self._begun_ns = realtime_minus_monotonic_ns
            return False
        if self._accounts.tells_step(realtime_minus_monotonic_ns):
            return True
        believed = self._accounts.newest_ns == realtime_minus_monotonic_ns
        if believed and self._epoch is not None and self._step is None:
            self._keep()
        return False

    def host_step(self, realtime_minus_monotonic_ns: int) -> bool:
        """The host's clock was stepped to this since its last account: a new segment begins. True where one did.

        The step is known to the microsecond, so the old line moves by it; packets stamped after it never meet
        packets stamped before, of which those since the checkpoint are not used: one of them could belong to either
        side of a small step. Packets that speak against it for 20 s undo it. A step that nothing has shown yet is
        forgotten when the next one is told: both together are one, or none.
        """
        stepped = abs(self._accounts.step_ns(realtime_minus_monotonic_ns)) > STEP_NS
        if stepped and self._epoch is not None and self._checkpoint is None:
            self._keep()
        self._accounts.follow(realtime_minus_monotonic_ns)
        if self._epoch is None or not stepped:
            return False
        account_ns, packets = self._back_to_checkpoint()
        step_ns = 0 if account_ns is None else realtime_minus_monotonic_ns - account_ns
        if abs(step_ns) <= STEP_NS:
            self._replay(packets)
            self._keep()
            return True
        cut = self._first_after(self._epoch, step_ns * 1e-9, packets)
        self._step = HostStep(step_ns * 1e-9, self._epoch.copy())
        self._epoch.move_host(step_ns)
        self._newest_of.move_host(step_ns)
        self._newest = (self._newest[0], self._newest[1] + step_ns)
        self._old, self._jump = None, None
        self._replay(packets[cut:])
        return True

    def _judge_start(self, packet: Packet) -> bool:
        """Forget a clock that is no more; True where it was only set, as the first packet since shows: a segment began.

        What a host counts from its start says nothing of its wall clock, which may have been anything meanwhile.
        """
        account_ns, self._begun_ns = self._begun_ns, None
        if account_ns is None or self._epoch is None:
            return False
        moved_s = self._epoch.above_s(packet.device_ns, packet.received_ns)
        if abs(moved_s) > abs(self._accounts.step_ns(account_ns)) * 0.5e-9:
            return self.host_step(account_ns)
        self._accounts = Accounts()
        self._accounts.follow(account_ns)
        self._epoch, self._step, self._checkpoint = None, None, None
        self._since.clear()
        return False

    def _judge_step(self) -> bool:
        """Do what the packets say of the last step of the host's clock; True where they have undone it."""
        step = self._step
        if step is None or not (step.shown or step.refuted):
            return False
        if step.refuted:
            account_ns, packets = self._back_to_checkpoint()
            self._accounts.deny(account_ns)
            self._replay(packets)
        self._step = None
        self._keep()
        return step.refuted

    def _back_to_checkpoint(self) -> tuple[int | None, list[Packet]]:
        """Begin a segment with all as it was then; return the account that went with it and the packets since."""
        assert self._checkpoint is not None
        checkpoint, packets = self._checkpoint, list(self._since)
        self._epoch, self._newest = checkpoint.epoch.copy(), checkpoint.newest
        self._newest_of.packets = dict(checkpoint.newest_of)
        self._old, self._jump, self._step = None, None, None
        self.segment += 1
        self._delays = (0.0, 0)
        return checkpoint.account_ns, packets

    def _replay(self, packets: list[Packet]) -> None:
        for item in packets:
            self._take(item)

    def _keep(self) -> None:
        assert self._epoch is not None
        self._checkpoint = _Checkpoint(
            self._epoch.copy(), dict(self._newest_of.packets), self._newest, self._accounts.newest_ns
        )
        self._since.clear()

    def model(self) -> Model:
        """The model now. latency_s: mean delay of the packets since the last call."""
        epoch = self._epoch
        assert epoch is not None, "no packet yet"
        envelope, line = epoch.envelope, epoch.envelope.line
        assert line is not None
        device_ns, received_ns = self._newest
        tau = epoch.tau_s(device_ns)
        y, skew, uncertainty = line.at(tau) - self.transport_delay_s, line.skew, envelope.uncertainty_s()
        fresh = epoch.measured_ns is not None and received_ns - epoch.measured_ns < TWO_WAY_FRESH_S * SECOND_NS
        if fresh:
            y, skew, uncertainty = epoch.two_way.at(tau), epoch.two_way.skew, 2 * epoch.two_way.sigma_s(tau)
        elif epoch.measured_ns is not None:
            y += self.transport_delay_s - epoch.link_delay_s
        if self._step is not None and self._step.disputed:
            uncertainty += abs(self._step.step_s)
        total, count = self._delays
        latency = line.at(tau) - y + (total / count if count else 0.0)
        self._delays = (0.0, 0)
        return Model(
            received_ns,
            device_ns,
            epoch.received_ns - epoch.device_ns + round(y * SECOND_NS),
            skew * 1e6,
            uncertainty,
            max(latency, 0.0),
            self.segment,
            self._state(envelope, uncertainty, fresh),
        )

    def _state(self, envelope: Envelope, uncertainty_s: float, measured: bool) -> State:
        stalled = self._jump is not None and self._jump.lasts_s() > STALL_S
        disputed = self._step is not None and self._step.disputed
        if stalled or disputed or (envelope.holding and not measured):
            return State.HOLDOVER
        age = envelope.age_s()
        locked = age > LOCK_ANYWAY_S or (uncertainty_s < LOCK_UNCERTAINTY_S and (measured or age > LOCK_S))
        return State.LOCKED if locked else State.WARMUP

    def _feed(self, packet: Packet) -> None:
        epoch, (_, device_ns, received_ns) = self._epoch, packet
        assert epoch is not None
        delay = epoch.envelope.add(epoch.tau_s(device_ns), epoch.y_s(device_ns, received_ns))
        self._delays = (self._delays[0] + max(delay, 0.0), self._delays[1] + 1)
        if received_ns >= self._newest[1] or device_ns > self._newest[0]:
            self._newest = (device_ns, received_ns)

    def _open(self, packet: Packet) -> None:
        """Begin a segment with this packet; nothing of the one before is used."""
        self._old = self._epoch
        self._replace(Epoch(packet.device_ns, packet.received_ns))
        self._newest_of.packets = {packet.stream: packet}
        self._newest = (packet.device_ns, packet.received_ns)
        self._feed(packet)

    def _replace(self, epoch: Epoch) -> None:
        self._epoch, self._jump = epoch, None
        if self._step is not None:  # of a clock that is no more
            self._step, self._checkpoint = None, None
            self._since.clear()
        self.segment += 1
        self._delays = (0.0, 0)

    def _follow_jump(self, jump: Jump, item: Packet) -> bool:
        """True where the jump has turned out to be a new epoch, which then has all its packets already."""
        epoch = self._epoch
        assert epoch is not None
        jump.packets.append(item)
        jump.y_s.append(epoch.y_s(item.device_ns, item.received_ns))
        if jump.drained():
            self._jump = None
            return False
        if not jump.confirmed():
            return False
        first, *others = jump.packets
        self._open(first)
        for later in others:
            self._newest_of.packets[later.stream] = later
            self._feed(later)
        return True

    @staticmethod
    def _first_after(epoch: Epoch, step_s: float, packets: list[Packet]) -> int:
        """Index of the first packet stamped after a step of the host's clock."""
        above = [epoch.above_s(item.device_ns, item.received_ns) for item in packets]
        tolerance = min(2 * epoch.envelope.uncertainty_s(), abs(step_s) / 2)
        if step_s < 0:
            return next((i for i, v in enumerate(above) if v < -tolerance), len(above))
        return next((i + 1 for i in range(len(above) - 1, -1, -1) if above[i] < step_s - tolerance), 0)
