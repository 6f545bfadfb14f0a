"""What happened to one stream of raw samples on its way into the file, message by message.

Times and losses are the kit's `SampleClock`'s. Before it stands what it cannot know from one stamp alone: a message
that fills a hole it left is late, not a restart; one that came before is a repetition; and a device clock that runs
ahead of its samples' receipt has been set, nothing was lost.
"""

from __future__ import annotations

import zlib
from collections import Counter, OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri import clock_model
from sense4hri.cdr import RawMessage
from sense4hri.chunk import Break, Chunk
from sense4hri.sample_clock import UNTIMED_S, SampleClock
from sense4hri.stamps import SECOND_NS
from sense4hri_recording.receipts import Receipts

LISTEN = 24  # messages by whose stamps a stream's true rate is found before its samples are counted
DECLARED_TRUST = 0.03  # share by which the declared rate may differ from that one; the kit follows what is left
HOLES = 64  # holes back that a late message is tried on
PACED = 8  # messages that tell whether they came at the pace of new samples
WAITING = 256  # messages that may be late and are kept until something tells
MEMORY = 1024  # messages back in which a repetition or a late message is recognised
STEP_S = 0.25  # a device clock that runs ahead of receipt by more was set; the delay of a link does not get shorter
PAUSE_S = 1.0  # receipts further apart than this, beyond the samples they bring: the stream paused
BASE_TRUST = 8  # messages after which the smallest delay seen is taken for the link's
BASE_WINDOW = 10  # minutes in which the smallest delay is sought
EXACT, WHOLE = 16, 0.05  # messages whose stamps were so exact, in samples, tell a lost sample from jitter
KEPT = 5000  # events of one kind that are listed; all are counted
KINDS = ("duplicate", "conflict", "reorder", "backwards", "reboot", "clock_reset", "channels")


@dataclass
class Hole:
    """Samples that are missing. Device times are those of the neighbours' newest samples; log times those of receipt.

    lost: samples per channel. estimated: by receipt, since no device time tells.
    """

    from_device_ns: int
    to_device_ns: int
    from_log_ns: int
    to_log_ns: int
    from_ns: int
    to_ns: int
    lost: int
    estimated: bool = False


class Event(NamedTuple):
    """Something else than a hole. at_ns: ROS time. kind: one of KINDS; what: details."""

    at_ns: int
    kind: str
    what: str


class Placed(NamedTuple):
    """Samples with ROS times, shape (n,); fresh: they do not continue those before."""

    times_ns: NDArray[np.int64]
    channels: tuple[str, ...]
    samples: NDArray[np.float64]
    fresh: bool


class Model(NamedTuple):
    """A clock model of the recording: ROS = device + offset + skew from the reference on."""

    reference_ns: int
    offset_ns: int
    skew_ppm: float

    def ros_ns(self, device_ns: int) -> int:
        return clock_model.ros_ns(device_ns, self.reference_ns, self.offset_ns, self.skew_ppm)


@dataclass
class _Waiting:
    raw: RawMessage
    log_ns: int


@dataclass
class RawAccount:
    """Counts of one raw stream; `take` every message in the order of the file, then `finish`.

    declared_hz: the declared rate, 0 = irregular, None = nowhere declared. on_samples: gets everything that counts.
    """

    declared_hz: float | None
    on_samples: Callable[[Placed], None] = lambda placed: None
    messages: int = 0
    samples: int = 0
    undecodable: int = 0
    duplicates: int = 0
    conflicts: int = 0
    reorders: int = 0
    backwards: int = 0
    resets: int = 0
    mixed: int = 0
    untimed: int = 0
    lost_within: int = 0
    """Samples that messages lack among their own."""
    first_ns: int = 0
    last_ns: int = 0
    first_log_ns: int = 0
    last_log_ns: int = 0
    first_device_ns: int = 0
    last_device_ns: int = 0
    has_device_time: bool = False
    holes: list[Hole] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    channels: dict[str, bool] = field(default_factory=dict)
    """All that ever came, and whether every message brought them."""
    corrected: bool = False
    """The clock models of the recording gave the times; else receipt did, less the smallest delay seen."""

    def __post_init__(self) -> None:
        self.receipts = Receipts()
        self.rate_hz: float | None = None
        self._clock: SampleClock | None = None
        self._listening: list[_Waiting] = []
        self._late: list[_Waiting] = []
        self._jitter: deque[float] = deque(maxlen=4 * EXACT)
        self._epoch_holes = self._based_on = 0
        self._memory: OrderedDict[int, int] = OrderedDict()
        self._bases: deque[tuple[int, int]] = deque(maxlen=BASE_WINDOW)
        self._model: Model | None = None
        self._steady_samples = self._steady_ns = 0
        self._received_ns = self._log_ns = self._frame = self._told_ns = 0
        self._channels: tuple[str, ...] = ()
        self.counts: Counter[str] = Counter()
        """Events by kind; `events` lists the first of them."""

    @property
    def measured_hz(self) -> float | None:
        """Samples over the time of the stamps where nothing was missing; None where that cannot be known."""
        return self._steady_samples * SECOND_NS / self._steady_ns if self._steady_ns > 0 else None

    @property
    def lost(self) -> int | None:
        """Samples missing between others, by device time; None where the device gives none to count them by."""
        if self.messages and (not self.has_device_time or not self.rate_hz):
            return None
        return sum(hole.lost for hole in self.holes if not hole.estimated)

    @property
    def lost_estimated(self) -> int:
        """Samples that about fit into holes whose length only receipt tells."""
        return sum(hole.lost for hole in self.holes if hole.estimated)

    @property
    def frame_s(self) -> float:
        """Length of the newest message in s; 0 where irregular."""
        return self._frame / self.rate_hz if self.rate_hz else 0.0

    def model(self, model: Model) -> None:
        """A clock model of the stream has come; one of another epoch is not used."""
        if self.has_device_time and abs(model.ros_ns(self.last_device_ns) - self._received_ns) < 30 * SECOND_NS:
            if self._model is None and not self.corrected and self.resets == 0:
                self.first_ns = model.ros_ns(self.first_device_ns) - self._reach_ns(self._first_count)
            self._model, self.corrected = model, True

    def host_stepped(self) -> None:
        """The host's clock was set: the smallest delay has to be found again."""
        self._bases.clear()
        self._based_on = 0
        self._model = None

    def take(self, raw: RawMessage, log_ns: int) -> int:
        """One message; returns its receipt, as far as it can be believed."""
        if not self.messages:
            self.first_log_ns = log_ns
        self.messages += 1
        raw = raw._replace(received_ns=self.receipts.believed_ns(raw.received_ns, log_ns))
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
            self._event(raw.received_ns, "channels", what)
        first, self._channels = not self._channels, raw.channels
        always = {name: whole and name in raw.channels for name, whole in self.channels.items()}
        self.channels = {**dict.fromkeys([*self.channels, *raw.channels], first), **always}

    def finish(self) -> None:
        """No message comes any more."""
        if self._clock is None and self._listening:
            self._begin()
        if self._late:
            self._settle(None)

    def _begin(self) -> None:
        waiting, self._listening = self._listening, []
        self.has_device_time = sum(message.raw.device_ns != 0 for message in waiting) * 2 > len(waiting)
        found_hz = _rate(waiting, self.has_device_time)
        self.rate_hz = found_hz if self.declared_hz is None else self.declared_hz
        if self.rate_hz and found_hz and self.has_device_time and abs(found_hz / self.rate_hz - 1) > DECLARED_TRUST:
            self.rate_hz = found_hz
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
            self._broken(raw, log_ns, previous_ns, n, fs_hz, placed.break_, placed.lost)
        elif placed.break_ is None:
            self._look_within(stamp_ns - previous_ns, n, fs_hz)
            self._steady_samples += n
            self._steady_ns += stamp_ns - previous_ns
        if self.has_device_time:
            self._learn_base(raw)
        offset_ns = self._ros_ns(stamp_ns) - stamp_ns if self.has_device_time else 0
        times_ns = placed.times_ns + offset_ns
        if placed.break_ is Break.FIRST:
            self.first_ns, self.first_device_ns, self._first_count = int(times_ns[0]), stamp_ns, n
        self.last_ns = int(times_ns[-1])
        self._remember(raw)
        self._received_ns, self._log_ns, self._frame = raw.received_ns, log_ns, n
        self.samples += n
        self.on_samples(Placed(times_ns, raw.channels, raw.samples, placed.break_ is not None))

    def _look_within(self, step_ns: int, n: int, fs_hz: float) -> None:
        """Samples lost inside a long message, which the kit takes for jitter, where a stream's stamps show none."""
        late = step_ns / SECOND_NS * fs_hz - n
        exact = len(self._jitter) >= EXACT and max(self._jitter) < WHOLE
        if exact and late > 0.5 and abs(late - round(late)) < 2 * WHOLE:
            self.lost_within += round(late)
        else:
            self._jitter.append(abs(late))

    def _is_repeated(self, raw: RawMessage) -> bool:
        """True for samples that came already: the same stamp, and the same content unless it comes at once again."""
        stamp_ns = raw.device_ns or raw.received_ns
        before = self._memory.get(stamp_ns)
        if before is None:
            return False
        if before == _content(raw):
            self.duplicates += 1
            self._event(self._ros_ns(stamp_ns), "duplicate", f"{len(raw.samples)} samples came again")
            return True
        if stamp_ns != self.last_device_ns:
            return False
        self.conflicts += 1
        self._event(raw.received_ns, "conflict", "other samples with the stamp of the message before")
        return True

    def _hole_of(self, stamp_ns: int, n: int) -> int | None:
        """Index of the hole of this epoch in which n samples that end here are missing."""
        if stamp_ns >= self.last_device_ns or self._clock is None:
            return None
        period_ns = SECOND_NS / self._clock.fs_hz
        begin_ns = stamp_ns - n * period_ns
        slack_ns = max(0.5, n / 20) * period_ns
        for i in range(len(self.holes) - 1, max(self._epoch_holes, len(self.holes) - HOLES) - 1, -1):
            hole = self.holes[i]
            if hole.estimated or hole.lost < n:
                continue
            if begin_ns > hole.from_device_ns - slack_ns and stamp_ns < hole.to_device_ns:
                return i
        return None

    def _fill(self, raw: RawMessage) -> None:
        """A late message makes its hole smaller; where another one has filled it already, it is a repetition."""
        assert self._clock is not None
        stamp_ns, n = raw.device_ns, len(raw.samples)
        i = self._hole_of(stamp_ns, n)
        if i is None:
            self.duplicates += 1
            self._event(self._ros_ns(stamp_ns), "duplicate", f"{n} samples came again")
            return
        self._split(i, stamp_ns, n, SECOND_NS / self._clock.fs_hz)
        self._remember(raw)
        self.samples += n
        self.reorders += 1
        late_s = (raw.received_ns - self._ros_ns(stamp_ns)) * 1e-9
        self._event(self._ros_ns(stamp_ns), "reorder", f"{n} samples came after newer ones, {late_s:.2f} s late")

    def _split(self, i: int, stamp_ns: int, n: int, period_ns: float) -> None:
        hole = self.holes.pop(i)
        begin_ns = stamp_ns - n * period_ns
        left = min(max(round((begin_ns - hole.from_device_ns) / period_ns), 0), hole.lost - n)
        right = hole.lost - n - left
        middle_ns = self._ros_ns(stamp_ns)
        parts = []
        if left:
            begin_ros_ns = middle_ns - round(n * period_ns)
            parts.append(Hole(hole.from_device_ns, round(begin_ns), hole.from_log_ns, hole.to_log_ns,
                              hole.from_ns, begin_ros_ns, left))  # fmt: skip
        if right:
            parts.append(Hole(stamp_ns, hole.to_device_ns, hole.from_log_ns, hole.to_log_ns,
                              middle_ns, hole.to_ns, right))  # fmt: skip
        self.holes[i:i] = parts

    def _broken(
        self, raw: RawMessage, log_ns: int, previous_ns: int, n: int, fs_hz: float, break_: Break, lost: int
    ) -> None:
        """Samples that do not continue those before them: a hole, or a clock that was set."""
        assert self._clock is not None
        before_ros_ns = self.last_ns
        pause_s = (raw.received_ns - self._received_ns) * 1e-9 - (n / fs_hz if fs_hz else 0.0)
        if not self.has_device_time:
            if break_ is Break.GAP and pause_s > 0:
                to_ns = raw.received_ns - round(n / fs_hz * 1e9)
                lost = round(pause_s * fs_hz)
                self.holes.append(Hole(0, 0, self._log_ns, log_ns, before_ros_ns, to_ns, lost, estimated=True))
            elif break_ is Break.RESET:
                self.backwards += 1
                self._event(raw.received_ns, "backwards", "stamp of receipt earlier than the samples before allow")
            return
        if not self._clock.nominal_hz:
            self.backwards += 1
            self._event(raw.received_ns, "backwards", f"stamp {(previous_ns - raw.device_ns) * 1e-9:.3f} s back")
            return
        jump_s = (raw.device_ns - previous_ns) * 1e-9
        if break_ is Break.GAP and not self._ran_ahead(raw, jump_s - n / fs_hz):
            to_ns = self._ros_ns(raw.device_ns) - round(n / fs_hz * 1e9)
            self.holes.append(Hole(previous_ns, raw.device_ns, self._log_ns, log_ns, before_ros_ns, to_ns, lost))
            return
        self.resets += 1
        kind = "reboot" if pause_s > PAUSE_S else "clock_reset"
        where = f"device clock went {'ahead' if jump_s > 0 else 'back'} by {_duration(abs(jump_s))}"
        self._memory.clear()
        self._bases.clear()
        self._based_on = 0
        self._model = None
        self._learn_base(raw)
        if kind == "reboot":
            to_ns = raw.received_ns - round(n / fs_hz * 1e9)
            lost = round(pause_s * fs_hz)
            logs = (self._log_ns, log_ns)
            self.holes.append(Hole(previous_ns, raw.device_ns, *logs, before_ros_ns, to_ns, lost, estimated=True))
            where += f" after a pause of {pause_s:.1f} s"
        self._epoch_holes = len(self.holes)
        self._event(raw.received_ns, kind, where)

    def _ran_ahead(self, raw: RawMessage, excess_s: float) -> bool:
        """True where the samples would have been received before they were taken, had any been lost."""
        if not self._bases:
            return False
        ahead_s = (min(base for _, base in self._bases) - (raw.received_ns - raw.device_ns)) * 1e-9
        return ahead_s > (STEP_S if self._based_on >= BASE_TRUST else max(STEP_S, 0.5 * excess_s))

    def _learn_base(self, raw: RawMessage) -> None:
        delay_ns = raw.received_ns - raw.device_ns
        self._based_on += 1
        if self._bases and delay_ns < min(base for _, base in self._bases) - SECOND_NS:
            self._bases.clear()  # the host's clock was set back
        minute = raw.received_ns // (60 * SECOND_NS)
        if self._bases and self._bases[-1][0] == minute:
            self._bases[-1] = (minute, min(self._bases[-1][1], delay_ns))
        else:
            self._bases.append((minute, delay_ns))

    def _ros_ns(self, device_ns: int) -> int:
        """Corrected ROS time of device time in the present epoch."""
        if not self.has_device_time:
            return device_ns
        if self._model is not None:
            return self._model.ros_ns(device_ns)
        return device_ns + (min(base for _, base in self._bases) if self._bases else 0)

    def _reach_ns(self, n: int) -> int:
        """From a message's first to its last sample."""
        return round((n - 1) / self.rate_hz * SECOND_NS) if self.rate_hz else 0

    def _event(self, at_ns: int, kind: str, what: str) -> None:
        self.counts[kind] += 1
        if self.counts[kind] <= KEPT:
            self.events.append(Event(at_ns, kind, what))

    def _remember(self, raw: RawMessage) -> None:
        self._memory[raw.device_ns or raw.received_ns] = _content(raw)
        if len(self._memory) > MEMORY:
            self._memory.popitem(last=False)


def _at_pace(late: list[_Waiting]) -> bool:
    """True for messages received about as far apart as they were taken; what is late comes in a burst."""
    stamps = [message.raw.device_ns for message in late]
    span_ns = max(stamps) - min(stamps)
    return len(late) >= PACED and abs(late[-1].raw.received_ns - late[0].raw.received_ns - span_ns) < span_ns / 4


def _content(raw: RawMessage) -> int:
    return zlib.crc32(raw.samples.tobytes())


def _rate(waiting: list[_Waiting], by_device: bool) -> float:
    """Rate by the median step of the stamps; 0 where there are fewer than three messages or the stamps are unsteady."""
    stamps = np.array([w.raw.device_ns if by_device else w.raw.received_ns for w in waiting], np.int64)
    counts = np.array([len(w.raw.samples) for w in waiting], float)
    steps = np.diff(stamps) * 1e-9
    good = steps > 0
    if good.sum() < 3:
        return 0.0
    per_sample = steps[good] / counts[1:][good]
    middle = float(np.median(per_sample))
    if by_device and np.median(np.abs(per_sample / middle - 1)) > 0.2:
        return 0.0  # irregular
    if by_device:
        return 1.0 / middle
    return float(counts[1:].sum() / ((stamps[-1] - stamps[0]) * 1e-9)) if stamps[-1] > stamps[0] else 0.0


def _duration(seconds: float) -> str:
    if seconds < 600:
        return f"{seconds:.3f} s"
    return f"{seconds / 3600:.1f} h" if seconds < 100 * 3600 else f"{seconds / 86400:.0f} days"
