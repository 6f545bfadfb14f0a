"""What happened to one stream of raw samples on its way into the file, message by message.

Times and losses are the kit's `SampleClock`'s. Before it stands what it cannot know from one stamp alone: a message
that fills a hole it left is late, not a restart; one that came before is a repetition; and a device clock that runs
ahead of its samples' receipt has been set, nothing was lost.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from sense4hri.cdr import RawMessage
from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import UNTIMED_S, SampleClock
from sense4hri.stamps import SECOND_NS
from sense4hri_recording.repetitions import MEMORY, content, stamps

from sense4hri_report.doubts import LATE, Doubt, Doubts
from sense4hri_report.holes import Hole
from sense4hri_report.rates import rate_by_stamps, true_rate, usual_rate
from sense4hri_report.raw_findings import Placed, RawFindings
from sense4hri_report.ros_time import Model, RosTime
from sense4hri_report.watch import HostStep

LISTEN = 24  # messages by whose stamps a stream's true rate is found before its samples are counted
PACED = 8  # messages that tell whether they came at the pace of new samples
WAITING = 256  # messages that may be late and are kept until something tells
PAUSE_S = 1.0  # receipts further apart than this, beyond the samples they bring: the stream paused
EXACT, WHOLE = 16, 0.05  # messages whose stamps were so exact, in samples, tell a lost sample from jitter


@dataclass
class _Waiting:
    raw: RawMessage
    log_ns: int


class _Joint(NamedTuple):
    """A message, when it was recorded, the stamp that it follows, and the rate until then; 0 = irregular."""

    raw: RawMessage
    log_ns: int
    previous_ns: int
    fs_hz: float

    @property
    def seconds(self) -> float:
        """How long the message's samples took."""
        return len(self.raw.samples) / self.fs_hz if self.fs_hz else 0.0

    @property
    def jump_s(self) -> float:
        """How far its stamp is from the one before."""
        return (self.raw.device_ns - self.previous_ns) * 1e-9


class RawAccount(RawFindings):
    """Finds it: `take` every message in the order of the file, then `finish`."""

    def __init__(self, declared_hz: float | None, on_samples: Callable[[Placed], None] = lambda placed: None) -> None:
        super().__init__(declared_hz, on_samples)
        self._clock: SampleClock | None = None
        self._time = RosTime()
        self._listening: list[_Waiting] = []
        self._late: list[_Waiting] = []
        self._steps: list[HostStep] = []
        self._jitter: deque[float] = deque(maxlen=4 * EXACT)
        self._doubts = Doubts()
        self._memory: OrderedDict[tuple[int, ...], int] = OrderedDict()
        self._received_ns = self._log_ns = self._told_ns = 0
        self._channels: tuple[str, ...] = ()

    def model(self, model: Model) -> None:
        """A clock model of the stream has come; one of another epoch is not used."""
        if self.has_device_time and abs(model.ros_ns(self.last_device_ns) - self._received_ns) < 30 * SECOND_NS:
            if self._time.model is None and not self.corrected and self.resets == 0:
                self.first_ns = model.ros_ns(self.first_device_ns) - self._reach_ns(self._first_count)
            self._time.model, self.corrected = model, True

    def host_stepped(self, step: HostStep) -> None:
        """The host's clock was set: the smallest delay has to be found again, and a hole by receipt is no loss."""
        self._time.restart()
        self._steps.append(step)

    def take(self, raw: RawMessage, log_ns: int) -> int:
        """One message; returns its receipt, as far as it can be believed."""
        if not self.messages:
            self.first_log_ns = log_ns
        self.messages += 1
        received_ns = self.receipts.believed_ns(raw.received_ns, log_ns)
        if received_ns != raw.received_ns:
            raw = raw._replace(received_ns=received_ns)
        self.last_log_ns = max(self.last_log_ns, log_ns)
        if raw.channels != self._channels:
            self._change_channels(raw)
        if self._clock is not None:
            self._place(raw, log_ns)
            return raw.received_ns
        self._listening.append(_Waiting(raw, log_ns))
        if len(self._listening) >= LISTEN or self.declared_hz == 0:
            self._begin()
        return raw.received_ns

    def _change_channels(self, raw: RawMessage) -> None:
        """Other channels than before, or the first ones."""
        if self._channels:
            what = f"channels changed from {', '.join(self._channels)} to {', '.join(raw.channels)}"
            self.event(raw.received_ns, "channels", what)
        first, self._channels = not self._channels, raw.channels
        always = {name: whole and name in raw.channels for name, whole in self.channels.items()}
        self.channels = {**dict.fromkeys([*self.channels, *raw.channels], first), **always}

    def finish(self) -> None:
        """No message comes any more."""
        if self._clock is None and self._listening:
            self._begin()
        if self._late:
            self._settle(None)
        for step in self._steps if not self.has_device_time else ():
            self.holes.without(step, self.rate_hz or 0.0)

    def _begin(self) -> None:
        waiting, self._listening = self._listening, []
        self.has_device_time = sum(message.raw.device_ns != 0 for message in waiting) * 2 > len(waiting)
        stamps = [w.raw.device_ns if self.has_device_time else w.raw.received_ns for w in waiting]
        counts = [len(w.raw.samples) for w in waiting]
        found_hz = rate_by_stamps(stamps, counts, self.has_device_time)
        self.rate_hz = true_rate(self.declared_hz, found_hz, self.has_device_time, usual_rate(stamps, counts))
        self._clock = SampleClock(self.rate_hz)
        for message in waiting:
            self._place(message.raw, message.log_ns)

    def _place(self, raw: RawMessage, log_ns: int) -> None:
        assert self._clock is not None
        if not raw.device_ns and self._may_lack_time(raw):
            self.untimed += 1
            raw = raw._replace(device_ns=self.last_device_ns + round(len(raw.samples) / self._clock.fs_hz * SECOND_NS))
        elif raw.device_ns:
            self._told_ns = raw.received_ns
        if (raw.device_ns != 0) != self.has_device_time:
            self.mixed += 1
            return
        if not self.has_device_time or not self._clock.fs_hz:
            if not self._is_repeated(raw):
                self._in_order(raw, log_ns)
            return
        stamp_ns, n = raw.device_ns, len(raw.samples)
        if self._is_repeated(raw):
            return
        if self._hole_of(stamp_ns, n) is not None:
            self._late.append(_Waiting(raw, log_ns))
            if len(self._late) >= WAITING or _at_pace(self._late):
                self._settle(None)
            return
        if self._late:
            self._settle(raw)
            self._place(raw, log_ns)
            return
        self._in_order(raw, log_ns)

    def _may_lack_time(self, raw: RawMessage) -> bool:
        """True for a message without a time among others of a device that gives one: it follows those before."""
        regular = self._clock is not None and self._clock.fs_hz > 0
        known = self.has_device_time and self.last_device_ns > 0
        return regular and known and raw.received_ns - self._told_ns < UNTIMED_S * SECOND_NS

    def _settle(self, after: RawMessage | None) -> None:
        """Decide on messages that fit into a hole, by the next one that does not.

        Where it goes on from them, or they came at the pace of new samples with no new one between, the device's clock
        was set back, by chance into the hole; else they were late.
        """
        assert self._clock is not None
        late, self._late = self._late, []
        step_ns = 0 if after is None else after.device_ns - late[-1].raw.device_ns
        set_back = _at_pace(late) or (
            after is not None
            and after.device_ns <= self.last_device_ns
            and abs(step_ns / SECOND_NS * self._clock.fs_hz - len(after.samples)) < max(0.5, len(after.samples) / 20)
        )
        for i, message in enumerate(late):
            if set_back and i == 0:
                self._in_order(message.raw, message.log_ns)
            elif set_back:
                self._place(message.raw, message.log_ns)
            elif not self._is_repeated(message.raw):
                self._fill(message.raw)

    def _in_order(self, raw: RawMessage, log_ns: int) -> None:
        """A message that is neither repeated nor late."""
        assert self._clock is not None
        n, stamp_ns = len(raw.samples), raw.device_ns or raw.received_ns
        fs_hz = self._clock.fs_hz
        placed = self._clock.place(Chunk(raw.channels, raw.samples, raw.device_ns or None, raw.received_ns))
        previous_ns, self.last_device_ns = self.last_device_ns, stamp_ns
        if placed.break_ in (Break.GAP, Break.RESET):
            self._broken(_Joint(raw, log_ns, previous_ns, fs_hz), placed.break_, placed.lost)
        elif placed.break_ is None:
            late = (stamp_ns - previous_ns) / SECOND_NS * fs_hz - n
            self._look_within(late)
            if abs(late) > LATE * n and self.has_device_time and fs_hz:
                self._doubts.take(self._doubt(_Joint(raw, log_ns, previous_ns, fs_hz)))
            self.steady_samples += n
            self.steady_ns += stamp_ns - previous_ns
        if self.has_device_time:
            self._time.learn(raw)
        offset_ns = self._ros_ns(stamp_ns) - stamp_ns if self.has_device_time else 0
        times_ns = placed.times_ns + offset_ns
        if placed.break_ is Break.FIRST:
            self.first_ns, self.first_device_ns, self._first_count = int(times_ns[0]), stamp_ns, n
        self.last_ns = int(times_ns[-1])
        self._remember(raw)
        self._received_ns, self._log_ns, self.frame = raw.received_ns, log_ns, n
        self.samples += n
        self.on_samples(Placed(times_ns, raw.channels, raw.samples, placed.break_ is not None))

    def _doubt(self, joint: _Joint) -> Doubt:
        """By how much a message is late, and the hole before it."""
        raw, previous_ns = joint.raw, joint.previous_ns
        n, step_ns = len(raw.samples), raw.device_ns - previous_ns
        to_ns = self._ros_ns(raw.device_ns) - round(joint.seconds * 1e9)
        hole = Hole(previous_ns, raw.device_ns, self._log_ns, joint.log_ns, self.last_ns, to_ns, lost=0)
        return Doubt(step_ns / SECOND_NS * joint.fs_hz - n, hole, n, step_ns)

    def _lose(self, newest: Doubt, lost: int) -> None:
        """Samples are missing before the newest message, or before an earlier one.

        Where stamps jitter the kit believes a loss some messages after it; until then it counted as steady.
        """
        earlier = self._doubts.settle(newest.late)
        if earlier is not None:
            self.steady_samples -= earlier.samples
            self.steady_ns -= earlier.step_ns
        self.holes.append(replace((earlier or newest).hole, lost=lost))

    def _look_within(self, late: float) -> None:
        """Samples lost inside a long message, which the kit takes for jitter, where a stream's stamps show none."""
        whole = late > 0.5 and abs(late - round(late)) < 2 * WHOLE
        if whole and len(self._jitter) >= EXACT and max(self._jitter) < WHOLE:
            self.lost_within += round(late)
        else:
            self._jitter.append(abs(late))

    def _is_repeated(self, raw: RawMessage) -> bool:
        """True for samples that came already: the same stamp, and the same content unless it comes at once again."""
        assert self._clock is not None
        stamp_ns, rate_hz = raw.device_ns or raw.received_ns, self._clock.nominal_hz
        before = self._memory.get(stamps(raw, rate_hz))
        if before is None:
            return False
        if before == content(raw):
            self.duplicates += 1
            self.event(self._ros_ns(stamp_ns), "duplicate", f"{len(raw.samples)} samples came again")
            return True
        if not rate_hz or stamp_ns != self.last_device_ns:
            return False
        self.conflicts += 1
        self.event(raw.received_ns, "conflict", "other samples with the stamp of the message before")
        return True

    def _hole_of(self, stamp_ns: int, n: int) -> int | None:
        """Index of the hole of this epoch in which n samples that end here are missing."""
        if stamp_ns >= self.last_device_ns or self._clock is None:
            return None
        return self.holes.around(stamp_ns, n, SECOND_NS / self._clock.fs_hz)

    def _fill(self, raw: RawMessage) -> None:
        """A late message makes its hole smaller; where another one has filled it already, it is a repetition."""
        assert self._clock is not None
        stamp_ns, n = raw.device_ns, len(raw.samples)
        i = self._hole_of(stamp_ns, n)
        if i is None:
            self.duplicates += 1
            self.event(self._ros_ns(stamp_ns), "duplicate", f"{n} samples came again")
            return
        self.holes.fill(i, stamp_ns, n, SECOND_NS / self._clock.fs_hz, self._ros_ns(stamp_ns))
        self._remember(raw)
        self.samples += n
        self.reorders += 1
        late_s = (raw.received_ns - self._ros_ns(stamp_ns)) * 1e-9
        self.event(self._ros_ns(stamp_ns), "reorder", f"{n} samples came after newer ones, {late_s:.2f} s late")

    def _broken(self, joint: _Joint, break_: Break, lost: int) -> None:
        """Samples that do not continue those before them: a hole, or a clock that was set."""
        assert self._clock is not None
        if not self.has_device_time:
            self._broken_by_receipt(joint, break_)
        elif not self._clock.nominal_hz:
            back_s = (joint.previous_ns - joint.raw.device_ns) * 1e-9
            self._went_back(joint.raw, f"stamp {back_s:.3f} s back")
        elif break_ is Break.GAP and not self._time.ran_ahead(joint.raw, joint.jump_s - joint.seconds):
            self._lose(self._doubt(joint), lost)
        else:
            self._reset(joint)

    def _broken_by_receipt(self, joint: _Joint, break_: Break) -> None:
        """Without device time a hole is as long as the link was silent."""
        if break_ is Break.GAP and self._pause_s(joint) > 0:
            self.holes.append(self._pause(joint, 0, 0))
        elif break_ is Break.RESET:
            self._went_back(joint.raw, "stamp of receipt earlier than the samples before allow")

    def _went_back(self, raw: RawMessage, what: str) -> None:
        self.backwards += 1
        self.event(raw.received_ns, "backwards", what)

    def _reset(self, joint: _Joint) -> None:
        """The device's clock was set; after a pause the device was restarted, and what it lost then is estimated."""
        raw, way = joint.raw, "ahead" if joint.jump_s > 0 else "back"
        self.resets += 1
        kind, where = "clock_reset", f"device clock went {way} by {_duration(abs(joint.jump_s))}"
        self._memory.clear()
        self._doubts = Doubts()
        self._time.restart()
        self._time.learn(raw)
        if self._pause_s(joint) > PAUSE_S:
            kind, where = "reboot", f"{where} after a pause of {self._pause_s(joint):.1f} s"
            self.holes.append(self._pause(joint, joint.previous_ns, raw.device_ns))
        self.holes.begin_epoch()
        self.event(raw.received_ns, kind, where)

    def _pause_s(self, joint: _Joint) -> float:
        """For how long nothing was received, beyond the time that the message's samples took."""
        return (joint.raw.received_ns - self._received_ns) * 1e-9 - joint.seconds

    def _pause(self, joint: _Joint, from_device_ns: int, to_device_ns: int) -> Hole:
        """The hole of such a pause, in device time from and to these stamps."""
        to_ns = joint.raw.received_ns - round(joint.seconds * 1e9)
        lost = round(self._pause_s(joint) * joint.fs_hz)
        spans = from_device_ns, to_device_ns, self._log_ns, joint.log_ns, self.last_ns, to_ns
        return Hole(*spans, lost, estimated=True)

    def _ros_ns(self, device_ns: int) -> int:
        """Corrected ROS time of device time in the present epoch."""
        return self._time.ros_ns(device_ns) if self.has_device_time else device_ns

    def _reach_ns(self, n: int) -> int:
        """From a message's first to its last sample."""
        return round((n - 1) / self.rate_hz * SECOND_NS) if self.rate_hz else 0

    def _remember(self, raw: RawMessage) -> None:
        assert self._clock is not None
        self._memory[stamps(raw, self._clock.nominal_hz)] = content(raw)
        if len(self._memory) > MEMORY:
            self._memory.popitem(last=False)


def _at_pace(late: list[_Waiting]) -> bool:
    """True for messages received about as far apart as they were taken; what is late comes in a burst."""
    stamps = [message.raw.device_ns for message in late]
    span_ns = max(stamps) - min(stamps)
    return len(late) >= PACED and abs(late[-1].raw.received_ns - late[0].raw.received_ns - span_ns) < span_ns / 4


def _duration(seconds: float) -> str:
    if seconds < 600:
        return f"{seconds:.3f} s"
    return f"{seconds / 3600:.1f} h" if seconds < 100 * 3600 else f"{seconds / 86400:.0f} days"
