"""What is wrong, in sentences, with what is being done about it. Pure."""

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple

from sense4hri.beats import AFRESH_S
from sense4hri.modalities import MODALITIES
from sense4hri.names import UNASSIGNED
from sense4hri.stamps import SECOND_NS

from web_gui.intake import LONGEST_SENTENCE, shown
from web_gui.model import Study
from web_gui.readings import number
from web_gui.stream import FRESH_NS, Stream

SETTLE_S = 10.0  # a new stream may take this long before anything is missing
MOVING_NS = 3 * SECOND_NS  # for so long the old topics of a sensor that moves may still be seen
LOW_BATTERY_PERCENT = 15.0
LOW_QUALITY = 0.5
MOST_ENDED = 200
RECORDER = "recorder"  # its node
INTERPRETED = tuple(name for name, entry in MODALITIES.items() if entry.message and not entry.helper)


class Problem(NamedTuple):
    """One sentence. key: what it is about, the same as long as it lasts; severity: `error` or `warning`."""

    key: str
    text: str
    severity: str


class Entry(NamedTuple):
    """A problem with its time on the host's wall clock; ended_ns None = it lasts."""

    problem: Problem
    since_ns: int
    ended_ns: int | None


class ProblemLog:
    """Remembers since when a problem lasts, and those that are over."""

    def __init__(self) -> None:
        self._lasting: dict[str, Entry] = {}
        self._ended: deque[Entry] = deque(maxlen=MOST_ENDED)

    def update(self, problems: Iterable[Problem], now_ns: int) -> None:
        """Take the problems of this moment."""
        current = {one.key: one._replace(text=shown(one.text, LONGEST_SENTENCE)) for one in problems}
        for key in [key for key in self._lasting if key not in current]:
            self._ended.append(self._lasting.pop(key)._replace(ended_ns=now_ns))
        for key, problem in current.items():
            since_ns = self._lasting[key].since_ns if key in self._lasting else now_ns
            self._lasting[key] = Entry(problem, since_ns, None)

    def lasting(self) -> list[Entry]:
        """Return what is wrong now, newest first."""
        return sorted(self._lasting.values(), key=lambda entry: -entry.since_ns)

    def ended(self) -> list[Entry]:
        """Return what is over, newest first."""
        return sorted(self._ended, key=lambda entry: -(entry.ended_ns or 0))


def problems(study: Study, now_ns: int) -> Iterator[Problem]:
    """Yield everything that is wrong with the study at this moment."""
    if study.session.phase == "failed":
        detail = study.session.state.get("detail") or "no detail given"
        yield Problem("session", f"the session failed: {detail}", "error")
    recorder = study.session.recorder.newest(now_ns)
    if study.session.recorder.doubt:
        yield Problem("not recorded", study.session.recorder.doubt, "error")
    elif recorder is not None and recorder.level != "ok":
        yield Problem("recorder", f"recorder: {recorder.message}", recorder.level)
    yield from _of_services(study, now_ns / SECOND_NS)
    yield from (Problem(f"fault {topic}", text, "warning") for topic, text in study.faults.items())
    for sensor_id, texts in study.notes.items():
        for which, text in enumerate(texts):
            yield Problem(f"note {sensor_id} {which}", f"{sensor_id}: {text}", "error")
    by_sensor = sorted(study.streams.values(), key=_sensor_key)
    for (human_id, sensor_id), streams in groupby(by_sensor, key=_sensor_key):
        yield from _of_sensor(study, human_id, sensor_id, list(streams), now_ns)
    yield from _duplicates(study, now_ns)


def _of_services(study: Study, now_s: float) -> Iterator[Problem]:
    """Yield who hangs, was stopped or killed; of the recorder more is known where its words are doubted."""
    for service, why in study.beats.troubles(now_s).items():
        if not (service == RECORDER and study.session.recorder.doubt):
            yield Problem(f"service {service}", f"{service}: {why}", "error")
    for service in study.beats.afresh(now_s):
        text = f"{service} was killed or failed, and was started afresh less than {AFRESH_S:g} s ago"
        yield Problem(f"afresh {service}", text, "warning")


def _sensor_key(stream: Stream) -> tuple[str, str]:
    return stream.name.human_id, stream.name.sensor_id


def _of_sensor(study: Study, human_id: str, sensor_id: str, streams: list[Stream], now_ns: int) -> Iterator[Problem]:
    who = f"{human_id} / {sensor_id}"
    if human_id == UNASSIGNED and any(stream.online for stream in streams):
        yield Problem(
            f"unassigned {sensor_id}", f"{sensor_id} is worn by nobody: assign it to a participant", "warning"
        )
    for stream in streams:
        if stream.info is not None and stream.info.problem:
            yield Problem(f"unusable {stream.key}", f"{who}: {stream.name.sensor_type}: {stream.info.problem}", "error")
        if stream.refused.why and now_ns - stream.refused.at_ns < SETTLE_S * SECOND_NS:
            text = f"{who}: {stream.name.sensor_type} messages are left out: {stream.refused.why}"
            yield Problem(f"refused {stream.key}", text, "error")
    dead = [stream for stream in streams if _dead(stream, now_ns)]
    if dead and len(dead) == len([stream for stream in streams if stream.has_raw or stream.health]):
        yield Problem(f"lost {who}", f"{who}: {_why_dead(dead, now_ns)}", "error")
        return
    for stream in dead:
        text = f"{who}: {stream.name.sensor_type} is silent; {_why_dead([stream], now_ns)}"
        yield Problem(f"silent {stream.key}", text, "error")
    yield from _condition(who, streams, now_ns)
    losses = [f"{lost} {s.name.sensor_type}" for s in streams if (lost := s.lost_lately(now_ns))]
    if losses:
        yield Problem(f"losing {who}", f"{who}: lost {' and '.join(losses)} samples in the last 10 s", "warning")
    for stream in streams:
        if stream not in dead and stream.raw_at_ns and _age_s(stream, now_ns) > SETTLE_S:
            yield from _of_stream(study, who, stream, now_ns)


def _dead(stream: Stream, now_ns: int) -> bool:
    if not stream.has_raw and stream.health is None:
        return False  # derived from another stream, which tells what is wrong
    status = stream.status(now_ns)
    settling = status in ("starting", "connecting", "waiting") and not stream.raw_at_ns
    return status in ("lost", "silent", "connecting", "starting") and not (settling and _age_s(stream, now_ns) < 5.0)


def _why_dead(streams: list[Stream], now_ns: int) -> str:
    stream = min(streams, key=lambda s: s.silence_s(now_ns))
    statuses = {s.status(now_ns) for s in streams}
    since = f"no data for {_duration(stream.silence_s(now_ns))}"
    if not any(s.raw_at_ns for s in streams):
        since = f"no data yet, {_duration(stream.silence_s(now_ns))} after it appeared"
    health = stream.health
    if health is None or now_ns - health.at_ns > 3 * SECOND_NS:
        silent = "its driver has left the graph" if not stream.online else "its driver says nothing"
        return f"{since}; {silent}. It comes back by itself when the driver does"
    reasons = "; ".join(str(text) for text in health.plain.get("reasons", ()))
    doing = "connecting" if statuses & {"connecting", "starting"} else "reconnecting"
    if statuses == {"silent"}:
        doing = "the driver is connected but receives no samples"
    times = int(health.plain.get("reconnects_total", 0))
    again = f", {times} reconnection{'s' * (times != 1)} so far" if times > 0 else ""
    return f"{since}, {doing}{again}" + (f" ({reasons})" if reasons else "")


def _condition(who: str, streams: list[Stream], now_ns: int) -> Iterator[Problem]:
    fresh = [s.health.plain for s in streams if s.health and now_ns - s.health.at_ns < 3 * SECOND_NS]
    batteries = [value for plain in fresh if (value := number(plain.get("battery_percent"))) is not None]
    if batteries and min(batteries) <= LOW_BATTERY_PERCENT:
        yield Problem(f"battery {who}", f"{who}: battery at {min(batteries):.0f} %, charge it soon", "warning")
    if any(number(plain.get("contact")) == 0 for plain in fresh):
        yield Problem(f"contact {who}", f"{who}: no skin contact; moisten the electrodes or tighten the strap", "error")


def _of_stream(study: Study, who: str, stream: Stream, now_ns: int) -> Iterator[Problem]:
    kind = stream.name.sensor_type
    if kind in INTERPRETED or stream.features:
        yield from _interpretation(study, who, stream, now_ns)
    if stream.history and stream.history.device_time:
        yield from _timing(who, stream, now_ns)


def _interpretation(study: Study, who: str, stream: Stream, now_ns: int) -> Iterator[Problem]:
    kind = stream.name.sensor_type
    features = stream.fresh_features(now_ns)
    if features is None:
        service = f"interpreter-{kind.replace('_', '-')}"
        running = service.replace("-", "_") in study.nodes
        cause = f"{service} runs but gives none" if running else f"{service} is not running"
        yield Problem(f"features {stream.key}", f"{who}: {kind} samples arrive, but no features; {cause}", "warning")
        return
    quality = number(features.get("signal_quality"))
    if quality is not None and quality < LOW_QUALITY:
        reasons = "; ".join(str(text) for text in features.get("reasons", ()))
        text = f"{who}: {kind} signal quality is {quality:.2f}" + (f" ({reasons})" if reasons else "")
        yield Problem(f"quality {stream.key}", text, "warning")


def _timing(who: str, stream: Stream, now_ns: int) -> Iterator[Problem]:
    kind = stream.name.sensor_type
    if stream.clock is None or now_ns - stream.clock.at_ns > 2 * FRESH_NS:
        text = f"{who}: no clock model for {kind}; placed by arrival, tens of ms late. Is clock-sync running?"
        yield Problem(f"clock {stream.key}", text, "warning")
    elif stream.clock.plain.get("state") == 2:
        text = f"{who}: {kind} clock in holdover: the link is congested, the last rate is kept"
        yield Problem(f"clock {stream.key}", text, "warning")


def _duplicates(study: Study, now_ns: int) -> Iterator[Problem]:
    """Yield sensors that stream under two names for longer than a move to another one takes."""
    settled = [s.name for s in study.streams.values() if s.online and now_ns - s.since_ns > MOVING_NS]
    online = sorted((name.sensor_type, name.sensor_id, name.human_id) for name in settled)
    for (kind, sensor_id), names in groupby(online, key=lambda name: name[:2]):
        humans = [name[2] for name in names]
        if len(humans) > 1:
            text = f"{sensor_id} ({kind}) streams under {' and '.join(humans)} at once; a sensor_id must be unique"
            yield Problem(f"duplicate {kind} {sensor_id}", text, "error")


def _age_s(stream: Stream, now_ns: int) -> float:
    return (now_ns - stream.since_ns) / SECOND_NS


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
