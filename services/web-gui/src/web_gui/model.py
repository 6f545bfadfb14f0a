"""What is known of the study right now: participants, their streams, and the newest of everything. Pure.

Nothing here asks how late it is: every method is given `now_ns`, of the study's `clock`. Freshness is judged by
arrival, so that a replay of any age looks alive while it plays.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from sense4hri.chunk import Chunk
from sense4hri.modalities import MODALITIES
from sense4hri.names import UNASSIGNED, StreamName
from sense4hri.stamps import SECOND_NS

from web_gui.axis import Axis
from web_gui.hosts import Hosts
from web_gui.readings import Plain, number
from web_gui.services import Services
from web_gui.session import Session
from web_gui.steady import Steady
from web_gui.stream import FRESH_NS, Fresh, Stream

FACE_FRESH_NS = 3 * SECOND_NS
FORGET_NS = 600 * SECOND_NS  # a stream that is gone stays on the page for this long
MOST_MARKERS = 500
DRIVER = "driver_"  # begins a driver's node; it is ready while its device streams, which the streams tell
MOST_PEOPLE, MOST_FAULTS = 1000, 200
MOST_STREAMS, MOST_GONE = 2000, 100  # known at once; of these, no longer on the graph
MOST_BYTES, MOST_GONE_BYTES = 512_000_000, 16_000_000  # of their samples
_ORDER = ("streaming", "derived", "starting", "connecting", "waiting", "stopping", "silent", "lost")


class Marked(NamedTuple):
    """A marker: the event's ROS time, its name and value, whom it concerns ("" = everybody)."""

    at_ns: int
    name: str
    value: str
    human_id: str


class Moment(NamedTuple):
    """One point of the strip, each second; heart rate NaN = unknown; step_ns: about how long after the one before."""

    at_ns: int
    step_ns: int
    heart_rate_bpm: float
    state: str
    expression: str


class Study:
    """Everything the page shows. clock: of the host on which it runs; kept with the reference host's time of day."""

    def __init__(self, history_s: float = 600.0, trend_s: float = 600.0, clock: Steady | None = None) -> None:
        self.hosts = Hosts()
        self.history_s, self.clock = history_s, (clock or Steady()).corrected(self.hosts.of_here_ns)
        self.trend_s = round(trend_s)
        self.streams: dict[StreamName, Stream] = {}
        self._worn: dict[str, list[Stream]] | None = None  # by whom, in the order of the page; None = to be sorted anew
        self.states: dict[str, Fresh] = {}
        self.faces: dict[str, Fresh] = {}
        self.trends: dict[str, deque[Moment]] = {}
        self.markers: deque[Marked] = deque(maxlen=MOST_MARKERS)
        self.session = Session(self.clock)
        self.faults: dict[str, str] = {}
        """What publishers do wrong, one sentence each."""
        self.notes: dict[str, list[str]] = {}
        """What the registry says of a sensor: an assignment that was asked and has not happened."""
        self.services = Services()
        self.axis = Axis(self.clock.wall_ns)

    def stream(self, name: StreamName, now_ns: int) -> Stream:
        """Return a stream, made at first sight; the same sensor under another human_id moves."""
        found = self.streams.get(name)
        if found is None:
            if len(self.streams) >= MOST_STREAMS:
                self._forget(min(self.streams.values(), key=lambda one: one.last_at_ns).name)
            sensors = self.hosts.sensors
            found = self.streams[name] = Stream(name, self.history_s, now_ns, self.clock, self.axis.age_ns, sensors)
            self._worn = None
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

    def features_gone(self, name: StreamName) -> None:
        """Nobody computes a stream any more; one without samples of its own moved with what it is computed from."""
        found = self.streams.get(name)
        if found and not found.has_raw and any(s[1:] == name[1:] and s != name for s in self.streams):
            self._forget(name)

    def take_raw(self, name: StreamName, chunk: Chunk, now_ns: int) -> None:
        """Take one raw message of a stream."""
        self.axis.saw(self.hosts.sensors.reference_ns(name.sensor_id, chunk.received_ns), now_ns)
        self.stream(name, now_ns).raw(chunk, now_ns)

    def take_state(self, human_id: str, plain: Plain, now_ns: int) -> None:
        """Take a fused state."""
        _keep(self.states, human_id, Fresh(plain, now_ns))

    def take_expression(self, face_id: str, plain: Plain, now_ns: int) -> None:
        """Take the expression of a face."""
        _keep(self.faces, face_id, Fresh(plain, now_ns))

    def take_marker(self, plain: Plain, now_ns: int) -> None:
        """Take a marker; one without a stamp stands where it was heard, one that a replay says again where it is."""
        texts = (str(plain.get(key, "")) for key in ("name", "value", "human_id"))
        stamp_ns = self.hosts.marked_ns(str(plain.get("source", "")), int(plain["stamp_ns"]))
        marked = Marked(stamp_ns or self.clock.wall_ns(now_ns), *texts)
        if marked not in self.markers:
            self.markers.append(marked)

    def tick(self, now_ns: int) -> None:
        """Once per second: extend the strip, forget what has long been gone."""
        signals = any(now_ns - stream.raw_at_ns < SECOND_NS for stream in self.streams.values())
        session = self.session
        phase = "idle" if session.replayed else session.phase
        session.recorder.judge(phase, str(session.state.get("session_id", "")), signals, now_ns)
        self._forget_gone(now_ns)
        self._bound_memory()
        at_ns = self.axis.now_ns(now_ns)
        for human_id in self.humans():
            if human_id == UNASSIGNED:
                continue
            trend = self.trends.setdefault(human_id, deque(maxlen=self.trend_s))
            heart_rate = self.heart_rate(human_id, now_ns)[0]
            state = self.state(human_id, now_ns)
            while trend and trend[-1].at_ns >= at_ns:  # a replay was sought back, or the host's clock set back
                trend.pop()
            trend.append(
                Moment(
                    at_ns,
                    self.axis.step_ns(now_ns),
                    math.nan if heart_rate is None else heart_rate,
                    str(state["state"]) if state else "",
                    self.expression(human_id, now_ns),
                )
            )

    def judge(self, topic: str, why: str) -> None:
        """Take what is wrong with a topic; an empty why: nothing is, or it has gone."""
        if not why:
            self.faults.pop(topic, None)
        elif topic in self.faults or len(self.faults) < MOST_FAULTS:
            self.faults[topic] = why

    def take_notes(self, notes: dict[str, list[str]]) -> None:
        """Take all that the registry says of sensors."""
        self.notes = dict(list(notes.items())[:MOST_FAULTS])

    def state_gone(self, human_id: str) -> None:
        """Nobody tells this participant's state any more."""
        self.states.pop(human_id, None)

    def face_gone(self, face_id: str) -> None:
        """Nobody tells this face's expression any more."""
        self.faces.pop(face_id, None)

    def unseen(self, now_ns: int) -> dict[str, str]:
        """Return the drivers whose device has shown no stream yet, by which else they are told of; each with why.

        A driver's node is named `driver_<kind>_<sensor_id>`.
        """
        sensors = {name.sensor_id for name in self.streams}
        return {
            driver: why
            for driver, why in self.services.not_ready(now_ns).items()
            if driver.startswith(DRIVER) and not any(driver.endswith(f"_{sensor_id}") for sensor_id in sensors)
        }

    def humans(self) -> list[str]:
        """Return every human_id known, unassigned last."""
        known = {name.human_id for name in self.streams} | set(self.states)
        known |= set(self.session.human_ids)
        return sorted(known, key=lambda human_id: (human_id == UNASSIGNED, _natural(human_id)))

    def streams_of(self, human_id: str) -> list[Stream]:
        """Return a participant's streams in the order of the page."""
        if self._worn is None:
            self._worn = {}
            for stream in sorted(self.streams.values(), key=_place):
                self._worn.setdefault(stream.name.human_id, []).append(stream)
        return list(self._worn.get(human_id, ()))

    def ordered(self) -> Iterable[Stream]:
        """Yield every stream in the order of the page, below those with samples what is derived from them."""
        for human_id in self.humans():
            yield from sorted(self.streams_of(human_id), key=lambda stream: stream.derived)

    def state(self, human_id: str, now_ns: int) -> Plain | None:
        """Return a participant's fused state unless it is old."""
        fresh = self.states.get(human_id)
        return fresh.plain if fresh and self.axis.age_ns(fresh.at_ns, now_ns) < FRESH_NS else None

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
        if face is not None and self.axis.age_ns(face.at_ns, now_ns) < FACE_FRESH_NS:
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

    def _forget_gone(self, now_ns: int) -> None:
        """Of what has left the graph keep the newest, for a while; and no strip of people of whom nothing is left."""
        gone = [s for s in self.streams.values() if not (s.online and s.has_raw) and now_ns - s.last_at_ns > FRESH_NS]
        kept_bytes = 0
        for rank, stream in enumerate(sorted(gone, key=lambda s: -s.last_at_ns)):
            kept_bytes += stream.kept_bytes
            long_ago = now_ns - stream.last_at_ns > FORGET_NS
            if long_ago or rank >= MOST_GONE or kept_bytes > MOST_GONE_BYTES:
                self._forget(stream.name)
        for human_id in self.trends.keys() - set(self.humans()):
            del self.trends[human_id]

    def _bound_memory(self) -> None:
        """Where the samples take too much memory the streams that take most of it remember less."""
        while sum(stream.kept_bytes for stream in self.streams.values()) > MOST_BYTES:
            max(self.streams.values(), key=lambda stream: stream.kept_bytes).shrink()

    def _forget(self, name: StreamName) -> None:
        self.streams.pop(name, None)
        self._worn = None


def _keep(newest: dict[str, Fresh], key: str, fresh: Fresh) -> None:
    """Keep what was heard last of everybody; where there are too many, whoever was silent longest makes room."""
    newest[key] = fresh
    if len(newest) > MOST_PEOPLE:
        del newest[min(newest, key=lambda one: newest[one].at_ns)]


_TYPE_ORDER = list(MODALITIES)


def _place(stream: Stream) -> tuple[int, tuple[str, int, str]]:
    return _rank(stream.name.sensor_type), _natural(stream.name.sensor_id)


def _rank(sensor_type: str) -> int:
    return _TYPE_ORDER.index(sensor_type) if sensor_type in MODALITIES else len(_TYPE_ORDER)


def _natural(text: str) -> tuple[str, int, str]:
    """Sort p2 before p10."""
    stem = text.rstrip("0123456789")
    return stem, int(text[len(stem) :] or 0), text
