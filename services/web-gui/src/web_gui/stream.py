"""One stream as the page needs it: its samples on the event clock, and the newest of everything else. Pure.

Nothing here asks how late it is: every method is given `now_ns`, of the study's `clock`.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from sense4hri.chunk import Break, Chunk, TimedChunk
from sense4hri.host_clocks import SensorHosts
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import SECOND_NS
from sense4hri.stream_info import StreamInfo, long_s

from web_gui.drawn import DERIVED, drawn
from web_gui.history import BELIEVABLE_NS, Clock, History
from web_gui.intake import MOST_ITEMS, shown
from web_gui.lately import Delays, Increase
from web_gui.marks import Marks
from web_gui.readings import Plain, at_path, number
from web_gui.steady import Steady

HEALTH_FRESH_NS = 3 * SECOND_NS  # contract, section 7: older health means LOST
STARTS_S = 3.0  # the kit's drivers say LOST where a device that is there sends nothing for so long,
HEALTH_S = 2.0  # with their next health
FRESH_NS = 5 * SECOND_NS  # features and states older than this are not shown as current
MOST_PENDING, MOST_PENDING_VALUES = 2000, 1 << 19  # messages kept while a stream's rate is not known yet
MOST_REPORTED = 64  # values that one device computes itself
LONGEST_S = 2.0  # between two messages of a stream whose rate says nothing else
LOWEST_HZ, HIGHEST_HZ = 1e-3, 1e6
MOST_SKEW_PPM = 10_000.0  # of a quartz it is below 200; anything like this is no clock
LATENCIES = 60
STARTING = 0  # StreamHealth
STATES = ("starting", "connecting", "streaming", "lost", "stopping")
CLOCK_STATES = ("WARMUP", "LOCKED", "HOLDOVER")


class Fresh(NamedTuple):
    """A message as plain values, and when it came."""

    plain: Plain
    at_ns: int


@dataclass
class Info:
    """What the stream's node says about it; unit empty and rate 0 where unknown."""

    sampling_frequency_hz: float = 0.0
    unit: str = ""
    parameters: Mapping[str, str] = field(default_factory=dict)
    problem: str = ""

    @classmethod
    def of(cls, told: StreamInfo) -> "Info":
        """Return what a node tells, as texts; a rate that nothing has is no rate."""
        rate_hz = told.sampling_frequency_hz
        known = {shown(name): shown(str(value)) for name, value in list(told.parameters.items())[:MOST_ITEMS]}
        return cls(rate_hz if LOWEST_HZ <= rate_hz <= HIGHEST_HZ else 0.0, shown(told.unit), known, shown(told.problem))


class Stream:
    """One topic family `/humans/physiological/<human>/<type>/<sensor>/*`.

    clock: tells the time of day of a moment `now_ns`, for whatever stands beside a stamp.
    age_ns: of a moment and of `now_ns`, see `axis.Axis`. hosts: tell the reference host's time of the stamps of
    whichever host the driver runs on; by it everything is placed, and `clock` goes.
    """

    def __init__(
        self,
        name: StreamName,
        history_s: float,
        now_ns: int,
        clock: Steady,
        age_ns: Callable[[int, int], int],
        hosts: SensorHosts,
    ) -> None:
        self.name, self.since_ns, self.age_ns = name, now_ns, age_ns
        self.key = "/".join(name)
        self.info: Info | None = None
        self.history: History | None = None
        self.has_raw = False
        self.online = True
        self.raw_at_ns = 0
        self.last_at_ns = now_ns
        self.interval_s = 0.0  # longest time between two raw messages lately
        self.features: Fresh | None = None
        self.health: Fresh | None = None
        self.starting_ns = 0  # since when its driver says that it starts
        self.clock: Fresh | None = None
        self.reported: dict[str, tuple[float, int]] = {}
        self.latencies: deque[float] = deque(maxlen=LATENCIES)
        self.lost = Increase()
        self.delays = Delays()
        self.marks = Marks(drawn(name.sensor_type))
        self._history_s, self._day, self._hosts = history_s, clock, hosts
        self._sample_clock: SampleClock | None = None
        self._features_clock = SampleClock(0.0)
        self._told_ns = 0  # event time of the newest derived value
        self._pending: deque[Chunk] = deque()
        self._pending_values = 0

    def learn(self, info: Info) -> None:
        """Take the stream's metadata; what came before it is placed now."""
        if self.info is None or info.sampling_frequency_hz != self.info.sampling_frequency_hz:
            self._sample_clock = SampleClock(max(0.0, info.sampling_frequency_hz))
        self.info = info
        while self._pending:
            self._place(self._oldest_pending())

    def raw(self, chunk: Chunk, now_ns: int) -> None:
        """Take one raw message; of a stream that has samples nothing else is drawn as its signal."""
        if not self.has_raw:
            self.history = None
        if self.raw_at_ns:
            self.interval_s = max(0.98 * self.interval_s, min(self._longest_s, self.silence_s(now_ns)))
        self.has_raw, self.raw_at_ns, self.last_at_ns = True, now_ns, now_ns
        chunk = chunk._replace(received_ns=self._to_reference(chunk.received_ns))
        delay_ns = self._day.wall_ns(now_ns) - chunk.received_ns
        if self._day.settled(now_ns):
            self.delays.take(delay_ns / SECOND_NS, now_ns)
        if self._sample_clock is None:
            self._wait(chunk)
        else:
            self._place(chunk)

    def take_features(self, plain: Plain, now_ns: int) -> None:
        """Take a features message and the marks it makes."""
        self.features = Fresh(plain, now_ns)
        self.last_at_ns = now_ns
        self.marks.take(plain, self.history.samples_total if self.history else 1)
        if not self.has_raw and self.name.sensor_type in DERIVED:
            self._derive(plain, now_ns)

    def take_health(self, plain: Plain, now_ns: int) -> None:
        """Take a health message; one from another time, as of a replay sought elsewhere, begins another count."""
        if self.health is not None:
            step_ns = _stamp_ns(plain) - _stamp_ns(self.health.plain)
            if not -BELIEVABLE_NS <= step_ns <= now_ns - self.health.at_ns + BELIEVABLE_NS:
                self.lost = Increase()
        before, self.health = self.health, Fresh(plain, now_ns)
        if before is None or int(before.plain.get("state", 0)) != STARTING:
            self.starting_ns = now_ns
        self._hosts.told(self.name.sensor_id, str(plain.get("host", "")))
        self.last_at_ns = now_ns
        self.lost.take(max(0, int(plain.get("lost_samples_total", 0))), now_ns)

    def take_clock(self, plain: Plain, now_ns: int) -> None:
        """Take a clock model, and lead it on to the reference host's time."""
        if stamp_ns := _stamp_ns(plain):
            plain = {**plain, "offset_ns": plain["offset_ns"] + self._to_reference(stamp_ns) - stamp_ns}
        self.clock = Fresh(plain, now_ns)
        if (latency_s := number(plain.get("latency_s"))) is not None:
            self.latencies.append(latency_s)
        if self.history is not None and (model := self._model()) is not None:
            self.history.set_model(model)

    def take_reported(self, values: Mapping[str, float], now_ns: int) -> None:
        """Take what the device itself computed: name -> newest value."""
        for name, value in values.items():
            self.reported[name] = (value, now_ns)
        while len(self.reported) > MOST_REPORTED:
            del self.reported[min(self.reported, key=lambda name: self.reported[name][1])]

    def device_values(self, now_ns: int) -> dict[str, float]:
        """Return what the device itself reported lately."""
        return {name: value for name, (value, at_ns) in self.reported.items() if self.age_ns(at_ns, now_ns) < FRESH_NS}

    def silence_s(self, now_ns: int) -> float:
        """Return for how long no raw message came."""
        return self.age_ns(self.raw_at_ns or self.since_ns, now_ns) / SECOND_NS

    def patience_s(self) -> float:
        """Return after how long a silence is a hole rather than the usual pause between two messages."""
        if self.derived:
            return FRESH_NS / SECOND_NS
        return max(1.0, 2.0 * self.interval_s + 0.5)

    def status(self, now_ns: int) -> str:
        """Return the stream's state in one word."""
        if self.health is None:
            if not self.has_raw:
                return "waiting" if self.features is None else "derived" if self.fresh_features(now_ns) else "silent"
            return "streaming" if self.silence_s(now_ns) < max(3.0, self.patience_s()) else "lost"
        if (health := self.fresh_health(now_ns)) is None:
            return "lost"
        state = int(health.get("state", 0))
        word = STATES[state] if state < len(STATES) else "lost"
        if word == "streaming" and self.silence_s(now_ns) > max(3.0, self.patience_s()):
            return "streaming" if not self.has_raw and self.device_values(now_ns) else "silent"
        return "lost" if word == "starting" and self._starts_in_vain(now_ns) else word

    def _starts_in_vain(self, now_ns: int) -> bool:
        """Return whether a stream that had samples has none, for longer than a driver of the kit says STARTING.

        One that never had any is being put on or switched on.
        """
        nominal_hz = number(self.health.plain.get("nominal_rate_hz")) if self.health else None
        silent_s = min(self.silence_s(now_ns), self.age_ns(self.starting_ns, now_ns) / SECOND_NS)
        return bool(self.raw_at_ns) and silent_s > long_s(STARTS_S, nominal_hz or 0.0) + HEALTH_S

    def fresh_features(self, now_ns: int) -> Plain | None:
        """Return the newest features unless they are old."""
        return self.features.plain if self.features and self.age_ns(self.features.at_ns, now_ns) < FRESH_NS else None

    def fresh_health(self, now_ns: int) -> Plain | None:
        """Return what the driver said last unless it is old."""
        return self.health.plain if self.health and self.age_ns(self.health.at_ns, now_ns) <= HEALTH_FRESH_NS else None

    def fresh_clock(self, now_ns: int) -> Plain | None:
        """Return the newest clock model unless it is old."""
        return self.clock.plain if self.clock and self.age_ns(self.clock.at_ns, now_ns) <= 2 * FRESH_NS else None

    @property
    def _longest_s(self) -> float:
        """What may still be the usual time between two messages: of one sample each, where they are so few."""
        rate_hz = self.info.sampling_frequency_hz if self.info else 0.0
        return max(LONGEST_S, 1.5 / rate_hz) if rate_hz else LONGEST_S

    @property
    def derived(self) -> bool:
        """True where a number of the features is the signal, for the stream has no samples of its own."""
        return self.history is not None and not self.has_raw

    @property
    def kept_bytes(self) -> int:
        """Memory that the stream's samples and marks take."""
        return 8 * self._pending_values + self.marks.kept_bytes + (self.history.kept_bytes if self.history else 0)

    def shrink(self) -> None:
        """Forget the older half of the samples and marks."""
        self.marks.halve()
        if self.history is not None:
            self.history.halve()

    def _wait(self, chunk: Chunk) -> None:
        """Keep a message until the stream's rate is known; the oldest make room."""
        self._pending.append(chunk)
        self._pending_values += chunk.samples.size
        while len(self._pending) > MOST_PENDING or self._pending_values > MOST_PENDING_VALUES:
            self._oldest_pending()

    def _oldest_pending(self) -> Chunk:
        chunk = self._pending.popleft()
        self._pending_values -= chunk.samples.size
        return chunk

    def _place(self, chunk: Chunk) -> None:
        if self._sample_clock is None:
            return
        self._keep(self._sample_clock.place(chunk), self._sample_clock.in_device_time)

    def _derive(self, plain: Plain, now_ns: int) -> None:
        """Keep the number that is drawn of a stream without samples; None and NaN lift the pen."""
        drawn_ = DERIVED[self.name.sensor_type]
        value = number(plain.get(drawn_.field))
        samples = np.array([[np.nan if value is None else value]])
        stamp_ns = _stamp_ns(plain)
        received_ns = self._to_reference(stamp_ns) if stamp_ns else self._day.wall_ns(now_ns)
        timed = self._features_clock.place(
            Chunk((drawn_.name,), samples, plain.get("device_timestamp") or None, received_ns)
        )
        before_ns, self._told_ns = self._told_ns, int(timed.times_ns[-1])
        if timed.break_ is None and self._told_ns - before_ns > FRESH_NS:
            timed = timed._replace(break_=Break.GAP)
        self._keep(timed, self._features_clock.in_device_time)

    def _keep(self, timed: TimedChunk, device_time: bool) -> None:
        history = self.history
        if history is None or history.channels != timed.channels or history.device_time != device_time:
            history = self.history = History(timed.channels, self._history_s, device_time, self._to_reference)
            if (model := self._model()) is not None:
                history.set_model(model)
        history.push(timed)

    def _to_reference(self, host_ns: Any) -> Any:
        """Return the reference host's time of what the driver's host shows, a number or many."""
        return self._hosts.reference_ns(self.name.sensor_id, host_ns)

    def _model(self) -> Clock | None:
        if self.clock is None or not abs(self.clock.plain["skew_ppm"]) < MOST_SKEW_PPM:
            return None
        plain = self.clock.plain
        return Clock(plain["device_reference"], plain["offset_ns"], plain["skew_ppm"], plain["segment"])


def _stamp_ns(plain: Plain) -> int:
    """The header's stamp of a message, 0 where it has none."""
    return int(at_path(plain, "header.stamp") or 0)
