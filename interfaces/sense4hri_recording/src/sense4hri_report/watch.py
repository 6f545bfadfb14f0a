"""What others said of a stream while it was recorded: its driver (health), clock-sync (clock), its interpreter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sense4hri.host_account import HostAccount
from sense4hri.intake import LARGEST_DIFFERENCE_NS, LARGEST_PPM
from sense4hri.stamps import to_ns
from sense4hri.stream_info import can_be_rate

from sense4hri_report.bins import Axis, Values
from sense4hri_report.ros_time import Model

STATES = ("STARTING", "CONNECTING", "STREAMING", "LOST", "STOPPING")
CLOCK_STATES = ("WARMUP", "LOCKED", "HOLDOVER")
STREAMING, LOCKED = 2, 1
HOST_STEP_NS = 5_000_000
"""A host clock that moved so far between two accounts, and stayed there, was set; slewing is slower."""
EPOCH_NS = 1_000_000_000
"""Models that are so far apart are of two epochs of the device's clock, whatever number clock-sync gives them."""
SLACK_NS = 1_000_000_000
"""By so much a silence may seem shorter than the step that it is."""
COUNTERS = ("samples_total", "lost_samples_total", "gaps_total", "duplicates_total", "reconnects_total")


@dataclass
class Span:
    """Something that held for a while, ROS time."""

    from_ns: int
    to_ns: int
    what: str


class HostStep(NamedTuple):
    """A step of a host's clock; before_ns, after_ns: stamps of the accounts around it."""

    host: str
    before_ns: int
    after_ns: int
    step_ns: int

    def moved(self, to_reference: Callable[[int], int]) -> HostStep:
        """The step with its stamps led to the reference host's time, by what held before it."""
        before_ns = to_reference(self.before_ns)
        return self._replace(before_ns=before_ns, after_ns=before_ns + self.after_ns - self.before_ns - self.step_ns)

    def left_of(self, from_ns: int, to_ns: int) -> int:
        """How long a silence by that clock truly was; a time that is not of the step is left as it is."""
        left_ns = to_ns - from_ns - self.step_ns
        is_of_step = self.step_ns > 0 and from_ns <= self.after_ns and to_ns >= self.before_ns
        return max(left_ns, 0) if is_of_step and left_ns > -SLACK_NS else to_ns - from_ns


@dataclass
class HostWatch:
    """CLOCK_REALTIME minus CLOCK_MONOTONIC of one host, as its drivers tell it again and again."""

    host: str
    steps: list[HostStep] = field(default_factory=list)
    _before: HostAccount | None = None
    _candidate: HostAccount | None = None

    def take(self, account: HostAccount) -> HostStep | None:
        """One account; returns a step once the next account confirms it. One odd account is a busy host."""
        value, before, candidate = account.realtime_minus_monotonic_ns, self._before, self._candidate
        if value == 0:
            return None
        if before is None or abs(value - before.realtime_minus_monotonic_ns) < HOST_STEP_NS:
            self._before, self._candidate = account, None
            return None
        if candidate is None or abs(value - candidate.realtime_minus_monotonic_ns) >= HOST_STEP_NS:
            self._candidate = account
            return None
        self._before, self._candidate = account, None
        if account.is_of_a_new_start(before):
            return None
        step_ns = candidate.realtime_minus_monotonic_ns - before.realtime_minus_monotonic_ns
        self.steps.append(HostStep(self.host, before.stamp_ns, candidate.stamp_ns, step_ns))
        return self.steps[-1]


class HealthWatch:
    """A driver's account of one stream."""

    def __init__(self, axis: Axis) -> None:
        self.messages = 0
        self.nominal_hz: float | None = None
        self.host = ""
        self.battery, self.rssi, self.latency = Values(axis), Values(axis), Values(axis)
        self.off_skin: list[Span] = []
        self.not_streaming: list[Span] = []
        self.restarts = 0
        self.sent_since_raw = 0
        """About how many samples the driver has sent since the newest raw message came."""
        self.lost: list[tuple[int, int, int]] = []  # from, to (ROS time, ns), samples, as the driver counted
        self.reconnects: list[int] = []
        self._contact_known = 0
        self._on_skin = 0
        self._gained = dict.fromkeys(COUNTERS, 0)
        self._known: dict[str, int] = {}
        self._before: Any = None
        self._before_ns = 0

    @property
    def contact_share(self) -> float:
        """Share of the accounts that say `on the skin`; NaN where none says anything."""
        return self._on_skin / self._contact_known if self._contact_known else math.nan

    def counted(self, name: str) -> int | None:
        """What a counter of the driver gained while recorded; None = cannot be known, as the driver said last."""
        told = self._before is not None and getattr(self._before, name) >= 0
        return self._gained[name] if told else None

    @property
    def last_state(self) -> str:
        """The state that the driver told last, empty where it never did."""
        return "" if self._before is None else _name(STATES, self._before.state)

    def raw_came(self) -> None:
        """A raw message of the stream has come."""
        self.sent_since_raw = 0

    def take(self, message: Any, at_ns: int) -> None:
        """Take one health message: the driver's account of the stream. at_ns: its stamp, in the reference's time."""
        before, self._before = self._before, message
        self.messages += 1
        self.host = message.host
        if can_be_rate(message.nominal_rate_hz):
            self.nominal_hz = float(message.nominal_rate_hz)
        self.battery.add(at_ns, message.battery_percent)
        self.rssi.add(at_ns, message.rssi_dbm)
        self.latency.add(at_ns, message.latency_s)
        if math.isfinite(message.contact):
            self._contact_known += 1
            self._on_skin += message.contact > 0
            if message.contact <= 0:
                _extend(self.off_skin, at_ns, "off the skin")
        if message.state != STREAMING:
            why = f": {message.reasons[0]}" if len(message.reasons) else ""
            _extend(self.not_streaming, at_ns, f"{_name(STATES, message.state)}{why}")
        self._count(before, message, at_ns)
        self._before_ns = at_ns

    def _count(self, before: Any, message: Any, at_ns: int) -> None:
        restarted = before is not None and message.samples_total < before.samples_total
        self.restarts += restarted
        if restarted:
            self._known.clear()
        for name in COUNTERS:
            now = int(getattr(message, name))
            if now < 0:
                continue
            then, self._known[name] = self._known.get(name, 0), now
            gained = now - then
            self._gained[name] += 0 if before is None else max(gained, 0)
            if name == "samples_total" and before is not None:
                self.sent_since_raw += max(gained, 0)
            if name == "lost_samples_total" and before is not None and gained > 0:
                self.lost.append((self._before_ns, at_ns, gained))
            if name == "reconnects_total" and before is not None and gained > 0:
                self.reconnects.append(at_ns)


class ClockWatch:
    """The clock models of one stream. points: (index of segment, ROS time ns, offset ns), one per column of the axis.

    segments: when each began, and its number, which a clock-sync that was started anew counts from 1 again.
    """

    def __init__(self, axis: Axis) -> None:
        self.messages = 0
        self.uncertainty_s, self.latency_s = Values(axis), Values(axis)
        self.points: dict[int, tuple[int, int, int]] = {}
        self.segments: list[tuple[int, int]] = []
        self.unlocked: list[Span] = []
        self.skew_ppm = math.nan
        self.impossible = 0
        self._axis = axis
        self._locked = 0
        self._last_ns = 0
        self._newest: Model | None = None
        self._number = 0

    @property
    def locked_share(self) -> float:
        """Share of the models that are LOCKED; NaN where there is none."""
        return self._locked / self.messages if self.messages else math.nan

    def take(self, message: Any, at_ns: int) -> Model | None:
        """One model; None for one that came already, as at the head of every file, and for one that is no clock's.

        at_ns: its stamp, in the reference host's time.
        """
        stamp_ns = to_ns(message.header.stamp)
        if not abs(message.skew_ppm) <= LARGEST_PPM or abs(message.offset_ns) > LARGEST_DIFFERENCE_NS:
            self.impossible += 1
            return None
        reference_ns = to_ns(message.device_reference)
        if stamp_ns == self._last_ns:
            return None
        self._last_ns = stamp_ns
        self.messages += 1
        self._locked += message.state == LOCKED
        model = Model(reference_ns, int(message.offset_ns), float(message.skew_ppm))
        self.uncertainty_s.add(at_ns, message.uncertainty_s)
        self.latency_s.add(at_ns, message.latency_s)
        if self._begins(model, int(message.segment)):
            self.segments.append((at_ns, int(message.segment)))
        self._newest, self._number = model, int(message.segment)
        self.points[self._axis.column(at_ns)] = (len(self.segments), model.ros_ns(reference_ns), model.offset_ns)
        if message.state == LOCKED:
            self.skew_ppm = float(message.skew_ppm)
        else:
            _extend(self.unlocked, at_ns, _name(CLOCK_STATES, message.state))
        return model

    def _begins(self, model: Model, number: int) -> bool:
        """True where a segment begins; one that only counts from 1 again goes on where the one before was."""
        if self._newest is None or number > self._number:
            return True
        apart_ns = model.ros_ns(model.reference_ns) - self._newest.ros_ns(model.reference_ns)
        return abs(apart_ns) > EPOCH_NS


class FeatureWatch:
    """What an interpreter published on one stream."""

    def __init__(self, axis: Axis) -> None:
        self.messages = 0
        self.quality = Values(axis)
        self.first_ns = self.last_ns = 0

    def take(self, message: Any, at_ns: int) -> None:
        """Take one features message. at_ns: its stamp, in the reference host's time."""
        self.messages += 1
        self.first_ns, self.last_ns = self.first_ns or at_ns, at_ns
        self.quality.add(at_ns, float(getattr(message, "signal_quality", math.nan)))


def _extend(spans: list[Span], at_ns: int, what: str) -> None:
    """Accounts come about once a second: the same word within three seconds is the same span."""
    if spans and spans[-1].what == what and 0 <= at_ns - spans[-1].to_ns <= 3_000_000_000:
        spans[-1].to_ns = at_ns
    else:
        spans.append(Span(at_ns, at_ns, what))


def _name(names: tuple[str, ...], number: int) -> str:
    return names[number] if 0 <= number < len(names) else f"state {number}"
