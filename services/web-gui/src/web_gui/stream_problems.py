"""What is wrong with one sensor and its streams, in sentences. Pure."""

from collections.abc import Iterator

from sense4hri.modalities import MODALITIES
from sense4hri.names import UNASSIGNED
from sense4hri.stamps import SECOND_NS

from web_gui.model import Study
from web_gui.problem_log import Problem
from web_gui.readings import number
from web_gui.rules import RULES
from web_gui.stream import Stream

SETTLE_S = 10.0  # a new stream may take this long before anything is missing
LOW_QUALITY = 0.5
INTERPRETED = tuple(name for name, entry in MODALITIES.items() if entry.message and not entry.helper)


def of_sensor(study: Study, human_id: str, sensor_id: str, streams: list[Stream], now_ns: int) -> Iterator[Problem]:
    """Yield what is wrong with a sensor; where all its streams are dead, one sentence and nothing else of it."""
    who = f"{human_id} / {sensor_id}"
    if human_id == UNASSIGNED and any(stream.online for stream in streams):
        text = f"{sensor_id} is worn by nobody: assign it to a participant"
        yield Problem(f"unassigned {sensor_id}", text, "warning", stream=streams[0].key)
    for stream in streams:
        if stream.info is not None and stream.info.problem:
            text = f"{who}: {stream.name.sensor_type}: {stream.info.problem}"
            yield Problem(f"unusable {stream.key}", text, "error", stream=stream.key)
    dead = [stream for stream in streams if (stream.has_raw or stream.health) and _silence(stream, now_ns)]
    if dead and len(dead) == len([stream for stream in streams if stream.has_raw or stream.health]):
        alert = max((_silence(stream, now_ns) for stream in dead), key=lambda name: RULES[name].severity == "error")
        yield Problem.of(alert, f"lost {who}", f"{who}: {_why_dead(dead, now_ns)}", dead[0].key)
        return
    for stream in dead:
        text = f"{who}: {stream.name.sensor_type} is silent; {_why_dead([stream], now_ns)}"
        yield Problem.of(_silence(stream, now_ns), f"silent {stream.key}", text, stream.key)
    yield from _worn(who, streams, now_ns)
    for stream in streams:
        if stream not in dead and stream.raw_at_ns:
            yield from _of_stream(study, who, stream, now_ns)


def _silence(stream: Stream, now_ns: int) -> str:
    """Return the rule that a stream without samples breaks, empty where it streams or has only just begun."""
    status = stream.status(now_ns)
    if status in ("lost", "silent"):
        return "StreamSilent"
    if status not in ("connecting", "starting"):
        return ""
    again = stream.raw_at_ns or (stream.health and int(stream.health.plain.get("reconnects_total", 0)) > 0)
    return "StreamSilent" if again and status == "connecting" else "SensorNotFound"


def _why_dead(streams: list[Stream], now_ns: int) -> str:
    stream = min(streams, key=lambda s: s.silence_s(now_ns))
    statuses = {s.status(now_ns) for s in streams}
    since = f"no data for {_duration(stream.silence_s(now_ns))}"
    if not any(s.raw_at_ns for s in streams):
        since = f"no data yet, {_duration(stream.silence_s(now_ns))} after it appeared; is it on, worn and near?"
    health = stream.fresh_health(now_ns)
    if health is None:
        silent = "its driver has left the graph" if not stream.online else "its driver says nothing"
        return f"{since}; {silent}. It comes back by itself when the driver does"
    reasons = "; ".join(str(text) for text in health.get("reasons", ()))
    doing = "connecting" if statuses & {"connecting", "starting"} else "reconnecting"
    if statuses == {"silent"}:
        doing = "the driver is connected but receives no samples"
    times = int(health.get("reconnects_total", 0))
    again = f", {times} reconnection{'s' * (times != 1)} so far" if times > 0 else ""
    return f"{since}, {doing}{again}" + (f" ({reasons})" if reasons else "")


def _worn(who: str, streams: list[Stream], now_ns: int) -> Iterator[Problem]:
    """Yield what the sensor's wearer, or whoever walks to them, can mend; and what its link has lost."""
    for name, text in (
        ("BatteryLow", "battery at {:.0f} %, charge it soon"),
        ("ContactLost", "no skin contact; moisten the electrodes or tighten the strap"),
    ):
        values = [value for stream in streams if (value := condition(name, stream, now_ns)) is not None]
        if values and RULES[name].broken(min(values)):
            yield Problem.of(name, f"{name} {who}", f"{who}: {text.format(100 * min(values))}", streams[0].key)
    losses = [(s, lost) for s in streams if RULES["SamplesLost"].broken(lost := s.lost.lately(now_ns))]
    if losses:
        told = " and ".join(f"{lost:.0f} {s.name.sensor_type}" for s, lost in losses)
        text = f"{who}: lost {told} samples within the last minute"
        yield Problem.of("SamplesLost", f"losing {who}", text, losses[0][0].key)


def condition(rule: str, stream: Stream, now_ns: int) -> float | None:
    """Return the value of a stream that BatteryLow, ContactLost or RateLow judges; None where it is not known."""
    if (told := stream.fresh_health(now_ns)) is None:
        return None
    if rule == "BatteryLow":
        percent = number(told.get("battery_percent"))
        return None if percent is None else percent / 100
    if rule == "ContactLost":
        return number(told.get("contact"))
    measured_hz, nominal_hz = number(told.get("measured_rate_hz")), number(told.get("nominal_rate_hz"))
    return measured_hz / nominal_hz if measured_hz is not None and nominal_hz else None


def _of_stream(study: Study, who: str, stream: Stream, now_ns: int) -> Iterator[Problem]:
    kind = stream.name.sensor_type
    ratio = condition("RateLow", stream, now_ns)
    if ratio is not None and RULES["RateLow"].broken(ratio) and stream.status(now_ns) == "streaming":
        yield Problem.of(
            "RateLow", f"rate {stream.key}", f"{who}: {kind} comes at {100 * ratio:.0f} % of its rate", stream.key
        )
    settled = stream.age_ns(stream.since_ns, now_ns) / SECOND_NS > SETTLE_S
    if settled and (kind in INTERPRETED or stream.features):
        yield from _interpretation(study, who, stream, now_ns)
    if stream.history and stream.history.device_time:
        yield from _timing(who, stream, settled, now_ns)


def _interpretation(study: Study, who: str, stream: Stream, now_ns: int) -> Iterator[Problem]:
    kind = stream.name.sensor_type
    features = stream.fresh_features(now_ns)
    if features is None:
        service = f"interpreter-{kind.replace('_', '-')}"
        running = service.replace("-", "_") in study.services.nodes
        cause = f"{service} runs but gives none" if running else f"{service} is not running"
        text = f"{who}: {kind} samples arrive, but no features; {cause}"
        yield Problem(f"features {stream.key}", text, "warning", stream=stream.key)
        return
    quality = number(features.get("signal_quality"))
    if quality is not None and quality < LOW_QUALITY:
        reasons = "; ".join(str(text) for text in features.get("reasons", ()))
        text = f"{who}: {kind} signal quality is {quality:.2f}" + (f" ({reasons})" if reasons else "")
        yield Problem(f"quality {stream.key}", text, "warning", stream=stream.key)


def _timing(who: str, stream: Stream, settled: bool, now_ns: int) -> Iterator[Problem]:
    kind, clock = stream.name.sensor_type, stream.fresh_clock(now_ns)
    if clock is None:
        if settled:
            placed = "placed by arrival, tens of ms late" if stream.clock is None else "placed by the last one"
            text = f"{who}: no clock model for {kind}; {placed}. Is clock-sync running?"
            yield Problem(f"clock {stream.key}", text, "warning", stream=stream.key)
        return
    state = number(clock.get("state"))
    if RULES["ClockUnlocked"].broken(state):
        text = f"{who}: {kind} clock in holdover: the link is congested, the last rate is kept"
        yield Problem.of("ClockUnlocked", f"clock {stream.key}", text, stream.key)
    if RULES["ClockNotFound"].broken(state):
        text = f"{who}: {kind} clock is not locked yet; its times are uncertain until it is"
        yield Problem.of("ClockNotFound", f"clock warm-up {stream.key}", text, stream.key)
    late_s = number(clock.get("latency_s"))
    if RULES["LinkBehind"].broken(late_s):
        text = f"{who}: {kind} is {late_s:.1f} s late: its link holds the data back"
        yield Problem.of("LinkBehind", f"behind {stream.key}", text, stream.key)


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
