"""What is known of the study right now: participants, their streams, and the newest of everything. Pure.

Nothing here asks a clock: every method is given `now_ns`, the host's wall clock at arrival. Freshness is judged by
arrival, so that a replay of any age looks alive while it plays.
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sense4hri.chunk import Chunk
from sense4hri.names import UNASSIGNED, StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stamps import SECOND_NS

from web_gui.history import Clock, History
from web_gui.readings import EVENTS, Plain, number

HEALTH_FRESH_NS = 3 * SECOND_NS  # contract, section 7: older health means LOST
FRESH_NS = 5 * SECOND_NS  # features and states older than this are not shown as current
FACE_FRESH_NS = 3 * SECOND_NS
FORGET_NS = 600 * SECOND_NS  # a stream that is gone stays on the page for this long
LIVE_NS = 10 * SECOND_NS  # data further than this from the wall clock is a replay
MOST_PENDING = 2000  # messages kept while a stream's rate is not known yet
MOST_EVENTS = 4000
MOST_MARKERS = 500
MOST_SKEW_PPM = 10_000.0  # of a quartz it is below 200; anything like this is no clock
LATENCIES = 60
STATES = ("starting", "connecting", "streaming", "lost", "stopping")
CLOCK_STATES = ("WARMUP", "LOCKED", "HOLDOVER")
_ORDER = ("streaming", "derived", "starting", "connecting", "waiting", "stopping", "silent", "lost")


class Fresh(NamedTuple):
    """A message as plain values, and the host's wall clock when it came."""

    plain: Plain
    at_ns: int


class Marked(NamedTuple):
    """A marker: the event's ROS time, its name and value, whom it concerns ("" = everybody)."""

    at_ns: int
    name: str
    value: str
    human_id: str


@dataclass
class Info:
    """What the stream's node says about it; unit empty and rate 0 where unknown."""

    sampling_frequency_hz: float = 0.0
    unit: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)


class Stream:
    """One topic family `/humans/physiological/<human>/<type>/<sensor>/*`."""

    def __init__(self, name: StreamName, history_s: float, now_ns: int) -> None:
        self.name, self.since_ns = name, now_ns
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
        self.clock: Fresh | None = None
        self.reported: dict[str, tuple[float, int]] = {}
        self.latencies: deque[float] = deque(maxlen=LATENCIES)
        self.losses: deque[tuple[int, int]] = deque(maxlen=30)
        self.events: deque[int] = deque(maxlen=MOST_EVENTS)
        self.events_total = 0
        self._history_s = history_s
        self._sample_clock: SampleClock | None = None
        self._pending: deque[Chunk] = deque(maxlen=MOST_PENDING)

    def learn(self, info: Info) -> None:
        """Take the stream's metadata; what came before it is placed now."""
        if self.info is None or info.sampling_frequency_hz != self.info.sampling_frequency_hz:
            self._sample_clock = SampleClock(max(0.0, info.sampling_frequency_hz))
        self.info = info
        while self._pending:
            self._place(self._pending.popleft())

    def raw(self, chunk: Chunk, now_ns: int) -> None:
        """Take one raw message."""
        if self.raw_at_ns:
            self.interval_s = max(0.98 * self.interval_s, min(2.0, (now_ns - self.raw_at_ns) / SECOND_NS))
        self.has_raw, self.raw_at_ns, self.last_at_ns = True, now_ns, now_ns
        if self._sample_clock is None:
            self._pending.append(chunk)
        else:
            self._place(chunk)

    def take_features(self, plain: Plain, now_ns: int) -> None:
        """Take a features message and the events it confirms."""
        self.features = Fresh(plain, now_ns)
        self.last_at_ns = now_ns
        events = plain.get(EVENTS.get(self.name.sensor_type, ("", ""))[0], ())
        self.events.extend(events)
        self.events_total += len(events)

    def take_health(self, plain: Plain, now_ns: int) -> None:
        """Take a health message."""
        self.health = Fresh(plain, now_ns)
        self.last_at_ns = now_ns
        self.losses.append((now_ns, max(0, int(plain.get("lost_samples_total", 0)))))

    def take_clock(self, plain: Plain, now_ns: int) -> None:
        """Take a clock model."""
        self.clock = Fresh(plain, now_ns)
        if (latency_s := number(plain.get("latency_s"))) is not None:
            self.latencies.append(latency_s)
        if self.history is not None and (model := self._model()) is not None:
            self.history.set_model(model)

    def take_reported(self, values: Mapping[str, float], now_ns: int) -> None:
        """Take what the device itself computed: name -> newest value."""
        for name, value in values.items():
            self.reported[name] = (value, now_ns)

    def device_values(self, now_ns: int) -> dict[str, float]:
        """Return what the device itself reported lately."""
        return {name: value for name, (value, at_ns) in self.reported.items() if now_ns - at_ns < FRESH_NS}

    def events_ns(self) -> list[int]:
        """Return the axis times of the events known."""
        if self.history is None:
            return []
        return [self.history.axis_ns(event_ns) for event_ns in self.events]

    def lost_lately(self, now_ns: int, seconds: float = 10.0) -> int:
        """Return how many samples went missing in the last seconds."""
        recent = [lost for at_ns, lost in self.losses if now_ns - at_ns <= seconds * SECOND_NS]
        return max(0, recent[-1] - recent[0]) if recent else 0

    def silence_s(self, now_ns: int) -> float:
        """Return for how long no raw message came."""
        return (now_ns - (self.raw_at_ns or self.since_ns)) / SECOND_NS

    def patience_s(self) -> float:
        """Return after how long a silence is a hole rather than the usual pause between two messages."""
        return max(1.0, 2.0 * self.interval_s + 0.5)

    def status(self, now_ns: int) -> str:
        """Return the stream's state in one word."""
        if self.health is None:
            if not self.has_raw:
                return "waiting" if self.features is None else "derived" if self.fresh_features(now_ns) else "silent"
            return "streaming" if self.silence_s(now_ns) < 3.0 else "lost"
        if now_ns - self.health.at_ns > HEALTH_FRESH_NS:
            return "lost"
        state = int(self.health.plain.get("state", 0))
        word = STATES[state] if state < len(STATES) else "lost"
        if word == "streaming" and self.silence_s(now_ns) > max(3.0, self.patience_s()):
            return "silent"
        return word

    def fresh_features(self, now_ns: int) -> Plain | None:
        """Return the newest features unless they are old."""
        return self.features.plain if self.features and now_ns - self.features.at_ns < FRESH_NS else None

    def _place(self, chunk: Chunk) -> None:
        if self._sample_clock is None:
            return
        device_time = chunk.device_ns is not None
        history = self.history
        if history is None or history.channels != chunk.channels or history.device_time != device_time:
            history = self.history = History(chunk.channels, self._history_s, device_time)
            if (model := self._model()) is not None:
                history.set_model(model)
        history.push(self._sample_clock.place(chunk))

    def _model(self) -> Clock | None:
        if self.clock is None or not abs(self.clock.plain["skew_ppm"]) < MOST_SKEW_PPM:
            return None
        plain = self.clock.plain
        return Clock(plain["device_reference"], plain["offset_ns"], plain["skew_ppm"], plain["segment"])


class Axis:
    """The page's right edge: the wall clock, or the time of a replay that plays from long ago."""

    def __init__(self) -> None:
        self._live_until_ns = 0
        self._offset_ns = 0
        self._offset_at_ns = 0

    def saw(self, stamp_ns: int, now_ns: int) -> None:
        """Take the receipt stamp of a message and the wall clock when it came."""
        offset_ns = stamp_ns - now_ns
        if abs(offset_ns) < LIVE_NS:
            self._live_until_ns = now_ns + FRESH_NS
        if offset_ns > self._offset_ns or now_ns - self._offset_at_ns > FRESH_NS or abs(self._offset_ns) < LIVE_NS:
            self._offset_ns = offset_ns
        self._offset_at_ns = now_ns

    def replaying(self, now_ns: int) -> bool:
        """True while everything that arrives is from another time."""
        playing = now_ns - self._offset_at_ns < 30 * SECOND_NS
        return playing and now_ns > self._live_until_ns and abs(self._offset_ns) >= LIVE_NS

    def now_ns(self, now_ns: int) -> int:
        """Return the axis time of the right edge."""
        return now_ns + self._offset_ns if self.replaying(now_ns) else now_ns


class Moment(NamedTuple):
    """One second of the strip; heart rate NaN = unknown."""

    at_ns: int
    heart_rate_bpm: float
    state: str
    expression: str


class Study:
    """Everything the page shows."""

    def __init__(self, history_s: float = 180.0, trend_s: float = 600.0) -> None:
        self.history_s = history_s
        self._trend_length = max(2, round(trend_s))
        self.streams: dict[StreamName, Stream] = {}
        self.states: dict[str, Fresh] = {}
        self.faces: dict[str, Fresh] = {}
        self.trends: dict[str, deque[Moment]] = {}
        self.markers: deque[Marked] = deque(maxlen=MOST_MARKERS)
        self.session: Plain | None = None
        self.nodes: set[str] = set()
        self.axis = Axis()

    def stream(self, name: StreamName, now_ns: int) -> Stream:
        """Return a stream, made at first sight; the same sensor under another human_id moves."""
        found = self.streams.get(name)
        if found is None:
            found = self.streams[name] = Stream(name, self.history_s, now_ns)
        return found

    def found(self, name: StreamName, now_ns: int) -> None:
        """A publisher of the stream's raw topic is on the graph."""
        self.stream(name, now_ns).online = True
        for other in [s for s in self.streams.values() if s.name[1:] == name[1:] and s.name != name and not s.online]:
            self._forget(other.name)

    def gone(self, name: StreamName, now_ns: int) -> None:
        """The publisher of the stream's raw topic left the graph."""
        self.stream(name, now_ns).online = False
        if any(s.name[1:] == name[1:] and s.name != name and s.online for s in self.streams.values()):
            self._forget(name)

    def take_state(self, human_id: str, plain: Plain, now_ns: int) -> None:
        """Take a fused state."""
        self.states[human_id] = Fresh(plain, now_ns)

    def take_expression(self, face_id: str, plain: Plain, now_ns: int) -> None:
        """Take the expression of a face."""
        self.faces[face_id] = Fresh(plain, now_ns)

    def take_marker(self, plain: Plain) -> None:
        """Take a marker."""
        texts = (str(plain.get(key, "")) for key in ("name", "value", "human_id"))
        self.markers.append(Marked(int(plain["stamp_ns"]), *texts))

    def tick(self, now_ns: int) -> None:
        """Once per second: extend the strip, forget what has long been gone."""
        for stream in list(self.streams.values()):
            if now_ns - stream.last_at_ns > FORGET_NS and not (stream.online and stream.has_raw):
                self._forget(stream.name)
        for face_id in [f for f, fresh in self.faces.items() if now_ns - fresh.at_ns > FORGET_NS]:
            del self.faces[face_id]
        for human_id in self.humans():
            if human_id == UNASSIGNED:
                continue
            trend = self.trends.setdefault(human_id, deque(maxlen=self._trend_length))
            heart_rate = self.heart_rate(human_id, now_ns)[0]
            state = self.state(human_id, now_ns)
            trend.append(
                Moment(
                    self.axis.now_ns(now_ns),
                    math.nan if heart_rate is None else heart_rate,
                    str(state["state"]) if state else "",
                    self.expression(human_id, now_ns),
                )
            )

    def humans(self) -> list[str]:
        """Return every human_id known, unassigned last."""
        known = {name.human_id for name in self.streams} | set(self.states)
        if self.session:
            known |= set(self.session.get("human_ids", ()))
        return sorted(known, key=lambda human_id: (human_id == UNASSIGNED, _natural(human_id)))

    def streams_of(self, human_id: str) -> list[Stream]:
        """Return a participant's streams in the order of the page."""
        own = (stream for stream in self.streams.values() if stream.name.human_id == human_id)
        return sorted(own, key=lambda s: (_rank(s.name.sensor_type), _natural(s.name.sensor_id)))

    def ordered(self) -> Iterable[Stream]:
        """Yield every stream in the order of the page."""
        for human_id in self.humans():
            yield from self.streams_of(human_id)

    def state(self, human_id: str, now_ns: int) -> Plain | None:
        """Return a participant's fused state unless it is old."""
        fresh = self.states.get(human_id)
        return fresh.plain if fresh and now_ns - fresh.at_ns < FRESH_NS else None

    def heart_rate(self, human_id: str, now_ns: int) -> tuple[float | None, str]:
        """Return (beats per minute, where it is from), or (None, why there is none)."""
        state = self.state(human_id, now_ns)
        if state is not None and (value := number(state.get("heart_rate_bpm"))) is not None:
            return value, "fused state"
        cardiac = [s for s in self.streams_of(human_id) if s.name.sensor_type in ("ecg", "ppg")]
        for stream in cardiac:
            features = stream.fresh_features(now_ns) or {}
            if (value := number(features.get("heart_rate_bpm"))) is not None:
                return value, f"{stream.name.sensor_type} {stream.name.sensor_id}"
        return None, self._no_heart_rate(cardiac, now_ns)

    def expression(self, human_id: str, now_ns: int) -> str:
        """Return a participant's facial expression, "" where none is known."""
        state = self.state(human_id, now_ns)
        if state is None:
            return ""
        face = self.faces.get(str(state.get("face_id", "")))
        if face is not None and now_ns - face.at_ns < FACE_FRESH_NS:
            return str(face.plain.get("expression", ""))
        return str(state.get("expression", ""))

    def sensor_status(self, streams: Iterable[Stream], now_ns: int) -> str:
        """Return the worst status among one sensor's streams."""
        return max((stream.status(now_ns) for stream in streams), key=_ORDER.index)

    def _no_heart_rate(self, cardiac: list[Stream], now_ns: int) -> str:
        if not cardiac:
            return "no ECG or PPG sensor on this participant"
        for stream in cardiac:
            features = stream.fresh_features(now_ns)
            if features is not None:
                texts = "; ".join(str(text) for text in features.get("reasons", ()))
                return texts or "the interpreter gives no heart rate and no reason"
        if all(stream.status(now_ns) in ("lost", "silent", "connecting", "starting") for stream in cardiac):
            return "no data from " + " and ".join(sorted({stream.name.sensor_id for stream in cardiac}))
        return f"no features for {FRESH_NS // SECOND_NS} s"

    def _forget(self, name: StreamName) -> None:
        self.streams.pop(name, None)


_TYPE_ORDER = (
    "ecg",
    "ppg",
    "respiration",
    "eda",
    "emg",
    "eeg",
    "eog",
    "eye_tracking",
    "pupillometry",
    "temperature",
    "accelerometer",
    "gyroscope",
    "magnetometer",
)


def _rank(sensor_type: str) -> int:
    return _TYPE_ORDER.index(sensor_type) if sensor_type in _TYPE_ORDER else len(_TYPE_ORDER)


def _natural(text: str) -> tuple[str, int, str]:
    """Sort p2 before p10."""
    stem = text.rstrip("0123456789")
    return stem, int(text[len(stem) :] or 0), text
